"""Look up known vulnerabilities of the pinned versions: `python tools/audit.py ENVIRONMENT PIP_AUDIT_VERSION FILE...`.

Called by `make audit`, with an environment of its own for pip-audit, which asks the package index for its advisories. Exit 0:
none is known, or nothing could be asked, as on a machine without a network; the sentence says which. Exit 1: some are known.
Exit 2: it went wrong for another reason.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

#: An index that does not answer is given up on; together they are well below what the tests take.
INSTALL_S, AUDIT_S = 120.0, 180.0
#: What pip and pip-audit say where the network is not there, by whichever way they find out.
NO_NETWORK = re.compile(
    r"Max retries|NewConnectionError|ConnectionError|ConnectTimeout|ReadTimeout|timed out|ProxyError|name resolution"
    r"|Name or service not known|Connection refused|Network is unreachable|from versions: none|Failed to connect",
    re.IGNORECASE,
)


def called(words: Sequence[str], *, limit_s: float) -> tuple[int, str, str]:
    """Its exit code and what it wrote, on either stream; beyond the limit it is ended, and has timed out."""
    try:
        done = subprocess.run(words, check=False, capture_output=True, text=True, timeout=limit_s)
    except subprocess.TimeoutExpired:
        return 1, "", f"timed out after {limit_s:.0f} s"
    return done.returncode, done.stdout, done.stderr


def verdict(code: int, out: str, err: str) -> tuple[int, str]:
    """The exit code and the sentences, of what pip-audit left behind."""
    try:
        parts = json.loads(out)["dependencies"]
    except (ValueError, KeyError, TypeError):
        return not_asked("the package index does not answer", err) if code else (2, f"pip-audit said nothing: {err}")
    found = [(part, flaw) for part in parts for flaw in part.get("vulns", [])]
    unknown = [part["name"] for part in parts if "skip_reason" in part]
    lines = [
        f"{part['name']} {part['version']}: {flaw['id']}, mended in {', '.join(flaw['fix_versions']) or 'no version yet'}"
        for part, flaw in found
    ]
    lines += [f"{name}: the package index does not know it" for name in unknown]
    if parts and len(unknown) == len(parts):  # a mirror that has the packages, and nothing else of the index
        return 0, "The pinned versions were not audited: the package index that is asked from here has no advisories."
    told = f"{len(found)} known vulnerabilities" if found else "No known vulnerability"
    return (1 if found else 0), "\n".join([*lines, f"{told} in {len(parts) - len(unknown)} pinned versions."])


def not_asked(why: str, err: str) -> tuple[int, str]:
    """No network is no verdict; anything else is a defect of the audit itself."""
    if NO_NETWORK.search(err):
        return 0, f"The pinned versions were not audited: {why} from here."
    return 2, f"The pinned versions could not be audited: {err.strip()[-2000:]}"


def audit(environment: Path, version: str, files: Sequence[str]) -> tuple[int, str]:
    """All of it."""
    python = environment / "bin" / "python"
    install = [str(python), "-m", "pip", "--disable-pip-version-check", "--timeout", "10", "--retries", "1", "--quiet"]
    steps = [[sys.executable, "-m", "venv", str(environment)], [*install, "install", f"pip-audit=={version}"]]
    for words in steps:
        code, _, err = called(words, limit_s=INSTALL_S)
        if code != 0:
            return not_asked("pip-audit cannot be had", err)
    words = [str(environment / "bin" / "pip-audit"), "--require-hashes", "--disable-pip", "--progress-spinner=off"]
    words += ["--format=json", *(word for file in files for word in ("-r", file))]
    return verdict(*called(words, limit_s=AUDIT_S))


if __name__ == "__main__":
    exit_code, sentences = audit(Path(sys.argv[1]), sys.argv[2], sys.argv[3:])
    sys.stdout.write(sentences + "\n")
    raise SystemExit(exit_code)
