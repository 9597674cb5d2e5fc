"""What a document has of the sensors themselves: its sentences, as the estimator worded and ordered them, for screens that have
room for a few, and its parameters kind by kind.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from calib_core.intrinsics import STANDARD_GRAVITY_M_S2, UNITS
from calib_core.result import CalibrationResult, Intrinsic
from calib_core.sigmas import decimals, two_digits

#: What begins the code of each, and what it costs not to know which sensors there are: the one that asks for something.
_SENSOR, _COST = "sensor.", "sensor.priors"


def biggest_of_sensors(result: CalibrationResult, most: int) -> tuple[list[str], int]:
    """The first so many of what was found and what was counted, and what it costs after them; and how many more there are.

    Warnings are no part of it: they are told as such.
    """
    said = [message for message in result.messages if message.code.startswith(_SENSOR) and message.level == "info"]
    found = [message.text for message in said if message.code != _COST]
    cost = [message.text for message in said if message.code == _COST]
    return [*found[:most], *cost], max(0, len(found) - most)


#: In which units people read a parameter's, and how many of them are one of the document's.
_READABLE: Mapping[str, tuple[float, str]] = {
    "1": (1e2, "%"),
    "rad": (math.degrees(1.0), "deg"),
    "m": (1e3, "mm"),
    "s": (1e3, "ms"),
    "s2": (1e6, "ms²"),
    "s3": (1e9, "ms³"),
    UNITS["g_sensitivity"]: (math.degrees(STANDARD_GRAVITY_M_S2), "deg/s per g"),
    UNITS["accelerometer_quadratic"]: (1e3 * STANDARD_GRAVITY_M_S2, "mg at one g"),
}


@dataclass(frozen=True, slots=True)
class KindRow:
    """One kind of parameter, as a table has it.

    largest: the one that is farthest from zero in its own sigmas, with its sigma; of considered ones what they would be.
    before: one sigma of what was expected.   beyond: how many are more than three sigmas from zero.
    """

    kind: str
    count: int
    state: str
    largest: str
    before: str
    beyond: int


def kinds_of(result: CalibrationResult) -> list[KindRow]:
    """The parameters of a document kind by kind, in its order; none where the sensors were taken for ideal."""
    kinds: dict[tuple[str, str], list[Intrinsic]] = {}
    for each in result.intrinsics or ():
        kinds.setdefault((each.block, each.state), []).append(each)
    return [_kind_row(some) for some in kinds.values()]


def _kind_row(some: Sequence[Intrinsic]) -> KindRow:
    first = max(some, key=lambda each: abs(each.value) / each.std if each.std > 0.0 else 0.0)
    times, unit = _READABLE.get(first.unit, (1.0, first.unit))
    kind = first.block.replace("_", " ")
    of = "" if len(some) == 1 else f"{'ring ' if kind.startswith('laser') else ''}{first.name}: "
    value = f"{times * first.value:.{decimals(times * first.std)}f}"
    return KindRow(
        kind,
        len(some),
        first.state,
        f"{of}{value if float(value) else value.removeprefix('-')} ± {two_digits(times * first.std)} {unit}",
        f"{two_digits(times * max(each.prior_std for each in some))} {unit}",
        sum(each.significant for each in some),
    )
