"""The cost of eq. (2) with the weights of eq. (14), its normal equations, and steps on the manifold.

Unknowns of a knot (one per scan): phi, p, v. Shared, the border of the arrow, in this order:

    0:3 R_imu_lidar   3:6 p_imu_lidar   6 time shift   7:10 gyro bias   10:13 accelerometer bias   13:15 first attitude

The first knot has p = 0 and no attitude of its own: R_W^0 is shared, since eq. (9) puts it into every lidar factor.
Of its
three degrees of freedom the turn about the vertical changes nothing and is held: the two left turn about the world's
horizontal axes, R0 Exp(R0' [a, b, 0]).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.geometry import exp
from calib_core.paper.imu_factor import imu_factors, imu_residuals
from calib_core.paper.lidar_factor import (
    CalibrationState,
    LidarFactors,
    LidarMeasurements,
    ScanStates,
    lidar_distances,
    lidar_factors,
)
from calib_core.paper.preintegration import Preintegrated
from calib_core.paper.records import ImuStates
from calib_core.paper.weights import Weights
from calib_core.solver.arrow import ArrowSolution
from calib_core.solver.system import ArrowSystem
from calib_core.types import FloatArray, IntArray

N_SHARED = 15
_FIRST_ATTITUDE = slice(13, 15)


@dataclass(frozen=True)
class PaperState:
    """The paper's S: shared unknowns and the IMU states at every knot."""

    shared: CalibrationState
    knots: ImuStates

    def moved(self, step: FloatArray, step_shared: FloatArray) -> PaperState:
        """The state after a step. step: (M, 9) phi, p, v.   step_shared: (15,)."""
        s, c = step_shared, self.shared
        shared = CalibrationState(
            c.R_imu_lidar @ exp(s[0:3]),
            c.p_imu_lidar + s[3:6],
            c.gyro_bias_delta + s[7:10],
            c.accel_bias_delta + s[10:13],
            c.time_delta_s + float(s[6]),
        )
        turn = step[:, :3].copy()
        turn[0] = first_attitude_basis(self.knots.R[0]) @ s[_FIRST_ATTITUDE]
        knots = ImuStates(self.knots.R @ exp(turn), self.knots.p + step[:, 3:6], self.knots.v + step[:, 6:9])
        return PaperState(shared, knots)


def first_attitude_basis(R_world_imu_first: FloatArray) -> FloatArray:
    """(3, 2): turns of the first attitude about the world's horizontal axes, in the IMU's axes."""
    return R_world_imu_first.T[:, :2]


@dataclass(frozen=True)
class PaperProblem:
    """All measurements and weights.

    lidar: points sorted by knot.   knot_of_point: (N,).   links: preintegrated from each knot to the next, (M - 1,).
    duration_s: (M - 1,).   fixed_knots: IMU states are known (IV-A.3, IV-A.4): only the first 13 shared unknowns move.
    """

    lidar: LidarMeasurements
    knot_of_point: IntArray
    links: Preintegrated
    duration_s: FloatArray
    gravity_world: FloatArray
    weights: Weights
    fixed_knots: bool

    def distances(self, state: PaperState) -> FloatArray:
        """Point-to-plane distances, (N,) [m]."""
        at = _at_points(state.knots, self.knot_of_point)
        return lidar_distances(self.lidar, state.shared, at, state.knots.R[0], self.gravity_world)

    def lidar_factors(self, state: PaperState) -> LidarFactors:
        """Distances and Jacobians."""
        at = _at_points(state.knots, self.knot_of_point)
        return lidar_factors(self.lidar, state.shared, at, state.knots.R[0], self.gravity_world)

    def cost(self, state: PaperState) -> float:
        """Half the sum of squares."""
        lidar = float(np.sum(self.weights.inverse_var_d * self.distances(state) ** 2))
        first, second = _pairs(state.knots)
        residual = imu_residuals(self.links, self.duration_s, first, second, state.shared, self.gravity_world)
        return 0.5 * (lidar + float(np.sum((self.weights.sqrt_info @ residual[..., None]) ** 2)))

    def linearised(self, state: PaperState) -> ArrowSystem:
        """The normal equations at a state."""
        system = ArrowSystem.zeros(state.knots.R.shape[0], 9, N_SHARED)
        self._add_lidar(system, state)
        self._add_imu(system, state)
        self._hold(system)
        return system

    def _add_lidar(self, system: ArrowSystem, state: PaperState) -> None:
        f = self.lidar_factors(state)
        basis = first_attitude_basis(state.knots.R[0])
        root = np.sqrt(self.weights.inverse_var_d)[:, None]
        own = root * np.hstack([f.dist_D_phi, f.dist_D_p, f.dist_D_v])
        shared = root * np.hstack(
            [f.dist_D_phic, f.dist_D_pc, f.dist_D_t[:, None], f.dist_D_bg, f.dist_D_ba, f.dist_D_phi0 @ basis]
        )
        residual = root[:, 0] * f.dist_m
        bounds = np.searchsorted(self.knot_of_point, np.arange(system.diagonal.shape[0] + 1))
        for knot in np.flatnonzero(np.diff(bounds)):
            rows = slice(bounds[knot], bounds[knot + 1])
            system.diagonal[knot] += own[rows].T @ own[rows]
            system.border[knot] += own[rows].T @ shared[rows]
            system.gradient[knot] += own[rows].T @ residual[rows]
        system.corner += shared.T @ shared
        system.gradient_shared += shared.T @ residual
        system.cost += 0.5 * float(residual @ residual)

    def _add_imu(self, system: ArrowSystem, state: PaperState) -> None:
        first, second = _pairs(state.knots)
        f = imu_factors(self.links, self.duration_s, first, second, state.shared, self.gravity_world)
        L = self.weights.sqrt_info
        residual = (L @ f.residual[..., None])[..., 0]
        own, other = L @ f.r_D_first, L @ f.r_D_second
        shared = np.zeros((residual.shape[0], 9, N_SHARED))
        shared[:, :, 6] = (L @ f.r_D_t[..., None])[..., 0]
        shared[:, :, 7:10] = L @ f.r_D_bg
        shared[:, :, 10:13] = L @ f.r_D_ba
        # The first knot's attitude is the shared one.
        shared[0, :, _FIRST_ATTITUDE] = own[0, :, :3] @ first_attitude_basis(state.knots.R[0])
        own_t, other_t, shared_t = np.swapaxes(own, 1, 2), np.swapaxes(other, 1, 2), np.swapaxes(shared, 1, 2)
        system.diagonal[:-1] += own_t @ own
        system.diagonal[1:] += other_t @ other
        system.lower += other_t @ own
        system.border[:-1] += own_t @ shared
        system.border[1:] += other_t @ shared
        system.corner += np.sum(shared_t @ shared, axis=0)
        system.gradient[:-1] += (own_t @ residual[..., None])[..., 0]
        system.gradient[1:] += (other_t @ residual[..., None])[..., 0]
        system.gradient_shared += np.sum(shared_t @ residual[..., None], axis=0)[:, 0]
        system.cost += 0.5 * float(np.sum(residual**2))

    def _hold(self, system: ArrowSystem) -> None:
        """Takes what is not an unknown out of the equations: a unit diagonal, no coupling, no gradient."""
        held = np.zeros(system.gradient.shape, dtype=bool)
        held[0, :6] = True
        if self.fixed_knots:
            held[:] = True
            system.corner[_FIRST_ATTITUDE] = system.corner[:, _FIRST_ATTITUDE] = 0.0
            system.corner[_FIRST_ATTITUDE, _FIRST_ATTITUDE] = np.eye(2)
            system.gradient_shared[_FIRST_ATTITUDE] = 0.0
        free: FloatArray = (~held).astype(np.float64)
        system.diagonal *= free[:, :, None] * free[:, None, :]
        system.diagonal[:, np.arange(9), np.arange(9)] += 1.0 - free
        system.lower *= free[1:, :, None] * free[:-1, None, :]
        system.border *= free[:, :, None]
        system.gradient *= free


def covariance_of_calibration(solution: ArrowSolution) -> FloatArray:
    """The (7, 7) covariance of rotation, lever arm and time shift, all else marginalised.

    The contract's standing prior (1 rad, 10 m, 10 s; as wide for the biases and the first attitude) keeps it finite.
    """
    standing: FloatArray = np.array([1.0] * 3 + [10.0] * 4 + [1.0] * 3 + [10.0] * 3 + [1.0] * 2)
    information: FloatArray = solution.information + np.diag(1.0 / standing**2)
    covariance = np.linalg.inv(information)[:7, :7]
    return 0.5 * (covariance + covariance.T)


def _at_points(knots: ImuStates, knot_of_point: IntArray) -> ScanStates:
    return ScanStates(knots.R[knot_of_point], knots.p[knot_of_point], knots.v[knot_of_point])


def _pairs(knots: ImuStates) -> tuple[ScanStates, ScanStates]:
    return ScanStates(knots.R[:-1], knots.p[:-1], knots.v[:-1]), ScanStates(knots.R[1:], knots.p[1:], knots.v[1:])
