"""Weights of the paper's cost: noise propagated on the implicit residual (III-A) and factor balance (III-B, eq. 14).

A distance d is not a measurement but a function of several: its variance is that of the point, DR and Dp sent
through d's Jacobians at the current estimate, and is held constant while the optimiser iterates. In the first round
every measurement's covariance is the identity: all distances weigh the same, and so do all components of an IMU
residual.

Eq. (14) multiplies the squared norms of the IMU residuals' blocks R, v, p by

    lambda = 3 N / M mean(1 / var_d) mean(tr(cov))

N points, M scans. tr(cov) / 3 is a block's typical variance, so lambda cov^-1 is about 9 N / M mean(1 / var_d):
whatever the IMU's noise level, a radian, a metre a second and a metre count alike, as nine times the points of a
scan. That is what makes the cost indifferent to an over-confident covariance, and what makes its minimum not the
maximum likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.paper.lidar_factor import LidarFactors
from calib_core.paper.preintegration import Preintegrated
from calib_core.types import FloatArray

#: Added to every covariance, as a share of the mean variance.
_COVARIANCE_FLOOR = 1e-2


@dataclass(frozen=True, slots=True)
class Weights:
    """inverse_var_d: (N,) [1/m^2].   sqrt_info: (L, 9, 9), blocks R, v, p of the IMU residuals, lambda included."""

    inverse_var_d: FloatArray
    sqrt_info: FloatArray


def distance_variance(
    factors: LidarFactors, preintegrated: Preintegrated, points_lidar: FloatArray, range_std_m: float
) -> FloatArray:
    """Variance of each distance (III-A). points_lidar: (N, 3). range_std_m: along the beam. Returns (N,) [m^2]."""
    beam = points_lidar / np.linalg.norm(points_lidar, axis=1, keepdims=True)
    of_range = (range_std_m * np.einsum("ni,ni->n", factors.dist_D_point, beam)) ** 2
    of_rotation = np.einsum("ni,nij,nj->n", factors.dist_D_DR, preintegrated.cov_R, factors.dist_D_DR)
    of_position = np.einsum("ni,nij,nj->n", factors.dist_D_Dp, preintegrated.cov_p, factors.dist_D_Dp)
    variance: FloatArray = of_range + of_rotation + of_position
    # Noise-free data would divide by zero; a hundredth of a millimetre is beyond any range finder.
    return np.maximum(variance, 1e-10)


def balance(n_points: int, n_scans: int, inverse_var_d: FloatArray, cov: FloatArray) -> float:
    """The factor lambda of eq. (14) for one block. inverse_var_d: (N,). cov: (L, 3, 3)."""
    return 3.0 * n_points / n_scans * float(np.mean(inverse_var_d)) * float(np.mean(np.trace(cov, axis1=1, axis2=2)))


def balanced_weights(inverse_var_d: FloatArray, n_scans: int, cov_rvp: FloatArray) -> Weights:
    """The weights of eq. (14). inverse_var_d: (N,).   cov_rvp: (3, L, 3, 3), of the IMU residuals' blocks."""
    sqrt_info = np.zeros((cov_rvp.shape[1], 9, 9))
    for i, cov in enumerate(cov_rvp):
        # A window of a few readings may be fitted without any noise: no pair counts for more than a hundred typical
        # ones.
        typical = max(float(np.mean(np.trace(cov, axis1=1, axis2=2))) / 3.0, 1e-30)
        floored = cov + _COVARIANCE_FLOOR * typical * np.eye(3)
        scale = balance(inverse_var_d.size, n_scans, inverse_var_d, floored)
        block = slice(3 * i, 3 * i + 3)
        # L^-1 of cov = L L': |L^-1 r|^2 = r' cov^-1 r.
        sqrt_info[:, block, block] = np.sqrt(scale) * np.linalg.inv(np.linalg.cholesky(floored))
    return Weights(inverse_var_d, sqrt_info)


def identity_weights(n_points: int, n_scans: int, n_pairs: int) -> Weights:
    """The first round's: every covariance the identity, eq. (14) applied to that."""
    identity = np.broadcast_to(np.eye(3), (3, n_pairs, 3, 3))
    return balanced_weights(np.ones(n_points), n_scans, identity)
