"""Counts in sentences."""

from __future__ import annotations

from calib_core.phrasing import counted, joined


def test_one_is_said_as_one() -> None:
    """Mutations: an s in any case; none at all; no separator of thousands."""
    assert [counted(n, "more plane") for n in (0, 1, 2, 1200)] == [
        "0 more planes", "1 more plane", "2 more planes", "1,200 more planes",
    ]  # fmt: skip
    assert counted(1, "scan was", "scans were") == "1 scan was"
    assert counted(3, "scan was", "scans were") == "3 scans were"


def test_words_are_listed_as_people_do() -> None:
    """Mutations: one word joined with nothing; a comma before the last; the last word's own `or` passed over."""
    assert joined(["x"]) == "x"
    assert joined(["x", "y"]) == "x and y"
    assert joined(["x", "y", "z"], "or") == "x, y or z"
