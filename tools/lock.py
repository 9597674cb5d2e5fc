"""Write requirements*.txt: one version of everything for every Python and platform, with the hashes of all its files.

Called by `make lock` with the path of uv. The files hold no address of any package index, so they serve behind
any mirror; the hashes make sure that what a mirror hands out is what was locked.
"""

import subprocess
import sys
from pathlib import Path

COMPILE = ["pip", "compile", "--quiet", "--universal", "--python-version", "3.11", "--fork-strategy", "fewest"]
CONTENT = ["--generate-hashes", "--no-emit-index-url", "--no-emit-find-links", "--custom-compile-command", "make lock"]


def compile_lock(uv: str, output: str, *arguments: str) -> None:
    """Resolve anew and write `output`."""
    Path(output).unlink(missing_ok=True)  # uv would otherwise keep the versions it finds in there
    subprocess.run([uv, *COMPILE, *CONTENT, *arguments, "--output-file", output], check=True)


def main(uv: str) -> None:
    """Write the four lock files; the later ones agree with the first wherever they share a package."""
    agreed = ["--constraint", "requirements.txt"]
    compile_lock(uv, "requirements.txt", "pyproject.toml")
    compile_lock(uv, "requirements-fleet.txt", "pyproject.toml", "--extra", "fleet", *agreed)
    compile_lock(uv, "requirements-build.txt", "--group", "build", *agreed)
    compile_lock(uv, "requirements-test.txt", "--group", "test", *agreed, "--constraint", "requirements-fleet.txt")


if __name__ == "__main__":
    main(sys.argv[1])
