"""Upsampled preintegration, eq. (3), with its covariance and its first-order dependence on biases and time, eq. (12).

Within one step of length h the reading is constant, taken at the step's middle (w, f; biases removed):

    DR' = DR Exp(w h)                          S  = DR Exp(w h / 2), the attitude in mid-step
    Dv' = Dv + S f h
    Dp' = Dp + Dv h + 1/2 S f h^2

so that with gravity g and elapsed time z (eq. 4-6)

    R = R0 DR,    v = v0 + z g + R0 Dv,    p = p0 + z v0 + 1/2 z^2 g + R0 Dp

Departures. The printed eq. (3) lacks the 1/2 of the last term; a constant acceleration decides for it. Reading and
attitude are taken in mid-step, not at its start: at 1 kHz and fast motion the left-hand rule is wrong by 1e-3 rad a
scan. What the letter of eq. (3) leads to can be had (`as_printed`): w, f at the step's start, S = DR, and no 1/2.

First-order changes, tangents on the right, E = Exp(w h), H = Exp(w h / 2), K = hat(f), Jr at w h, Jh at w h / 2:

    d DR' = E' d DR + Jr h dw                  d S = H' d DR + Jh (h / 2) dw
    d Dv' = d Dv - S K h dS + S h df
    d Dp' = d Dp + h d Dv - 1/2 S K h^2 dS + 1/2 S h^2 df

With dw = -d gyro_bias, df = -d accel_bias this gives the bias Jacobians; with dw, df the readings' errors, the
covariance ([21], section 1.1, with a covariance for each step). Steps' errors count as uncorrelated: the published
choice, though neighbouring values of one GP are nearly the same. The time-shift Jacobian is a central difference.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from calib_core.geometry import exp, hat, log, right_jacobian
from calib_core.paper.upsample import Readings, ReadingSource
from calib_core.types import FloatArray, IntArray

#: Half the span of the central difference that gives the time-shift Jacobian.
TIME_DIFFERENCE_S = 5e-4


@dataclass(frozen=True, slots=True)
class Preintegrated:
    """Preintegrated measurements. Leading shape L, e.g. (M, K + 1) or (N,).

    DR (L, 3, 3), Dv [m/s], Dp [m] (L, 3).   DR_D_bg (L, 3, 3) tangent on the right, Dv_D_bg, Dp_D_bg, Dv_D_ba,
    Dp_D_ba (L, 3, 3).
    DR_D_t, Dv_D_t, Dp_D_t: (L, 3), per second of time shift.   cov_R, cov_v, cov_p: (L, 3, 3), the covariance's blocks.
    """

    DR: FloatArray
    Dv: FloatArray
    Dp: FloatArray
    DR_D_bg: FloatArray
    Dv_D_bg: FloatArray
    Dp_D_bg: FloatArray
    Dv_D_ba: FloatArray
    Dp_D_ba: FloatArray
    DR_D_t: FloatArray
    Dv_D_t: FloatArray
    Dp_D_t: FloatArray
    cov_R: FloatArray
    cov_v: FloatArray
    cov_p: FloatArray

    def first(self, count: int) -> Preintegrated:
        """The first `count` measurements."""
        return Preintegrated(*(getattr(self, each.name)[:count] for each in fields(self)))

    def corrected(
        self, gyro_bias_delta: FloatArray, accel_bias_delta: FloatArray, time_delta_s: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Measurements moved to first order, eq. (12): DR, Dv, Dp and the rotation vector (L, 3) that moved DR."""
        rotvec = self.DR_D_bg @ gyro_bias_delta + self.DR_D_t * time_delta_s
        Dv = self.Dv + self.Dv_D_bg @ gyro_bias_delta + self.Dv_D_ba @ accel_bias_delta + self.Dv_D_t * time_delta_s
        Dp = self.Dp + self.Dp_D_bg @ gyro_bias_delta + self.Dp_D_ba @ accel_bias_delta + self.Dp_D_t * time_delta_s
        return self.DR @ exp(rotvec), Dv, Dp, rotvec


@dataclass(frozen=True, slots=True)
class _Chain:
    """Measurements and bias Jacobians along steps."""

    DR: FloatArray
    Dv: FloatArray
    Dp: FloatArray
    DR_D_bg: FloatArray
    Dv_D_bg: FloatArray
    Dp_D_bg: FloatArray
    Dv_D_ba: FloatArray
    Dp_D_ba: FloatArray

    @staticmethod
    def at_rest(*shape: int) -> _Chain:
        matrix, vector = np.zeros((*shape, 3, 3)), np.zeros((*shape, 3))
        return _Chain(matrix + np.eye(3), vector, vector, matrix, matrix, matrix, matrix, matrix)

    def arrays(self) -> tuple[FloatArray, ...]:
        return (
            self.DR, self.Dv, self.Dp, self.DR_D_bg, self.Dv_D_bg, self.Dp_D_bg, self.Dv_D_ba, self.Dp_D_ba
        )  # fmt: skip

    def take(self, *index: IntArray) -> _Chain:
        return _Chain(*(each[index] for each in self.arrays()))


def _advance(chain: _Chain, gyro: FloatArray, accel: FloatArray, h: FloatArray, as_printed: bool) -> _Chain:
    """The chain after one step. gyro, accel: (L, 3), biases removed.   h: (L,) [s]."""
    if as_printed:
        return _advance_as_printed(chain, gyro, accel, h)
    h1, h2 = h[..., None], h[..., None, None]
    S, E, H = _step_rotations(chain.DR, gyro, h1)
    Sf = _rotate(S, accel)
    SK = S @ hat(accel)
    jr, jh = right_jacobian(gyro * h1), right_jacobian(0.5 * gyro * h1)
    S_D_bg = _transpose(H) @ chain.DR_D_bg - jh * (0.5 * h2)
    return _Chain(
        chain.DR @ E,
        chain.Dv + Sf * h1,
        chain.Dp + chain.Dv * h1 + 0.5 * Sf * h1**2,
        _transpose(E) @ chain.DR_D_bg - jr * h2,
        chain.Dv_D_bg - SK @ S_D_bg * h2,
        chain.Dp_D_bg + chain.Dv_D_bg * h2 - 0.5 * SK @ S_D_bg * h2**2,
        chain.Dv_D_ba - S * h2,
        chain.Dp_D_ba + chain.Dv_D_ba * h2 - 0.5 * S * h2**2,
    )


def _advance_as_printed(chain: _Chain, gyro: FloatArray, accel: FloatArray, h: FloatArray) -> _Chain:
    """Eq. (3) to the letter: the attitude at the step's start, and no 1/2."""
    h1, h2 = h[..., None], h[..., None, None]
    E, Sf, SK = exp(gyro * h1), _rotate(chain.DR, accel), chain.DR @ hat(accel)
    return _Chain(
        chain.DR @ E,
        chain.Dv + Sf * h1,
        chain.Dp + chain.Dv * h1 + Sf * h1**2,
        _transpose(E) @ chain.DR_D_bg - right_jacobian(gyro * h1) * h2,
        chain.Dv_D_bg - SK @ chain.DR_D_bg * h2,
        chain.Dp_D_bg + chain.Dv_D_bg * h2 - SK @ chain.DR_D_bg * h2**2,
        chain.Dv_D_ba - chain.DR * h2,
        chain.Dp_D_ba + chain.Dv_D_ba * h2 - chain.DR * h2**2,
    )


def _advance_covariance(
    cov: FloatArray, DR: FloatArray, gyro: FloatArray, accel: FloatArray, var: FloatArray, h: FloatArray
) -> FloatArray:
    """Covariance (L, 9, 9) after one step with reading variances var (L, 6): gyro, accel."""
    h2 = h[..., None, None]
    S, E, H = _step_rotations(DR, gyro, h[..., None])
    SK = S @ hat(accel)
    jr, jh = right_jacobian(gyro * h[..., None]), right_jacobian(0.5 * gyro * h[..., None])
    A = np.zeros_like(cov) + np.eye(9)
    A[..., 0:3, 0:3] = _transpose(E)
    A[..., 3:6, 0:3] = -SK @ _transpose(H) * h2
    A[..., 6:9, 0:3] = 0.5 * h2 * A[..., 3:6, 0:3]
    A[..., 6:9, 3:6] = np.eye(3) * h2
    B = np.zeros((*cov.shape[:-2], 9, 6))
    B[..., 0:3, 0:3] = jr * h2
    B[..., 3:6, 0:3] = -SK @ jh * (0.5 * h2**2)
    B[..., 6:9, 0:3] = 0.5 * h2 * B[..., 3:6, 0:3]
    B[..., 3:6, 3:6] = S * h2
    B[..., 6:9, 3:6] = 0.5 * S * h2**2
    return A @ cov @ _transpose(A) + (B * var[..., None, :]) @ _transpose(B)


def _step_rotations(DR: FloatArray, gyro: FloatArray, h1: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    H = exp(0.5 * gyro * h1)
    return DR @ H, H @ H, H


def _transpose(matrix: FloatArray) -> FloatArray:
    return np.swapaxes(matrix, -1, -2)


def _rotate(R: FloatArray, vector: FloatArray) -> FloatArray:
    rotated: FloatArray = (R @ vector[..., None])[..., 0]
    return rotated


@dataclass(frozen=True, slots=True)
class _Grid:
    """A chain at the knots of every scan: chain (M, K + 1), step readings gyro, accel (M, K, 3), step_s (M,).

    as_printed: stepped by the letter of eq. (3).
    """

    chain: _Chain
    gyro: FloatArray
    accel: FloatArray
    step_s: FloatArray
    as_printed: bool

    def at(self, scan: IntArray, elapsed_s: FloatArray) -> _Chain:
        """The chain at elapsed_s (N,) after the starts of scans (N,): the last knot and a shorter step from there."""
        step = np.clip((elapsed_s / self.step_s[scan]).astype(np.int64), 0, self.gyro.shape[1] - 1)
        rest = elapsed_s - step * self.step_s[scan]
        start = self.chain.take(scan, step)
        return _advance(start, self.gyro[scan, step], self.accel[scan, step], rest, self.as_printed)


def _integrate(readings: Readings, step_s: FloatArray, as_printed: bool) -> _Grid:
    """The chain of every scan over its steps. readings: (M, K, 3). step_s: (M,)."""
    n_scans, n_steps, _ = readings.gyro_rad_s.shape
    chains = [_Chain.at_rest(n_scans)]
    for k in range(n_steps):
        chains.append(_advance(chains[-1], readings.gyro_rad_s[:, k], readings.accel_m_s2[:, k], step_s, as_printed))
    stacked = [np.stack(each, axis=1) for each in zip(*(chain.arrays() for chain in chains), strict=True)]
    return _Grid(_Chain(*stacked), readings.gyro_rad_s, readings.accel_m_s2, step_s, as_printed)


def _integrate_covariance(grid: _Grid, readings: Readings) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Diagonal blocks of the covariance at every knot: cov_R, cov_v, cov_p, each (M, K + 1, 3, 3)."""
    n_scans, n_steps, _ = grid.gyro.shape
    var = np.concatenate([readings.var_gyro, readings.var_accel], axis=2)
    cov = np.zeros((n_scans, 9, 9))
    blocks = np.zeros((3, n_scans, n_steps + 1, 3, 3))
    for k in range(n_steps):
        cov = _advance_covariance(cov, grid.chain.DR[:, k], grid.gyro[:, k], grid.accel[:, k], var[:, k], grid.step_s)
        for i in range(3):
            blocks[i, :, k + 1] = cov[:, 3 * i : 3 * i + 3, 3 * i : 3 * i + 3]
    return blocks[0], blocks[1], blocks[2]


@dataclass(frozen=True, slots=True)
class ScanPreintegration:
    """Preintegration of every scan from its first point on, about one prior of biases and time shift.

    start_s: (M,) scans' first points [s, lidar clock].   duration_s: (M,) covered.   centre, later, earlier: the
    readings as stamped, and with the time shift moved by +-TIME_DIFFERENCE_S.   cov_R, cov_v, cov_p: (M, K + 1, 3, 3).
    """

    start_s: FloatArray
    duration_s: FloatArray
    centre: _Grid
    later: _Grid
    earlier: _Grid
    cov_R: FloatArray
    cov_v: FloatArray
    cov_p: FloatArray

    def at(self, scan: IntArray, elapsed_s: FloatArray) -> Preintegrated:
        """Measurements from scans' (N,) first points to elapsed_s (N,) after them; covariance of the nearest knot."""
        centre = self.centre.at(scan, elapsed_s)
        plus, minus = self.later.at(scan, elapsed_s), self.earlier.at(scan, elapsed_s)
        span = 2.0 * TIME_DIFFERENCE_S
        back = _transpose(centre.DR)
        knot = np.rint(elapsed_s / self.centre.step_s[scan]).astype(np.int64)
        knot = np.clip(knot, 0, self.cov_R.shape[1] - 1)
        return Preintegrated(
            centre.DR,
            centre.Dv,
            centre.Dp,
            centre.DR_D_bg,
            centre.Dv_D_bg,
            centre.Dp_D_bg,
            centre.Dv_D_ba,
            centre.Dp_D_ba,
            (log(back @ plus.DR) - log(back @ minus.DR)) / span,
            (plus.Dv - minus.Dv) / span,
            (plus.Dp - minus.Dp) / span,
            self.cov_R[scan, knot],
            self.cov_v[scan, knot],
            self.cov_p[scan, knot],
        )

    def to_next(self) -> Preintegrated:
        """Measurements from each scan's first point over its whole duration: the IMU factors', (M,)."""
        return self.at(np.arange(self.start_s.shape[0]), self.duration_s)


def preintegrate_scans(
    source: ReadingSource,
    start_s: FloatArray,
    duration_s: FloatArray,
    *,
    time_offset_prior_s: float,
    gyro_bias_prior: FloatArray,
    accel_bias_prior: FloatArray,
    rate_hz: float = 1000.0,
    as_printed: bool = False,
) -> ScanPreintegration:
    """Preintegration of all scans on grids of about `rate_hz`.

    start_s, duration_s: (M,) [s, lidar clock].   time_offset_prior_s: t_imu = t_lidar - time_offset.   *_bias_prior:
    (3,).   as_printed: by the letter of eq. (3).
    """
    n_scans = start_s.shape[0]
    n_steps = max(1, int(np.ceil(np.median(duration_s) * rate_hz)))
    step_s = duration_s / n_steps
    lidar_s = start_s[:, None] + (np.arange(n_steps) + (0.0 if as_printed else 0.5)) * step_s[:, None]
    scan = np.repeat(np.arange(n_scans), n_steps)

    def readings(shift_s: float) -> Readings:
        # The only place where the time shift's sign is applied: eq. (3)'s t - delta t.
        flat = source.at(scan, (lidar_s - (time_offset_prior_s + shift_s)).ravel())
        shape = (n_scans, n_steps, 3)
        gyro, accel = (
            flat.gyro_rad_s.reshape(shape) - gyro_bias_prior,
            flat.accel_m_s2.reshape(shape) - accel_bias_prior,
        )
        return Readings(gyro, accel, flat.var_gyro.reshape(shape), flat.var_accel.reshape(shape))

    as_stamped = readings(0.0)
    centre = _integrate(as_stamped, step_s, as_printed)
    later, earlier = (
        _integrate(readings(shift_s), step_s, as_printed) for shift_s in (TIME_DIFFERENCE_S, -TIME_DIFFERENCE_S)
    )
    cov_R, cov_v, cov_p = _integrate_covariance(centre, as_stamped)
    return ScanPreintegration(start_s, duration_s, centre, later, earlier, cov_R, cov_v, cov_p)
