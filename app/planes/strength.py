"""What is foreseen of the least known axis with the planes that are confirmed.

The doctor's forecast holds for the planes it found. The planes' information on where the lidar is, noise taken as white,

    I = sum over planes of  n_points / rms^2  n n^T

only ever shrinks when one is left out, and standard deviations grow with the root of what is left along the worst
direction. So the forecast is scaled by the smallest ratio of what is confirmed to what was suggested, at most 1: leaving a
plane out never makes it better, which a measure of how evenly directions are spread would.
"""

from __future__ import annotations

import numpy as np

from app.planes.state import PlaneSet
from app.schemas.planes import Foreseen
from app.weak_limits import AXIS_NAMES, WEAK_IN
from calib_core.doctor.report import Forecast
from calib_core.sigmas import Unit, std_text, tells_nothing
from calib_core.types import FloatArray

#: A plane flatter than the lidar's own noise is not known better for it.
LEAST_RMS_M = 0.003
#: Less than this of the information left along some direction is none.
NOTHING_LEFT = 1e-6


def foreseen(forecast: Forecast | None, planes: PlaneSet, suggestion: PlaneSet) -> Foreseen | None:
    """The least known axis against its limit; None without a forecast."""
    if forecast is None or not forecast.parameters:
        return None
    left = share_left(information(planes), information(suggestion))
    if left < NOTHING_LEFT:
        return None
    # One that the data alone do not tell comes first: a prior may hide that.
    worst = max(forecast.parameters, key=lambda parameter: (parameter.weak, parameter.std / WEAK_IN[parameter.unit]))
    limit = WEAK_IN[worst.unit]
    std = worst.std / float(np.sqrt(left))
    name = AXIS_NAMES[worst.name]
    by_motion = worst.weak or worst.std > limit
    weak = by_motion or std > limit
    text = _what_to_do(_stays(name, std, worst.unit, limit), worst.advice, by_motion=by_motion) if weak else ""
    return Foreseen(name=name, std=std, unit=worst.unit, limit=limit, weak=weak, text=text)


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
        return f"{stays}: too little is left of what fixes it. Confirm more planes."
    cure = advice or "Record again, with turns about all three axes."
    return f"{stays}, whichever planes are confirmed: the motion does not tell it. {cure}"


def information(planes: PlaneSet) -> FloatArray:
    """(3, 3) [1/m2] of the confirmed planes on the lidar's place."""
    total = np.zeros((3, 3))
    for patch in planes.patches:
        if patch.confirmed:
            normal = np.array(patch.normal)
            total += patch.n_points / max(patch.rms_m, LEAST_RMS_M) ** 2 * np.outer(normal, normal)
    return total


def share_left(chosen: FloatArray, whole: FloatArray) -> float:
    """The smallest share, over all directions, that `chosen` (3, 3) has of `whole` (3, 3); 0..1."""
    values, vectors = np.linalg.eigh(whole)
    if values[0] <= 1e-9 * max(values[-1], 1e-300):
        return 1.0 if np.allclose(chosen, whole) else 0.0
    root = vectors / np.sqrt(values)
    return float(np.clip(np.linalg.eigvalsh(root.T @ chosen @ root)[0], 0.0, 1.0))
