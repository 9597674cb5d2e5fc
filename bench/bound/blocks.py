r"""What real sensors add to an ideal one, as further unknowns: what one error of each does to readings and ranges.

Linearised about ideal sensors, with the signs of calib_core.intrinsics. With w, f the true angular rate and specific force
in the IMU's axes, a gyroscope reads too much by

    diag(w) scale + (0, yx w_x, zx w_x + zy w_y) axes + r x w rotation + F f,

an accelerometer by the like of f, by -f' delay, by diag(f)^2 quadratic and, axis k, by that axis of w' x place_k +
w x (w x place_k). An error of a parameter does to the motion what a bias of that size does. A range is too long by

    offset,   d scale,   1 / c - 1 incidence,   d (n . up) / c elevation,   d (n . side) / c azimuth

where the ray is published along u, meets the plane of normal n against it at the cosine c = -n . u, and up, side are the
directions into which u moves with elevation and azimuth. Apart clocks move the time offset by 1e-6 (t - middle) a ppm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bench.bound.lidar import Returns
from bench.bound.model import Columns, FloatArray
from bench.bound.motion import cross_matrix
from calib_core.simulate.motion import Kinematics

#: Numbers in each block that does not go by the laser.
_ONCE = {
    "gyroscope_scale": 3,
    "gyroscope_axes": 3,
    "gyroscope_rotation": 3,
    "accelerometer_scale": 3,
    "accelerometer_axes": 3,
    "accelerometer_delay": 1,
    "accelerometer_quadratic": 3,
    "g_sensitivity": 9,
    "size_effect": 9,
    "low_pass_spread": 2,
    "low_pass_skew": 2,
    "clock_rate": 1,
    "range_offset": 1,
    "incidence": 1,
    "grazing": 1,
    "eccentricity": 2,
}
_BY_LASER = ("laser_range_offset", "laser_elevation", "laser_azimuth", "laser_range_scale")
#: Between the instants of the differences that are derivatives, and how many steps each is from the middle.
_STEP_S = 1e-4
AROUND_S = _STEP_S * np.arange(-2.0, 3.0)


def derivatives(around: FloatArray) -> FloatArray:
    """(4, ..., 3) the value and its first three derivatives, of (5, ..., 3) at AROUND_S from an instant."""
    stencils = [[0, 0, 1, 0, 0], [0, -0.5, 0, 0.5, 0], [0, 1, -2, 1, 0], [-0.5, 1, 0, -1, 0.5]]
    per_s = _STEP_S ** -np.arange(4.0)
    return np.einsum("di,i...->d...", np.asarray(stencils) * per_s[:, None], around)


@dataclass(frozen=True, slots=True)
class Blocks:
    """Which columns, from the first of these unknowns on, belong to which block. lasers: of the lidar."""

    lasers: int

    @property
    def places(self) -> Mapping[str, slice]:
        """By name, in order."""
        sizes = {**_ONCE, **dict.fromkeys(_BY_LASER, self.lasers)}
        ends = np.cumsum(list(sizes.values()))
        return {name: slice(int(end) - size, int(end)) for (name, size), end in zip(sizes.items(), ends, strict=True)}

    @property
    def size(self) -> int:
        """All of them."""
        return sum(_ONCE.values()) + len(_BY_LASER) * self.lasers

    def rate_errors(self, rates: FloatArray, forces: FloatArray) -> FloatArray:
        """(N, 3, size) of gyroscope readings, by parameter. rates, forces: (4, N, 3) turning and specific force in IMU axes, and
        their derivatives."""
        rate_rad_s, force_m_s2 = rates[0], forces[0]
        errors = np.zeros((len(rate_rad_s), 3, self.size))
        errors[:, :, self.places["gyroscope_scale"]] = _diagonal(rate_rad_s)
        errors[:, :, self.places["gyroscope_axes"]] = _lower(rate_rad_s)
        errors[:, :, self.places["gyroscope_rotation"]] = -cross_matrix(rate_rad_s)
        errors[:, :, self.places["g_sensitivity"]] = np.einsum("ij,nk->nijk", np.eye(3), force_m_s2).reshape(-1, 3, 9)
        errors[:, :, self.places["low_pass_spread"].start] = rates[2] / 2.0
        errors[:, :, self.places["low_pass_skew"].start] = -rates[3] / 6.0
        return errors

    def force_errors(self, rates: FloatArray, forces: FloatArray) -> FloatArray:
        """(N, 3, size) of accelerometer readings, by parameter. As `rate_errors`."""
        force_m_s2, jerk_m_s3, rate_rad_s, slope_rad_s2 = forces[0], forces[1], rates[0], rates[1]
        errors = np.zeros((len(force_m_s2), 3, self.size))
        errors[:, :, self.places["accelerometer_scale"]] = _diagonal(force_m_s2)
        errors[:, :, self.places["accelerometer_axes"]] = _lower(force_m_s2)
        errors[:, :, self.places["accelerometer_delay"]] = -jerk_m_s3[:, :, None]
        errors[:, :, self.places["accelerometer_quadratic"]] = _diagonal(force_m_s2**2)
        spin = cross_matrix(rate_rad_s)
        by_place = cross_matrix(slope_rad_s2) + spin @ spin
        errors[:, :, self.places["size_effect"]] = np.einsum("ij,njk->nijk", np.eye(3), by_place).reshape(-1, 3, 9)
        errors[:, :, self.places["low_pass_spread"].start + 1] = forces[2] / 2.0
        errors[:, :, self.places["low_pass_skew"].start + 1] = -forces[3] / 6.0
        return errors

    def range_errors(self, seen: Returns, normals_lidar: FloatArray, middle_s: float, offset: FloatArray) -> FloatArray:
        """(N, size) of ranges [m], by parameter. normals_lidar: (N, 3) against the rays.   middle_s: of the recording.
        offset: (N,) of the time offset's own column."""
        errors = np.zeros((len(seen.t_s), self.size))
        rows, cosine = np.arange(len(seen.t_s)), np.abs(seen.cosine)
        up, side = _moves(seen.ray)
        raised = seen.range_m * np.einsum("ni,ni->n", normals_lidar, up) / cosine
        turned = seen.range_m * np.einsum("ni,ni->n", normals_lidar, side) / cosine
        azimuth = np.arctan2(seen.ray[:, 1], seen.ray[:, 0])
        errors[:, self.places["eccentricity"]] = (turned * np.stack([np.sin(azimuth), np.cos(azimuth)])).T
        errors[:, self.places["clock_rate"].start] = 1e-6 * (seen.t_s - middle_s) * offset
        errors[:, self.places["range_offset"].start] = 1.0
        errors[:, self.places["incidence"].start] = 1.0 / cosine - 1.0
        errors[:, self.places["grazing"].start] = -seen.range_m * np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) / cosine
        lasers = {
            "laser_range_offset": np.ones(len(rows)),
            "laser_elevation": raised,
            "laser_azimuth": turned,
            "laser_range_scale": seen.range_m,
        }
        for name, values in lasers.items():
            errors[rows, self.places[name].start + seen.laser] = values
        return errors


def _diagonal(vectors: FloatArray) -> FloatArray:
    return np.einsum("ni,ij->nij", vectors, np.eye(3))


def _lower(vectors: FloatArray) -> FloatArray:
    matrix = np.zeros((len(vectors), 3, 3))
    matrix[:, 1, 0] = matrix[:, 2, 1] = vectors[:, 0]
    matrix[:, 2, 2] = vectors[:, 1]
    return matrix


def _moves(ray: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Directions into which a ray moves with elevation and with azimuth, (N, 3) each; the latter as long as its level part."""
    level = np.hypot(ray[:, 0], ray[:, 1])
    side = np.stack([-ray[:, 1], ray[:, 0], np.zeros(len(ray))], axis=1)
    up = np.stack([-ray[:, 2] * ray[:, 0] / level, -ray[:, 2] * ray[:, 1] / level, level], axis=1)
    return up, side


def imu_frame(motion: Kinematics, gravity_world_m_s2: FloatArray) -> FloatArray:
    """Specific force in the IMU's axes, (N, 3)."""
    return np.asarray(np.einsum("nji,nj->ni", motion.R_world, motion.a_m_s2 - gravity_world_m_s2))


def add_to_steps(back: FloatArray, columns: Columns, rate_errors: FloatArray, force_errors: FloatArray) -> None:
    """Fill the blocks' columns of the steps of motion.py: they act through the biases' columns."""
    moved = slice(0, 9)
    back[:, moved, columns.extra] = (
        back[:, moved, columns.gyro_bias] @ rate_errors + back[:, moved, columns.accel_bias] @ force_errors
    )
