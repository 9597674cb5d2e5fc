"""White noise of the IMU, measured: from the still seconds where there are any, else from what no motion can explain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_core.full.prepare.noise_floor import Floor, noise_floor
from calib_core.full.prepare.settings import NOISE
from calib_core.full.run import ImuNoiseLevel
from calib_core.gp.noise import high_frequency_noise
from calib_core.imu.preintegration import NoiseDensity
from calib_core.imu.quantisation import resolution
from calib_core.types import FloatArray, ImuData

#: Standard deviations in the width of a uniform law: what cutting to steps makes of anything.
_UNIFORM_STDS = np.sqrt(12.0)


def noise_of(stamps_s: FloatArray, imu: ImuData) -> tuple[ImuNoiseLevel, slice | None]:
    """The noise of an IMU, and the samples of its longest standstill. stamps_s: (Q,) of its readings, when they were taken."""
    still = longest_still(stamps_s, imu.gyro_rad_s, imu.accel_m_s2)
    return measure_imu_noise(stamps_s, imu.gyro_rad_s, imu.accel_m_s2, still), still


def measure_imu_noise(stamps_s: FloatArray, gyro: FloatArray, accel: FloatArray, still: slice | None) -> ImuNoiseLevel:
    """The noise of one IMU.

    stamps_s: (Q,).   gyro, accel: (Q, 3).   still: samples of the longest standstill, or None.

    A reading's standard deviation is what no smooth motion explains, an engine's shaking included: interpolation need not
    follow that. The density is that of low frequencies, which is what integrates: the same number where noise is white.
    """
    values = np.hstack([gyro, accel])
    period = float(np.median(np.diff(stamps_s)))
    std, source = high_frequency_noise(stamps_s, values), "the part of the moving readings that no motion explains"
    if still is not None and (still.stop - still.start) * period < NOISE.least_still_s:
        still = None
    floors = [noise_floor(stamps_s, values, lowest_hz=NOISE.motion_hz)]
    if still is not None:
        quiet = values[still]
        # Slow drift in a standstill (thermal, a hand that is not quite still) is not white noise: differences are blind to it.
        steps = np.diff(quiet, axis=0)
        std = np.sqrt(np.mean(steps**2, axis=0) / 2.0)
        source = f"{(still.stop - still.start) * period:.1f} s of standstill"
        floors.insert(0, noise_floor(stamps_s[still], quiet, lowest_hz=NOISE.drift_hz))
    floor = np.repeat([NOISE.gyro_floor_rad_s_sqrt_hz, NOISE.accel_floor_m_s2_sqrt_hz], 3) / np.sqrt(period)
    least = np.maximum(resolution(values) / _UNIFORM_STDS, floor)
    std = np.maximum(std, least)
    # One level for the three axes of a triad, the root mean square: a single chip, and three times the data.
    white, least = _of_triads(std * np.sqrt(period)), _of_triads(least * np.sqrt(period))
    density = np.array([_at_low_frequencies(white[k], floors, slice(3 * k, 3 * k + 3)) for k in (0, 1)])
    density = np.maximum(density, least)
    if not np.allclose(density, white, rtol=1e-9, atol=0.0):
        source = "their spectrum at low frequencies, between the motion and what else shakes the sensor"
    gyro_density, accel_density = np.repeat(density, 3).reshape(2, 3)
    return ImuNoiseLevel(
        NoiseDensity(gyro_density, accel_density),
        np.repeat(white, 3) / np.sqrt(period),
        source,
        shaken=bool(np.max(white / density) > NOISE.shaken),
    )


def _of_triads(channels: FloatArray) -> FloatArray:
    """(2,) root mean squares of (6,)."""
    return np.asarray(np.sqrt(np.mean(channels.reshape(2, 3) ** 2, axis=1)))


def _at_low_frequencies(white: float, floors: Sequence[Floor], triad: slice) -> float:
    """A triad's density: that of all frequencies where the first floor agrees with it and none is lower, else the lowest floor
    there is.

    Whatever else moves a sensor adds to a floor, and nothing takes from it at the frequencies where it is looked for. In a
    standstill of two seconds with an engine on its lines are all there is to see.
    """
    found: list[tuple[float, float]] = []
    for floor in floors:
        density, std = floor.density[triad], floor.relative_std[triad]
        flat = np.isfinite(density)
        if not flat.any():
            continue
        level = float(np.sqrt(np.mean(density[flat] ** 2)))
        found.append((level, float(np.sqrt(np.mean(std[flat] ** 2) / flat.sum()))))
    beside = [(float(np.log(level / white)), NOISE.white_sigmas * chance) for level, chance in found]
    if found and (abs(beside[0][0]) >= beside[0][1] or any(apart < -chance for apart, chance in beside)):
        return min(level for level, _ in found)
    return white


def rests_throughout(stamps_s: FloatArray, imu: ImuData) -> bool:
    """Whether the whole of a recording is one standstill of its IMU, but for what is less than a block. stamps_s: (Q,)."""
    still = longest_still(stamps_s, imu.gyro_rad_s, imu.accel_m_s2)
    return still is not None and still.start == 0 and len(stamps_s) - still.stop < _block(stamps_s)


def _block(stamps_s: FloatArray) -> int:
    """Readings of a block by which standing still is told."""
    period = float(np.median(np.diff(stamps_s)))
    return max(NOISE.fewest_in_block, round(NOISE.block_s / period))


def longest_still(stamps_s: FloatArray, gyro: FloatArray, accel: FloatArray) -> slice | None:
    """The longest run of samples without motion, or None where there is none to speak of.

    Still: over short blocks the mean rate and mean force stay within what white noise of the recording's own level, and
    a constant bias, allow. A steady turn is told from a bias by the force it makes and by its size. Whether somebody moves the
    rig is another question, and has its own test: doctor/stillness.py says why.
    """
    values = np.hstack([gyro, accel])
    period = float(np.median(np.diff(stamps_s)))
    width = _block(stamps_s)
    count = len(values) // width
    if count < NOISE.fewest_blocks:
        return None
    sigma = np.maximum(
        high_frequency_noise(stamps_s, values), np.repeat([NOISE.least_gyro_rad_s, NOISE.least_accel_m_s2], 3)
    )
    blocks = values[: count * width].reshape(count, width, 6)
    means = blocks.mean(axis=1)
    spread = blocks.std(axis=1)
    trembling = np.repeat([NOISE.trembling_rad_s, NOISE.trembling_m_s2], 3)
    quiet = (spread < NOISE.block_sigmas * sigma + trembling).all(axis=1)
    quiet &= np.linalg.norm(means[:, :3], axis=1) < NOISE.most_bias_rad_s
    drift = np.repeat([NOISE.drift_rad_s, NOISE.drift_m_s2], 3)
    allowed = NOISE.mean_sigmas * sigma / np.sqrt(width) + drift
    best: tuple[int, int] | None = None
    start = 0
    while start < count:
        if not quiet[start]:
            start += 1
            continue
        end = start + 1
        while end < count and quiet[end] and (np.abs(means[end] - means[start]) < allowed).all():
            end += 1
        if best is None or end - start > best[1] - best[0]:
            best = (start, end)
        start = end
    if best is None or (best[1] - best[0]) * width * period < NOISE.shortest_still_s:
        return None
    return slice(best[0] * width, best[1] * width)
