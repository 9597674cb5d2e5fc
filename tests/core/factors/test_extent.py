"""A plane's cells against counts made with dictionaries."""

from __future__ import annotations

from collections import Counter

import numpy as np

from calib_core.factors.extent import CELL_M, HALF_CELLS, ExtentSurvey, PlaneExtents, reach_around
from calib_core.types import BoolArray, IntArray

NORMALS = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


def _returns(seed: int, count: int) -> tuple[IntArray, IntArray, BoolArray]:
    """Returns about the middle of two planes' grids: plane, cell, whether on it."""
    rng = np.random.default_rng(seed)
    plane = rng.integers(2, size=count)
    cell = HALF_CELLS + rng.integers(-4, 5, size=(count, 2))
    return plane, cell, rng.random(count) < np.where(cell[:, 0] < HALF_CELLS, 0.95, 0.6)


def test_counts_and_cells_are_those_of_a_dictionary() -> None:
    """Fails when rows and columns are flattened in different orders, or a second scan replaces the first's counts."""
    survey = ExtentSurvey.empty(NORMALS)
    on: Counter[tuple[int, int, int]] = Counter()
    beside: Counter[tuple[int, int, int]] = Counter()
    for seed in range(3):
        plane, cell, hit = _returns(seed, 700)
        survey.add(plane, cell, hit)
        for j, (a, b), h in zip(plane, cell, hit, strict=True):
            (on if h else beside)[int(j), int(a), int(b)] += 1
    expected = {key for key, n in on.items() if n >= 8 and n >= 0.75 * (n + beside[key])}
    inside = survey.finish().inside
    assert {tuple(int(v) for v in place) for place in np.argwhere(inside)} == expected
    # Both rules decide somewhere, or the test shows nothing.
    assert any(n >= 8 and key not in expected for key, n in on.items())
    assert any(n < 8 and n >= 0.75 * (n + beside[key]) for key, n in on.items())


def test_few_returns_make_no_cell() -> None:
    """Fails when a cell needs 7 returns, not 8, or the share is asked to be strictly more than three quarters."""
    survey = ExtentSurvey.empty(NORMALS[:1])
    cell = np.repeat([[500, 500], [500, 501], [500, 502], [500, 503]], [7, 8, 12, 13], axis=0)
    on = np.concatenate([np.ones(7), np.ones(8), np.arange(12) < 9, np.arange(13) < 9]).astype(bool)
    survey.add(np.zeros(len(cell), np.int64), cell, on)
    np.testing.assert_array_equal(survey.finish().inside[0, 500, 500:504], [False, True, True, False])


def test_the_rim_belongs_to_no_plane() -> None:
    """Fails when the clamped hits from beyond 100 m make a cell."""
    survey = ExtentSurvey.empty(NORMALS[:1])
    last = 2 * HALF_CELLS - 1
    corners = np.repeat([[0, 300], [last, 300], [300, 0], [300, last]], 20, axis=0)
    survey.add(np.zeros(len(corners), np.int64), corners, np.ones(len(corners), bool))
    assert not survey.finish().inside.any()


def test_only_hits_on_a_planes_own_cells_count() -> None:
    """Fails when cells are counted on another plane's grid, or with rows and columns the wrong way round."""
    survey = ExtentSurvey.empty(NORMALS)
    survey.add(np.full(10, 1), np.repeat([[498, 503]], 10, axis=0), np.ones(10, bool))
    extents = survey.finish()
    np.testing.assert_array_equal(np.argwhere(extents.inside), [[1, 498, 503]])
    assert extents.area_m2(1) == CELL_M**2
    assert extents.area_m2(0) == 0.0


def test_a_pots_foot_on_the_ground_is_an_island_and_a_gap_between_rings_is_not() -> None:
    """Fails when islands are kept, or patches one empty cell apart are taken for two."""
    survey = ExtentSurvey.empty(NORMALS[:1])
    ground = np.array([[500 + i, 500 + j] for i in range(8) for j in range(8) if i != 3])
    foot = np.array([[530, 530]])
    cells = np.concatenate([np.repeat(ground, 60, axis=0), np.repeat(foot, 20, axis=0)])
    survey.add(np.zeros(len(cells), np.int64), cells, np.ones(len(cells), bool))
    inside = survey.finish().inside[0]
    assert not inside[530, 530]
    assert inside[ground[:, 0], ground[:, 1]].all()


def test_a_plane_may_go_on_by_its_reach_and_no_further() -> None:
    """Fails when the reach is counted from the grid's corner."""
    inside = np.zeros((1, 2 * HALF_CELLS, 2 * HALF_CELLS), bool)
    inside[0, 400, 700] = True
    found = np.argwhere(reach_around(PlaneExtents(NORMALS[:1], inside), 3 * CELL_M).inside[0])
    np.testing.assert_array_equal(found.min(axis=0), [397, 697])
    np.testing.assert_array_equal(found.max(axis=0), [403, 703])
