"""Write what the program is made of, as CycloneDX 1.6 JSON: every pinned distribution, its hashes and its licence.

Called by `make sbom`. All of it is read from requirements.txt and from what is installed; no network is asked.
"""

import json
import re
import sys
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def pinned(text: str) -> list[dict[str, object]]:
    """The components of a lock file."""
    found = []
    for line in text.replace("\\\n", " ").splitlines():
        match = re.match(r"([\w.-]+)==([\w.]+)", line)
        if match is None:
            continue
        name, version = match[1].lower(), match[2]
        found.append(
            {
                "type": "library",
                "bom-ref": f"pkg:pypi/{name}@{version}",
                "name": name,
                "version": version,
                "purl": f"pkg:pypi/{name}@{version}",
                "hashes": [
                    {"alg": "SHA-256", "content": digest} for digest in re.findall(r"sha256:([0-9a-f]{64})", line)
                ],
                **licence_of(name),
            }
        )
    return found


def licence_of(name: str) -> dict[str, object]:
    """The licence that the installed distribution states; nothing where it states none or is not installed here."""
    try:
        told = metadata(name)
    except PackageNotFoundError:
        return {}
    expression = told.get("License-Expression")
    if expression:
        return {"licenses": [{"expression": expression}]}
    classifiers = [
        text.rpartition(" :: ")[2] for text in told.get_all("Classifier", []) if text.startswith("License ::")
    ]
    stated = classifiers or [line for line in (told.get("License") or "").splitlines()[:1] if line]
    return {"licenses": [{"license": {"name": text}} for text in stated]} if stated else {}


def document() -> dict[str, object]:
    """The whole document."""
    version = re.search(r'__version__ = "([^"]+)"', (ROOT / "calib_core" / "__init__.py").read_text(encoding="utf-8"))
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": {"type": "application", "name": "unsweep", "version": version[1] if version else ""}},
        "components": pinned((ROOT / "requirements.txt").read_text(encoding="utf-8")),
    }


if __name__ == "__main__":
    sys.stdout.write(json.dumps(document(), indent=1) + "\n")
