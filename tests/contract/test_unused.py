"""Nothing stands in the sources that nobody calls, and no thread pool is made where work is done over and over."""

from __future__ import annotations

import ast
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("calib_core", "app", "bench", "tools")
#: What is called by other names than its own, or by tests alone, and why.
ALLOWED = {
    "down_revision": "Alembic's own name",
    "budget": "tests ask what was counted of a whole solve",
    "is_there": "tests ask which parts of a budget there are",
    "disk_bytes": "a column of bench/results",
    "status_from_truth": "a column of bench/results",
    "SOURCES": "what a reason begins with, held by a test",
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


@dataclass(frozen=True)
class Uses:
    """How often each name is used. read: as a value by itself.   asked: of something else, as `something.name`."""

    read: Counter[str]
    asked: Counter[str]

    @staticmethod
    def of(source: str) -> Uses:
        """In one file. What is said of a name uses it not: docstrings, comments and sentences do not count, nor where it is set.

        A whole string may be a name: what `getattr`, a pattern, a `cast` or another process is told.
        """
        read, asked = Counter[str](), Counter[str]()
        for node in ast.walk(ast.parse(source)):
            match node:
                case ast.Name(id=name, ctx=ast.Load()):
                    read[name] += 1
                case ast.Attribute(attr=name, ctx=ast.Load()):
                    asked[name] += 1
                case ast.MatchClass(kwd_attrs=names):
                    asked.update(names)
                case ast.Constant(value=str(text)) if re.fullmatch(r"[\w.:]+|\w+\[.*\]", text):
                    asked.update(re.findall(r"\w+", text))
        return Uses(read, asked)


def unused(files: dict[str, str], templates: str = "") -> list[str]:
    """Functions, classes and constants at the top of a file, fields of a record, and methods of a class that is no other's kind,
    that nobody uses.

    What a decorator hands to a framework is used by it, and so is what a class has from another. templates: of pages, which ask
    for fields of their records.
    """
    uses = [Uses.of(source) for source in files.values()]
    asked = sum((each.asked for each in uses), Counter(re.findall(r"\.(\w+)", templates)))
    read = sum((each.read for each in uses), asked.copy())
    return [
        f"{path}: {name}"
        for path, source in files.items()
        for node in ast.parse(source).body
        for names, used in ((made_by(node), read), (made_within(node), asked))
        for name in names
        if name not in ALLOWED and not name.startswith("__") and not used[name]
    ]


def made_by(node: ast.stmt) -> list[str]:
    """The names that a statement at the top of a file makes, and that somebody should want."""
    if isinstance(node, ast.Assign | ast.AnnAssign):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        return [name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)]
    if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return []
    return [node.name] if not node.decorator_list or _is_record(node) else []


def made_within(node: ast.stmt) -> list[str]:
    """A record's fields and a class's methods and properties, by name."""
    if not isinstance(node, ast.ClassDef):
        return []
    fields = [each.target for each in node.body if isinstance(each, ast.AnnAssign)] if _is_record(node) else []
    methods = [each for each in node.body if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef)]
    plain = {"property", "staticmethod", "classmethod"}
    return [
        *(field.id for field in fields if isinstance(field, ast.Name)),
        *(each.name for each in methods if not node.bases and {ast.unparse(d) for d in each.decorator_list} <= plain),
    ]


def _is_record(node: ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) -> bool:
    return isinstance(node, ast.ClassDef) and any("dataclass" in ast.unparse(each) for each in node.decorator_list)


def test_every_function_is_called_somewhere() -> None:
    """By its name, tests not counted. Mutations: `def rebinned(): ...` in a stage; a function kept when its caller went."""
    files = {path: source for package in PACKAGES for path, source in sources(package).items()}
    templates = " ".join(path.read_text(encoding="utf-8") for path in sorted((ROOT / "app").rglob("*.jinja")))
    assert unused(files, templates) == []


def test_a_function_that_nobody_calls_is_seen() -> None:
    """Mutations: look at classes only; take a use in another file for none; constants, fields or methods are not looked at; taken
    for used is a field that is given by name, or described in its record, or that has a variable's name; templates ask nothing.
    """
    a = "def one(): ...\nclass Two: ...\n@route\ndef three(): ...\nFOUR, FIVE = 4, 5\nSIX: int = FIVE\n"
    record = '@dataclass(frozen=True)\nclass Seven:\n    """eight: of seven."""\n    eight: int\n    nine: int\n    ten: int\n'
    method = "    def eleven(self): ...\n    @property\n    def twelve(self): ...\n"
    used = "from a import Two\nnine = Two()\nSeven(nine=nine).ten.twelve = 'one of them'\n"
    files = {
        "a.py": a,
        "b.py": used,
        "c.py": record + method,
        "d.py": "class Kind(Base):\n    def told(self): ...\nKind()\n",
    }
    never = ["a.py: one", "a.py: FOUR", "a.py: SIX", "c.py: eight", "c.py: nine", "c.py: eleven", "c.py: twelve"]
    assert unused(files) == never
    more = "getattr(x, 'eight'), x.nine\nmatch x:\n    case Seven(twelve=y): ...\n"
    assert unused({**files, "e.py": more}, "{{ page.eleven }} one") == never[:3]


def test_pools_are_made_once_a_process_or_once_a_recording() -> None:
    """Starting threads for every step of a solve costs more than the steps. Mutation: `with ThreadPoolExecutor(4)` in joint/."""
    found = {path for path, source in sources("calib_core").items() if re.search(r"\w*PoolExecutor\(", source)}
    assert found == POOLS
