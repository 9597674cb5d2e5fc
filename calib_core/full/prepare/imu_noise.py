"""White noise of the IMU, measured: from the still seconds where there are any, else from what no motion can explain."""

from __future__ import annotations

import numpy as np

from calib_core.full.run import ImuNoiseLevel
from calib_core.gp.noise import high_frequency_noise
from calib_core.imu.preintegration import NoiseDensity
from calib_core.types import FloatArray

#: Below these no MEMS or fibre-optic sensor has been: what a noise-free or coarsely quantised recording is held to.
GYRO_FLOOR_RAD_S_SQRT_HZ = 1e-6
ACCEL_FLOOR_M_S2_SQRT_HZ = 1e-5


def resolution(values: FloatArray) -> FloatArray:
    """The smallest step a channel's readings take: (C,). 0 where they never change."""
    out = np.zeros(values.shape[1])
    for channel in range(values.shape[1]):
        steps = np.diff(np.unique(values[: min(len(values), 20000), channel]))
        steps = steps[steps > 0]
        # Readings of float origin differ by round-off: a true resolution is one that most steps are multiples of.
        if len(steps):
            out[channel] = float(np.min(steps))
    return out


def measure_imu_noise(stamps_s: FloatArray, gyro: FloatArray, accel: FloatArray, still: slice | None) -> ImuNoiseLevel:
    """The noise of one IMU.

    stamps_s: (Q,).   gyro, accel: (Q, 3).   still: samples of the longest standstill, or None.
    """
    values = np.hstack([gyro, accel])
    period = float(np.median(np.diff(stamps_s)))
    everywhere = high_frequency_noise(stamps_s, values)
    std, source = everywhere, "the part of the moving readings that no motion explains"
    if still is not None and (still.stop - still.start) * period >= 2.0:
        quiet = values[still]
        # Slow drift in a standstill (thermal, a hand that is not quite still) is not white noise: differences are blind to it.
        steps = np.diff(quiet, axis=0)
        std = np.sqrt(np.mean(steps**2, axis=0) / 2.0)
        source = f"{(still.stop - still.start) * period:.1f} s of standstill"
    floor = np.repeat([GYRO_FLOOR_RAD_S_SQRT_HZ, ACCEL_FLOOR_M_S2_SQRT_HZ], 3) / np.sqrt(period)
    std = np.maximum(std, np.maximum(resolution(values) / np.sqrt(12.0), floor))
    density = std * np.sqrt(period)
    # One level for the three axes of a triad, the root mean square: a single chip, and three times the data.
    pooled = np.repeat(np.sqrt(np.mean(density.reshape(2, 3) ** 2, axis=1)), 3)
    return ImuNoiseLevel(NoiseDensity(pooled[:3], pooled[3:]), pooled / np.sqrt(period), source)


def longest_still(stamps_s: FloatArray, gyro: FloatArray, accel: FloatArray) -> slice | None:
    """The longest run of samples (at least 0.5 s) without motion, or None.

    Still: over 0.25 s windows the mean rate and mean force stay within what white noise of the recording's own level, and
    a constant bias, allow. A steady turn is told from a bias by the force it makes and by its size.
    """
    values = np.hstack([gyro, accel])
    period = float(np.median(np.diff(stamps_s)))
    width = max(4, round(0.25 / period))
    count = len(values) // width
    if count < 3:
        return None
    sigma = np.maximum(high_frequency_noise(stamps_s, values), np.repeat([1e-4, 1e-3], 3))
    blocks = values[: count * width].reshape(count, width, 6)
    means = blocks.mean(axis=1)
    spread = blocks.std(axis=1)
    quiet = (spread < 2.0 * sigma + np.repeat([2e-3, 2e-2], 3)).all(axis=1)
    quiet &= np.linalg.norm(means[:, :3], axis=1) < 0.12
    best: tuple[int, int] | None = None
    start = 0
    while start < count:
        if not quiet[start]:
            start += 1
            continue
        end = start + 1
        allowed = 6.0 * sigma / np.sqrt(width) + np.repeat([4e-3, 4e-2], 3)
        while end < count and quiet[end] and (np.abs(means[end] - means[start]) < allowed).all():
            end += 1
        if best is None or end - start > best[1] - best[0]:
            best = (start, end)
        start = end
    if best is None or (best[1] - best[0]) * width * period < 0.5:
        return None
    return slice(best[0] * width, best[1] * width)
