"""Patches of planes against their own places, and heights between them against a plane through four corners."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.factors.lidar_plane import Gate, find_hits
from calib_core.factors.patches import SurfacePatches, patches_of
from calib_core.factors.support import CELL_M, HALF_CELLS, PlaneExtents
from calib_core.geometry import plane_axes
from tests.core.factors import three_planes


def _patches() -> SurfacePatches:
    """A square of patches about the origin of each plane's grid."""
    inside = np.zeros((3, 2 * HALF_CELLS, 2 * HALF_CELLS), bool)
    inside[:, HALF_CELLS - 40 : HALF_CELLS + 40, HALF_CELLS - 40 : HALF_CELLS + 40] = True
    return patches_of(PlaneExtents(three_planes.NORMALS, inside))


def test_every_cell_has_its_patch_and_a_house_no_more_than_a_room() -> None:
    """Mutations: patches not numbered through all planes, their width not grown with the area."""
    patches = _patches()
    assert [f"{1 + plane}" for plane in patches.planes] == [name.split(":")[0] for name in patches.names]
    assert 700 < patches.count == len(patches.names) == len(set(patches.names)) <= 1300
    assert patches.width * CELL_M >= 0.75
    few = np.zeros((1, 2 * HALF_CELLS, 2 * HALF_CELLS), bool)
    edge = 3 * (HALF_CELLS // 3)
    few[0, edge : edge + 6, edge : edge + 6] = True
    small = patches_of(PlaneExtents(three_planes.NORMALS[:1], few))
    assert (small.width, small.count) == (3, 4)


def test_heights_between_patches_lie_on_the_plane_through_their_middles() -> None:
    """Heights that are linear in the place come back exactly wherever four patches are about.

    Mutations: middles half a patch aside; rows for columns; two corners exchanged; a hit's own patch instead of what is between.
    """
    scene = three_planes.scanned(3)
    hits = find_hits(scene.xyz, scene.offset_s, scene.poses, three_planes.NORMALS, three_planes.OFFSETS_M, Gate())
    patches = _patches()
    plane, row, column = np.nonzero(patches.number >= 0)
    slope = np.array([[0.001, -0.002], [0.003, 0.001], [-0.002, 0.004]])
    width_m = patches.width * CELL_M
    middle_m = (np.stack([row, column], axis=1) + 0.5) * width_m - HALF_CELLS * CELL_M
    values = np.einsum("ni,ni->n", slope[plane], middle_m)
    between = patches.between(hits)
    found = patches.heights_m(between, values)
    seen = hits.plane >= 0
    R, p = scene.poses.R[hits.slice_index], scene.poses.p[hits.slice_index]
    there = (R @ hits.x_hit[..., None])[..., 0] + p
    place = np.einsum("nij,nj->ni", plane_axes(three_planes.NORMALS)[np.maximum(hits.plane, 0)], there)
    expected = np.einsum("ni,ni->n", slope[np.maximum(hits.plane, 0)], place)
    well_within = seen & (np.abs(place).max(axis=1) < 40 * CELL_M - 1.5 * width_m)
    assert well_within.sum() > 100
    np.testing.assert_allclose(found[well_within], expected[well_within], atol=1e-9)
    assert (patches.of(hits)[well_within] < patches.count).all()
    assert found[~seen] == pytest.approx(0.0)
    assert (between.square[~seen] == between.squares - 1).all()
    # What is missing at an edge the others have: all alike, heights are that everywhere they lie about.
    alike = patches.heights_m(between, np.ones(patches.count))
    np.testing.assert_allclose(alike, between.square < between.squares - 1)
    assert alike[patches.of(hits) < patches.count] == pytest.approx(1.0)


def test_heights_that_are_white_once_whitened_are_alike_near_one_another_and_on_one_plane() -> None:
    """Mutations: patches of other planes alike; distances in cells; variances for standard deviations."""
    number = np.full((2, 4, 5), -1)
    number[0, 1, :3], number[0, 2, 1], number[1, 1, :2] = [0, 1, 2], 3, [4, 5]
    patches = SurfacePatches(np.eye(3)[:2], number, 3)
    places = [(0, 1, 0), (0, 1, 1), (0, 1, 2), (0, 2, 1), (1, 1, 0), (1, 1, 1)]
    expected = np.zeros((6, 6))
    for i, (plane, row, column) in enumerate(places):
        for j, (other, its_row, its_column) in enumerate(places):
            away_m = 0.6 * ((row - its_row) ** 2 + (column - its_column) ** 2) ** 0.5
            expected[i, j] = 0.004**2 * np.exp(-away_m / 2.5) if plane == other else 0.0
    whitener = patches.whitener(0.004, 2.5)
    np.testing.assert_allclose(np.linalg.inv(whitener.T @ whitener), expected, rtol=1e-10, atol=1e-18)
