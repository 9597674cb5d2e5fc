"""Standard deviations as people read them, worded in one place for the terminal, the report and every sentence.

Degrees, millimetres and milliseconds to two digits. What is known to no better than a metre or a second is said in these:
9135.06 mm would pretend to tell something. A turn known to no better than half a circle is not known at all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

Unit = Literal["deg", "m", "s"]

NOT_DETERMINED = "not determined"
HELD = "held"
_ALL_ROUND_DEG = 180.0
#: What a large sigma is said in, and what a usual one.
_SMALLER: dict[Unit, tuple[float, str]] = {"deg": (1.0, "deg"), "m": (1e3, "mm"), "s": (1e3, "ms")}


def two_digits(value: float) -> str:
    """With its last zero, as the tables beside a sentence have it: 0.020 and not 0.02."""
    return "0" if value <= 0.0 else f"{value:.{decimals(value)}f}"


def decimals(std: float) -> int:
    """So many show a sigma's second digit; 0 where that stands before the point."""
    # Rounded first: 0.996 has its two digits one place further left than it seems.
    return max(0, 1 - math.floor(math.log10(float(f"{max(std, 1e-9):.1e}"))))


def scale_of(std: float, unit: Unit) -> tuple[float, str]:
    """What a sigma, and the value beside it, is multiplied by, and the name of the unit that it is in then."""
    return (1.0, unit) if std >= 1.0 else _SMALLER[unit]


def tells_nothing(std: float, unit: Unit) -> bool:
    """Whether a sigma is so wide that what it stands beside is as good as unknown: a metre, a second, half a circle."""
    return std >= (_ALL_ROUND_DEG if unit == "deg" else 1.0)


def std_text(std: float, unit: Unit) -> str:
    """A standard deviation in `unit` as a sentence has it: 0.020 deg, 0.86 mm, 9.1 m."""
    if unit == "deg" and tells_nothing(std, unit):
        return NOT_DETERMINED
    scale, name = scale_of(std, unit)
    return f"{two_digits(scale * std)} {name}"


def std_cell(std: float, unit: Unit, digits: int, *, named: bool = False) -> str:
    """The same as a cell of a table in deg, mm or ms with so many decimals; with its unit if that is another, or if `named`."""
    usual, name = _SMALLER[unit]
    if tells_nothing(std, unit):
        return std_text(std, unit)
    return f"{usual * std:.{digits}f}" + (f" {name}" if named else "")


def std_row(stds: Sequence[float | None], unit: Unit, digits: int) -> tuple[list[str], str]:
    """Cells of one row, and the unit at its end: none where a cell has another one, each has its own then. None: held."""
    plain = [HELD if std is None else std_cell(std, unit, digits) for std in stds]
    named = [HELD if std is None else std_cell(std, unit, digits, named=True) for std in stds]
    if any(one == other and one != HELD for one, other in zip(plain, named, strict=True)):
        return named, ""
    return plain, "" if all(std is None for std in stds) else _SMALLER[unit][1]
