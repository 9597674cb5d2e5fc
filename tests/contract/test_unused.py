"""Nothing stands in the sources that nobody calls, and no thread pool is made where work is done over and over."""

from __future__ import annotations

import ast
import re
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("calib_core", "app", "bench", "tools")
#: What is called by other names than its own, or by tests alone, and why.
ALLOWED = {
    "__getattr__": "Python's own name",
    "random_room": "rooms that tests draw",
    "status_of": "the tests of interrupted uploads speak to the server as the killer of servers does",
}
#: Files that may make a pool: one for the process, or one for as long as a recording is read, prepared or simulated.
POOLS = {
    "calib_core/threads.py",
    "calib_core/readers/load.py",
    "calib_core/readers/reading.py",
    "calib_core/full/prepare/prepare.py",
    "calib_core/simulate/generate.py",
}


def sources(package: str) -> dict[str, str]:
    """Path below the repository -> source."""
    return {
        path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
        for path in sorted((ROOT / package).rglob("*.py"))
    }


def unused(files: dict[str, str]) -> list[str]:
    """Functions, classes and constants at the top of a file, and fields of a record, whose name stands nowhere but where they are
    made.

    What a decorator hands to a framework is used by it.
    """
    words = Counter(word for source in files.values() for word in re.findall(r"\w+", source))
    return [
        f"{path}: {name}"
        for path, source in files.items()
        for node in ast.parse(source).body
        for name in made_by(node)
        if name not in ALLOWED and words[name] == 1
    ]


def made_by(node: ast.stmt) -> list[str]:
    """The names that a statement at the top of a file makes, and that somebody should want."""
    if isinstance(node, ast.Assign | ast.AnnAssign):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        return [name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)]
    if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return []
    if not node.decorator_list:
        return [node.name]
    if isinstance(node, ast.ClassDef) and any("dataclass" in ast.unparse(each) for each in node.decorator_list):
        fields = (each.target for each in node.body if isinstance(each, ast.AnnAssign))
        return [node.name, *(field.id for field in fields if isinstance(field, ast.Name))]
    return []


def test_every_function_is_called_somewhere() -> None:
    """By its name, tests not counted. Mutations: `def rebinned(): ...` in a stage; a function kept when its caller went."""
    files = {path: source for package in PACKAGES for path, source in sources(package).items()}
    assert unused(files) == []


def test_a_function_that_nobody_calls_is_seen() -> None:
    """Mutations: look at classes only; take a use in another file for none; constants, or fields, are not looked at."""
    a = "def one(): ...\nclass Two: ...\n@route\ndef three(): ...\nFOUR, FIVE = 4, 5\nSIX: int = FIVE\n"
    record = "@dataclass(frozen=True)\nclass Seven:\n    eight: int\n    nine: int\n"
    files = {"a.py": a, "b.py": "from a import Two\nSeven(nine=1)\n", "c.py": record}
    assert unused(files) == ["a.py: one", "a.py: FOUR", "a.py: SIX", "c.py: eight"]


def test_pools_are_made_once_a_process_or_once_a_recording() -> None:
    """Starting threads for every step of a solve costs more than the steps. Mutation: `with ThreadPoolExecutor(4)` in joint/."""
    found = {path for path, source in sources("calib_core").items() if re.search(r"\w*PoolExecutor\(", source)}
    assert found == POOLS
