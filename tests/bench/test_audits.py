"""What the bench of audits counts, by hand."""

from __future__ import annotations

from bench.audits import Told, rooms_table, verdicts_table


def test_a_recording_counts_where_both_wrong_ones_are_blurrier() -> None:
    """A motion that fits none of them tells, too. Mutations: either instead of both; no motion taken for blindness."""
    told = [
        Told("a", "rx", 0.01, 9.0),
        Told("a", "tz", 0.001, -4.0),
        Told("b", "ry", None, 9.0),
        Told("b", "tx", -0.001, 9.0),
    ]
    page = "\n".join(rooms_table(told))
    assert "in 1 of 2" in page
    assert "the same of 3 of 4 wrong ones" in page
    assert "| b | 0.5 deg, ry | no motion fits | 9 |" in page
    assert "| a | 20 mm, tz | +0.0010 | 4 |" in page


def test_what_passes_and_what_fails_is_counted_apart() -> None:
    """Mutation: both counted from one column."""
    page = "\n".join(verdicts_table([("rx", True, True), ("dt", True, False)]))
    assert "passes in 2 of 2 recordings" in page
    assert "fails in 1 of 2" in page
