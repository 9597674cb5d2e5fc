"""The tables of docs/security.md: each promise and each finding has what holds it, and every figure what it was measured with."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOUND = 15


PAGE = ROOT / "docs" / "security.md"


def table() -> list[str]:
    """The rows of the table."""
    page = PAGE.read_text(encoding="utf-8")
    rows = page.partition("| found | mended by | reproduced by |\n| --- | --- | --- |\n")[2]
    return [line for line in rows.splitlines() if line.startswith("| ")]


def test_every_finding_has_a_test_that_reproduces_it() -> None:
    """Oracle: the tests' own sources. Mutations: a test renamed; one that says nothing of how it fails; a row left out."""
    rows = table()
    assert len(rows) == FOUND
    for row in rows:
        named = re.findall(r"`(tests/[\w/]+\.py)::(test_\w+)`", row)
        assert named, row
        for path, name in named:
            tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
            found = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
            assert name in found, f"{path}::{name}"
            told = ast.get_docstring(found[name]) or ""
            assert re.search(r"Mutation|Fails|Oracle", told), f"{path}::{name}"
            assert any(isinstance(node, (ast.Assert, ast.With)) for node in ast.walk(found[name])), f"{path}::{name}"


def promises() -> list[list[str]]:
    """The cells of every row of the tables that begin with a promise."""
    found, within = [], False
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        within = line.startswith("| promise |") or (within and line.startswith("|"))
        if within and not line.startswith(("| promise |", "| ---")):
            found.append([cell.strip() for cell in line.strip("|").split(" | ")])
    return found


def test_every_promise_is_held_by_a_test_or_a_measurement_that_is_there() -> None:
    """Mutations: a row without one; a test's file moved; a script renamed."""
    rows = promises()
    assert len(rows) > 40
    for row in rows:
        text = " ".join(row[1:])
        files = re.findall(r"`(tests/[\w/]+\.py)`", text)
        files += [f"{name.replace('.', '/')}.py" for name in re.findall(r"`python -m (bench\.\w+)[^`]*`", text)]
        assert files, row[0]
        assert [name for name in files if not (ROOT / name).is_file()] == [], row[0]
