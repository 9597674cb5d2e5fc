"""The turn about the only axis that a platform turned about, where its accelerations do not tell it.

Turning in place about one axis, the lidar and the IMU each see that axis and nothing across it: along the turn that stays
open any answer is as good by the data, and by what people build that one is likeliest in which gravity stands upright on
floors and lies along walls.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from calib_core.full.initialise.settings import UPRIGHT
from calib_core.full.initialise.start import RotationStart, Start
from calib_core.geometry import exp
from calib_core.types import FloatArray


def turns_about(axis: FloatArray, R: FloatArray, count: int) -> list[FloatArray]:
    """The rotation turned about an axis of its own left frame by equal steps of a full turn. axis: (3,), R: (3, 3)."""
    unit = axis / np.linalg.norm(axis)
    return [exp(unit * angle) @ R for angle in np.arange(count) * 2 * np.pi / count]


def upright(trials: Sequence[Start], normals: FloatArray, trial: Callable[[RotationStart], Start]) -> Start:
    """The trial that fits best; of many that fit alike, differing by a turn about the only axis, the most upright one.

    normals: (P, 3) of the planes, map.   trial: solves for one rotation more; trials of one candidate are equal turns
    apart.
    """
    best = min(trials, key=lambda t: t.misfit)
    axis = best.rotation.open_axis_imu
    if axis is None:
        return best
    family = [t for t in trials if t.rotation.time_offset_s == best.rotation.time_offset_s]
    angles = np.arange(len(family)) * 2 * np.pi / len(family)
    alike = np.array([t.misfit <= UPRIGHT.alike * best.misfit for t in family])
    if alike.sum() < UPRIGHT.fewest_alike:
        return best
    # Gravity goes round the axis with the turn: a constant and one harmonic tell it at any angle.
    gravity = np.array([t.linear.gravity for t in family])
    harmonic = np.linalg.lstsq(_circle(angles[alike]), gravity[alike], rcond=None)[0]
    fine = np.arange(0.0, 2 * np.pi, np.radians(UPRIGHT.fine_deg))
    apart = np.abs((fine[:, None] - angles[alike] + np.pi) % (2 * np.pi) - np.pi).min(axis=1)
    within = fine[apart <= np.pi / len(family)]
    slopes = [_slope(g, normals) for g in _circle(within) @ harmonic]
    if min(slopes) > _slope(best.linear.gravity, normals) - UPRIGHT.worth_a_turn:
        return best
    unit = axis / np.linalg.norm(axis)
    R = exp(unit * within[int(np.argmin(slopes))]) @ family[0].rotation.R_imu_lidar
    return trial(replace(best.rotation, R_imu_lidar=R))


def _circle(angles: FloatArray) -> FloatArray:
    """(N, 3): 1, cosine and sine."""
    return np.stack([np.ones_like(angles), np.cos(angles), np.sin(angles)], axis=1)


def _slope(gravity: FloatArray, normals: FloatArray) -> float:
    """How far planes are from level or plumb, whichever is nearer, each at most counting as one. normals: (P, 3), map."""
    cosine = np.abs(normals @ gravity) / np.linalg.norm(gravity)
    off = np.arcsin(np.minimum(np.minimum(cosine, np.sqrt(np.maximum(1.0 - cosine**2, 0.0))), 1.0))
    return float(np.sum(off**2 / (off**2 + np.radians(UPRIGHT.plumb_deg) ** 2)))
