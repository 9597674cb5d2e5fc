"""How a forecast is held against a solve, on rows made by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.forecast import Row, read_rows, table, write_rows

KNOWN = Row("paper-normal", "rx", 0.0036, 0.0034, False, False, "calibrated", "", 6.0, 14.0)
WEAK = Row("one-axis", "tz", 9.1, 9.2, True, True, "weak", "", 6.0, 14.0)
REFUSED = Row("static", "rx", np.nan, np.nan, True, True, "refused", "the lidar stood still", 3.0, 4.0)


@pytest.mark.parametrize(
    ("row", "holds"),
    [
        (KNOWN, True),
        (replace(KNOWN, forecast=0.0034 * 1.49), True),
        (replace(KNOWN, forecast=0.0034 * 1.51), False),
        (replace(KNOWN, forecast=0.0034 / 1.51), False),
        (WEAK, True),
        (replace(WEAK, forecast=50.0), True),
        (replace(WEAK, forecast_weak=False), False),
        (replace(KNOWN, forecast_weak=True), False),
        (REFUSED, True),
        (replace(REFUSED, forecast=0.1, forecast_weak=False), False),
        (replace(KNOWN, forecast=np.nan, forecast_weak=True), False),
    ],
)
def test_what_was_promised_is_what_is_judged(row: Row, holds: bool) -> None:
    """Mutation: judge one side of the factor only, or let a forecast without numbers pass beside a solve that has some."""
    assert row.holds is holds


def test_rows_come_back_in_the_scenarios_order(tmp_path: Path) -> None:
    """Mutation: read a flag as text (every "False" would be true)."""
    path = tmp_path / "rows.csv"
    write_rows([REFUSED, WEAK, KNOWN], path)
    back = read_rows(path)
    assert back[:2] == [KNOWN, WEAK]
    assert (back[2].said, np.isnan(back[2].solve), back[2].forecast_weak) == ("the lidar stood still", True, True)


def test_the_table_says_what_fails() -> None:
    """Mutation: count rows that do not hold as holding, or show millimetres as metres."""
    text = table([KNOWN, replace(KNOWN, parameter="tx", forecast=0.002, solve=0.001), WEAK, REFUSED])
    assert "3 of 4 parameters of 3 scenarios hold." in text
    assert "| paper-normal | tx | 2 mm | 1 mm | 2.00 |  |  | **no** |" in text
    assert "| one-axis | tz | 9100 mm | 9200 mm |  | weak | weak | yes |" in text
    assert "the lidar stood still" in text
