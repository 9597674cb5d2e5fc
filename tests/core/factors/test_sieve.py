"""Returns of a cloud that a grid thinned, counted by what their cell leaves of their noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.factors.kernels import cut_off
from calib_core.factors.lidar_plane import Gate, LidarNoise, SlicePoses, as_sieved, cells_across, find_hits, select
from calib_core.full.joint.lidar_noise import tapered_variance
from calib_core.types import Float32Array, FloatArray
from tests.core.factors import three_planes

CELL_M, STD_M = 0.1, 0.02


@pytest.mark.parametrize("seed", range(6))
def test_what_a_cell_leaves_of_a_normal_law(seed: int) -> None:
    """Mean and variance by summing the density over the part of the ray that is in the cell, a micrometre apart, for
    rays into any octant. Mutations: a face beside the cell where a coordinate is negative; the variance without its mean's
    square; one axis left out.
    """
    rng = np.random.default_rng(seed)
    for _ in range(20):
        ray = rng.normal(size=3)
        ray /= np.linalg.norm(ray)
        hit_m, error_m = rng.uniform(1.0, 6.0), STD_M * rng.normal()
        x = ray * (hit_m + error_m)
        e = np.arange(-0.12, 0.12, 1e-6)
        inside = (np.floor((hit_m + e)[:, None] * ray / CELL_M) == np.floor(x / CELL_M)).all(axis=1)
        density = np.exp(-0.5 * (e / STD_M) ** 2) * inside
        mean = float(np.sum(e * density) / np.sum(density))
        variance = float(np.sum((e - mean) ** 2 * density) / np.sum(density))
        got = cut_off(x[0], x[1], x[2], error_m, STD_M, CELL_M)
        assert got[0] == pytest.approx(mean, abs=3e-6)
        assert got[1] == pytest.approx(variance / STD_M**2, abs=3e-4)


def test_a_ray_along_an_axis_meets_two_faces() -> None:
    """Mutation: divide by a coordinate that is zero."""
    mean_m, share = cut_off(2.05, 0.0, 0.0, 0.0, STD_M, CELL_M)
    assert (mean_m, share) == (pytest.approx(0.0, abs=1e-12), pytest.approx(0.9113, abs=1e-3))


def _swept(normal: FloatArray, seed: int) -> tuple[Float32Array, FloatArray]:
    """Sixty sweeps of 31 lasers over a wall, each from a distance of its own, thinned by the grid; and each return's distance."""
    rng = np.random.default_rng(seed)
    azimuth, elevation = np.meshgrid(
        np.radians(np.arange(-40.0, 40.0, 0.2)), np.radians(np.arange(-15.0, 16.0)), indexing="ij"
    )
    rays = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1
    )
    rays = rays.reshape(-1, 3)
    points, sweeps = [], []
    for _ in range(60):
        away_m = 3.0 + 0.3 * rng.uniform()
        range_m = away_m / (rays @ normal) + STD_M * rng.normal(size=len(rays))
        xyz = rays * range_m[:, None]
        _, first = np.unique(np.floor(xyz / CELL_M), axis=0, return_index=True)
        points.append(xyz[np.sort(first)])
        sweeps.append(np.full(len(points[-1]), away_m))
    return np.concatenate(points).astype(np.float32), np.concatenate(sweeps)


def _distances(
    xyz: Float32Array, away_m: FloatArray, normal: FloatArray, sieve_m: float
) -> tuple[FloatArray, FloatArray]:
    """What each return asks a wall to be off by, and its weight [1/m^2]."""
    d, weight = [], []
    still, noise = np.zeros((1, 3)), LidarNoise(STD_M, 1e-4)
    poses = SlicePoses(np.eye(3)[None], still, still, still, np.ones(1, bool))
    for away in np.unique(away_m):
        mine = away_m == away
        hits = find_hits(xyz[mine], np.zeros(np.count_nonzero(mine)), poses, -normal[None], np.array([away]), Gate())
        kept = as_sieved(hits, replace(noise, sieve_m=sieve_m), Gate(), *select(hits, noise, Gate(), None))
        d.append(kept[0].d[kept[1]])
        weight.append(kept[2][kept[1]])
    return np.concatenate(d), np.concatenate(weight)


@pytest.mark.parametrize("turn_deg", [17.0, 31.0])
def test_a_wall_is_where_it_is_whatever_the_grid_leaves(turn_deg: float) -> None:
    """Noise decides which returns of a slanted wall a grid leaves: the first in each cell are those that it pushed over the face.
    Oracle: the wall that was swept, and the law of the weighted mean and of the squares, if the weights are right. Taken as they
    came they put the wall many sigmas off. Mutations: distances without their cells' mean;
    weights that are not less for it.
    """
    normal = Rotation.from_euler("zy", [turn_deg, 8.0], degrees=True).apply([1.0, 0.0, 0.0])
    xyz, away_m = _swept(normal, 3)
    off, squares = [], []
    for sieve_m in (CELL_M, 0.0):
        d, weight = _distances(xyz, away_m, normal, sieve_m)
        off.append(abs(float(np.sum(weight * d))) / np.sqrt(float(np.sum(weight))))
        squares.append(float(np.mean(weight * d**2)))
    assert off[0] < 3.0
    assert off[1] > 10.0
    assert squares[0] == pytest.approx(1.0, abs=0.03)


def test_where_the_motion_is_less_sure_than_a_range_cells_tell_nothing() -> None:
    """Mutation: cells whatever the gate."""
    normal = np.array([1.0, 0.0, 0.0])
    xyz, away_m = _swept(normal, 1)
    still = np.zeros((1, 3))
    poses = SlicePoses(np.eye(3)[None], still, still, still, np.ones(1, bool))
    noise, gate = LidarNoise(STD_M, 1e-4, sieve_m=CELL_M), Gate(extra_m=4.1 * STD_M)
    hits = find_hits(xyz, np.zeros(len(xyz)), poses, -normal[None], away_m[:1], gate)
    keep, weight = select(hits, noise, gate, None)
    after, still_kept, same = as_sieved(hits, noise, gate, keep, weight)
    np.testing.assert_array_equal(after.d, hits.d)
    np.testing.assert_array_equal(still_kept, keep)
    np.testing.assert_array_equal(same, weight)


def test_what_a_cell_keeps_of_a_hits_error_across_its_plane() -> None:
    """Of each return, by moving it along its ray until it is in another cell, a tenth of a millimetre at a time; errors that read
    long are positive, seen from either side of a plane. Mutations: the sign of the cosine left out; faces not foreshortened; the
    error not added.
    """
    scene = three_planes.scanned(5, slices=3)
    hits = find_hits(scene.xyz, scene.offset_s, scene.poses, three_planes.NORMALS, three_planes.OFFSETS_M, Gate())
    across = cells_across(hits, CELL_M)
    assert not np.isfinite(cells_across(hits, 0.0)).any()
    some = np.flatnonzero(hits.plane >= 0)[:60]
    assert (hits.cosine[some] < 0.0).all()
    for i in some:
        x = hits.published_m[i].astype(np.float64)
        r, ray = np.linalg.norm(x), x / np.linalg.norm(x)
        along = np.arange(-0.4, 0.4, 1e-4)
        inside = (np.floor((r + along)[:, None] * ray / CELL_M) == np.floor(x / CELL_M)).all(axis=1)
        errors_m = hits.d[i] / hits.cosine[i] + along[inside]
        expected = np.abs(hits.cosine[i]) * np.array([errors_m[0], errors_m[-1]])
        np.testing.assert_allclose(across[i], expected, atol=1.5e-4)


@pytest.mark.parametrize("std_m", [0.006, 0.02, 0.04])
def test_the_noise_of_what_a_grid_left_is_that_of_the_lidar(std_m: float) -> None:
    """A wall that moves through cells; of all returns each cell keeps one, whichever: by a fifth to a third too much as they are.

    One in a hundred is no return of the wall, and in its cell alone. Mutations: cells not asked; cells in metres, not in standard
    deviations; the law of the middle cell for all.
    """
    rng = np.random.default_rng(int(1e3 * std_m))
    wall_m = np.repeat(rng.uniform(0.0, 40 * CELL_M, 4000), 30)
    error_m = std_m * rng.normal(size=len(wall_m))
    odd = rng.random(len(wall_m)) < 0.01
    error_m[odd] = rng.uniform(-0.3, 0.3, odd.sum())
    cell = np.floor((wall_m + error_m) / CELL_M).astype(np.int64)
    # The first in each cell that a look at one place of the wall sees.
    _, first = np.unique(np.arange(len(cell)) // 30 * 1000 + cell, return_index=True)
    error_m, cell, wall_m = error_m[first], cell[first], wall_m[first]
    faces_m = np.stack([cell * CELL_M - wall_m, (cell + 1) * CELL_M - wall_m], axis=1)
    assert np.sqrt(tapered_variance(error_m)) > 1.1 * std_m
    assert np.sqrt(tapered_variance(error_m, faces_m)) == pytest.approx(std_m, rel=0.05)


def test_a_cell_that_keeps_all_changes_nothing() -> None:
    """Mutation: the taper's share of the variance left out of the cells' law."""
    d = np.random.default_rng(3).normal(size=3000)
    everywhere = np.tile([-np.inf, np.inf], (3000, 1))
    assert tapered_variance(d, everywhere) == pytest.approx(tapered_variance(d), rel=1e-5)
