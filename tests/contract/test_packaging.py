"""What a fresh machine installs: everything that is imported, pinned with hashes, from no named place."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from calib_core import __version__

ROOT = Path(__file__).resolve().parents[2]
LOCKS = ("requirements.txt", "requirements-fleet.txt", "requirements-test.txt", "requirements-build.txt")
#: Imported where it is there, with a pinned package for the Pythons that lack it.
NEWER_STANDARD_LIBRARY = {"compression"}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def bare(name: str) -> str:
    return re.split(r"[^\w.-]", name, maxsplit=1)[0].replace("_", "-").replace(".", "-").lower()


def pinned(lock: str) -> dict[str, str]:
    """Each entry of a lock file by its name, continuation lines joined."""
    text = (ROOT / lock).read_text().replace("\\\n", " ")
    return {bare(line): line for line in text.splitlines() if line and line[0] not in "# "}


def imported(folder: str) -> Iterator[tuple[str, Path]]:
    for path in (ROOT / folder).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                yield from ((alias.name.partition(".")[0], path) for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
                yield node.module.partition(".")[0], path


@pytest.mark.parametrize(
    ("folder", "groups"), [("app", ()), ("calib_core", ()), ("bench", ("test",)), ("tests", ("test", "build"))]
)
def test_every_import_is_declared(folder: str, groups: tuple[str, ...]) -> None:
    """Fails when a module imports what only happens to be installed (seen: threadpoolctl taken out of pyproject)."""
    declared = {bare(name) for name in PROJECT["project"]["dependencies"]}
    if folder == "app":  # extras, imported where they are asked for
        declared |= {bare(name) for extra in PROJECT["project"]["optional-dependencies"].values() for name in extra}
    for group in groups:
        declared |= {bare(name) for name in PROJECT["dependency-groups"][group]}
    own = {"app", "calib_core", "bench", "tests", "tools", "hatch_build", "__future__"}
    owners = packages_distributions()
    for module, path in imported(folder):
        if module in sys.stdlib_module_names | NEWER_STANDARD_LIBRARY or module in own:
            continue
        distributions = {bare(name) for name in owners.get(module, [module])}
        allowed = declared | ({"pyyaml"} if folder == "tests" else set())
        assert distributions & allowed, f"{path.relative_to(ROOT)} imports {module}, which pyproject.toml does not name"


@pytest.mark.parametrize("lock", LOCKS)
def test_locks_are_exact_and_from_nowhere(lock: str) -> None:
    """Fails if a version floats, a hash is missing, or an address or a path of some machine is in there."""
    text = (ROOT / lock).read_text()
    assert not re.search(r"https?:|file:|--(extra-)?index|--find-links|--trusted-host|/(home|root|tmp|work|opt)/", text)
    for name, line in pinned(lock).items():
        assert re.match(r"[\w.-]+==[\w.]+( ;|\s+--hash)", line), line[:80]
        assert len(re.findall(r"--hash=sha256:[0-9a-f]{64}", line)) >= 1, name


def test_locks_agree_and_hold_what_is_declared() -> None:
    """Fails if pyproject.toml was changed without `make lock`, or two locks pin different versions of one package."""
    runtime = pinned("requirements.txt")
    assert {bare(name) for name in PROJECT["project"]["dependencies"]} <= set(runtime)
    fleet = pinned("requirements-fleet.txt")
    assert {bare(name) for name in PROJECT["project"]["optional-dependencies"]["fleet"]} | set(runtime) <= set(fleet)
    for group in ("build", "test"):
        entries = pinned(f"requirements-{group}.txt")
        assert {bare(name) for name in PROJECT["dependency-groups"][group]} <= set(entries)
        for name in set(entries) & set(fleet):
            assert entries[name].split()[0] == fleet[name].split()[0]
    assert all(fleet[name].split()[0] == entry.split()[0] for name, entry in runtime.items())


def test_one_open3d_for_each_machine() -> None:
    """Both share one import folder: fails if a machine would get two, or none."""
    runtime = pinned("requirements.txt")
    markers = {
        name: runtime[name].partition(";")[2].partition("--hash")[0].strip() for name in ("open3d", "open3d-cpu")
    }
    assert markers["open3d-cpu"] == "platform_machine == 'x86_64' and sys_platform == 'linux'"
    assert markers["open3d"] == "platform_machine != 'x86_64' or sys_platform != 'linux'"


def test_build_requirements_are_the_pinned_ones() -> None:
    """`make run` builds without isolation: fails if the build system asks for something that the lock lacks."""
    assert {bare(name) for name in PROJECT["build-system"]["requires"]} <= set(pinned("requirements-build.txt"))


def test_version_is_in_the_changelog() -> None:
    """Fails when a version is made without a word about what is new."""
    assert f"## {__version__}" in (ROOT / "CHANGELOG.md").read_text()
