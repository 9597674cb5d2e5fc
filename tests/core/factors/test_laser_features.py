"""A lidar's own parameters in its factors: points moved by the formula, moments point by point, features differenced."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.factors import laser_features
from calib_core.factors.blocks import sine_and_cosine
from calib_core.factors.laser_assembly import add_features_kernel, features_pull_kernel, features_times_kernel
from calib_core.factors.laser_features import (
    LaserErrors,
    LaserFactors,
    LaserSums,
    collapse_features,
    feature_changes,
    features_squares,
    numbered,
    summed_grams,
)
from calib_core.factors.laser_kernels import COLUMNS, Clusters, add_ones_kernel
from calib_core.factors.lidar_plane import Gate, find_hits
from calib_core.factors.patches import Between
from calib_core.types import FloatArray
from tests.core.factors import three_planes
from tests.core.factors.triangles import triangle

LASERS = 4


def _published(xyz: FloatArray, laser: np.ndarray, errors: LaserErrors) -> FloatArray:
    """What a lidar with these errors would publish for true points (calib_core/intrinsics.py)."""
    r = np.linalg.norm(xyz, axis=1) * (1.0 + errors.range_scale[laser]) + errors.range_offset_m[laser]
    elevation = np.arcsin(xyz[:, 2] / np.linalg.norm(xyz, axis=1)) - errors.elevation_rad[laser]
    true = np.arctan2(xyz[:, 1], xyz[:, 0])
    azimuth = true - errors.azimuth_rad[laser]
    for _ in range(5):  # published, whose own sine and cosine it is
        round_ = errors.eccentricity_rad @ np.array([np.sin(azimuth), np.cos(azimuth)])
        azimuth = true - errors.azimuth_rad[laser] - round_
    level = r * np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), r * np.sin(elevation)], axis=1)


def _errors(rng: np.random.Generator) -> LaserErrors:
    return LaserErrors(
        0.01 * rng.normal(size=LASERS), 0.004 * rng.normal(size=LASERS), 0.002 * rng.normal(size=LASERS),
        0.002 * rng.normal(size=LASERS), np.zeros(1), 0.003 * rng.normal(size=2),
    )  # fmt: skip


def test_points_come_back_from_what_a_wrong_lidar_publishes() -> None:
    """Mutations: elevation subtracted, scale before offset, azimuth about the other way."""
    rng = np.random.default_rng(0)
    xyz, laser = 4.0 * rng.normal(size=(500, 3)), rng.integers(0, LASERS, 500)
    errors = _errors(rng)
    published = _published(xyz, laser, errors).astype(np.float32)
    np.testing.assert_allclose(errors.corrected(published, laser.astype(np.uint16)), xyz, atol=3e-6)


def test_slant_is_taken_off_as_it_is_published() -> None:
    """Points of a wall at 3 m, met at all angles: a range r falls short by grazing r tan(i), and long by incidence (1 / c - 1),
    which is the wall's own.

    Mutations: grazing's sign; by the cosine instead of the sine; without the range; the first wall's incidence for all.
    """
    angle = np.linspace(-1.2, 1.2, 41)
    true_m, c = 3.0 / np.cos(angle), np.cos(angle)
    none = [np.zeros(LASERS) for _ in range(4)]
    incidence_m, wall = np.array([0.004, -0.002]), np.arange(41) % 2
    errors = LaserErrors(*none, incidence_m, np.zeros(2), 0.0007)
    published_m = true_m + incidence_m[wall] * (1.0 / c - 1.0) - 0.0007 * true_m * np.tan(np.abs(angle))
    hit = 3.0 / np.cos(angle)[:, None] * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(41)])
    np.testing.assert_allclose(errors.straightened((3.0 - published_m * c), -c, hit, wall), 0.0, atol=1e-12)


def test_points_of_no_known_laser_stay_as_they_are() -> None:
    """Mutation: the number of a laser taken modulo how many there are."""
    errors = _errors(np.random.default_rng(1))
    xyz = np.ones((2, 3), np.float32)
    out = errors.corrected(xyz, np.array([LASERS, 0], np.uint16))
    assert (out[0] == xyz[0]).all()
    assert (out[1] != xyz[1]).any()


@pytest.mark.parametrize("column", range(8))
def test_features_are_the_derivatives_of_distances(column: int) -> None:
    """Finite differences through the correction and the plane. Mutations: two features exchanged, a sign, cosine for its
    negative."""
    scene = three_planes.scanned(2, noise_m=0.0, slices=1)
    laser = np.random.default_rng(2).integers(0, LASERS, len(scene.xyz)).astype(np.uint16)
    gate = Gate()

    def hits(parameter: float):
        parts, off_axis = [np.zeros(LASERS) for _ in range(4)], np.zeros(2)
        if column < 4:
            parts[(0, 2, 3, 1)[column]] += parameter
        elif column in (5, 6):
            off_axis[column - 5] = parameter
        moved = LaserErrors(*parts, np.zeros(1), off_axis).corrected(scene.xyz, laser)
        return find_hits(moved, scene.offset_s, scene.poses, three_planes.NORMALS, three_planes.OFFSETS_M, gate)

    size = 1e-3
    forth, back, here = hits(size), hits(-size), hits(0.0)
    same = (forth.plane == back.plane) & (forth.plane == here.plane) & (here.plane >= 0)
    numerical = (forth.d - back.d) / (2 * size)
    if column in (4, 7):
        own = (np.ones(1),) if column == 4 else (np.zeros(1), np.zeros(2), 1.0)
        unit = LaserErrors(*(np.zeros(LASERS) for _ in range(4)), *own)
        numerical = unit.straightened(here.d, here.cosine, here.x_hit) - here.d
    for laser_of in range(LASERS):
        some = same & (laser == laser_of)
        keep = np.zeros(len(same), bool)
        index = np.flatnonzero(some)[:1]
        keep[index] = True
        sums = collapse_features(
            here, keep, np.ones(len(same)), three_planes.NORMALS, laser=laser, lasers=LASERS,
            group=np.zeros(1, np.int64), middle=np.zeros(1, np.int64),
        )  # fmt: skip
        assert sums.laser.tolist() == [laser_of]
        # A point's first moment with the constant is its feature.
        assert sums.cross[0, column, 3] == pytest.approx(numerical[index[0]], rel=2e-3, abs=2e-3)


def _features(x_hit: FloatArray, seen: FloatArray, n: FloatArray) -> FloatArray:
    """(N, 8) as the module's head writes them. x_hit: (N, 3).   seen: (N,) minus the cosine.   n: (N, 3), lidar axes."""
    r, level = np.linalg.norm(x_hit, axis=1), np.linalg.norm(x_hit[:, :2], axis=1)
    rising = np.column_stack([-x_hit[:, 2] * x_hit[:, 0] / level, -x_hit[:, 2] * x_hit[:, 1] / level, level])
    aside = np.sum(n * np.cross([0.0, 0.0, 1.0], x_hit), axis=1)
    return np.column_stack(
        [
            seen, np.sum(n * rising, axis=1), aside, seen * r, 1.0 - seen, aside * x_hit[:, 1] / level,
            aside * x_hit[:, 0] / level, -r * np.sqrt(1.0 - seen**2),
        ]
    )  # fmt: skip


@pytest.mark.parametrize("angle_rad", [0.0, 1e-9, -3e-4, 0.0499, -0.05])
def test_sine_and_cosine_of_small_angles(angle_rad: float) -> None:
    """Mutations: the cosine without its last term, the sine without its last but one."""
    sine, cosine = sine_and_cosine(angle_rad)
    assert sine == pytest.approx(math.sin(angle_rad), rel=3e-16, abs=0.0)
    assert cosine == pytest.approx(math.cos(angle_rad), rel=3e-16)


def test_a_laser_that_looks_far_aside_is_turned_back() -> None:
    """By a radian, beside one that is turned by a milliradian. Mutation: the series for any angle."""
    none = np.zeros(2)
    errors = LaserErrors(none, none, none, np.array([1.0, 1e-3]), np.zeros(1))
    rng = np.random.default_rng(8)
    xyz, laser = rng.normal(size=(200, 3)).astype(np.float32), rng.integers(0, 2, 200).astype(np.uint16)
    turned = np.array([1.0, 1e-3])[laser]
    expected = Rotation.from_rotvec(turned[:, None] * [0.0, 0.0, 1.0]).apply(xyz)
    np.testing.assert_allclose(errors.corrected(xyz, laser), expected, atol=1e-6)


def test_moments_are_those_of_the_points_and_move_with_them() -> None:
    """Mutations: hits left at their slice, gram by the wrong laser, weight squared; of the incidence's products what belongs to
    the one's; a product of the triangle twice; points of a laser beyond the last to the next plane's first.
    """
    scene = three_planes.scanned(4, slices=3)
    rng = np.random.default_rng(4)
    hits = find_hits(scene.xyz, scene.offset_s, scene.poses, three_planes.NORMALS, three_planes.OFFSETS_M, Gate())
    keep, weight = hits.plane >= 0, rng.uniform(1.0, 2.0, len(hits.plane))
    laser = rng.integers(0, LASERS + 1, len(hits.plane)).astype(np.uint16)  # of one that nobody knows, too
    sums = collapse_features(
        hits, keep, weight, three_planes.NORMALS, laser=laser, lasers=LASERS,
        group=np.zeros(3, np.int64), middle=np.array([1]),
    )  # fmt: skip
    whole = np.zeros(5)
    for plane, own, cross, gram in zip(sums.plane, sums.laser, sums.cross, sums.gram, strict=True):
        mine = keep & (hits.plane == plane) & (laser == own)
        seen = -hits.cosine[mine]
        f = _features(hits.x_hit[mine], seen, (three_planes.NORMALS[plane] @ hits.poses.R)[hits.slice_index[mine]])
        np.testing.assert_allclose(gram, triangle((weight[mine, None] * f).T @ f), rtol=2e-6, atol=1e-3)
        y = np.column_stack([hits.x_hit[mine], np.ones(mine.sum()), hits.d[mine]])
        np.testing.assert_allclose(cross[0], (weight[mine] * seen) @ y, rtol=2e-6, atol=1e-4)
        np.testing.assert_allclose(cross[4], (weight[mine] * (1.0 - seen)) @ y, rtol=2e-6, atol=1e-4)
        whole += (weight[mine] * seen) @ y
    known = keep & (laser < LASERS)
    every = np.column_stack([hits.x_hit, np.ones(len(keep)), hits.d])[known]
    np.testing.assert_allclose(whole, (weight * -hits.cosine)[known] @ every, rtol=1e-5)


def test_changed_parameters_add_what_their_points_say() -> None:
    """Mutations: the cross term once instead of twice; a plane's material not added to the incidence."""
    rng = np.random.default_rng(5)
    y, f = rng.normal(size=(20, 5)), rng.normal(size=(20, 8))
    one = np.zeros(1, np.int64)
    factors = LaserFactors.unmoved(one, one + 1, (f.T @ y)[None], triangle(f.T @ f)[None], one)
    a, change = rng.normal(size=(1, 5)), rng.normal(size=(2, COLUMNS))
    moved = feature_changes(change, 8)[1]
    before, after = y @ a[0], y @ a[0] + f @ moved
    assert features_squares(factors, a, change, one)[0] == pytest.approx(after @ after - before @ before)
    expected = np.array([change[1, 0] + change[1, 4], *change[1, 1:4], change[1, 5] + change[1, 13], *change[1, 6:9]])
    np.testing.assert_allclose(moved, expected)
    np.testing.assert_allclose(feature_changes(change, 12)[1], [*expected, *-change[1, 9:13]])


def _moves(rng: np.random.Generator, poses: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """R (T, 3, 3), p (T, 3), and what takes [x, 1, d] to [R x + p, 1, d]: (T, 5, 5)."""
    R, p = Rotation.random(poses, random_state=rng).as_matrix(), rng.normal(size=(poses, 3))
    whole = np.tile(np.eye(5), (poses, 1, 1))
    whole[:, :3, :3], whole[:, :3, 3] = R, p
    return R, p, whole


def test_many_clusters_add_what_all_their_points_say_where_their_hits_are_now() -> None:
    """Eleven clusters of three planes and two lasers, in parts on all threads, against their points one by one, each with its
    hits moved; one bin holds two that moved by different poses.

    Mutations: a part's clusters with the others' changes; products summed by laser alone; the plane's and laser's numbers
    exchanged; hits left where they were; the pose of a bin's first cluster for all of it; turned the other way; not shifted.
    """
    rng = np.random.default_rng(8)
    y, f = rng.normal(size=(11, 6, 5)), rng.normal(size=(11, 6, 8))
    y[:, :, 3] = 1.0
    plane, laser = np.array([0, 0, 1, 1, 1, 2, 2, 2, 2, 2]), np.array([0, 1, 0, 0, 1, 1, 1, 1, 0, 0, 1])
    in_bin, pose = np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 8, 9]), np.array([0, 0, 1, 2, 2, 2, 3, 0, 1, 3, 3])
    R, p, whole = _moves(rng, 4)
    cross = np.einsum("bpf,bpc->bfc", f, y).astype(np.float32)
    gram = triangle(np.einsum("bpf,bpe->bfe", f, f)).astype(np.float32)
    factors = replace(LaserFactors.unmoved(in_bin, laser, cross, gram, plane), pose=pose, R=R, p=p)
    a, change = rng.normal(size=(10, 5)), rng.normal(size=(2, COLUMNS))
    moved = feature_changes(change, 8)[laser]
    there = np.einsum("bij,bpj->bpi", whole[pose], y)
    before = np.einsum("bpc,bc->bp", there, a[in_bin])
    after = before + np.einsum("bpf,bf->bp", f, moved)
    expected = np.bincount(plane[in_bin], np.sum(after**2 - before**2, axis=1))
    np.testing.assert_allclose(features_squares(factors, a, change, plane), expected, rtol=1e-6)


def test_points_of_all_lasers_are_counted_where_their_hits_are_now() -> None:
    """Mutations: hits left where they were; of the two that make one a point only the first."""
    rng = np.random.default_rng(9)
    cross, in_bin, pose = (
        rng.normal(size=(5, 8, 5)).astype(np.float32),
        np.array([0, 0, 2, 2, 2]),
        np.array([1, 1, 0, 0, 1]),
    )
    R, p, whole = _moves(rng, 2)
    sums, expected = np.zeros((3, 4)), np.zeros((3, 4))
    for b in range(5):
        expected[in_bin[b]] += (whole[pose[b]] @ (cross[b, 0].astype(float) + cross[b, 4]))[:4]
    add_ones_kernel(Clusters(in_bin, np.zeros(5, np.int64), pose, cross, R, p), sums)
    np.testing.assert_allclose(sums, expected, atol=1e-12)


def test_heights_are_felt_by_the_shares_that_points_have_of_them() -> None:
    """Moments of the points in a square between heights, laser by laser, with their shares as four features more.

    Mutations: square and laser exchanged in the cluster's number; of a share's products with the incidence the one's; two shares'
    product taken twice; a share's moments without the weight.
    """
    scene = three_planes.scanned(6, slices=3)
    rng = np.random.default_rng(6)
    hits = find_hits(scene.xyz, scene.offset_s, scene.poses, three_planes.NORMALS, three_planes.OFFSETS_M, Gate())
    keep, weight = hits.plane >= 0, rng.uniform(1.0, 2.0, len(hits.plane))
    laser = rng.integers(0, LASERS, len(hits.plane)).astype(np.uint16)
    between = Between(rng.integers(0, 4, len(hits.plane)), rng.dirichlet(np.ones(4), len(hits.plane)), 4)
    sums = collapse_features(
        hits, keep, weight, three_planes.NORMALS, laser=laser, lasers=LASERS,
        group=np.zeros(3, np.int64), middle=np.array([1]), between=between,
    )  # fmt: skip
    seen = 0
    for plane, unit, cross, gram in zip(sums.plane, sums.laser, sums.cross, sums.gram, strict=True):
        mine = keep & (hits.plane == plane) & (between.square == unit // LASERS) & (laser == unit % LASERS)
        n_lidar = (three_planes.NORMALS[plane] @ hits.poses.R)[hits.slice_index[mine]]
        f = np.hstack([_features(hits.x_hit[mine], -hits.cosine[mine], n_lidar), between.share[mine]])
        np.testing.assert_allclose(gram, triangle((weight[mine, None] * f).T @ f), rtol=2e-6, atol=1e-3)
        np.testing.assert_allclose(cross[:, 3], weight[mine] @ f, rtol=1e-5, atol=1e-4)
        np.testing.assert_allclose(cross[:, 4], (weight * hits.d)[mine] @ f, rtol=1e-4, atol=1e-4)
        seen += int(mine.sum())
    assert seen == keep.sum()


@pytest.mark.parametrize("cells", [40, 10_000])
def test_clusters_are_numbered_in_order_looked_up_or_sorted(cells: int) -> None:
    """Oracle: NumPy's. Mutations: numbers of keys that nobody has counted along; the keys' own order."""
    key = np.random.default_rng(cells).integers(0, 40, 200)
    keys, place = numbered(key[key != 7], cells)
    expected, of = np.unique(key[key != 7], return_inverse=True)
    assert keys.tolist() == expected.tolist()
    assert place.tolist() == of.tolist()


@pytest.mark.parametrize("width", [19, 20])
def test_normal_equations_of_clusters_are_those_of_whole_rows(width: int) -> None:
    """Against J' M J with every row written out, of clusters in two parts, lasers without columns of their own among them.

    Mutations: stretches that reach over a column nobody touches (those of others are written then: here, of NaN); a bin's rows
    not emptied for the next; the distance's moment left out of the force; the clocks' column where planes are.
    """
    rng = np.random.default_rng(11)
    knots, planes, lasers = 4, 3, 6
    knot, plane = np.array([0, 0, 1, 3]), np.array([0, 2, 1, 2])
    which = [rng.permutation(lasers)[:4] for _ in knot]
    laser, bins_ = np.concatenate([np.sort(w) for w in which]), np.repeat(np.arange(4), 4)
    planes_start, clock = 12, 12 + 3 * planes
    first = clock + 2  # one column that is nobody's of these
    column_of = np.full((lasers, COLUMNS), -1)
    column_of[:, 0], column_of[:, 1] = first + np.arange(lasers), first + lasers + np.arange(lasers)
    column_of[2, 1] = -1
    column_of[:, 4], column_of[:, 5] = first + 2 * lasers, first + 2 * lasers + 1
    column_of[:3, 9], column_of[1:, 12] = (
        first + 2 * lasers + 3,
        first + 2 * lasers + 5,
    )  # two heights, one between is nobody's
    size = first + 2 * lasers + 6
    J, a = rng.normal(size=(4, 4, width)), rng.normal(size=(4, 5))
    cross, change = rng.normal(size=(len(bins_), 12, 5)).astype(np.float32), rng.normal(size=(lasers, 12))
    pose = np.array([0, 0, 1, 1, *[1] * 4, 2, 2, 2, 0, *[2] * 4])
    R, p, whole = _moves(rng, 3)
    there = cross.astype(float) @ np.swapaxes(whole[pose], 1, 2)
    coefficients = np.stack(
        [feature_changes(column, 12) for column in np.eye(COLUMNS)[:, None].repeat(lasers, 1)], axis=-1
    )
    border, gradient = np.zeros((knots, 9, size)), np.zeros((knots, 9))
    corner, shared = np.zeros((size, size)), np.zeros(size)
    untouched = np.delete(np.arange(size), np.unique(column_of[column_of >= 0]))
    border[:, :, untouched] = np.nan
    want_border, want_gradient = np.where(np.isnan(border), np.nan, 0.0), np.zeros((knots, 9))
    want_corner, want_shared = np.zeros((size, size)), np.zeros(size)
    for b, q in enumerate(bins_):
        j, k = laser[b], knot[q]
        own = np.concatenate([np.arange(7), planes_start + 3 * plane[q] + np.arange(3), np.full(width - 19, clock)])
        by = J[q].T @ there[b, :, :4].T  # (width, 12)
        want_gradient[k] += by[:9] @ change[j]
        want_shared[own] += by[9:] @ change[j]
        for c, column in enumerate(column_of[j]):
            if column >= 0:
                f = coefficients[j, :, c]
                want_border[k, :, column] += by[:9] @ f
                want_corner[own, column] += by[9:] @ f
                want_corner[column, own] += by[9:] @ f
                want_shared[column] += f @ there[b] @ a[q]
    for some in (slice(0, 8), slice(8, None)):
        clusters = Clusters(bins_[some], laser[some], pose[some], cross[some], R, p)
        add_features_kernel(
            clusters, knot, plane, J, a, column_of, change, planes_start, clock, gradient, border, corner, shared
        )
    for got, want in ((gradient, want_gradient), (border, want_border), (corner, want_corner), (shared, want_shared)):
        np.testing.assert_allclose(got, want, rtol=1e-12, atol=1e-12)
    # The gradient alone, and what columns of the border times changes of the lasers' parameters pull knots by.
    pulled, own_shared, columns = np.zeros((4, 4)), np.zeros(size), rng.normal(size=(lasers, COLUMNS, 3))
    crossed, every = np.zeros((4, 4, 3)), Clusters(bins_, laser, pose, cross, R, p)
    features_pull_kernel(every, a, column_of, change, pulled, own_shared)
    features_times_kernel(every, feature_changes(columns, 12), crossed)
    by_bin = np.zeros((4, 4, 12))
    for b, q in enumerate(bins_):
        by_bin[q] += there[b, :, :4].T * change[laser[b]]
    np.testing.assert_allclose(pulled, by_bin.sum(axis=2), atol=1e-12)
    lasers_own = np.unique(column_of[column_of >= 0])
    np.testing.assert_allclose(own_shared[lasers_own], want_shared[lasers_own], atol=1e-12)
    expected = np.zeros((4, 4, 3))
    for b, q in enumerate(bins_):
        expected[q] += there[b, :, :4].T @ feature_changes(columns, 12)[laser[b]]
    np.testing.assert_allclose(crossed, expected, atol=1e-12)


def test_points_in_no_square_are_told_apart_by_their_plane() -> None:
    """Three lasers, two squares between heights. Mutations: points in squares shifted, too; by one for each plane; those of the
    last laser in a square taken for beyond."""
    laser = np.array([0, 5, 6, 8, 6, 8])
    plane = np.array([1, 1, 0, 0, 2, 1])
    sums = LaserSums(
        np.zeros(6, np.int64), plane, laser, np.zeros((6, 12, 5), np.float32), np.zeros((6, 78), np.float32)
    )
    np.testing.assert_array_equal(sums.by_plane(3, 6).laser, [0, 5, 6, 8, 12, 11])
    np.testing.assert_array_equal(sums.by_plane(3, 6).laser % 3, laser % 3)


@pytest.mark.parametrize("at_once", [3, 65536])
def test_products_are_summed_by_plane_and_laser(at_once: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: matrices added one by one. Mutations: the last ones left out; their places those of the first."""
    monkeypatch.setattr(laser_features, "_AT_ONCE", at_once)
    rng = np.random.default_rng(3)
    f = rng.normal(size=(11, 8)).astype(np.float32)
    products = f[:, :, None] * f[:, None]
    plane, laser = rng.integers(0, 2, 11), rng.integers(0, 3, 11)
    grams, of_plane, of_laser = summed_grams(triangle(products).astype(np.float32), plane, laser)
    found = {(p, u): gram for p, u, gram in zip(of_plane.tolist(), of_laser.tolist(), grams, strict=True)}
    assert set(found) == set(zip(plane.tolist(), laser.tolist(), strict=True))
    for (p, u), gram in found.items():
        np.testing.assert_allclose(gram, products[(plane == p) & (laser == u)].sum(axis=0), rtol=1e-5, atol=1e-5)
