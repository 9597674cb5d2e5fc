"""The table of what an attack found: every test that it names is there, and says what it was seen to fail with."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOUND = 15


def table() -> list[str]:
    """The rows of the table."""
    page = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
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
