"""Collapsed scatter matrices against the same points one by one, each with its own range residual."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.factors import lidar_plane
from calib_core.factors.lidar_plane import (
    SLICE_S,
    Gate,
    Hits,
    LidarNoise,
    SlicePoses,
    cells_of,
    collapse,
    distinct,
    find_hits,
    move_and_sum,
    select,
)
from calib_core.factors.support import CELL_M, HALF_CELLS, PlaneExtents
from calib_core.geometry import plane_axes
from calib_core.types import FloatArray
from tests.core.factors.three_planes import NORMALS, OFFSETS_M, Scene, scanned

#: Range noise alone: a distance's standard deviation is then that of the range times the cosine.
NOISE = LidarNoise(0.02, 0.0)


def _seen(R: FloatArray, p: FloatArray, normals: FloatArray, offsets_m: FloatArray) -> FloatArray:
    """A = [n_lidar, w_lidar, 1] of every plane from one pose, (P, 5)."""
    return np.column_stack([normals @ R, normals @ p + offsets_m, np.ones(len(normals))])


def _range_errors(
    scene: Scene, hits: Hits, R: FloatArray, p: FloatArray, normals: FloatArray, offsets_m: FloatArray
) -> FloatArray:
    """Measured range less that at which the ray meets its plane, point by point."""
    x = scene.xyz.astype(np.float64)
    reach = np.linalg.norm(x, axis=1)
    n = normals[hits.plane]
    cosine = np.einsum("ni,ni->n", n, x @ R.T) / reach
    return reach + (n @ p + offsets_m[hits.plane]) / cosine


def _collapsed_cost(hits: Hits, R: FloatArray, p: FloatArray, normals: FloatArray, offsets_m: FloatArray) -> float:
    keep, _ = select(hits, NOISE, Gate(sigmas=1e9, margin_m=-1.0, robust_sigmas=1e9, least_cosine=0.0), None)
    bins = collapse(hits, keep, 1.0 / NOISE.distance_std_m(hits.cosine) ** 2, len(normals))
    a = _seen(R, p, normals, offsets_m)[bins.plane]
    return 0.5 * float(np.einsum("bi,bij,bj->", a, unpack(bins.scatter), a))


def test_collapsed_cost_is_the_range_residuals_cost_and_so_is_its_gradient() -> None:
    """Fails when x_hit is left at the noisy point (x - 0 e ray): the variance of the range then pulls the gradient.

    At the pose of association both costs are one; away from it they part with the square of the step, the pose, the
    planes' normals and their offsets moving together.
    """
    scene = scanned(1)
    hits = find_hits(scene.xyz, scene.offset_s, scene.poses, NORMALS, OFFSETS_M, Gate())
    assert (hits.plane >= 0).all()
    R, p = scene.poses.R[0], scene.poses.p[0]
    rng = np.random.default_rng(2)

    def both(
        size: float, turn: FloatArray, shift: FloatArray, lean: FloatArray, offset: FloatArray
    ) -> tuple[float, float]:
        normals = NORMALS + size * lean
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        turned = R @ Rotation.from_rotvec(size * turn).as_matrix()
        where = (turned, p + size * shift, normals, OFFSETS_M + size * offset)
        slow = 0.5 * float(np.sum(_range_errors(scene, hits, *where) ** 2)) / NOISE.range_std_m**2
        return _collapsed_cost(hits, *where), slow

    zero = (np.zeros(3), np.zeros(3), np.zeros((3, 3)), np.zeros(3))
    fast, slow = both(0.0, *zero)
    # The kernel takes a range from single-precision coordinates as it stands.
    assert fast == pytest.approx(slow, rel=1e-7)
    for _ in range(4):
        way = (rng.normal(size=3), rng.normal(size=3), rng.normal(size=(3, 3)), rng.normal(size=3))
        gaps, slope = [], 0.0
        for size in (4e-4, 2e-4, 1e-4):
            fast_forth, slow_forth = both(size, *way)
            fast_back, slow_back = both(-size, *way)
            slope = (slow_forth - slow_back) / size
            gaps.append(abs((fast_forth - fast_back) / size - slope))
        # A central difference has no second-order term: if the gradients agree, their gap falls with the square.
        assert gaps[2] < 5e-3 * abs(slope)
        assert 0.2 < gaps[1] / gaps[0] < 0.3
        assert 0.2 < gaps[2] / gaps[1] < 0.3


def test_moving_a_bin_is_moving_the_plane_it_is_seen_from() -> None:
    """Fails when A' M A is taken, or the translation is left out.

    Points in one frame and the plane seen from it, or both in a frame R, p further on: the same cost.
    """
    rng = np.random.default_rng(3)
    y = np.concatenate([rng.normal(size=(8, 50, 3)), np.ones((8, 50, 1)), 0.02 * rng.normal(size=(8, 50, 1))], axis=2)
    scatter = np.swapaxes(y, 1, 2) @ y
    R, p = Rotation.random(8, rng=rng).as_matrix(), rng.normal(size=(8, 3))
    n, w = rng.normal(size=(8, 3)), rng.normal(size=8)
    here = np.column_stack([n, w, np.ones(8)])
    n_there = (R @ n[..., None])[..., 0]
    there = np.column_stack([n_there, w - np.einsum("bi,bi->b", n_there, p), np.ones(8)])
    cost_here = np.einsum("bi,bij,bj->b", here, scatter, here)
    _, moved = move_and_sum(scatter[:, *np.triu_indices(5)], R, p, np.arange(8), np.arange(8))
    np.testing.assert_allclose(np.einsum("bi,bij,bj->b", there, moved, there), cost_here, rtol=1e-10)
    x = np.einsum("bij,bnj->bni", R, y[:, :, :3]) + p[:, None, :]
    directly = np.concatenate([x, y[:, :, 3:]], axis=2)
    np.testing.assert_allclose(moved, np.swapaxes(directly, 1, 2) @ directly, atol=1e-9)
    back_R, back_p = np.swapaxes(R, 1, 2), -np.einsum("bji,bj->bi", R, p)
    _, back = move_and_sum(moved[:, *np.triu_indices(5)], back_R, back_p, np.arange(8), np.arange(8))
    np.testing.assert_allclose(back, scatter, atol=1e-9)


def test_points_are_carried_to_their_slices_centre() -> None:
    """Fails when the turning within a slice is left out, or its translation is.

    Exact twist: 3 rad/s and 2 m/s for a millisecond. What is left is of second order: 6 m (3e-3)^2 / 2 = 0.03 mm.
    """
    rng = np.random.default_rng(4)
    still = scanned(5, noise_m=0.0, slices=1, n=300)
    omega, v = np.array([1.5, -2.0, 1.6]), np.array([1.2, 0.9, -1.3])
    t = rng.uniform(0.0, SLICE_S, len(still.xyz)) - 0.5 * SLICE_S
    turn = Rotation.from_rotvec(t[:, None] * omega)
    seen_later = turn.inv().apply(still.xyz.astype(np.float64) - t[:, None] * v)
    poses = replace(still.poses, omega_rad_s=omega[None], v_m_s=v[None])
    hits = find_hits(seen_later.astype(np.float32), t + 0.5 * SLICE_S, poses, NORMALS, OFFSETS_M, Gate())
    assert np.abs(hits.d).max() < 4e-5
    np.testing.assert_allclose(hits.x_hit, still.xyz, atol=2e-4)


def test_every_hit_lies_on_its_plane() -> None:
    """Fails when the range error is added instead of taken away: the hit lands twice as far off."""
    scene = scanned(6, noise_m=0.1)
    hits = find_hits(scene.xyz, scene.offset_s, scene.poses, NORMALS, OFFSETS_M, Gate())
    at = hits.x_hit @ scene.poses.R[0].T + scene.poses.p[0]
    distance = np.einsum("ni,ni->n", at, NORMALS[hits.plane]) + OFFSETS_M[hits.plane]
    np.testing.assert_allclose(distance, 0.0, atol=1e-12)
    x = scene.xyz @ scene.poses.R[0].T + scene.poses.p[0]
    np.testing.assert_allclose(hits.d, np.einsum("ni,ni->n", x, NORMALS[hits.plane]) + OFFSETS_M[hits.plane], atol=1e-6)


def test_field_of_view_keeps_azimuths() -> None:
    """Fails when degrees are taken for radians."""
    scene = scanned(7)
    hits = find_hits(scene.xyz, scene.offset_s, scene.poses, NORMALS, OFFSETS_M, Gate(), field_of_view_deg=45.0)
    azimuth = np.degrees(np.arctan2(scene.xyz[:, 1], scene.xyz[:, 0]))
    np.testing.assert_array_equal(hits.plane >= 0, np.abs(azimuth) <= 45.0)


def test_selection_and_weights_point_by_point() -> None:
    """Fails when `extra_m` is left out of the gate or of the weight, or a margin is taken for a limit from above; when
    the weight does not fall to zero at the gate, at the margin, where ranges end and where rays graze their plane; when the range
    is that of the point.

    Twin: the rules of `Gate` and of `LidarNoise`, said once more in a loop.
    """
    scene = scanned(8, noise_m=0.06, n=4000)
    farthest_m = float(np.quantile(np.linalg.norm(scene.xyz, axis=1), 0.8))
    nearest_m = float(np.quantile(np.linalg.norm(scene.xyz, axis=1), 0.2))
    noise = LidarNoise(0.02, 0.005, farthest_m, nearest_m=nearest_m)
    gate = Gate(sigmas=3.0, extra_m=0.01, margin_m=0.3, robust_sigmas=6.0, least_cosine=0.4)
    hits = find_hits(scene.xyz, scene.offset_s, scene.poses, NORMALS, OFFSETS_M, gate)
    cells = cells_of(hits, NORMALS)
    inside = np.zeros((3, 2 * HALF_CELLS, 2 * HALF_CELLS), bool)
    inside[:, :HALF_CELLS] = True
    extents = PlaneExtents(NORMALS, inside)
    keep, weight = select(hits, noise, gate, extents)
    without, _ = select(hits, noise, gate, None)
    edges, ends, begins, grazing = set(), set(), set(), set()
    for i in range(len(keep)):
        std = np.sqrt(0.02**2 * hits.cosine[i] ** 2 + 0.005**2)
        room, clear = 3.0 * std + 0.01 - abs(hits.d[i]), hits.ambiguous_m[i] - 0.225
        short = farthest_m - 3.0 * 0.02 - np.linalg.norm(hits.x_hit[i])
        long = np.linalg.norm(hits.x_hit[i]) - nearest_m - 3.0 * 0.02
        facing = -hits.cosine[i] - gate.least_cosine
        begins.add(bool(room > 0 and clear > 0 and facing > 0 and 0 < long < 0.005))
        short = min(short, long)
        near = room > 0 and clear > 0 and short > 0 and facing > 0
        grazing.add(bool(room > 0 and clear > 0 and short > 0 and facing < 0))
        ends.add(bool(room > 0 and clear > 0 and 0 < short < 0.005))
        assert without[i] == near
        assert keep[i] == (near and cells[i, 0] < HALF_CELLS)
        u = hits.d[i] / (6.0 * std + 0.01)
        edge = (
            min(room / (0.25 * std), 1.0) * min(clear / 0.075, 1.0) * min(short / 0.005, 1.0) * min(facing / 0.1, 1.0)
        )
        edges.add(bool(edge < 1.0))
        assert weight[i] == pytest.approx(edge * (1 - u**2) ** 2 / (std**2 + 0.0025**2) if near else 0.0)
    assert edges == ends == begins == grazing == {False, True}
    assert 0 < keep.sum() < without.sum() < len(keep)


@pytest.mark.parametrize("end", ["farthest_m", "nearest_m"])
def test_where_ranges_end_what_is_left_of_the_noise_does_not_count(end: str) -> None:
    """A wall seen at all slants, returns kept to a longest or from a shortest range on: those that count lie evenly about it.

    Oracle: the noise is even. Without that range the mean is 4 sigma off; fails, too, when the range of the noisy
    point is asked instead of that of where its ray meets the wall.
    """
    std_m, rng = 0.02, np.random.default_rng(4)
    limit_m, way = (4.0, 1.0) if end == "farthest_m" else (2.7, -1.0)
    ends_m = np.stack([np.full(400_000, 2.5), rng.uniform(-4.0, 4.0, 400_000), np.zeros(400_000)], axis=1)
    range_m = np.linalg.norm(ends_m, axis=1)
    xyz = (ends_m * (1.0 + std_m * rng.normal(size=len(range_m)) / range_m)[:, None]).astype(np.float32)
    xyz = xyz[way * np.linalg.norm(xyz, axis=1) < way * limit_m]
    still = np.zeros((1, 3))
    poses = SlicePoses(np.eye(3)[None], still, still, still, np.ones(1, bool))
    wall, at_m = np.array([[-1.0, 0.0, 0.0]]), np.array([2.5])
    hits = find_hits(xyz, np.zeros(len(xyz)), poses, wall, at_m, Gate())
    off = []
    plain = LidarNoise(std_m, 1e-4)
    for noise in (replace(plain, **{end: limit_m}), plain):
        keep, weight = select(hits, noise, Gate(), None)
        mean_m = float(np.sum(weight[keep] * hits.d[keep]) / np.sum(weight[keep]))
        off.append(abs(mean_m) * np.sqrt(float(np.sum(weight[keep]))))
    assert off[0] < 3.0 < off[1]


def test_cells_are_places_on_the_plane_whatever_the_lidars_pose() -> None:
    """Fails when the lidar's own place is left out of the cells' coordinates."""
    scene = scanned(9)
    hits = find_hits(scene.xyz, scene.offset_s, scene.poses, NORMALS, OFFSETS_M, Gate())
    at = hits.x_hit @ scene.poses.R[0].T + scene.poses.p[0]
    uv = np.einsum("nai,ni->na", plane_axes(NORMALS)[hits.plane], at)
    np.testing.assert_array_equal(cells_of(hits, NORMALS), np.floor(uv / CELL_M).astype(int) + HALF_CELLS)


def test_noise_of_a_distance() -> None:
    """Fails when the surface's roughness is multiplied by the cosine too."""
    noise = LidarNoise(0.03, 0.04)
    np.testing.assert_allclose(noise.distance_std_m(np.array([0.0, -1.0, 0.5])), [0.04, 0.05, np.hypot(0.015, 0.04)])


def unpack(scatter: FloatArray) -> FloatArray:
    """Full symmetric matrices from upper triangles (B, 15): (B, 5, 5)."""
    full = np.empty((len(scatter), 5, 5))
    full[:, *np.triu_indices(5)] = scatter
    return np.triu(full) + np.swapaxes(np.triu(full, 1), 1, 2)


@pytest.mark.parametrize("at_once", [65536, 4])
def test_bins_of_one_key_are_summed_each_from_its_own_pose(at_once: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fails when rows of equal keys that are not neighbours are not joined, or poses are counted by bins. Mutations, of some at a
    time: the last ones left out; poses of the first; rows counted among those asked for.
    """
    monkeypatch.setattr(lidar_plane, "_AT_ONCE", at_once)
    rng = np.random.default_rng(10)
    full = rng.normal(size=(6, 5, 5))
    full += np.swapaxes(full, 1, 2)
    R, p = Rotation.random(3, rng=rng).as_matrix(), rng.normal(size=(3, 3))
    pose, key = np.array([0, 1, 1, 2, 0, 0]), np.array([4, 2, 4, 9, 2, 2])
    A = np.tile(np.eye(5), (3, 1, 1))
    A[:, :3, :3], A[:, :3, 3] = R, p
    moved = A[pose] @ full @ np.swapaxes(A[pose], 1, 2)
    keys, sums = move_and_sum(full[:, *np.triu_indices(5)], R, p, pose, key)
    np.testing.assert_array_equal(keys, [2, 4, 9])
    for k, total in zip(keys, sums, strict=True):
        np.testing.assert_allclose(total, moved[key == k].sum(axis=0), atol=1e-12)
    among, rows = rng.normal(size=(9, 15)), np.array([1, 2, 4, 5, 7, 8])
    among[rows] = full[:, *np.triu_indices(5)]
    np.testing.assert_array_equal(move_and_sum(among, R, p, pose, key, rows)[1], sums)


@pytest.mark.parametrize("kind", ["rising", "rising but at seams", "any", "none"])
def test_distinct_keys_are_numpy_s(kind: str) -> None:
    """Mutations: places in the order of the sorted; one key more at the end."""
    rng = np.random.default_rng(7)
    key = np.repeat(np.arange(40), 3) + 100
    if kind == "rising but at seams":
        key = np.concatenate([key[:70], key[60:]])
    elif kind != "rising":
        key = rng.integers(-5, 30, 0 if kind == "none" else 200)
    keys, place = distinct(key)
    expected, of = np.unique(key, return_inverse=True)
    np.testing.assert_array_equal(keys, expected)
    np.testing.assert_array_equal(place, of)


def test_poses_are_seen_from_others() -> None:
    """Oracle: a point carried to the map and back. Mutations: the other pose not transposed; its place not taken away."""
    rng = np.random.default_rng(7)
    R, p, point = Rotation.random(6, random_state=7).as_matrix(), rng.normal(size=(6, 3)), rng.normal(size=3)
    none, usable = np.zeros((4, 3)), np.ones(4, bool)
    seen, others = SlicePoses(R[:4], p[:4], none, none, usable), SlicePoses(R[4:], p[4:], none, none, usable)
    which = np.array([1, 0, 0, 1])
    from_R, from_p = seen.seen_from(others, which)
    for i, k in enumerate(which):
        there = others.R[k].T @ (seen.R[i] @ point + seen.p[i] - others.p[k])
        np.testing.assert_allclose(from_R[i] @ point + from_p[i], there, atol=1e-14)
