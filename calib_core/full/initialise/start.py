"""Start values without any guess: time offset, rotation, then gravity, lever arm and accelerometer bias.

1. Time offset: how far a body turns in a given time is the same in any frame. The gyro's turns are correlated with the
   lidar's at every lag the two recordings allow; the best lags go on to 2. The lidar's turns are taken within its sweeps
   or between scans one or three apart, whichever agrees best: the first follows the quickest motion, the last is the
   least noisy, and a sweep that sees its planes for a moment only says nothing by itself.
2. Rotation: turn_imu = R_c turn_lidar + b T, in closed form (Kabsch), for each lag; the lag is refined on the residual of
   that fit. Where all turning is about one axis, the turn about it stays open and is settled in 3.
3. With the lidar's orientation and position known at every scan, p_imu = p_lidar - R_world_imu p_c, so

       p(m+1) - p(m) - (R(m+1) - R(m)) p_c = v(m) T + g T^2/2 + PP - PPb b_a
       v(m+1) - v(m) = g T + VV - VVb b_a

   where VV, PP integrate the rotated readings and VVb, PPb the rotations: linear in v(m), g, p_c, b_a. A turn that was
   left open is the one at which this fits best; where it fits alike at many, that at which planes are plumb and level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft, sparse
from scipy.ndimage import gaussian_filter1d
from scipy.sparse.linalg import spsolve

from calib_core.full.odometry.register import ScanMotion
from calib_core.geometry import exp, log, mean_rotation, nearest_rotation
from calib_core.types import FloatArray, IntArray

GRID_HZ = 50.0


@dataclass(frozen=True)
class LidarTrack:
    """The tracked motion as arrays. start_s: (M,) lidar clock, R, p at the scan's start; rates in the sweep; sweep_s: (M,)."""

    start_s: FloatArray
    sweep_s: FloatArray
    R: FloatArray
    p: FloatArray
    omega_rad_s: FloatArray
    v_m_s: FloatArray

    @staticmethod
    def of(motions: Sequence[ScanMotion], start_s: FloatArray, sweep_s: FloatArray) -> LidarTrack:
        """From tracked scans and their times."""
        return LidarTrack(
            start_s,
            sweep_s,
            np.array([m.R for m in motions]),
            np.array([m.p for m in motions]),
            np.array([m.omega_rad_s for m in motions]),
            np.array([m.v_m_s for m in motions]),
        )

    def at(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lidar poses at instants of the lidar clock: R (N, 3, 3), p (N, 3). Constant rates from each scan's start."""
        m = np.clip(np.searchsorted(self.start_s, t_s, side="right") - 1, 0, len(self.start_s) - 1)
        tau = np.clip(t_s - self.start_s[m], -0.2, 0.3)[:, None]
        return self.R[m] @ exp(self.omega_rad_s[m] * tau), self.p[m] + self.v_m_s[m] * tau


@dataclass(frozen=True)
class RotationStart:
    """A lag and the rotation at it. time_offset_s: added to IMU stamps. open_axis_imu: (3,) where the turn about it is open.

    correlation: of the rates' norms at the lag. residual: rms of the fit over rms of the rates, 0 for perfect.
    """

    time_offset_s: float
    R_imu_lidar: FloatArray
    gyro_bias: FloatArray
    residual: float
    correlation: float
    open_axis_imu: FloatArray | None


@dataclass(frozen=True)
class LinearStart:
    """The linear solution. gravity (3,) map, p_imu_lidar (3,), accel_bias (3,), rms: whitened residual."""

    gravity: FloatArray
    p_imu_lidar: FloatArray
    accel_bias: FloatArray
    rms: float


@dataclass(frozen=True)
class Start:
    """Start values of the joint solve: a rotation and the linear solution with it."""

    rotation: RotationStart
    linear: LinearStart

    @property
    def misfit(self) -> float:
        """Of both steps, to be compared between trials."""
        return self.linear.rms * (1.0 + self.rotation.residual)


@dataclass(frozen=True)
class Turns:
    """The lidar's turns over spans of time. start_s, end_s: (N,) lidar clock. rate_rad_s: (N, 3) rotation vector per second.

    worth: (N,) what each counts for beside the others, None for all alike.
    """

    start_s: FloatArray
    end_s: FloatArray
    rate_rad_s: FloatArray
    worth: FloatArray | None = None


def turns_of(track: LidarTrack) -> list[Turns]:
    """Turns within the sweeps, and between scans one and three apart."""
    out = [Turns(track.start_s, track.start_s + track.sweep_s, track.omega_rad_s)]
    period = float(np.median(np.diff(track.start_s))) if len(track.start_s) > 1 else 0.0
    for apart in (1, 3):
        if len(track.start_s) <= apart:
            continue
        T = track.start_s[apart:] - track.start_s[:-apart]
        rate = log(np.swapaxes(track.R[:-apart], 1, 2) @ track.R[apart:]) / T[:, None]
        whole = (apart + 0.5) * period > T
        out.append(Turns(track.start_s[:-apart][whole], track.start_s[apart:][whole], rate[whole]))
    return out


class GyroTurns:
    """How far the gyro turned over any span, from its running product of rotations. Times on the IMU's clock [s]."""

    def __init__(self, stamps_s: FloatArray, gyro_rad_s: FloatArray) -> None:
        self._t = stamps_s
        self._gyro = gyro_rad_s
        steps = exp(np.diff(stamps_s)[:, None] * 0.5 * (gyro_rad_s[1:] + gyro_rad_s[:-1]))
        self._R = np.concatenate([np.eye(3)[None], _running_product(steps)])

    def at(self, t_s: FloatArray) -> FloatArray:
        """Orientation at instants within the recording, from its first sample: (N, 3, 3). The rate is linear between samples."""
        k = np.clip(np.searchsorted(self._t, t_s, side="right") - 1, 0, len(self._t) - 2)
        tau = (t_s - self._t[k])[:, None]
        slope = (self._gyro[k + 1] - self._gyro[k]) / (self._t[k + 1] - self._t[k])[:, None]
        return self._R[k] @ exp(self._gyro[k] * tau + 0.5 * slope * tau**2)

    def over(self, start_s: FloatArray, end_s: FloatArray) -> FloatArray:
        """(N, 3) rotation vectors per second; NaN where the span leaves the recording."""
        out = log(np.swapaxes(self.at(start_s), 1, 2) @ self.at(end_s)) / (end_s - start_s)[:, None]
        out[(start_s < self._t[0]) | (end_s > self._t[-1])] = np.nan
        return out


def _running_product(steps: FloatArray) -> FloatArray:
    """steps[0] steps[1] ... steps[i] for every i, (N, 3, 3), in log2 N passes over all of them."""
    product = steps.copy()
    reach = 1
    while reach < len(product):
        product[reach:] = product[:-reach] @ product[reach:]
        reach *= 2
    return product


def candidate_lags(turns: Turns, gyro: GyroTurns, imu_s: FloatArray, *, count: int = 6) -> list[tuple[float, float]]:
    """The lags (seconds to add to IMU stamps) at which the turns' sizes agree best, with their correlations, best first."""
    t0, t1 = turns.start_s[0], turns.end_s[-1]
    lidar_t = np.arange(t0, t1, 1 / GRID_HZ)
    norms = np.linalg.norm(turns.rate_rad_s, axis=1)
    # A few spans in which the track leapt would outweigh all others in a correlation.
    norms = np.minimum(norms, 2.0 * np.percentile(norms, 90.0))
    lidar = np.interp(lidar_t, 0.5 * (turns.start_s + turns.end_s), norms)
    imu_t = np.arange(imu_s[0], imu_s[-1], 1 / GRID_HZ)
    width = float(np.median(turns.end_s - turns.start_s))
    mean = gyro.over(imu_t - width / 2, imu_t + width / 2)
    imu = np.linalg.norm(mean, axis=1)
    valid = np.isfinite(imu)
    imu = np.where(valid, imu, 0.0)
    correlation, overlap = masked_correlation(lidar, imu, valid.astype(float))
    # Sample k of the correlation pairs lidar sample i with imu sample i - (k - (len(imu) - 1)).
    shift = np.arange(len(correlation)) - (len(imu) - 1)
    lag = t0 - imu_t[0] + shift / GRID_HZ
    least = min(0.5 * min(len(lidar), len(imu)), max(8.0 * GRID_HZ, 0.3 * len(lidar)))
    score = np.where(overlap >= least, correlation, -np.inf)
    best: list[tuple[float, float]] = []
    while len(best) < count and np.isfinite(score.max()):
        k = int(np.argmax(score))
        best.append((float(lag[k]), float(correlation[k])))
        score[np.abs(lag - lag[k]) < 0.25] = -np.inf
    return best


def masked_correlation(a: FloatArray, b: FloatArray, mask_b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pearson's correlation of a with b at every shift, over the samples that overlap, and how many do."""
    # scipy.signal has this ready, but takes a second to import.
    size = len(a) + len(b) - 1
    fast = fft.next_fast_len(size, real=True)

    def cross(x: FloatArray, y: FloatArray) -> FloatArray:
        return np.asarray(fft.irfft(fft.rfft(x, fast) * fft.rfft(y[::-1], fast), fast)[:size])

    ones = np.ones_like(a)
    n = np.maximum(cross(ones, mask_b), 1.0)
    mean_a, mean_b = cross(a, mask_b) / n, cross(ones, b * mask_b) / n
    var_a = cross(a**2, mask_b) / n - mean_a**2
    var_b = cross(ones, b**2 * mask_b) / n - mean_b**2
    cov = cross(a, b * mask_b) / n - mean_a * mean_b
    floor = 1e-3 * float(np.var(a)) + 1e-12
    return cov / np.sqrt(np.maximum(var_a, floor) * np.maximum(var_b, floor)), np.rint(n)


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
        offsets = lag + np.arange(-0.06, 0.0601, 0.005)
        fits = [_fit_rotation(turns, gyro, o, correlation) for o in offsets]
        values = np.array([f.residual if f is not None else np.inf for f in fits])
        k = int(np.argmin(values))
        if not np.isfinite(values[k]):
            continue
        offset = offsets[k]
        if 0 < k < len(values) - 1 and np.isfinite(values[[k - 1, k + 1]]).all():
            left, mid, right = values[k - 1 : k + 2] ** 2
            bend = left - 2 * mid + right
            offset += 0.005 * 0.5 * (left - right) / bend if bend > 0 else 0.0
        refined = _fit_rotation(turns, gyro, float(offset), correlation)
        if refined is not None:
            starts.append(refined)
    return sorted(starts, key=lambda s: s.residual)


def _fit_rotation(turns: Turns, gyro: GyroTurns, offset_s: float, correlation: float) -> RotationStart | None:
    """Kabsch on the two streams of turns at one lag, reweighted against outliers."""
    imu = gyro.over(turns.start_s - offset_s, turns.end_s - offset_s)
    use = np.isfinite(imu[:, 0])
    if use.sum() < 10:
        return None
    a, b = turns.rate_rad_s[use], imu[use]
    worth = np.ones(len(a)) if turns.worth is None else turns.worth[use] / turns.worth[use].mean()
    weight = worth
    R, bias, singular = np.eye(3), np.zeros(3), np.zeros(3)
    residual = np.zeros_like(a)
    for _ in range(4):
        mean_a, mean_b = np.average(a, axis=0, weights=weight), np.average(b, axis=0, weights=weight)
        u, singular, vt = np.linalg.svd(((b - mean_b) * weight[:, None]).T @ (a - mean_a))
        R = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
        bias = mean_b - R @ mean_a
        residual = b - a @ R.T - bias
        size = np.linalg.norm(residual, axis=1)
        scale = 3.0 * max(float(np.median(size)), 1e-4)
        weight = worth / (1.0 + (size / scale) ** 2) ** 2
    spread = float(np.sqrt(np.average(np.sum((b - b.mean(axis=0)) ** 2, axis=1), weights=weight)))
    noise = float(np.sqrt(np.average(np.sum(residual**2, axis=1), weights=weight)))
    # The second singular value measures turning about a second axis; below the fit's own noise it settles nothing.
    total = weight.sum()
    second = float(np.sqrt(max(singular[1], 0.0) / total))
    axis = None
    if second < max(0.02, 1.5 * noise):
        axis = b[np.argmax(np.linalg.norm(b - bias, axis=1))] - bias
        u, _, _ = np.linalg.svd(((b - b.mean(axis=0)) * weight[:, None]).T @ (b - b.mean(axis=0)))
        axis = u[:, 0]
    return RotationStart(offset_s, R, bias, noise / max(spread, 1e-9), correlation, axis)


def acceleration_start(track: LidarTrack, imu_s: FloatArray, accel_m_s2: FloatArray) -> list[RotationStart]:
    """Time offset and rotation of a platform that moves without turning, from the accelerations alone, best first.

    The second derivative of the lidar's smoothed position and the equally smoothed specific force differ by a rotation
    and a constant (gravity and bias): Kabsch on both, centred, at the lags where their norms agree.
    """
    width_s, rate = 0.12, GRID_HZ
    lidar_t = np.arange(track.start_s[0], track.start_s[-1], 1 / rate)
    imu_t = np.arange(imu_s[0], imu_s[-1], 1 / rate)
    if len(lidar_t) < 4 * rate or len(imu_t) < 4 * rate:
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
    score = np.where(overlap >= max(5 * rate, 0.3 * len(a)), correlation, -np.inf)
    starts = []
    for _ in range(5):
        k = int(np.argmax(score))
        if not np.isfinite(score[k]):
            break
        fits = []
        for offset in lags[k] + np.arange(-0.06, 0.0601, 0.005):
            moved = np.stack([np.interp(lidar_t - offset, imu_t, force[:, i]) for i in range(3)], axis=1)
            inside = (lidar_t - offset > imu_t[0]) & (lidar_t - offset < imu_t[-1])
            x, y = lidar[inside] - lidar[inside].mean(axis=0), moved[inside] - moved[inside].mean(axis=0)
            R = nearest_rotation(y.T @ x)
            rest = float(np.sqrt(np.mean((y - x @ R.T) ** 2) / max(np.mean(y**2), 1e-12)))
            fits.append(RotationStart(float(offset), R, np.zeros(3), rest, float(correlation[k]), None))
        starts.append(min(fits, key=lambda f: f.residual))
        score[np.abs(lags - lags[k]) < 0.25] = -np.inf
    return sorted(starts, key=lambda f: f.residual)


def linear_start(
    track: LidarTrack,
    imu_s: FloatArray,
    accel_m_s2: FloatArray,
    start: RotationStart,
    *,
    gravity_m_s2: float,
    position_std_m: float = 0.015,
    velocity_std_m_s: float = 0.02,
) -> LinearStart:
    """Gravity, lever arm and accelerometer bias by sparse least squares over the tracked scans."""
    stamps = imu_s + start.time_offset_s
    inside = (stamps >= track.start_s[0]) & (stamps <= track.start_s[-1] + track.sweep_s[-1])
    t = stamps[inside]
    orientation = track.at(t)[0] @ start.R_imu_lidar.T
    rotated = (orientation @ accel_m_s2[inside][..., None])[..., 0]
    VV, PP = _double_integral(t, rotated, track.start_s)
    VVb, PPb = _double_integral(t, orientation.reshape(len(t), 9), track.start_s)
    m = len(track.start_s)
    R_imu = track.R @ start.R_imu_lidar.T
    gaps = np.diff(track.start_s)
    use = np.flatnonzero((gaps < 0.35) & (track.start_s[:-1] >= t[0]) & (track.start_s[1:] <= t[-1]))
    T = gaps[use]
    rows = _linear_rows(
        use, T, R_imu, VVb.reshape(-1, 3, 3), PPb.reshape(-1, 3, 3), m, position_std_m, velocity_std_m_s
    )
    rhs_p = (track.p[use + 1] - track.p[use] - PP[use]) / position_std_m
    rhs_v = -VV[use] / velocity_std_m_s
    rhs = np.concatenate([rhs_p.ravel(), -rhs_v.ravel()])
    gravity = np.zeros(3)
    solution = np.zeros(3 * m + 9)
    for _ in range(3):
        prior, target = _start_priors(m, gravity, gravity_m_s2)
        matrix = sparse.vstack([rows, prior]).tocsc()
        vector = np.concatenate([rhs, target])
        solution = spsolve((matrix.T @ matrix).tocsc(), matrix.T @ vector)
        gravity = solution[3 * m : 3 * m + 3]
    residual = rows @ solution - rhs
    return LinearStart(
        gravity, solution[3 * m + 3 : 3 * m + 6], solution[3 * m + 6 :], float(np.sqrt(np.mean(residual**2)))
    )


def _linear_rows(
    use: IntArray,
    T: FloatArray,
    R_imu: FloatArray,
    VVb: FloatArray,
    PPb: FloatArray,
    m: int,
    std_p: float,
    std_v: float,
) -> sparse.csr_matrix:
    """Whitened rows of both equations over v (3 m), g, p_c, b_a."""
    n = len(use)
    eye = np.broadcast_to(np.eye(3), (n, 3, 3))
    lever = R_imu[use + 1] - R_imu[use]
    blocks_p = [(use, eye * T[:, None, None]), (m, eye * (T**2 / 2)[:, None, None]), (m + 1, lever), (m + 2, -PPb[use])]
    blocks_v = [(use + 1, eye), (use, -eye), (m, -eye * T[:, None, None]), (m + 2, VVb[use])]
    triplets: list[tuple[IntArray, IntArray, FloatArray]] = []
    for base, std, blocks in ((0, std_p, blocks_p), (3 * n, std_v, blocks_v)):
        for column, values in blocks:
            row = base + 3 * np.arange(n)[:, None, None] + np.arange(3)[None, :, None] + np.zeros((1, 1, 3), int)
            col = (
                3 * np.broadcast_to(np.asarray(column), (n,))[:, None, None]
                + np.arange(3)[None, None, :]
                + np.zeros((1, 3, 1), int)
            )
            triplets.append((row.ravel(), col.ravel(), (values / std).ravel()))
    row, col, value = (np.concatenate([t[i] for t in triplets]) for i in range(3))
    return sparse.csr_matrix((value, (row, col)), shape=(6 * n, 3 * m + 9))


def _start_priors(m: int, gravity: FloatArray, magnitude: float) -> tuple[sparse.csr_matrix, FloatArray]:
    """Weak priors that keep undetermined directions finite: p_c within metres of zero, bias small, |g| known."""
    size = 3 * m + 9
    diagonal = np.concatenate([np.full(3 * m, 1e-3), np.full(3, 1e-4), np.full(3, 0.5), np.full(3, 1 / 0.3)])
    rows = [sparse.diags(diagonal)]
    target = np.zeros(size)
    norm = float(np.linalg.norm(gravity))
    if norm > 1.0:
        row = np.zeros((1, size))
        row[0, 3 * m : 3 * m + 3] = gravity / norm / 0.02
        rows.append(sparse.csr_matrix(row))
        target = np.append(target, magnitude / 0.02)
    return sparse.vstack(rows).tocsr(), target


def _double_integral(t: FloatArray, values: FloatArray, marks: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Integral, and integral of the integral, of samples over each interval between marks: (M - 1, C) each."""
    dt = np.diff(t)[:, None]
    single = np.vstack([np.zeros(values.shape[1]), np.cumsum(0.5 * dt * (values[1:] + values[:-1]), axis=0)])
    # On each step the integrand is linear, its integral quadratic, its double integral cubic.
    inner = single[:-1] * dt + dt**2 * (values[:-1] / 3 + values[1:] / 6)
    double = np.vstack([np.zeros(values.shape[1]), np.cumsum(inner, axis=0)])
    k = np.clip(np.searchsorted(t, marks, side="right") - 1, 0, len(t) - 2)
    s = (marks - t[k])[:, None]
    slope = (values[k + 1] - values[k]) / dt[k]
    V = single[k] + values[k] * s + slope * s**2 / 2
    P = double[k] + single[k] * s + values[k] * s**2 / 2 + slope * s**3 / 6
    T = np.diff(marks)[:, None]
    return V[1:] - V[:-1], P[1:] - P[:-1] - V[:-1] * T
