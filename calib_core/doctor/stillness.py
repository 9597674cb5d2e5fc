"""Where the platform stands still: where nobody moves it.

Two tests of a standstill read the IMU, as they answer two questions. This one tells a person how the rig was handled: by
limits of a hand's motion, the same for every sensor; every such span, with a bias that may drift from one to the next.
`longest_still` (full/prepare/imu_noise.py) tells where readings are a constant and white noise, from which the noise can be
read: by that recording's own noise, so that what an engine shakes evenly counts, and one span, cut where the bias drifts. By
the first a hand's calm moment would pass for noise; by the second a rig on a humming car would stand or move by how good its
sensor is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.types import BoolArray, FloatArray, ImuData, IntArray

WINDOW_S = 0.25
#: Mean rotation and change of mean acceleration below which a window counts as still. A hand holding a rig trembles
#: at several deg/s; a tripod or the floor stays far below.
STILL_ROTATION_RAD_S = np.deg2rad(1.5)
STILL_ROTATION_STD_RAD_S = np.deg2rad(2.0)
STILL_ACCELERATION_STD_M_S2 = 0.25
MIN_SPAN_S = 1.0


@dataclass(frozen=True, slots=True)
class StillSpan:
    """Readings first..last (last excluded) that stand still; times are seconds after the first reading."""

    first: int
    last: int
    start_s: float
    end_s: float


def still_spans(imu: ImuData) -> tuple[StillSpan, ...]:
    """Spans of at least MIN_SPAN_S in which nothing moves."""
    times_s = (imu.stamps_ns - imu.stamps_ns[0]) * 1e-9
    window = (times_s / WINDOW_S).astype(np.int64)
    starts = np.flatnonzero(np.diff(window, prepend=-1)).astype(np.int64)
    sizes = np.diff(starts, append=window.size).astype(np.int64)
    gyro_mean, gyro_std = _window_moments(imu.gyro_rad_s, starts, sizes)
    _, accel_std = _window_moments(imu.accel_m_s2, starts, sizes)
    bias = _resting_bias(gyro_mean, gyro_std, accel_std)
    still: BoolArray = (
        (np.linalg.norm(gyro_mean - bias, axis=1) < STILL_ROTATION_RAD_S)
        & (gyro_std < STILL_ROTATION_STD_RAD_S)
        & (accel_std < STILL_ACCELERATION_STD_M_S2)
    )
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(np.int8)))
    spans = []
    ends = np.append(starts[1:], window.size)
    for begin, end in edges.reshape(-1, 2):
        first, last = int(starts[begin]), int(ends[end - 1])
        if times_s[last - 1] - times_s[first] >= MIN_SPAN_S - WINDOW_S:
            spans.append(StillSpan(first, last, float(times_s[first]), float(times_s[last - 1])))
    return tuple(spans)


def _window_moments(channels: FloatArray, starts: IntArray, sizes: IntArray) -> tuple[FloatArray, FloatArray]:
    """Mean (K, 3) and norm of the standard deviation (K,) per window."""
    mean = np.add.reduceat(channels, starts, axis=0) / sizes[:, None]
    centred = (channels - np.repeat(mean, sizes, axis=0)) ** 2
    variance = np.add.reduceat(centred, starts, axis=0) / sizes[:, None]
    return mean, np.sqrt(variance.sum(axis=1))


def _resting_bias(gyro_mean: FloatArray, gyro_std: FloatArray, accel_std: FloatArray) -> FloatArray:
    """The rate shown at rest: mean of the calmest tenth of the windows, if it is small enough to be a bias."""
    unrest = gyro_std / max(float(np.median(gyro_std)), 1e-9) + accel_std / max(float(np.median(accel_std)), 1e-9)
    calm = np.argsort(unrest, kind="stable")[: max(1, unrest.size // 10)]
    bias = np.median(gyro_mean[calm], axis=0)
    return bias if np.linalg.norm(bias) < np.deg2rad(3.0) else np.zeros(3)
