"""How far the propagated motion may have strayed in each direction since the planes that hold it were last seen.

A small filter beside the estimate: position, velocity and a constant error of the acceleration (accelerometer bias,
gravity and tilt together), in the map frame. Time lets it grow, a plane in view shrinks it along that plane's normal only.
It decides how wide a gate has to be, plane by plane: along a corridor the position may be lost while the walls are not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.full.joint.settings import STRAYING
from calib_core.types import FloatArray

PLACE, VELOCITY, ACCELERATION = slice(0, 3), slice(3, 6), slice(6, 9)


@dataclass(frozen=True, slots=True)
class Drift:
    """covariance: (9, 9) of the errors of position [m], velocity [m/s] and acceleration [m/s2], map axes.

    noise_m_s2_sqrt_hz: white noise of the accelerometer.
    """

    covariance: FloatArray
    noise_m_s2_sqrt_hz: float

    @staticmethod
    def begun(acceleration_cov: FloatArray, noise_m_s2_sqrt_hz: float) -> Drift:
        """After a solve of the whole. acceleration_cov: (3, 3)."""
        covariance = np.zeros((9, 9))
        covariance[PLACE, PLACE] = np.eye(3) * STRAYING.position_std_m**2
        covariance[VELOCITY, VELOCITY] = np.eye(3) * STRAYING.velocity_std_m_s**2
        covariance[ACCELERATION, ACCELERATION] = acceleration_cov
        return Drift(covariance, noise_m_s2_sqrt_hz)

    def after(self, span_s: float) -> Drift:
        """When time has passed."""
        t = span_s
        F = np.eye(9)
        F[PLACE, VELOCITY] = F[VELOCITY, ACCELERATION] = np.eye(3) * t
        F[PLACE, ACCELERATION] = np.eye(3) * (0.5 * t**2)
        Q = np.zeros((9, 9))
        Q[PLACE, PLACE], Q[VELOCITY, VELOCITY] = np.eye(3) * (t**3 / 3), np.eye(3) * t
        Q[PLACE, VELOCITY] = Q[VELOCITY, PLACE] = np.eye(3) * (t**2 / 2)
        covariance = F @ self.covariance @ F.T + Q * self.noise_m_s2_sqrt_hz**2
        return Drift(covariance, self.noise_m_s2_sqrt_hz)

    def corrected(self, normals: FloatArray) -> Drift:
        """When planes have come into view and corrected the motion. normals: (P, 3)."""
        covariance = self.covariance.copy()
        for n in normals:
            along = covariance[:, PLACE] @ n
            gain = along / (n @ along[PLACE] + STRAYING.seen_std_m**2)
            covariance -= np.outer(gain, along)
        return Drift(0.5 * (covariance + covariance.T), self.noise_m_s2_sqrt_hz)

    def along(self, normals: FloatArray) -> FloatArray:
        """Standard deviation of the position along each normal (P, 3): (P,) [m]."""
        return np.sqrt(np.maximum(np.einsum("pi,ij,pj->p", normals, self.covariance[PLACE, PLACE], normals), 0.0))

    def farthest_m(self) -> float:
        """Standard deviation of the position along its worst direction."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[PLACE, PLACE])[-1]))
