"""Units in what persons read are typeset alike, whichever screen, terminal or page shows it: m/s² and √Hz."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

#: As a keyboard has them.
PLAIN = re.compile(r"\b(?:m|rad|deg)/s2\b|sqrt\(Hz\)")
#: Fields of documents that programs read, and what puts older documents right.
DATA = {
    "calib_core/intrinsics.py",
    "calib_core/simulate/faults/names.py",
    "calib_core/simulate/faults/named.py",
    "app/results/report.py",
}


def words(path: Path) -> Iterator[str]:
    """The strings of a source, docstrings left out."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    prose = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in prose:
            yield node.value


@pytest.mark.parametrize("package", ["calib_core", "app"])
def test_units_are_typeset_alike(package: str) -> None:
    """Mutation: a sentence with m/s2 or rad/s/sqrt(Hz) in it, as the noise of a solve was told."""
    found = [
        f"{path.relative_to(ROOT)}: {text}"
        for path in sorted((ROOT / package).rglob("*.py"))
        if str(path.relative_to(ROOT)) not in DATA
        for text in words(path)
        if PLAIN.search(text)
    ]
    assert found == []
