"""Which plane every return came from, where its ray met it, and what one range says about the errors.

A ray from o along d in the lidar frame meets the plane n . X + w = 0 of the world at range r. With x = o + r d and
X = R (R_c x + p_c) + p the hit in the world, seen by the IMU at R, p (instant t of the lidar clock, looked up at t - dt),

    range error = (n . dX + X . dn + dw) / (n . ray)
    dX = psi x (X - p) + dp + R R_c (theta x x) + R dp_c - (v + omega x (X - p)) d(dt)

whose columns follow. The pose is that of the return's firing column, at most 55 us away.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.bound.model import Assumptions, Columns, FloatArray
from calib_core.simulate import Simulation, Truth


@dataclass(frozen=True, slots=True)
class Returns:
    """Returns from planes. t_s: (N,) of their firing column.   plane: (N,) face of the scene.   x_m: (N, 3) where the ray
    met it, lidar frame.   hit_m: (N, 3) the same in the world.   arm_m: (N, 3) from the IMU to it, world.
    R_imu: (N, 3, 3).   sweep_m_s: (N, 3) velocity of the hit's place if it were fixed to the rig, world.
    ray: (N, 3) lidar frame, as published.   range_m: (N,) along it.   laser: (N,) channel in firing order.
    cosine: (N,) normal . ray, negative.   beside_m: (N,) distance to the nearest other plane.   range_error_m: (N,) of what
    the lidar measured.
    """

    t_s: FloatArray
    plane: NDArray[np.intp]
    x_m: FloatArray
    hit_m: FloatArray
    arm_m: FloatArray
    R_imu: FloatArray
    sweep_m_s: FloatArray
    ray: FloatArray
    range_m: FloatArray
    laser: NDArray[np.intp]
    cosine: FloatArray
    beside_m: FloatArray
    range_error_m: FloatArray

    def chosen(self, which: NDArray[np.bool_] | slice) -> Returns:
        """Some of them."""
        return Returns(*(getattr(self, name)[which] for name in self.__slots__))


@dataclass(frozen=True, slots=True)
class Faces:
    """The scene's planes. normals: (P, 3), offsets_m: (P,), axes: (P, 2, 3) across each normal."""

    normals: FloatArray
    offsets_m: FloatArray
    axes: FloatArray


def faces_of(simulation: Simulation) -> Faces:
    """The scene's planes in the world."""
    faces = simulation.scenario.scene.faces
    normals = np.array([face.unit_normal for face in faces])
    helper = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    first = np.cross(normals, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return Faces(normals, np.array([f.offset_m for f in faces]), np.stack([first, np.cross(normals, first)], axis=1))


def returns_of(simulation: Simulation, truth: Truth, faces: Faces, index: int) -> Returns:
    """What came back from planes in one sweep."""
    sweep = simulation.sweep(index)
    firings = simulation.scenario.lidar.pattern.firings(index)
    sent = sweep.valid & (sweep.surface >= 0) & (sweep.surface < len(faces.normals))
    if simulation.faults.voxel_grid_m:
        sent &= _first_of_cells(sweep.xyz_m, sweep.valid, simulation.faults.voxel_grid_m)
    column, channel = np.nonzero(sent)
    plane = sweep.surface[column, channel].astype(np.intp)
    column_s = np.asarray(firings.column_ns * 1e-9, dtype=np.float64)
    lidar, imu = truth.lidar(column_s), truth.imu(column_s)
    ray = np.moveaxis(firings.directions, 0, -1)[column, channel]
    origin = np.zeros_like(ray)
    if firings.origin_m is not None:
        origin = np.moveaxis(firings.origin_m, 0, -1)[column, channel]
    n = faces.normals[plane]
    n_lidar = np.einsum("nji,nj->ni", lidar.R_world[column], n)
    cosine = np.einsum("ni,ni->n", n_lidar, ray)
    height = (
        np.einsum("ni,ni->n", n, lidar.p_m[column]) + faces.offsets_m[plane] + np.einsum("ni,ni->n", n_lidar, origin)
    )
    x = origin + ray * (-height / cosine)[:, None]
    hit = np.einsum("nij,nj->ni", lidar.R_world[column], x) + lidar.p_m[column]
    arm = hit - imu.p_m[column]
    turning = np.einsum("nij,nj->ni", imu.R_world, imu.omega_rad_s)[column]
    distance = np.abs(hit @ faces.normals.T + faces.offsets_m)
    distance[np.arange(len(plane)), plane] = np.inf
    return Returns(
        t_s=column_s[column],
        plane=plane,
        x_m=x,
        hit_m=hit,
        arm_m=arm,
        R_imu=imu.R_world[column],
        sweep_m_s=imu.v_m_s[column] + np.cross(turning, arm),
        ray=ray,
        range_m=-height / cosine,
        laser=channel,
        cosine=cosine,
        beside_m=distance.min(axis=1),
        range_error_m=np.einsum("ni,ni->n", sweep.xyz_m[column, channel] - x, ray),
    )


def _first_of_cells(xyz_m: FloatArray, valid: NDArray[np.bool_], cell_m: float) -> NDArray[np.bool_]:
    """Of valid points, (T, C, 3), whether one is the first in its cube of space."""
    sent = np.flatnonzero(valid.ravel())
    _, first = np.unique(np.floor(xyz_m.reshape(-1, 3)[sent] / cell_m), axis=0, return_index=True)
    kept = np.zeros(valid.size, dtype=bool)
    kept[sent[first]] = True
    return kept.reshape(valid.shape)


def rows_of(
    seen: Returns,
    R_imu_lidar: FloatArray,
    faces: Faces,
    numbers: Sequence[int],
    after_s: FloatArray,
    range_std_m: float,
    columns: Columns,
) -> FloatArray:
    """One whitened row a return. numbers: faces of the scene that are unknown planes, in the order of their columns.
    after_s: (N,) from the instant of the moving columns to the return. Returns (N, size + 1), the last column what was drawn.
    """
    n = faces.normals[seen.plane]
    n_imu = np.einsum("nji,nj->ni", seen.R_imu, n)
    row = np.zeros((len(n), columns.size + 1))
    row[:, columns.turn] = np.cross(seen.arm_m, n)
    row[:, columns.velocity] = n * after_s[:, None]
    row[:, columns.position] = n
    start = columns.calibration.start
    row[:, start : start + 3] = np.cross(seen.x_m, n_imu @ R_imu_lidar)
    row[:, start + 3 : start + 6] = n_imu
    row[:, start + 6] = -np.einsum("ni,ni->n", n, seen.sweep_m_s)
    for number, face in enumerate(numbers):
        mine = seen.plane == face
        place = columns.plane(number)
        row[mine, place.start : place.start + 2] = seen.hit_m[mine] @ faces.axes[face].T
        row[mine, place.start + 2] = 1.0
    # The cosine is negative: a range too long is a point behind its plane.
    row[:, -1] = np.abs(seen.cosine) * seen.range_error_m
    return row / (np.abs(seen.cosine) * range_std_m)[:, None]


def all_returns(simulation: Simulation, truth: Truth, faces: Faces, assumed: Assumptions) -> Iterator[Returns]:
    """Sweep by sweep, what may be used."""
    for index in range(simulation.n_scans):
        seen = returns_of(simulation, truth, faces, index)
        seen = seen.chosen(slice(index % assumed.every, None, assumed.every))
        yield seen.chosen((seen.beside_m >= assumed.margin_m) & (np.abs(seen.cosine) >= assumed.min_cosine))
