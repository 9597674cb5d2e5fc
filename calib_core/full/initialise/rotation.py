"""The rotation at each lag, and the lag refined on what the rotation leaves.

    turn_imu = R_c turn_lidar + b T,        in closed form (Kabsch)

Where all turning is about one axis, the turn about it stays open and is settled by what follows. A platform that does not
turn at all has its rotation from the accelerations.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d

from calib_core.full.initialise.settings import LAGS, ROTATING
from calib_core.full.initialise.start import LidarTrack, RotationStart
from calib_core.full.initialise.time_offset import (
    GyroTurns,
    Turns,
    candidate_lags,
    masked_correlation,
    turns_of,
)
from calib_core.geometry import mean_rotation, nearest_rotation
from calib_core.types import FloatArray


def rotation_start(track: LidarTrack, imu_s: FloatArray, gyro_rad_s: FloatArray) -> list[RotationStart]:
    """Time offset and rotation, best first; more than one where several lags explain the motion about as well."""
    gyro = GyroTurns(imu_s, gyro_rad_s)
    kinds = [(turns, candidate_lags(turns, gyro, imu_s)) for turns in turns_of(track)]
    turns, lags = max(kinds, key=lambda kind: kind[1][0][1] if kind[1] else -np.inf)
    return fit_lags(turns, gyro, lags)


def fit_lags(turns: Turns, gyro: GyroTurns, lags: Sequence[tuple[float, float]]) -> list[RotationStart]:
    """The rotation at each lag, the lag refined on the residual; best first. lags: with their correlations."""
    starts = []
    for lag, correlation in lags:
        offsets = lag + _around()
        fits = [_fit_rotation(turns, gyro, o, correlation) for o in offsets]
        values = np.array([f.residual if f is not None else np.inf for f in fits])
        k = int(np.argmin(values))
        if not np.isfinite(values[k]):
            continue
        offset = offsets[k]
        if 0 < k < len(values) - 1 and np.isfinite(values[[k - 1, k + 1]]).all():
            left, mid, right = values[k - 1 : k + 2] ** 2
            bend = left - 2 * mid + right
            offset += ROTATING.step_s * 0.5 * (left - right) / bend if bend > 0 else 0.0
        refined = _fit_rotation(turns, gyro, float(offset), correlation)
        if refined is not None:
            starts.append(refined)
    return sorted(starts, key=lambda s: s.residual)


def _around() -> FloatArray:
    """Offsets from a lag at which the rotation is tried."""
    half = 0.5 * ROTATING.step_s
    return np.arange(-ROTATING.around_s, ROTATING.around_s + half, ROTATING.step_s)


def _fit_rotation(turns: Turns, gyro: GyroTurns, offset_s: float, correlation: float) -> RotationStart | None:
    """Kabsch on the two streams of turns at one lag, reweighted against outliers."""
    imu = gyro.over(turns.start_s - offset_s, turns.end_s - offset_s)
    use = np.isfinite(imu[:, 0])
    if use.sum() < ROTATING.fewest_turns:
        return None
    a, b = turns.rate_rad_s[use], imu[use]
    worth = np.ones(len(a)) if turns.worth is None else turns.worth[use] / turns.worth[use].mean()
    weight = worth
    R, bias, singular = np.eye(3), np.zeros(3), np.zeros(3)
    residual = np.zeros_like(a)
    for _ in range(ROTATING.passes):
        mean_a, mean_b = np.average(a, axis=0, weights=weight), np.average(b, axis=0, weights=weight)
        u, singular, vt = np.linalg.svd(((b - mean_b) * weight[:, None]).T @ (a - mean_a))
        R = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
        bias = mean_b - R @ mean_a
        residual = b - a @ R.T - bias
        size = np.linalg.norm(residual, axis=1)
        scale = ROTATING.outlier_times * max(float(np.median(size)), ROTATING.least_residual_rad_s)
        weight = worth / (1.0 + (size / scale) ** 2) ** 2
    spread = float(np.sqrt(np.average(np.sum((b - b.mean(axis=0)) ** 2, axis=1), weights=weight)))
    noise = float(np.sqrt(np.average(np.sum(residual**2, axis=1), weights=weight)))
    # The second singular value measures turning about a second axis; below the fit's own noise it settles nothing.
    total = weight.sum()
    second = float(np.sqrt(max(singular[1], 0.0) / total))
    axis = None
    if second < max(ROTATING.second_axis_rad_s, ROTATING.second_axis_noise * noise):
        axis = b[np.argmax(np.linalg.norm(b - bias, axis=1))] - bias
        u, _, _ = np.linalg.svd(((b - b.mean(axis=0)) * weight[:, None]).T @ (b - b.mean(axis=0)))
        axis = u[:, 0]
    return RotationStart(offset_s, R, bias, noise / max(spread, 1e-9), correlation, axis)


def acceleration_start(track: LidarTrack, imu_s: FloatArray, accel_m_s2: FloatArray) -> list[RotationStart]:
    """Time offset and rotation of a platform that moves without turning, from the accelerations alone, best first.

    The second derivative of the lidar's smoothed position and the equally smoothed specific force differ by a rotation
    and a constant (gravity and bias): Kabsch on both, centred, at the lags where their norms agree.
    """
    width_s, rate = ROTATING.smoothed_s, LAGS.grid_hz
    lidar_t = np.arange(track.start_s[0], track.start_s[-1], 1 / rate)
    imu_t = np.arange(imu_s[0], imu_s[-1], 1 / rate)
    if min(len(lidar_t), len(imu_t)) < ROTATING.least_s * rate:
        return []
    R0 = mean_rotation(track.R)
    position = gaussian_filter1d(track.at(lidar_t)[1], width_s * rate, axis=0)
    lidar = np.gradient(np.gradient(position, 1 / rate, axis=0), 1 / rate, axis=0) @ R0
    force = np.stack([np.interp(imu_t, imu_s, accel_m_s2[:, i]) for i in range(3)], axis=1)
    force = gaussian_filter1d(force, width_s * rate, axis=0)
    force -= force.mean(axis=0)
    lidar -= lidar.mean(axis=0)
    a, b = np.linalg.norm(lidar, axis=1), np.linalg.norm(force, axis=1)
    correlation, overlap = masked_correlation(a, b, np.ones(len(b)))
    lags = track.start_s[0] - imu_t[0] + (np.arange(len(correlation)) - (len(b) - 1)) / rate
    score = np.where(overlap >= max(ROTATING.overlap_s * rate, LAGS.overlap_share * len(a)), correlation, -np.inf)
    starts = []
    for _ in range(ROTATING.lags):
        k = int(np.argmax(score))
        if not np.isfinite(score[k]):
            break
        fits = []
        for offset in lags[k] + _around():
            moved = np.stack([np.interp(lidar_t - offset, imu_t, force[:, i]) for i in range(3)], axis=1)
            inside = (lidar_t - offset > imu_t[0]) & (lidar_t - offset < imu_t[-1])
            x, y = lidar[inside] - lidar[inside].mean(axis=0), moved[inside] - moved[inside].mean(axis=0)
            R = nearest_rotation(y.T @ x)
            rest = float(np.sqrt(np.mean((y - x @ R.T) ** 2) / max(np.mean(y**2), 1e-12)))
            fits.append(RotationStart(float(offset), R, np.zeros(3), rest, float(correlation[k]), None))
        starts.append(min(fits, key=lambda f: f.residual))
        score[np.abs(lags - lags[k]) < LAGS.apart_s] = -np.inf
    return sorted(starts, key=lambda f: f.residual)
