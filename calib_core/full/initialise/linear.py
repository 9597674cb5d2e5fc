"""Gravity, lever arm and accelerometer bias, once time offset and rotation are known.

With the lidar's orientation and position known at every scan, p_imu = p_lidar - R_world_imu p_c, so

    p(m+1) - p(m) - (R(m+1) - R(m)) p_c = v(m) T + g T^2/2 + PP - PPb b_a
    v(m+1) - v(m) = g T + VV - VVb b_a

where VV, PP integrate the rotated readings and VVb, PPb the rotations: linear in v(m), g, p_c, b_a.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from calib_core.full.initialise.settings import LINEAR
from calib_core.full.initialise.start import LidarTrack, LinearStart, RotationStart
from calib_core.imu.silence import spans_silence
from calib_core.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Steps:
    """A linear start and the steps from scan to scan that it was made of. step: (N,) scan before each.   shown_m: (N, 3) map,
    what the track says of it, felt_m: what the IMU does, under the start.   seen: (N, 3, 3) takes from a step what the points
    tell of it.   mean_force_m_s2: (3,) map, of the accelerometer all along: against gravity for what goes nowhere, wherever the
    track slid.
    """

    start: LinearStart
    step: IntArray
    shown_m: FloatArray
    felt_m: FloatArray
    seen: FloatArray
    mean_force_m_s2: FloatArray

    @property
    def off_m(self) -> FloatArray:
        """(N,) how far the track's steps are from the IMU's, as far as they are seen."""
        return np.asarray(np.linalg.norm((self.seen @ (self.shown_m - self.felt_m)[..., None])[..., 0], axis=1))

    @property
    def astray(self) -> BoolArray:
        """(N,) steps that the IMU has not felt: beyond chance, and beyond what the others are off by."""
        off_m = self.off_m
        usual_m = LINEAR.norm_of_median * float(np.median(off_m)) if len(off_m) else 0.0
        return np.asarray(off_m > LINEAR.astray_times * max(LINEAR.position_std_m, usual_m))


def linear_start(
    track: LidarTrack,
    imu_s: FloatArray,
    accel_m_s2: FloatArray,
    start: RotationStart,
    *,
    gravity_m_s2: float,
) -> LinearStart:
    """Gravity, lever arm and accelerometer bias by sparse least squares over the tracked scans."""
    fitted, steps = _fitting(track, imu_s, accel_m_s2, start, gravity_m_s2)
    return fitted(np.ones(steps)).start


def linear_steps(
    track: LidarTrack,
    imu_s: FloatArray,
    accel_m_s2: FloatArray,
    start: RotationStart,
    *,
    gravity_m_s2: float,
    lever_arm_m: FloatArray | None = None,
) -> Steps:
    """The same, with its steps. Where some have gone astray the others tell it: a track that took a box for the floor slid by
    0.7 m within half a second, and turned the lever arm by as much.
    """
    fitted, count = _fitting(track, imu_s, accel_m_s2, start, gravity_m_s2, lever_arm_m)
    steps = fitted(np.ones(count))
    if steps.astray.any():
        for _ in range(LINEAR.robust_passes):
            usual_m = max(float(np.median(steps.off_m)), LINEAR.least_off_m)
            steps = fitted(np.minimum(1.0, LINEAR.astray_times * usual_m / np.maximum(steps.off_m, usual_m)))
    return steps


def _fitting(
    track: LidarTrack,
    imu_s: FloatArray,
    accel_m_s2: FloatArray,
    start: RotationStart,
    gravity_m_s2: float,
    lever_arm_m: FloatArray | None = None,
) -> tuple[Callable[[FloatArray], Steps], int]:
    """The least squares under weights (N,) of the steps' positions, and how many steps there are."""
    stamps = imu_s + start.time_offset_s
    inside = (stamps >= track.start_s[0]) & (stamps <= track.start_s[-1] + track.sweep_s[-1])
    t = stamps[inside]
    orientation = track.at(t)[0] @ start.R_imu_lidar.T
    rotated = (orientation @ accel_m_s2[inside][..., None])[..., 0]
    VV, PP = double_integral(t, rotated, track.start_s)
    VVb, PPb = double_integral(t, orientation.reshape(len(t), 9), track.start_s)
    m = len(track.start_s)
    R_imu = track.R @ start.R_imu_lidar.T
    gaps = np.diff(track.start_s)
    most_gap_s = max(LINEAR.most_gap_s, LINEAR.usual_gaps * float(np.median(gaps))) if len(gaps) else LINEAR.most_gap_s
    felt = (track.start_s[:-1] >= t[0]) & (track.start_s[1:] <= t[-1])
    felt &= ~spans_silence(t, track.start_s[:-1], track.start_s[1:])
    use = np.flatnonzero((gaps < most_gap_s) & felt)
    T = gaps[use]
    rows = _linear_rows(
        use, T, R_imu, VVb.reshape(-1, 3, 3), PPb.reshape(-1, 3, 3), m, LINEAR.position_std_m, LINEAR.velocity_std_m_s
    )
    shown_m = track.p[use + 1] - track.p[use]
    # Both scans have to tell a step; what one does not, the other's mixture with it does not, either.
    seen = (np.eye(3) - track.unseen[use]) @ (np.eye(3) - track.unseen[use + 1])
    only_seen = scipy.sparse.block_diag([*seen, scipy.sparse.identity(3 * len(use))], format="csr")
    rhs_p = (shown_m - PP[use]) / LINEAR.position_std_m
    rhs_v = VV[use] / LINEAR.velocity_std_m_s
    rhs = np.concatenate([rhs_p.ravel(), rhs_v.ravel()])

    def fitted(weight: FloatArray) -> Steps:
        gravity = np.zeros(3)
        solution = np.zeros(3 * m + 9)
        every = np.concatenate([np.repeat(weight, 3), np.ones(3 * len(use))])
        told = scipy.sparse.diags(every) @ only_seen
        weighted = told @ rows
        for _ in range(LINEAR.passes):
            prior, target = _start_priors(m, gravity, gravity_m_s2, lever_arm_m)
            matrix = scipy.sparse.vstack([weighted, prior]).tocsc()
            vector = np.concatenate([told @ rhs, target])
            solution = scipy.sparse.linalg.spsolve((matrix.T @ matrix).tocsc(), matrix.T @ vector)
            gravity = solution[3 * m : 3 * m + 3]
        residual = rows @ solution - rhs
        found = LinearStart(
            gravity,
            solution[3 * m + 3 : 3 * m + 6],
            solution[3 * m + 6 :],
            float(np.sqrt(np.mean((told @ residual) ** 2))),
        )
        felt_m = shown_m + LINEAR.position_std_m * residual[: 3 * len(use)].reshape(-1, 3)
        return Steps(found, use, shown_m, felt_m, seen, rotated.mean(axis=0))

    return fitted, len(use)


def _linear_rows(
    use: IntArray,
    T: FloatArray,
    R_imu: FloatArray,
    VVb: FloatArray,
    PPb: FloatArray,
    m: int,
    std_p: float,
    std_v: float,
) -> scipy.sparse.csr_matrix:
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
    return scipy.sparse.csr_matrix((value, (row, col)), shape=(6 * n, 3 * m + 9))


def _start_priors(
    m: int, gravity: FloatArray, magnitude: float, lever_arm_m: FloatArray | None
) -> tuple[scipy.sparse.csr_matrix, FloatArray]:
    """Weak priors that keep undetermined directions finite: p_c within metres of zero, or as given; bias small, |g| known."""
    size = 3 * m + 9
    std = (LINEAR.any_velocity_m_s,) * m + (LINEAR.any_gravity_m_s2, LINEAR.lever_arm_m, LINEAR.bias_m_s2)
    diagonal = 1.0 / np.repeat(std, 3)
    rows = [scipy.sparse.diags(diagonal)]
    target = np.zeros(size)
    if lever_arm_m is not None:
        held = slice(3 * m + 3, 3 * m + 6)
        diagonal[held] = 1.0 / LINEAR.held_m
        rows = [scipy.sparse.diags(diagonal)]
        target[held] = lever_arm_m / LINEAR.held_m
    norm = float(np.linalg.norm(gravity))
    if norm > LINEAR.least_gravity_m_s2:
        row = np.zeros((1, size))
        row[0, 3 * m : 3 * m + 3] = gravity / norm / LINEAR.gravity_std_m_s2
        rows.append(scipy.sparse.csr_matrix(row))
        target = np.append(target, magnitude / LINEAR.gravity_std_m_s2)
    return scipy.sparse.vstack(rows).tocsr(), target


def double_integral(t: FloatArray, values: FloatArray, marks: FloatArray) -> tuple[FloatArray, FloatArray]:
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
