"""What of the sensors was not estimated and may move the answer all the same, in sentences: what widens error bars most, first.

A block whose members have the prior sigmas p moves the seven by S p, a column a member (considered.py): of a draw from the prior
the squares of these add up. It is told where without it an error bar would be narrower by what counts (WORDING.counted).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_core.full.assess.settings import WORDING
from calib_core.full.joint.state import ROTATION, TIME_OFFSET, TRANSLATION
from calib_core.intrinsics import STANDARD_GRAVITY_M_S2, Block
from calib_core.result import Intrinsic, Shift
from calib_core.sigmas import Unit, std_text, two_digits
from calib_core.types import FloatArray

#: The code of what is said of a block that was only considered.
CONSIDERED = "sensor.considered"
_RAISED = str.maketrans("23", "²³")
_GROUPS: tuple[tuple[str, Unit], ...] = (("the rotation", "deg"), ("the translation", "m"), ("the time offset", "s"))
#: Blocks as a sentence has them.
_CALLED: dict[Block, str] = {
    "gyroscope_scale": "the gyroscope's scale",
    "gyroscope_axes": "the angles between the gyroscope's axes",
    "gyroscope_rotation": "the gyroscope's rotation against the accelerometer",
    "accelerometer_scale": "the accelerometer's scale",
    "accelerometer_axes": "the angles between the accelerometer's axes",
    "accelerometer_delay": "the accelerometer's delay",
    "accelerometer_quadratic": "the accelerometer's nonlinearity",
    "g_sensitivity": "the gyroscope's sensitivity to acceleration",
    "size_effect": "the distances between the accelerometers",
    "low_pass_spread": "the smoothing by the IMU's low-pass filter",
    "low_pass_skew": "the asymmetry of the IMU's low-pass filter",
    "clock_rate": "the difference of the clocks' rates",
    "laser_range_offset": "range offsets of lasers",
    "laser_elevation": "elevations of lasers",
    "laser_azimuth": "azimuths of lasers",
    "laser_range_scale": "range scales of lasers",
    "eccentricity": "the encoder's eccentricity",
    "range_offset": "a range offset of all lasers",
    "incidence": "a range offset that grows with the angle of incidence",
    "grazing": "a range error at grazing incidence",
}


def shift_of(seven: FloatArray) -> Shift:
    """For the document. seven: (7,) SI."""
    return Shift(
        rotation_shift_deg=np.degrees(seven[ROTATION]).tolist(),
        translation_shift_m=seven[TRANSLATION].tolist(),
        time_offset_shift_s=float(seven[TIME_OFFSET]),
    )


def told_considered(parameters: Sequence[Intrinsic], covariance: FloatArray) -> list[tuple[str, str]]:
    """Code and text for each block that counts. covariance: (7, 7) of the answer, SI, with what they may move it by."""
    stated = _squares(covariance)
    found = []
    for block, called in _CALLED.items():
        mine = [each for each in parameters if each.block == block]
        shifts = [each.shift for each in mine if each.shift is not None]
        if not shifts:
            continue
        own = sum((_squares_of(shift) for shift in shifts), np.zeros(3))
        wider = _times_wider(stated, own)
        if wider.max() < WORDING.counted:
            continue
        moves = " and ".join(
            f"{group} by {std_text(float(np.sqrt(square)), unit)}"
            for (group, unit), square, times in zip(_GROUPS, own, wider, strict=True)
            if times >= WORDING.counted
        )
        size = f"{_size(mine[0])}{' each' if len(mine) > 1 else ''}, 1 sigma"
        text = f"not estimated, but counted in the error bars: {called} ({size}) could move {moves}"
        found.append((float(wider.max()), (CONSIDERED, text)))
    return [told for _, told in sorted(found, key=lambda each: -each[0])]


def _squares(covariance: FloatArray) -> FloatArray:
    """(3,) variance of the rotation [deg2], translation [m2] and time offset [s2], axes together."""
    variance = np.diag(covariance)
    turn = float(np.degrees(np.degrees(variance[ROTATION].sum())))
    return np.array([turn, variance[TRANSLATION].sum(), variance[TIME_OFFSET]])


def _squares_of(shift: Shift) -> FloatArray:
    """The same of one shift."""
    turn, place = np.array(shift.rotation_shift_deg), np.array(shift.translation_shift_m)
    return np.array([turn @ turn, place @ place, shift.time_offset_shift_s**2])


def _times_wider(stated: FloatArray, own: FloatArray) -> FloatArray:
    """(3,) how many times as wide error bars are for what is `own` of them; 1 for what was held."""
    left = np.maximum(stated - own, 1e-12 * stated)
    return np.asarray(np.sqrt(np.divide(stated, left, out=np.ones(3), where=stated > 0.0)))


def _size(one: Intrinsic) -> str:
    """A prior's standard deviation in a unit that people read."""
    std = one.prior_std
    if one.unit == "1":
        return f"{two_digits(100.0 * std)} %"
    if one.unit == "rad":
        return std_text(float(np.degrees(std)), "deg")
    if one.unit == "ppm":
        return f"{two_digits(std)} ppm"
    if one.unit == "m":
        return std_text(std, "m")
    if one.unit == "s":
        return std_text(std, "s")
    if one.block == "g_sensitivity":
        return f"{two_digits(float(np.degrees(std)) * STANDARD_GRAVITY_M_S2)} deg/s per g"
    return f"{two_digits(std)} {one.unit.translate(_RAISED)}"
