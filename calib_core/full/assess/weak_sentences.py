"""What the recording leaves weak, in sentences: how badly it is known, and what to record so that it will be.

Measured by observability.py; no number is made here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_core.full.assess.observability import Direction, Knowledge
from calib_core.full.assess.settings import WORDING
from calib_core.full.joint.state import CALIBRATION, ROTATION, TIME_OFFSET, TRANSLATION
from calib_core.full.joint.undetermined import NAMES, UNITS
from calib_core.result import COVARIANCE_ORDER, WeakDirection
from calib_core.settings import Axis
from calib_core.sigmas import std_text
from calib_core.types import FloatArray

_SHORT = (*(f"turn {a}" for a in "xyz"), *(f"translation {a}" for a in "xyz"), "time offset")


def weak_directions(knowledge: Knowledge) -> tuple[WeakDirection, ...]:
    """Each of them, for the document."""
    return tuple(_described(each, knowledge.data_std) for each in knowledge.weak)


def _described(direction: Direction, data_std: FloatArray) -> WeakDirection:
    """In words, by the parameter that it is most of, in its sense. data_std: (7,) of each parameter, SI, as Knowledge has it."""
    vector, largest, alone = _named(direction.vector)
    what = NAMES[largest] if alone else _mixture(vector)
    if direction.is_open:
        text = f"The recording does not determine {what}; the value stated for it is assumed, not measured."
    else:
        # By a parameter's name it is that parameter's own, as every table has it, to which other directions add their part.
        along = abs(float(vector[largest])) * direction.spread * float(UNITS[largest])
        amount = _amount(float(data_std[largest]) if alone else along, largest)
        text = f"The recording determines {what} only to {amount} (1 sigma)."
    return WeakDirection(
        label=COVARIANCE_ORDER[largest] if alone else None,
        vector=[float(v) for v in vector],
        std_scaled=direction.spread,
        text=text,
    )


def _mixture(vector: FloatArray) -> str:
    """A direction that is none of the seven parameters alone."""
    rotation, lever = (
        ", ".join(f"{round(float(v), 2) + 0.0:+.2f}" for v in vector[part]) for part in (ROTATION, TRANSLATION)
    )
    if np.linalg.norm(vector[TRANSLATION]) > WORDING.one_kind:
        return f"the translation along ({lever}) of the IMU's axes"
    if np.linalg.norm(vector[ROTATION]) > WORDING.one_kind:
        return f"the rotation about ({rotation}) of the lidar's axes"
    parts = ", ".join(f"{v:+.2f} {_SHORT[i]}" for i, v in enumerate(vector) if abs(v) > WORDING.named)
    return f"the combination {parts} (in units of 1 deg, 10 mm and 1 ms)"


def _amount(std: float, largest: int) -> str:
    if largest < 3:
        return std_text(float(np.degrees(std)), "deg")
    return std_text(std, "m" if largest < CALIBRATION - 1 else "s")


def named_direction(covariance: FloatArray) -> str:
    """Along what a covariance (7, 7), scaled units, reaches farthest, in words."""
    vector, largest, alone = _named(np.linalg.eigh(covariance)[1][:, -1])
    return NAMES[largest] if alone else _mixture(vector)


def _named(vector: FloatArray) -> tuple[FloatArray, int, bool]:
    """A unit vector (7,) the way round in which its largest part is positive, which that is, and whether it is all but alone."""
    largest = int(np.argmax(np.abs(vector)))
    vector = vector * np.sign(vector[largest])
    return vector, largest, bool(abs(vector[largest]) > WORDING.one_parameter)


@dataclass(frozen=True, slots=True)
class Advice:
    """What to record next. about: places of the parameters in the covariance that it would make known."""

    text: str
    about: tuple[int, ...]


def advice(
    knowledge: Knowledge,
    turning_std_rad_s: FloatArray,
    R_imu_lidar: FloatArray,
    scans: tuple[int, int] | None = None,
    *,
    by_sensors: Sequence[Axis] = (),
) -> list[Advice]:
    """What to record next, from the weak parameters and from how much the IMU turned about each of its axes.

    turning_std_rad_s: (3,) rms angular rate about the IMU's axes.   scans: how many count, and how many there are; None where
    that is not known yet. Where most of them do not, more turning is no remedy, and may be what lost the planes.
    by_sensors: axes that only what the sensors may be off by leaves weak, of which no motion tells where it is not estimated.
    """
    weak = [axis for axis in knowledge.weak_axes if axis not in by_sensors]
    axes = "xyz"
    if weak and scans is not None and scans[0] < WORDING.most_scans * scans[1]:
        about = tuple(i for i, axis in enumerate(COVARIANCE_ORDER) if axis in weak)
        text = (
            f"Only {scans[0]} of {scans[1]} scans count: in the others the planes did not determine where the lidar was. Keep "
            "three planes that face different directions in view, some metres away."
        )
        return [Advice(text, about)]
    # By the axis to turn about: what one turning makes known is said once.
    arms: dict[int, list[int]] = {}
    for i in range(3):
        if f"t{axes[i]}" in weak:
            quiet = min((a for a in range(3) if a != i), key=lambda a: turning_std_rad_s[a])
            arms.setdefault(quiet, []).append(i)
    out = [
        Advice(
            f"To determine the translation along the IMU's {' and '.join(axes[i] for i in along)} "
            f"{'axes' if along[1:] else 'axis'}, turn to and fro about the IMU's {axes[quiet]} axis (it turned at "
            f"{np.degrees(turning_std_rad_s[quiet]):.1f} deg/s rms; 30 deg/s or more with quick reversals is good).",
            tuple(3 + i for i in along),
        )
        for quiet, along in arms.items()
    ]
    if any(axis.startswith("r") for axis in weak):
        lidar_turning = np.abs(R_imu_lidar.T) @ turning_std_rad_s
        quiet_axis = int(np.argmin(lidar_turning))
        text = (
            "To determine the rotation, turn about two different axes; the recording turns least about the lidar's "
            f"{axes[quiet_axis]} axis."
        )
        out.append(Advice(text, (0, 1, 2)))
    if "dt" in weak:
        out.append(Advice("To determine the time offset, turn faster and reverse direction often.", (TIME_OFFSET,)))
    return out + _of_sensors(by_sensors)


def _of_sensors(axes: Sequence[Axis]) -> list[Advice]:
    if not axes:
        return []
    about = tuple(i for i, axis in enumerate(COVARIANCE_ORDER) if axis in axes)
    whole = {"r": "rotation", "t": "translation", "d": "time offset"}
    named = list(dict.fromkeys(whole[axis[0]] for axis in COVARIANCE_ORDER if axis in axes))
    text = (
        f"The {' and '.join(named)} {'is' if not named[1:] else 'are'} weak only because of possible sensor errors, which are "
        "counted but not estimated: estimate them (`--intrinsics auto`), or name an IMU whose data sheet allows less; no other "
        "motion is needed."
    )
    return [Advice(text, about)]
