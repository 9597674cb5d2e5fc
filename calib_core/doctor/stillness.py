"""Where the platform stands still, and how noisy its IMU is there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.settings import ImuNoise
from calib_core.types import BoolArray, FloatArray, ImuData, IntArray

WINDOW_S = 0.25
#: Mean rotation and change of mean acceleration below which a window counts as still. A hand holding a rig trembles
#: at several deg/s; a tripod or the floor stays far below.
STILL_ROTATION_RAD_S = np.deg2rad(1.5)
STILL_ROTATION_STD_RAD_S = np.deg2rad(2.0)
STILL_ACCELERATION_STD_M_S2 = 0.25
MIN_SPAN_S = 1.0
#: Noise is measured from at least this much stillness.
MIN_NOISE_S = 2.0


@dataclass(frozen=True, slots=True)
class StillSpan:
    """Readings first..last (last excluded) that stand still; times are seconds after the first reading."""

    first: int
    last: int
    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class MeasuredNoise:
    """White noise of static readings, as densities; resolutions are the smallest steps between readings."""

    noise: ImuNoise
    static_s: float
    gyro_resolution_rad_s: float
    accel_resolution_m_s2: float


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


def measured_noise(
    imu: ImuData, spans: tuple[StillSpan, ...], *, gyro_walk: float, accel_walk: float
) -> MeasuredNoise | None:
    """White noise from the still spans, floored at the readings' resolution; None below MIN_NOISE_S of stillness.

    Differences of neighbouring readings cancel bias, gravity and slow sway: their variance is twice the noise's.
    """
    total_s = sum(span.end_s - span.start_s for span in spans)
    if total_s < MIN_NOISE_S:
        return None
    period_s = float(np.median(np.diff(imu.stamps_ns))) * 1e-9
    gyro, gyro_step = _channel_noise(imu.gyro_rad_s, spans)
    accel, accel_step = _channel_noise(imu.accel_m_s2, spans)
    root = np.sqrt(period_s)
    noise = ImuNoise(
        gyroscope_noise_density_rad_s_sqrt_hz=max(gyro * root, 1e-9),
        accelerometer_noise_density_m_s2_sqrt_hz=max(accel * root, 1e-9),
        gyroscope_random_walk=gyro_walk,
        accelerometer_random_walk=accel_walk,
    )
    return MeasuredNoise(noise, total_s, gyro_step, accel_step)


def _channel_noise(channels: FloatArray, spans: tuple[StillSpan, ...]) -> tuple[float, float]:
    """Standard deviation per reading (root mean square over axes, floored), and the resolution."""
    differences = np.concatenate([np.diff(channels[s.first : s.last], axis=0) for s in spans])
    # Median absolute deviation per axis: a bump on the table must not count as noise.
    spread = 1.4826 * np.median(np.abs(differences - np.median(differences, axis=0)), axis=0) / np.sqrt(2)
    plain = differences.std(axis=0) / np.sqrt(2)
    # Coarse readings have a median step of zero; there the plain deviation is the better estimate.
    per_axis = np.where(spread > 0.3 * plain, spread, plain)
    values = np.unique(np.abs(differences[differences != 0]))
    step = float(values[0]) if values.size else 0.0
    if step < 1e-4 * float(per_axis.max(initial=0.0)):
        step = 0.0  # continuous to all purposes
    floor = step / np.sqrt(12)
    return float(max(np.sqrt(np.mean(per_axis**2)), floor)), step
