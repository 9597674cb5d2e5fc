r"""How errors of the motion grow from one instant to the next, in the world's axes.

Errors: Exp(psi) R for the attitude (a turn about the world's axes), v + dv, p + dp, b + db, g + dg. With the reading's
white noise n and a = R f the true specific force in the world,

    psi' = -R (db_w + n_w),     dv' = psi x a - R (db_f + n_f) + dg,     dp' = dv.

Steps go backwards, from t + h to t, because that is what the elimination substitutes. With R and a at the middle of the
step, A = -[a]x, and w the noise's integral over the step (isotropic, so the turn into the world does not matter),

    psi0 = psi1 + h R db_w + w_w
    dv0  = dv1 - h A psi1 - h^2/2 A R db_w + h R db_f - h dg + w_f - h/2 A w_w
    dp0  = dp1 - h dv1 + h^2/2 (A psi1 - R db_f + dg) + h^3/6 A R db_w - h/2 w_f + h^2/6 A w_w

and for walking biases db0 = db1 + w_b. Within a step the noise's integral is taken as a ramp; steps are shorter than a
sample, and halving them does not change the bound.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.bound.model import Columns, FloatArray
from calib_core.simulate import Simulation, Truth


@dataclass(frozen=True, slots=True)
class ImuNoise:
    """Densities: rad/s/sqrt(Hz), m/s2/sqrt(Hz); walks per sqrt(s)."""

    gyro: float
    accel: float
    gyro_walk: float
    accel_walk: float


def cross_matrix(v: FloatArray) -> FloatArray:
    """[v]x. v: (..., 3). Returns (..., 3, 3)."""
    matrix = np.zeros((*v.shape, 3))
    matrix[..., 0, 1], matrix[..., 0, 2], matrix[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    matrix[..., 1, 0], matrix[..., 2, 0], matrix[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return matrix


def steps_back(R: FloatArray, force_m_s2: FloatArray, h_s: float, columns: Columns) -> FloatArray:
    """The moving errors before each step from all errors after it. R: (N, 3, 3) and force_m_s2: (N, 3) at the middles,
    world. Returns (N, moving, size)."""
    n = len(R)
    A = -cross_matrix(force_m_s2)
    back = np.zeros((n, columns.moving, columns.size))
    same = np.arange(columns.moving)
    back[:, same, same] = 1.0
    turn, velocity, position = columns.turn, columns.velocity, columns.position
    back[:, turn, columns.gyro_bias] = h_s * R
    back[:, velocity, turn] = -h_s * A
    back[:, velocity, columns.gyro_bias] = -(h_s**2) / 2 * A @ R
    back[:, velocity, columns.accel_bias] = h_s * R
    back[:, velocity, columns.gravity] = -h_s * np.eye(3)
    back[:, position, velocity] = -h_s * np.eye(3)
    back[:, position, turn] = h_s**2 / 2 * A
    back[:, position, columns.gyro_bias] = h_s**3 / 6 * A @ R
    back[:, position, columns.accel_bias] = -(h_s**2) / 2 * R
    back[:, position, columns.gravity] = h_s**2 / 2 * np.eye(3)
    return back


def noise_back(force_m_s2: FloatArray, h_s: float, noise: ImuNoise, columns: Columns) -> FloatArray:
    """The moving errors before each step from its noises of unit variance. Returns (N, moving, noises)."""
    A = -cross_matrix(force_m_s2)
    gyro, accel = noise.gyro * np.sqrt(h_s), noise.accel * np.sqrt(h_s)
    back = np.zeros((len(A), columns.moving, columns.noises))
    back[:, 0:3, 0:3] = gyro * np.eye(3)
    back[:, 3:6, 0:3] = -gyro * h_s / 2 * A
    back[:, 3:6, 3:6] = accel * np.eye(3)
    back[:, 6:9, 0:3] = gyro * h_s**2 / 6 * A
    back[:, 6:9, 3:6] = -accel * h_s / 2 * np.eye(3)
    # The noise of lateness, where there is one, acts only from one scan to the next: `forget_lateness`.
    if columns.biases_walk:
        back[:, 9:12, 6:9] = noise.gyro_walk * np.sqrt(h_s) * np.eye(3)
        back[:, 12:15, 9:12] = noise.accel_walk * np.sqrt(h_s) * np.eye(3)
    return back


def drawn_noise(
    simulation: Simulation,
    truth: Truth,
    middles_s: FloatArray,
    R: FloatArray,
    h_s: float,
    noise: ImuNoise,
    columns: Columns,
) -> FloatArray:
    """(N, noises) right-hand side of the noises of unit variance: the errors that undo what the IMU really drew.

    A sample's noise counts for the time that is nearer to it than to its neighbours. middles_s: (N,), R: (N, 3, 3) there.
    """
    messages = simulation.imu_messages
    order = np.argsort(messages.true_ns, kind="stable")
    t_s = np.asarray(messages.true_ns[order] * 1e-9, dtype=np.float64)
    at = truth.imu(t_s)
    force = np.einsum("nji,nj->ni", at.R_world, at.a_m_s2 - truth.gravity_world_m_s2)
    gyro_bias, accel_bias = messages.gyro_bias_rad_s[order], messages.accel_bias_m_s2[order]
    gyro = messages.gyro_rad_s[order] - gyro_bias - at.omega_rad_s
    accel = messages.accel_m_s2[order] - accel_bias - force
    nearest = np.searchsorted(0.5 * (t_s[1:] + t_s[:-1]), middles_s)
    root = np.sqrt(h_s)
    parts = [
        -np.einsum("nij,nj->ni", R, gyro[nearest]) * root / noise.gyro,
        -np.einsum("nij,nj->ni", R, accel[nearest]) * root / noise.accel,
    ]
    if columns.biases_walk:
        for bias, walk in ((gyro_bias, noise.gyro_walk), (accel_bias, noise.accel_walk)):
            ends = [
                np.stack([np.interp(middles_s + side * h_s / 2, t_s, axis) for axis in bias.T], 1) for side in (-1, 1)
            ]
            parts.append((ends[1] - ends[0]) / (walk * root) if walk > 0.0 else np.zeros_like(ends[0]))
    if columns.scans_late:  # which was drawn does not matter to the covariance
        parts.append(np.zeros((len(middles_s), 1)))
    return np.hstack(parts)


def forget_lateness(
    back: FloatArray, disturbance: FloatArray, ends: NDArray[np.intp], std_s: float, columns: Columns
) -> None:
    """Between two scans the lateness is drawn anew: that of the scan before is a noise, and nothing of the next one's.

    back, disturbance: of `steps_back` and `noise_back`, changed in place.   ends: (B,) steps within which a scan ends.
    """
    back[ends, columns.lateness] = 0.0
    disturbance[ends, columns.lateness, -1] = std_s
