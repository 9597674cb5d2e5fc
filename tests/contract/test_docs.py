"""The pages say what the code is: the table of numbers, the files they name, the codes of refusals."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tools.steering import PAGE, RECORDS, numbers, with_table

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("docs/how-it-works.md", "docs/architecture.md", "docs/security.md", "calib_core/CONVENTIONS.md")
#: Where a page's bare file names may be.
FOLDERS = ("", "calib_core", "calib_core/full", *(f"calib_core/full/{room}" for room in (
    "prepare", "planes", "odometry", "initialise", "joint", "assess"
)), "bench/results", "docs")  # fmt: skip


def test_the_table_of_numbers_is_that_of_the_records() -> None:
    """Mutations: change a number in a record, or add one, without `python -m tools.steering`."""
    page = PAGE.read_text(encoding="utf-8")
    assert with_table(page) == page


def test_every_number_has_its_reason() -> None:
    """Mutation: a field at the top of a record without a comment."""
    found = list(numbers())
    assert {(n.stage, n.record) for n in found} == {(stage, record) for stage, _, record in RECORDS}
    assert [f"{n.record}.{n.name}" for n in found if not n.reason] == []


@pytest.mark.parametrize("page", PAGES)
def test_every_file_that_a_page_names_is_there(page: str) -> None:
    """Mutation: a file moved, and its name left in the page."""
    text = (ROOT / page).read_text(encoding="utf-8")
    named = set(re.findall(r"`([\w./-]+\.(?:py|md|csv|json))", text)) - {"planes.json"}
    missing = [name for name in sorted(named) if not any((ROOT / folder / name).is_file() for folder in FOLDERS)]
    assert missing == []


def test_the_codes_of_refusals_are_all_on_the_page() -> None:
    """Mutation: a new `Refused("some.code", ...)` that the page does not know."""
    page = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    sources = [path.read_text(encoding="utf-8") for path in (ROOT / "calib_core").rglob("*.py")]
    codes = {code for text in sources for code in re.findall(r'(?:Refused|_refuse)\(\s*"([a-z_]+\.[a-z_]+)"', text)}
    codes |= {code for text in sources for code in re.findall(r'Refused\(\s*"([a-z_]+\.[a-z_]+)"', text)}
    assert len(codes) > 10
    assert [code for code in sorted(codes) if f"`{code}`" not in page] == []
