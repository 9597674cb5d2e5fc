"""Standard deviations as people read them, worded in one place for the terminal, the report and every sentence.

Degrees, millimetres and milliseconds to two digits, in a table as in a sentence; the page's `ui/format.ts` has the same rule.
What is known to no better than a metre or a second is said in these:
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
#: Decimals of what was held, whose sigma says nothing of it.
_HELD_DIGITS: dict[Unit, int] = {"deg": 3, "m": 1, "s": 3}
#: What a large sigma is said in, and what a usual one.
_SMALLER: dict[Unit, tuple[float, str]] = {"deg": (1.0, "deg"), "m": (1e3, "mm"), "s": (1e3, "ms")}


def two_digits(value: float) -> str:
    """With its last zero: 0.020 and not 0.02."""
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


def std_cell(std: float, unit: Unit, *, named: bool = False) -> str:
    """The same as a cell of a table in deg, mm or ms: with its unit if that is another, or if `named`."""
    if named or tells_nothing(std, unit):
        return std_text(std, unit)
    return two_digits(_SMALLER[unit][0] * std)


def std_row(stds: Sequence[float | None], unit: Unit) -> tuple[list[str], str]:
    """Cells of one row, and the unit at its end: none where a cell has another one, each has its own then. None: held."""
    plain = [HELD if std is None else std_cell(std, unit) for std in stds]
    named = [HELD if std is None else std_cell(std, unit, named=True) for std in stds]
    return _unit_once(plain, named, unit) if any(std is not None for std in stds) else (plain, "")


def value_text(value: float, std: float | None, unit: Unit) -> tuple[str, str]:
    """A value to the digits that its sigma tells something of, and the unit that both are in. std: None where it was held."""
    if not std:
        return f"{_SMALLER[unit][0] * value:.{_HELD_DIGITS[unit]}f}", _SMALLER[unit][1]
    scale, name = scale_of(std, unit)
    text = f"{scale * value:.{decimals(scale * std)}f}"
    return (text if float(text) else text.removeprefix("-")), name


def value_row(values: Sequence[float], stds: Sequence[float | None], unit: Unit) -> tuple[list[str], str]:
    """The cells above those of `std_row`, in the same units."""
    told = [value_text(value, std, unit) for value, std in zip(values, stds, strict=True)]
    return _unit_once([text for text, _ in told], [f"{text} {name}" for text, name in told], unit)


def _unit_once(plain: list[str], named: list[str], unit: Unit) -> tuple[list[str], str]:
    """A row's cells without a unit, and that at its end, where it is the usual one of all of them; with their units otherwise."""
    usual = _SMALLER[unit][1]
    if all(one == HELD or other == f"{one} {usual}" for one, other in zip(plain, named, strict=True)):
        return plain, usual
    return named, ""
