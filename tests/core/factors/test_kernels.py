"""The compiled loops against plain NumPy twins of the same arithmetic, and against finite differences."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from calib_core.factors.blocks import SeenPlanes
from calib_core.factors.cell_kernels import Grids, cells_kernel, near_kernel
from calib_core.factors.kernels import collapse_kernel, hits_kernel
from calib_core.types import BoolArray, Float32Array, FloatArray, IntArray

SLICE_S = 0.002


@dataclass
class Sweep:
    """A sweep and planes for `hits_kernel`, and what it fills."""

    xyz: Float32Array
    offset_s: FloatArray
    n_lidar: FloatArray
    w_lidar: FloatArray
    omega: FloatArray
    v: FloatArray
    usable: BoolArray

    def run(self, min_cosine: float, min_azimuth: float) -> dict[str, FloatArray | IntArray]:
        n = len(self.xyz)
        plane, index = np.full(n, 77, np.int64), np.full(n, 77, np.int64)
        x_hit, d, cosine, beside = np.full((n, 3), np.nan), np.full(n, np.nan), np.full(n, np.nan), np.full(n, np.nan)
        seen = SeenPlanes(SLICE_S, self.n_lidar, self.w_lidar, self.omega, self.v, self.usable, min_cosine, min_azimuth)
        hits_kernel(self.xyz, self.offset_s, np.zeros(n, np.int64), seen, plane, index, x_hit, d, cosine, beside)
        return {"plane": plane, "index": index, "x_hit": x_hit, "d": d, "cosine": cosine, "beside": beside}

    def twin(self, min_cosine: float, min_azimuth: float) -> dict[str, FloatArray | IntArray]:
        """The same for all points at once, every plane's range error in one table."""
        x = self.xyz.astype(np.float64)
        index = np.floor(self.offset_s / SLICE_S).astype(int)
        t = self.offset_s - (index + 0.5) * SLICE_S
        r = np.linalg.norm(x, axis=1)
        turned = x + t[:, None] * np.cross(self.omega[index], x)
        shift = t[:, None] * self.v[index]
        with np.errstate(invalid="ignore", divide="ignore"):
            C = np.einsum("npi,ni->np", self.n_lidar[index], turned) / r[:, None]
            D = np.einsum("npi,ni->np", self.n_lidar[index], turned + shift) + self.w_lidar[index]
            error = np.where(-min_cosine > C, D / C, np.inf)
        seen = (r**2 >= 1e-6) & self.usable[index]
        if min_azimuth > -1.5:
            seen &= np.cos(np.arctan2(x[:, 1], x[:, 0])) >= min_azimuth
        best = np.argmin(np.abs(error), axis=1)
        at = np.arange(len(x))
        seen &= np.isfinite(error[at, best])
        e = error[at, best]
        with np.errstate(invalid="ignore"):
            other = np.abs(D - e[:, None] * C) / np.maximum(np.abs(C), 0.25)
            other[at, best] = np.inf
            x_hit = turned + shift - (e / r)[:, None] * turned
        blank = np.where(seen, 1.0, np.nan)
        return {
            "plane": np.where(seen, best, -1),
            "index": index,
            "x_hit": x_hit * blank[:, None],
            "d": D[at, best] * blank,
            "cosine": C[at, best] * blank,
            "beside": other.min(axis=1) * blank,
        }


def _sweep(seed: int, *, planes: int = 5, slices: int = 6, n: int = 400) -> Sweep:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(slices, planes, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    xyz = rng.normal(size=(n, 3)).astype(np.float32) * 4
    xyz[:3] = [[0, 0, 0], [2e-4, 0, 0], [0, 0, 3.0]]
    return Sweep(
        xyz, rng.uniform(0, slices * SLICE_S, n), normals, rng.uniform(0.5, 6.0, (slices, planes)),
        rng.normal(size=(slices, 3)) * 3, rng.normal(size=(slices, 3)) * 2, np.arange(slices) != 2,
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("azimuth_deg", [None, 60.0])
def test_hits_are_those_of_the_table_of_range_errors(seed: int, azimuth_deg: float | None) -> None:
    """Fails when the plane is chosen by distance instead of range error, or a point moves to its slice's start.

    What is not seen stays untouched: NaN went in and NaN comes out.
    """
    sweep = _sweep(seed)
    azimuth = -2.0 if azimuth_deg is None else float(np.cos(np.radians(azimuth_deg)))
    found, expected = sweep.run(0.05, azimuth), sweep.twin(0.05, azimuth)
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, atol=1e-12, err_msg=name)
    assert 0.2 < np.mean(expected["plane"] >= 0) < 0.95


def test_hits_without_planes_or_beside_a_single_one() -> None:
    """Fails when the distance to the nearest other plane starts at zero: a lone plane's hits would all be ambiguous."""
    sweep = _sweep(5, planes=1)
    found = sweep.run(0.05, -2.0)
    assert np.isinf(found["beside"][found["plane"] >= 0]).all()
    none = _sweep(5, planes=1)
    none.n_lidar, none.w_lidar = none.n_lidar[:, :0], none.w_lidar[:, :0]
    assert (none.run(0.05, -2.0)["plane"] == -1).all()


def test_cells_are_floors_of_the_planes_own_coordinates() -> None:
    """Fails when cells round instead of floor, or a hit far outside is not held at the rim."""
    rng = np.random.default_rng(1)
    n, slices, planes, half = 300, 4, 3, 20
    plane, index = rng.integers(-1, planes, n), rng.integers(0, slices, n)
    x_hit = rng.normal(size=(n, 3)) * 3
    x_hit[:4] *= 100
    u, origin = rng.normal(size=(slices, planes, 2, 3)), rng.normal(size=(slices, planes, 2))
    cell = np.empty((n, 2), np.int64)
    cells_kernel(plane, index, x_hit, Grids(u, origin, 0.25, half), cell)
    value = np.einsum("nai,ni->na", u[index, plane], x_hit) + origin[index, plane]
    expected = np.clip(np.floor(value / 0.25).astype(int) + half, 0, 2 * half - 1)
    np.testing.assert_array_equal(cell, np.where(plane[:, None] < 0, -1, expected))
    assert (cell == 0).any()
    assert (cell == 2 * half - 1).any()


def test_hits_near_their_planes_are_told_with_their_cells() -> None:
    """Fails when a hit of no plane is told, the gates' units are exchanged, or an array is filled at the hit's own place."""
    rng = np.random.default_rng(5)
    n, slices, planes, half = 400, 4, 3, 20
    plane, index = rng.integers(-1, planes, n), rng.integers(0, slices, n)
    x_hit, d, cosine = rng.normal(size=(n, 3)) * 3, 0.2 * rng.normal(size=n), rng.uniform(-1, 0, n)
    grid = Grids(rng.normal(size=(slices, planes, 2, 3)), rng.normal(size=(slices, planes, 2)), 0.25, half)
    near, cell, on, off = np.empty(n, np.int64), np.empty((n, 2), np.int64), np.empty(n, bool), np.empty(n)
    count = near_kernel(
        plane, index, x_hit, d, cosine, grid, 0.3, (0.05, 0.01), (4.0, 0.02), (2.0, 0.03), near, cell, on, off
    )
    close = np.flatnonzero((plane >= 0) & (np.abs(d) < 0.3))
    assert count == len(close)
    std = np.hypot(0.05 * cosine, 0.01)
    every = np.empty((n, 2), np.int64)
    cells_kernel(plane, index, x_hit, grid, every)
    np.testing.assert_array_equal(near[:count], plane[close])
    np.testing.assert_array_equal(cell[:count], every[close])
    np.testing.assert_array_equal(on[:count], (np.abs(d) < 4.0 * std + 0.02)[close])
    np.testing.assert_allclose(off[:count], (d / (2.0 * std + 0.03))[close])


def test_collapse_is_the_sum_of_outer_products() -> None:
    """Fails when a dropped point counts, or the order of the upper triangle is by columns."""
    rng = np.random.default_rng(2)
    n, slices, planes = 500, 5, 4
    keep, plane, index = rng.random(n) < 0.7, rng.integers(0, planes, n), rng.integers(0, slices, n)
    x_hit, d, weight = rng.normal(size=(n, 3)), rng.normal(size=n), rng.uniform(0.1, 5.0, n)
    x_hit[~keep] = d[~keep] = weight[~keep] = np.nan
    scatter, count = np.zeros((slices * planes, 15)), np.zeros(slices * planes, np.int64)
    collapse_kernel(keep, plane, index, x_hit, d, weight, planes, scatter, count)
    full = np.zeros((slices, planes, 5, 5))
    number = np.zeros((slices, planes), int)
    for i in np.flatnonzero(keep):
        y = np.array([*x_hit[i], 1.0, d[i]])
        full[index[i], plane[i]] += weight[i] * np.outer(y, y)
        number[index[i], plane[i]] += 1
    np.testing.assert_allclose(scatter.reshape(slices, planes, 15), full[:, :, *np.triu_indices(5)], atol=1e-12)
    np.testing.assert_array_equal(count.reshape(slices, planes), number)
