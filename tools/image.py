"""Build the image and run it as docker/compose.yaml says: `python -m tools.image [--root DEBIAN] [--work FOLDER]`.

With a Docker engine at hand, `docker build` makes it. Without one, and with --root, docker/Dockerfile's own steps are run one by
one in copies of an unpacked Debian root (as root: overlay mounts, chroot), which stands in for the base image:

    debootstrap --variant=minbase --include=python3,python3-venv,python3-pip,python-is-python3,ca-certificates bookworm DEBIAN

Either way the service is then started as the image's user, its root read-only, in a network of its own, and asked: is it well
by its own health check, does it refuse who has no token, is the client in it, can it write nowhere but its data, does it read
and solve a recording (image_questions.py). Which of the two ways it was is said first. What a root cannot show: bounds of memory
and processes.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from tools.image_questions import asked_of_container, asked_of_root
from tools.image_steps import ROOT, Roots, call, steps


def engine() -> bool:
    """Whether a Docker engine answers."""
    if shutil.which("docker") is None:
        return False
    return subprocess.run(["docker", "info"], check=False, capture_output=True).returncode == 0


def built(root: Path | None, work: Path) -> Iterator[str]:
    """Lines: which way it was, and what the service said."""
    if engine():
        call("docker", "build", "-f", ROOT / "docker" / "Dockerfile", "-t", "unsweep", ROOT)
        yield "built by a Docker engine"
        yield json.dumps(asked_of_container("unsweep-image-check"))
        return
    if root is None:
        raise SystemExit("No Docker engine answers, and no unpacked Debian root was given by --root.")
    stage = Roots(root, work).build(steps((ROOT / "docker" / "Dockerfile").read_text(encoding="utf-8")))
    release = re.search(r'PRETTY_NAME="([^"]+)"', (root / "etc" / "os-release").read_text(encoding="utf-8"))
    yield f"built by its steps in an unpacked root of {release[1] if release else 'unknown origin'}; no Docker engine is at hand"
    yield json.dumps(asked_of_root(stage))


def main() -> int:
    """The command line. Without an engine, mounts are those of a namespace: they end with it, before the folder is removed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, help="an unpacked Debian")
    parser.add_argument(
        "--work", type=Path, help="where to make a folder of a few GB; by default where temporary files are"
    )
    parser.add_argument("--within", type=Path, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.within is None:
        within = Path(tempfile.mkdtemp(prefix="unsweep-image-", dir=chosen.work))
        apart = [] if engine() else ["unshare", "--mount", "--pid", "--fork", "--kill-child"]
        try:
            again = [*apart, sys.executable, "-m", "tools.image", *sys.argv[1:], f"--within={within}"]
            return subprocess.run(again, check=False).returncode
        finally:
            shutil.rmtree(within, ignore_errors=True)
    for line in built(chosen.root, chosen.within):
        sys.stdout.write(line + "\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
