"""Which directions of the calibration the data leave open: what is held while solving, and said when it is over.

Knots, biases, gravity and planes are eliminated; what remains, 7 x 7 in the contract's order, is the calibration's
information. Priors on the calibration itself are taken out exactly: the verdict is the data's. Its eigenvectors, in units
of 1 deg, 10 mm and 1 ms, are the directions that are known well or badly together.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_core.full.joint.priors import Priors
from calib_core.full.joint.settings import HOLDING
from calib_core.full.joint.state import CALIBRATION, ROTATION, TRANSLATION
from calib_core.result import AXIS_WORDS, COVARIANCE_ORDER, WEAK_DEG, WEAK_M, WEAK_S
from calib_core.solver.information import marginal
from calib_core.types import BoolArray, FloatArray

#: The calibration to a person, in the order of its columns.
NAMES = tuple(AXIS_WORDS[axis] for axis in COVARIANCE_ORDER)
#: One unit of each parameter: 1 deg, 10 mm, 1 ms.
UNITS = np.array([np.radians(1.0)] * 3 + [0.01] * 3 + [1e-3])
#: A direction is weak where its spread along any parameter exceeds these: 0.5 deg, 20 mm or 2 ms.
LIMITS = np.repeat([WEAK_DEG, WEAK_M / 0.01, WEAK_S / 1e-3], (3, 3, 1))
#: The standing prior of 1 rad, 10 m, 10 s in the same units: along an undetermined direction this is all there is.
STANDING = np.array([np.degrees(1.0)] * 3 + [1000.0] * 3 + [10000.0])
#: Spread of a direction along any parameter, in the scaled units, beyond which it counts as undetermined and is held.
UNDETERMINED = np.repeat([np.radians(HOLDING.open_deg), HOLDING.open_m, HOLDING.open_s], (3, 3, 1)) / UNITS


def without_lever_arm(known: FloatArray) -> FloatArray:
    """The same information (7, 7) with nothing told of the lever arm."""
    told = known.copy()
    told[TRANSLATION, :] = told[:, TRANSLATION] = 0.0
    return told


def data_information(information: FloatArray, priors: Priors) -> FloatArray:
    """(7, 7), in the scaled units: what the data alone say of the calibration. information: (S, S), priors included."""
    data = (marginal(information, CALIBRATION) - priors.calibration_information()) * UNITS[:, None] * UNITS[None, :]
    return 0.5 * (data + data.T)


def undetermined(data: FloatArray) -> FloatArray:
    """Directions (7, U), scaled units, in which the data say less than noise alone would seem to say.

    Why a threshold far from zero: the information is evaluated at estimated motion, whose noise looks like excitation.
    A lever arm along a fixed axis, truly unknown, seems known to half a metre after 20 s, and left free it wanders.
    """
    values, vectors = np.linalg.eigh(data)
    spread = 1.0 / np.sqrt(np.maximum(values, 1e-16))
    return _without_traces(vectors[:, is_open(vectors, spread)])


def _without_traces(directions: FloatArray) -> FloatArray:
    """The directions (7, U), orthonormal, without parameters that take no real part in them.

    Noise in the motion mixes a thousandth of a degree into ten undetermined millimetres; times the ten metres of the
    standing prior that would pass for an unknown rotation. A part that even the whole prior does not make weak is none.
    """
    longest = 1.0 / np.sqrt(np.sum((directions / STANDING[:, None]) ** 2, axis=0))
    takes_part = (np.abs(directions) * longest > LIMITS[:, None]).any(axis=1)
    return np.asarray(np.linalg.qr(np.where(takes_part[:, None], directions, 0.0))[0])


def still_undetermined(data: FloatArray, before: Sequence[FloatArray]) -> FloatArray:
    """Directions (7, U), orthonormal: those undetermined now, and those held before that are not clearly determined.

    before: unit vectors (7,) in the scaled units.
    """
    found = undetermined(data)
    for vector in before:
        if is_hardly_determined(data, vector):
            beyond = vector - found @ (found.T @ vector)
            size = float(np.linalg.norm(beyond))
            if size > HOLDING.same_direction:  # otherwise the same direction, as it looks now
                found = np.column_stack([found, beyond / size])
    return found


def turns_about(axis_lidar: FloatArray, data: FloatArray) -> list[FloatArray]:
    """What is known together (7,), scaled units, and is a turn about an axis (3,) for the most part; the lever arm goes round."""
    along = axis_lidar / np.linalg.norm(axis_lidar)
    return [vector for vector in np.linalg.eigh(data)[1].T if (along @ vector[ROTATION]) ** 2 > HOLDING.turn_share]


def is_hardly_determined(data: FloatArray, vector: FloatArray) -> bool:
    """Whether a direction that is held stays so: the data tell of it no more than noise could. vector: (7,), scaled units."""
    spread = 1.0 / np.sqrt(max(float(vector @ data @ vector), 1e-16))
    return bool((np.abs(vector) * spread > HOLDING.let_go * UNDETERMINED).any())


def is_turning_felt(imu_s: FloatArray, gyro_rad_s: FloatArray, density_rad_s_sqrt_hz: FloatArray) -> bool:
    """Whether a gyroscope's readings (Q, 3) turn by more than their own noise (3,); without, nothing tells a lever arm.

    The information knows this only where the motion has come to rest: while it is rough, its errors turn the rig.
    """
    span = np.floor((imu_s - imu_s[0]) / HOLDING.felt_over_s).astype(np.int64)
    count = np.bincount(span)
    full = count > HOLDING.full_span * np.median(count)
    rates = np.array([np.bincount(span, axis) for axis in gyro_rad_s.T])[:, full] / count[full]
    noise = density_rad_s_sqrt_hz**2 / HOLDING.felt_over_s
    return bool((np.var(rates, axis=1) > HOLDING.felt_times * noise).any())


def towards_priors(directions: FloatArray, priors: Priors, at: FloatArray) -> FloatArray:
    """How far along open directions (7, U) a person's priors are from a place, (U,); zero where there are none.

    at: (7,) the place, scaled units, which the standing prior is laid about: what a person has not said stays where it is.
    """
    own = priors.given
    columns = [row.column for row in own]
    stds = np.array([row.std for row in own]) / UNITS[columns]
    away = np.array([row.value for row in own]) / UNITS[columns] - at[columns]
    rows = np.concatenate([directions[columns] / stds[:, None], directions / STANDING[:, None]])
    return np.asarray(np.linalg.lstsq(rows, np.concatenate([away / stds, np.zeros(CALIBRATION)]), rcond=None)[0])


def is_open(vectors: FloatArray, spread: FloatArray) -> BoolArray:
    """Which of the directions (7, U) of so much spread (U,) count as undetermined, (U,)."""
    return np.asarray((np.abs(vectors) * spread > UNDETERMINED[:, None]).any(axis=0))
