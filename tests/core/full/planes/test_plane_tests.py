"""Whether a plane stands still, is flat and is one: numbers made by hand, with noise of known size."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.full.planes.plane_tests import (
    PlaneSamples,
    Standing,
    doubts,
    fault_of,
    is_mostly_bent,
    standing_of,
    usual,
)
from calib_core.full.planes.settings import JUDGEMENT
from calib_core.types import FloatArray

STD_M = 0.004
SECONDS, CELLS, REPEATS = 12, 20, 5


def _samples(away_m: FloatArray, *, noise: bool = True) -> PlaneSamples:
    """Averages in every second and cell, five of each. away_m: (seconds, cells) where the surface is."""
    rng = np.random.default_rng(7)
    seconds, cells = away_m.shape
    second, cell, _ = np.meshgrid(np.arange(seconds), np.arange(cells), np.arange(REPEATS), indexing="ij")
    distance = np.broadcast_to(away_m[..., None], second.shape).ravel().copy()
    distance += noise * rng.normal(0.0, STD_M, distance.size)
    return PlaneSamples(second.ravel() + 0.3, cell.ravel(), distance, np.full(distance.size, STD_M), 1.0, 1000.0)


def _of(moved_m: float, bent_m: float, scatter: float, points: float = 50.0) -> Standing:
    return Standing(moved_m, bent_m, scatter, points)


def test_noise_alone_is_no_fault() -> None:
    """The excess of noise is zero on average; over N groups its square strays by sqrt(2 / N) of a mean's variance.

    Mutation: leave out the variance of the means: one sigma of a mean, 0.4 and 0.09 mm.
    """
    groups = 400
    got = standing_of(_samples(np.zeros((groups, CELLS))))
    assert got.moved_m < np.sqrt(3.0 * np.sqrt(2 / groups)) * STD_M / np.sqrt(CELLS * REPEATS)
    got = standing_of(_samples(np.zeros((SECONDS, groups))))
    assert got.bent_m < np.sqrt(3.0 * np.sqrt(2 / groups)) * STD_M / np.sqrt(SECONDS * REPEATS)


@pytest.mark.parametrize("groups", [1, 2, 5, 20])
def test_the_few_places_of_a_far_wall_are_no_bend(groups: int) -> None:
    """Noise of 30 mm over a few places: one excess in a thousand at most is called a bend, and one of 7 sigmas always.

    Oracle: binomial; of 4000 walls with the law's share of a thousandth more than 13 have one chance in a thousand.
    Mutation: take every excess that is above zero: a third to a half of all walls are bent by centimetres.
    """
    rng = np.random.default_rng(3)
    cell = np.repeat(np.arange(groups), 3)
    second = np.zeros(len(cell))

    def bent(away_m: FloatArray) -> float:
        noisy = away_m + rng.normal(0.0, 0.03, len(cell))
        return standing_of(PlaneSamples(second, cell, noisy, np.full(len(cell), 0.03), 1.0, 30.0)).bent_m

    assert np.count_nonzero([bent(np.zeros(len(cell))) for _ in range(4000)]) <= 13
    mean_std_m = 0.03 / np.sqrt(3.0)
    plus_and_minus = np.where(cell % 2, 1.0, -1.0) * 7.0 * mean_std_m
    assert all(bent(plus_and_minus) > 3.0 * mean_std_m for _ in range(100))


def test_what_moves_differs_by_second_and_what_bends_by_place() -> None:
    """Plus and minus 10 mm by second (by cell): the means of the other grouping are zero, exactly.

    Mutation: exchange the groupings; weigh with the standard deviation in place of its inverse square changes nothing
    here, so the second plane's averages differ in weight.
    """
    by_second = np.where(np.arange(SECONDS) % 2, 0.01, -0.01)[:, None] * np.ones(CELLS)
    by_cell = np.where(np.arange(CELLS) % 2, 0.01, -0.01) * np.ones(SECONDS)[:, None]
    moved, bent = (standing_of(_samples(away, noise=False)) for away in (by_second, by_cell))
    assert moved.moved_m == pytest.approx(np.sqrt(1e-4 - STD_M**2 / (CELLS * REPEATS)))
    assert bent.bent_m == pytest.approx(np.sqrt(1e-4 - STD_M**2 / (SECONDS * REPEATS)))
    assert moved.bent_m == 0.0
    assert bent.moved_m == 0.0


def test_sure_averages_count_for_more() -> None:
    """Three sure averages at 5 mm beside three unsure ones at 50 mm, all of one second and place.

    Mutation: the plain mean of a group, 27 mm.
    """
    distance, std = np.array([0.005] * 3 + [0.05] * 3), np.array([1e-4] * 3 + [1e-2] * 3)
    got = standing_of(PlaneSamples(np.zeros(6), np.zeros(6, np.int64), distance, std, 1.0, 6.0))
    assert got.moved_m == pytest.approx(0.005, rel=1e-2)


def test_few_averages_are_not_judged() -> None:
    """Mutation: judge groups of one: a single wrong return would be a person."""
    two = PlaneSamples(np.array([0.1, 1.1]), np.array([0, 1]), np.array([0.2, -0.2]), np.full(2, 0.01), 1.0, 2.0)
    assert standing_of(two) == Standing(0.0, 0.0, 1.0, 2.0)


def test_a_fault_is_beyond_what_is_usual_and_beyond_plaster() -> None:
    """Three walls that are 1 mm off flat, a box rim of 5 mm, a person, two surfaces as one; nobody else is named.

    Mutation: `usual` by planes in place of points; no floor (walls that are perfect would make 0.1 mm a fault).
    """
    walls = [_of(0.0002, 0.001, 0.9, 1000.0)] * 3
    others = [_of(0.0, 0.005, 1.0), _of(0.02, 0.01, 2.0), _of(0.0, 0.0, 9.0)]
    doubt = doubts([*walls, *others, _of(0.0001, 0.0009 + JUDGEMENT.least_m / 2, 1.2)])
    assert [fault_of(row) for row in doubt] == ["", "", "", "bent", "moved", "mixed", ""]


def test_a_rough_motion_is_no_fault_of_any_plane_but_has_its_limit() -> None:
    """All planes off by 5 mm: the motion's. All by 10 mm: none is a plane, but where sensors are not known yet that may be
    theirs. Mutations: no upper limit to the usual; one in any case.
    """
    assert [fault_of(row) for row in doubts([_of(0.005, 0.005, 1.0)] * 4)] == [""] * 4
    assert [fault_of(row) for row in doubts([_of(0.0, 0.01, 1.0)] * 4)] == ["bent"] * 4
    assert [fault_of(row) for row in doubts([_of(0.0, 0.01, 1.0)] * 4, 0.008, np.inf)] == [""] * 4
    box = _of(0.0, 0.05, 1.0, 10.0)
    assert [fault_of(row) for row in doubts([*[_of(0.0, 0.01, 1.0)] * 3, box], 0.008, np.inf)] == ["", "", "", "bent"]


def test_planes_are_mostly_bent_where_half_of_the_points_lie_on_such() -> None:
    """Mutations: one bent plane is enough; the middle plane whatever its points; walls that are flat to 2 mm called bent."""
    flat, bent = _of(0.0, 0.002, 1.0), _of(0.0, 0.004, 1.0)
    assert is_mostly_bent([bent] * 3)
    assert not is_mostly_bent([flat] * 3)
    assert not is_mostly_bent([flat, flat, bent])
    assert not is_mostly_bent([_of(0.0, 0.002, 1.0, 900.0), bent, bent])
    assert not is_mostly_bent([])


def test_the_usual_is_what_half_of_the_points_are() -> None:
    """Mutation: the middle plane: three bushes would outvote two walls."""
    assert usual(np.array([7.0, 0.5, 6.0, 0.6, 5.0]), np.array([30.0, 900.0, 40.0, 800.0, 50.0])) == 0.6
