"""The rotation at each lag, and the lag refined on what the rotation leaves.

    turn_imu = R_c turn_lidar + b T,        in closed form (Kabsch)

Where all turning is about one axis, the turn about it stays open and is settled by what follows. A platform that does not
turn at all has its rotation from the accelerations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import scipy

from calib_core.full.initialise.settings import AGREEING, LAGS, ROTATING
from calib_core.full.initialise.start import LidarTrack, RotationStart
from calib_core.full.initialise.time_offset import (
    GyroTurns,
    LidarTurns,
    candidate_lags,
    masked_correlation,
    nearest_peaks,
    turns_of,
)
from calib_core.geometry import mean_rotation, nearest_rotation
from calib_core.memoised import memoised
from calib_core.threads import workers
from calib_core.types import BoolArray, FloatArray


@memoised
def rotation_start(track: LidarTrack, imu_s: FloatArray, gyro_rad_s: FloatArray) -> list[RotationStart]:
    """Time offset and rotation, best first; more than one where several lags explain the motion about as well."""
    return fit_lags(*best_turns(track, imu_s, gyro_rad_s))


def best_turns(
    track: LidarTrack, imu_s: FloatArray, gyro_rad_s: FloatArray
) -> tuple[LidarTurns, GyroTurns, list[tuple[float, float]]]:
    """The turns that agree best with the gyroscope's, these, and the lags at which they do, with their correlations."""
    gyro = GyroTurns(imu_s, gyro_rad_s)
    kinds = [(turns, candidate_lags(turns, gyro, imu_s)) for turns in turns_of(track)]
    turns, lags = max(kinds, key=lambda kind: kind[1][0][1] if kind[1] else -np.inf)
    return turns, gyro, lags


def is_worse(left: float, best: float) -> bool:
    """Whether a rotation that leaves so much is no candidate beside the best."""
    return left > max(ROTATING.worse_times * best, best + ROTATING.worse_share)


def left_by(turns: LidarTurns, gyro: GyroTurns, offset_s: float, R_imu_lidar: FloatArray) -> FloatArray:
    """What each rotation (K, 3, 3) leaves of the turns at a lag, as `RotationStart.residual` has it. Turns that the first one
    leaves far off count little.
    """
    b = gyro.over(turns.start_s - offset_s, turns.end_s - offset_s)
    use = np.isfinite(b[:, 0])
    left = b[use] - turns.rate_rad_s[use] @ np.swapaxes(R_imu_lidar, 1, 2)
    left = left - np.median(left, axis=1)[:, None]
    size = np.linalg.norm(left, axis=2)
    weight = outlier_weights(size[:1], np.ones((1, size.shape[1]), bool))[0]
    spread = np.sum(weight * np.sum((b[use] - b[use].mean(axis=0)) ** 2, axis=1))
    return np.asarray(np.sqrt(np.sum(weight * size**2, axis=1) / spread))


def fit_lags(turns: LidarTurns, gyro: GyroTurns, lags: Sequence[tuple[float, float]]) -> list[RotationStart]:
    """The rotation at each lag, the lag refined on the residual; best first, and of such as good the nearest to the stamps' own.

    lags: with their correlations.
    """
    fits = workers().map(lambda lag: _fit_lag(turns, gyro, *lag), lags)

    def left(lags_s: FloatArray) -> list[float]:
        return [f.residual for f in _fit_rotations(turns, gyro, lags_s, 0.0) if f is not None]

    return _nearest_first(sorted((f for f in fits if f is not None), key=lambda f: f.residual), left)


def _nearest_first(found: list[RotationStart], left: Callable[[FloatArray], list[float]]) -> list[RotationStart]:
    """Of lags that leave about as little as the best, each a valley of its own, the one nearest to the stamps' own before all.

    A motion that repeats itself is as good a match a round later, and stamps are hardly off by a round. left: residuals at lags.
    """
    if not found or found[0].residual > AGREEING.fits:
        return found
    best = found[0]
    alike = [f for f in found if f.residual <= ROTATING.alike * best.residual and _is_apart(f, best, left)]
    nearest, *others = sorted([best, *alike], key=lambda f: abs(f.time_offset_s))
    repeated = replace(nearest, repeats_s=tuple(f.time_offset_s for f in others))
    return [repeated, *(f for f in found if f is not nearest)]


def _is_apart(one: RotationStart, best: RotationStart, left: Callable[[FloatArray], list[float]]) -> bool:
    """Whether the fit is worse between two lags: a slow motion's is about as good for a quarter of a second on either side."""
    between = np.linspace(best.time_offset_s, one.time_offset_s, ROTATING.between + 2)[1:-1]
    return max(left(between), default=0.0) > ROTATING.worse_times * one.residual


def _fit_lag(turns: LidarTurns, gyro: GyroTurns, lag_s: float, correlation: float) -> RotationStart | None:
    """The rotation about a lag, at the lag that leaves least; None where too few turns are in common."""
    offsets = lag_s + _around()
    values = np.array([np.inf if f is None else f.residual for f in _fit_rotations(turns, gyro, offsets, correlation)])
    k = int(np.argmin(values))
    if not np.isfinite(values[k]):
        return None
    offset = offsets[k]
    if 0 < k < len(values) - 1 and np.isfinite(values[[k - 1, k + 1]]).all():
        left, mid, right = values[k - 1 : k + 2] ** 2
        bend = left - 2 * mid + right
        offset += ROTATING.step_s * 0.5 * (left - right) / bend if bend > 0 else 0.0
    found = _fit_rotations(turns, gyro, np.array([offset]), correlation)[0]
    return None if found is None else with_uncertainty(turns, gyro, found)


def with_uncertainty(turns: LidarTurns, gyro: GyroTurns, found: RotationStart) -> RotationStart:
    """The same, with how well turns tell it:

        covariance(R) = s^2 (sum w (|a|^2 I - a a'))^-1,        s^2 = noise^2 (1 + 2 sum of its autocorrelation)

    a: turns from their mean.   noise: what the fit leaves along one axis. A track that drifts leaves for a second what it leaves
    for a scan: as long as neighbours are alike they are one piece of evidence, as if the rig turned one way for as long.
    """
    b = gyro.over(turns.start_s - found.time_offset_s, turns.end_s - found.time_offset_s)
    use = np.isfinite(b[:, 0])
    a, t_s = turns.rate_rad_s[use], turns.start_s[use]
    left = b[use] - a @ found.R_imu_lidar.T - found.gyro_bias
    weight = outlier_weights(np.linalg.norm(left, axis=1)[None], np.ones((1, len(left)), bool))[0]
    weight = weight if turns.worth is None else weight * turns.worth[use]
    total = float(weight.sum())
    mean = weight @ a / total
    spread = (weight[:, None] * (a - mean)).T @ (a - mean)
    told = float(np.linalg.eigvalsh(np.trace(spread) * np.eye(3) - spread)[0])
    noise = np.sqrt(np.sum(weight[:, None] * left**2) / (3.0 * total) * _lasting(left * np.sqrt(weight)[:, None], t_s))
    std = min(float(noise / np.sqrt(told)), np.pi) if told > 0.0 else np.pi
    bias_std = float(np.hypot(noise / np.sqrt(total), std * np.linalg.norm(mean)))
    return replace(found, std_rad=std, bias_std_rad_s=bias_std)


def _lasting(left: FloatArray, t_s: FloatArray) -> float:
    """How many turns in a row are one piece of evidence, as what is left of them (N, 3), at (N,), is alike for so long."""
    power = float(np.sum(left**2))
    if len(left) < ROTATING.parts or power <= 0.0:
        return 1.0
    longest = round(ROTATING.lasts_s / max(float(np.median(np.diff(t_s))), 1e-3))
    lasting = 1.0
    for lag in range(1, min(longest, len(left) // ROTATING.parts) + 1):
        alike = float(np.sum(left[lag:] * left[:-lag])) / power
        if alike <= 0.0:
            break
        lasting += 2.0 * alike
    return lasting


def _around() -> FloatArray:
    """Offsets from a lag at which the rotation is tried."""
    half = 0.5 * ROTATING.step_s
    return np.arange(-ROTATING.around_s, ROTATING.around_s + half, ROTATING.step_s)


def _fit_rotations(
    turns: LidarTurns, gyro: GyroTurns, offsets_s: FloatArray, correlation: float
) -> list[RotationStart | None]:
    """Kabsch on the two streams of turns at each of these lags (O,), reweighted against outliers; all of them at once."""
    at_once = offsets_s[:, None]
    b = gyro.over((turns.start_s - at_once).ravel(), (turns.end_s - at_once).ravel()).reshape(len(offsets_s), -1, 3)
    use = np.isfinite(b[..., 0])
    enough = np.count_nonzero(use, axis=1) >= ROTATING.fewest_turns
    if not enough.any():
        return [None] * len(offsets_s)
    offsets_s, b, use = offsets_s[enough], np.where(use[..., None], b, 0.0)[enough], use[enough]
    a = turns.rate_rad_s
    worth = use * (1.0 if turns.worth is None else turns.worth)
    worth = worth * (np.count_nonzero(use, axis=1) / worth.sum(axis=1))[:, None]
    R, bias, singular, size = _kabsch(a, b, worth)
    weight = worth * outlier_weights(size, use)
    for _ in range(ROTATING.passes - 1):
        R, bias, singular, size = _kabsch(a, b, weight)
        weight = worth * outlier_weights(size, use)
    total = weight.sum(axis=1)
    centred = b - (np.einsum("on,oni->oi", use, b) / np.count_nonzero(use, axis=1)[:, None])[:, None]
    spread = np.sqrt(np.sum(weight * np.sum(centred**2, axis=2), axis=1) / total)
    noise = np.sqrt(np.sum(weight * size**2, axis=1) / total)
    # The second singular value measures turning about a second axis; below the fit's own noise it settles nothing.
    second = np.sqrt(np.maximum(singular[:, 1], 0.0) / total)
    open_axis = second < np.maximum(ROTATING.second_axis_rad_s, ROTATING.second_axis_noise * noise)
    fits: list[RotationStart | None] = [None] * len(enough)
    for k, at in enumerate(np.flatnonzero(enough)):
        axis = np.linalg.svd((centred[k] * weight[k][:, None]).T @ centred[k])[0][:, 0] if open_axis[k] else None
        residual_share = float(noise[k] / max(spread[k], 1e-9))
        fits[at] = RotationStart(float(offsets_s[k]), R[k], bias[k], residual_share, correlation, axis)
    return fits


def _kabsch(a: FloatArray, b: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The rotations and constants that turn a into each of b, the singular values, and what is left of each turn.

    a: (N, 3).   b: (O, N, 3).   weight: (O, N).   Returns R (O, 3, 3), bias (O, 3), singular (O, 3), size (O, N).
    """
    share = weight / weight.sum(axis=1)[:, None]
    mean_a, mean_b = share @ a, np.einsum("on,oni->oi", share, b)
    u, singular, vt = np.linalg.svd(
        np.swapaxes((b - mean_b[:, None]) * weight[..., None], 1, 2) @ (a - mean_a[:, None])
    )
    handed = np.ones((len(u), 3))
    handed[:, 2] = np.linalg.det(u @ vt)
    R = (u * handed[:, None]) @ vt
    bias = mean_b - np.einsum("oij,oj->oi", R, mean_a)
    return R, bias, singular, np.linalg.norm(b - a @ np.swapaxes(R, 1, 2) - bias[:, None], axis=2)


def outlier_weights(size: FloatArray, of: BoolArray) -> FloatArray:
    """The weight of each turn by what is left of it, beside the median of those of its row that count. size, of: (O, N)."""
    ordered = np.sort(np.where(of, size, np.inf), axis=1)
    count, row = np.count_nonzero(of, axis=1), np.arange(len(size))
    median = 0.5 * (ordered[row, (count - 1) // 2] + ordered[row, count // 2])
    scale = ROTATING.outlier_times * np.maximum(median, ROTATING.least_residual_rad_s)
    return np.asarray(1.0 / (1.0 + (size / scale[:, None]) ** 2) ** 2)


def acceleration_start(track: LidarTrack, imu_s: FloatArray, accel_m_s2: FloatArray) -> list[RotationStart]:
    """Time offset and rotation of a platform that moves without turning, from the accelerations alone, best first, and of such as
    good the nearest to the stamps' own.

    The second derivative of the lidar's smoothed position and the equally smoothed specific force differ by a rotation
    and a constant (gravity and bias): Kabsch on both, centred, at the lags where their norms agree.
    """
    width_s, rate = ROTATING.smoothed_s, LAGS.grid_hz
    lidar_t = np.arange(track.start_s[0], track.start_s[-1], 1 / rate)
    imu_t = np.arange(imu_s[0], imu_s[-1], 1 / rate)
    if min(len(lidar_t), len(imu_t)) < ROTATING.least_s * rate:
        return []
    R0 = mean_rotation(track.R)
    position = scipy.ndimage.gaussian_filter1d(track.at(lidar_t)[1], width_s * rate, axis=0)
    lidar = np.gradient(np.gradient(position, 1 / rate, axis=0), 1 / rate, axis=0) @ R0
    # What is smoothed beyond either end is mirrored there, which nothing moved by: a lag that leaves an end out would fit better.
    edge = 3 * math.ceil(width_s * rate)
    lidar_t, lidar = lidar_t[edge:-edge], lidar[edge:-edge]
    scan = np.clip(np.searchsorted(track.start_s, lidar_t, side="right") - 1, 0, len(track.start_s) - 1)
    seen = np.eye(3) - (R0.T @ track.unseen @ R0)[scan]
    lidar = _times(seen, lidar)
    force = np.stack([np.interp(imu_t, imu_s, accel_m_s2[:, i]) for i in range(3)], axis=1)
    force = scipy.ndimage.gaussian_filter1d(force, width_s * rate, axis=0)
    force -= force.mean(axis=0)
    lidar -= lidar.mean(axis=0)
    a, b = np.linalg.norm(lidar, axis=1), np.linalg.norm(force, axis=1)
    correlation, overlap = masked_correlation(a, b, np.ones(len(b)))
    lags = lidar_t[0] - imu_t[0] + (np.arange(len(correlation)) - (len(b) - 1)) / rate
    score = np.where(overlap >= max(ROTATING.overlap_s * rate, LAGS.overlap_share * len(a)), correlation, -np.inf)
    nearest = nearest_peaks(lags, score)
    tried: list[int] = []
    while len(tried) < ROTATING.lags and np.isfinite(score.max()):
        tried.append(int(np.argmax(score)))
        score[np.abs(lags - lags[tried[-1]]) < LAGS.apart_s] = -np.inf
    tried += [k for k in nearest if np.isfinite(score[k])]

    def fit(offset_s: float, alike: float) -> RotationStart:
        moved = np.stack([np.interp(lidar_t - offset_s, imu_t, force[:, i]) for i in range(3)], axis=1)
        inside = (lidar_t - offset_s > imu_t[0]) & (lidar_t - offset_s < imu_t[-1])
        x, y, told = lidar[inside], moved[inside] - moved[inside].mean(axis=0), seen[inside]
        R = _of_seen(x, y, told)
        by_imu = _times(told, y @ R)
        rest = float(np.sqrt(np.mean((by_imu - x) ** 2) / max(np.mean(by_imu**2), 1e-12)))
        return RotationStart(offset_s, R, np.zeros(3), rest, alike, None)

    starts = [
        min((fit(float(lags[k] + away), float(correlation[k])) for away in _around()), key=lambda f: f.residual)
        for k in tried
    ]
    return _nearest_first(
        sorted(starts, key=lambda f: f.residual), lambda between: [fit(lag, 0.0).residual for lag in between.tolist()]
    )


def _of_seen(lidar: FloatArray, imu: FloatArray, seen: FloatArray) -> FloatArray:
    """The rotation R with imu = R lidar, (N, 3) each, of what is seen of the latter alone: seen (N, 3, 3).

    What no plane tells is filled with what the IMU has of it under the rotation so far, until that no longer changes.
    """
    R = nearest_rotation(imu.T @ lidar)
    for _ in range(ROTATING.fillings):
        filled = lidar + imu @ R - _times(seen, imu @ R)
        R, before = nearest_rotation(imu.T @ (filled - filled.mean(axis=0))), R
        if np.abs(R - before).max() < ROTATING.filled:
            break
    return R


def _times(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Each of the matrices (N, 3, 3) times its vector (N, 3)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])
