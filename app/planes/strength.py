"""What is foreseen of the least known axis with the planes that are confirmed.

The doctor's forecast holds for the planes it found. By what its standard deviations grow without some of them is told by the
forecast's own problem (calib_core/full/forecast_by_choice.py): they never shrink where a plane is left out, which a measure of
how evenly directions are spread would. A plane that boxes cut counts by what they leave of its outline. A plane that was grown by
hand was not foreseen, and adds nothing.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Collection, Mapping
from typing import Protocol, TypeVar

import numpy as np

from app.axes import AXIS_NAMES, WEAK_IN
from app.planes.geometry import left_of
from app.planes.state import PlaneSet
from app.planes.upright import Room
from app.schemas.planes import Foreseen
from calib_core import api
from calib_core.doctor.report import Forecast
from calib_core.result import COVARIANCE_ORDER
from calib_core.sigmas import Unit, std_text, tells_nothing
from calib_core.types import FloatArray, Narrowed


class Foresight(Protocol):
    """What an inspection has kept."""

    def growth(self, places: Collection[int], narrowed: Mapping[int, Narrowed]) -> FloatArray:
        """By what the standard deviations of the seven grow with these planes alone, (7,). narrowed: those that were cut."""


#: A report, the planes chosen of it, and what is left of those that were cut.
_Choice = tuple[str, frozenset[int], frozenset[tuple[int, bytes]]]
Key = TypeVar("Key")
Value = TypeVar("Value")

#: Recordings whose problem stays in memory between two clicks, and choices whose answer does.
KEPT_PROBLEMS, KEPT_CHOICES = 2, 200


class Strength:
    """By what a forecast's standard deviations grow with the choice of planes. Thread-safe; remembers what it was asked."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._problems: OrderedDict[str, Foresight | None] = OrderedDict()
        self._growths: OrderedDict[_Choice, FloatArray] = OrderedDict()

    def growth(self, room: Room, mark: str, planes: PlaneSet, suggestion: PlaneSet) -> FloatArray | None:
        """(7,) of the confirmed planes, at least 1; None where it cannot be told.

        mark: another one for each report.   suggestion: what was foreseen.
        """
        cut = _cut(planes, suggestion)
        left, whole = (
            _members(planes) - {member for member, part in cut.items() if not len(part.left)},
            _members(suggestion),
        )
        if left >= whole and not cut:
            return np.ones(len(AXIS_NAMES))
        # A plane that the report does not list adds nothing to what was foreseen.
        chosen = frozenset(room.ranks[member] for member in left if member in room.ranks)
        narrowed = {room.ranks[member]: part for member, part in cut.items() if member in left and member in room.ranks}
        choice = mark, chosen, frozenset((place, part.left.tobytes()) for place, part in narrowed.items())
        with self._lock:
            known = self._growths.get(choice)
            if known is None:
                if mark not in self._problems:
                    kept = None if room.foresight is None else api.foresight(room.foresight)
                    _remember(self._problems, mark, kept, KEPT_PROBLEMS)
                problem = self._problems[mark]
                if problem is None or not room.ranks:
                    return None
                known = problem.growth(chosen, narrowed)
                _remember(self._growths, choice, known, KEPT_CHOICES)
            return known


def _members(planes: PlaneSet) -> set[int]:
    return {member for patch in planes.patches if patch.confirmed for member in patch.members}


def _cut(planes: PlaneSet, suggestion: PlaneSet) -> dict[int, Narrowed]:
    """What boxes leave of the planes as they were found, by member; no corners where that is nothing."""
    found: dict[int, Narrowed] = {}
    for patch in planes.patches:
        sides = (*planes.region, *patch.region)
        for member in patch.members if patch.confirmed and sides else ():
            whole = np.array(suggestion.patches[member].outline_m).reshape(-1, 3)
            left = left_of(whole, sides)
            if left is not None:
                found[member] = Narrowed(whole, left)
    return found


def _remember(known: OrderedDict[Key, Value], key: Key, value: Value, most: int) -> None:
    known[key] = value
    while len(known) > most:
        known.popitem(last=False)


def foreseen(forecast: Forecast | None, growth: FloatArray | None) -> Foreseen | None:
    """The least known axis against its limit; None without a forecast, and where the planes leave a direction open.

    growth: (7,) of the forecast's standard deviations with the confirmed planes, None where it is not known.
    """
    if forecast is None or not forecast.parameters or growth is None or not np.isfinite(growth).all():
        return None
    grown = [
        parameter.model_copy(update={"std": parameter.std * float(growth[COVARIANCE_ORDER.index(parameter.name)])})
        for parameter in forecast.parameters
    ]
    # One that the data alone do not tell comes first: a prior may hide that.
    worst = max(grown, key=lambda parameter: (parameter.weak, parameter.std / WEAK_IN[parameter.unit]))
    limit = WEAK_IN[worst.unit]
    name = AXIS_NAMES[worst.name]
    before = next(parameter.std for parameter in forecast.parameters if parameter.name == worst.name)
    by_motion = worst.weak or before > limit
    weak = by_motion or worst.std > limit
    text = _what_to_do(_stays(name, worst.std, worst.unit, limit), worst.advice, by_motion=by_motion) if weak else ""
    return Foreseen(name=name, std=worst.std, unit=worst.unit, limit=limit, weak=weak, text=text)


def _stays(name: str, std: float, unit: Unit, limit: float) -> str:
    """What would be left of an axis. One within its limit has that from its prior alone, and one that is merely weak has a number
    beside this sentence: neither is unknown as one beyond a metre is."""
    if tells_nothing(std, unit):
        return f"{name} would stay unknown"
    if std <= limit:
        return f"{name} would rest on what is known beforehand"
    return f"{name} would stay weak, ± {std_text(std, unit).replace(' deg', '°')}"


def _what_to_do(stays: str, advice: str, *, by_motion: bool) -> str:
    """A sentence for an axis that would stay weak or unknown.

    stays: which, in words.   advice: of the forecast for this axis.   by_motion: all planes that were found would not tell it
    either.
    """
    if not by_motion:
        return f"{stays}: the confirmed planes do not determine it. Confirm more planes."
    cure = advice or "Record again, with turns about all three axes."
    return f"{stays}, whichever planes are confirmed: the motion does not determine it. {cure}"
