"""Walls that something before them passes for: what pulls their heights flat is widened to what they are."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calib_core.factors.patches import patches_of
from calib_core.full.joint import bent_surfaces, solve
from calib_core.full.joint.alternation import Near
from calib_core.full.joint.estimation import Estimation
from calib_core.full.joint.schedule import FULL
from calib_core.full.joint.sensor_state import SensorState
from calib_core.full.prepare.nuisance import SURFACE
from calib_core.geometry import exp
from tests.core.full.joint.conftest import Half

RULES = FULL.surfaces


def _off_flat(half: Half, by_m: float) -> Estimation:
    """With heights of this size, one up and one down."""
    assert half.state.support is not None
    patches = patches_of(half.state.support)
    nuisance = half.state.nuisance.with_surface(patches, RULES.height_std_m, RULES.alike_m)
    sensors = SensorState(nuisance, np.resize([by_m, -by_m], nuisance.size))
    return replace(half.state, estimate=replace(half.state.estimate, sensors=sensors))


@pytest.mark.parametrize(("by_mm", "wider"), [(5.0, False), (12.0, True)])
def test_heights_far_beyond_a_walls_may_be_as_large_as_they_are(
    half: Half, monkeypatch: pytest.MonkeyPatch, by_mm: float, wider: bool
) -> None:
    """Mutations: heights of any size; the prior as it was; that of walls beside the new one."""
    asked: list[Estimation] = []

    def rests(_: Any, state: Estimation, *__: Any, **___: Any) -> Near:
        asked.append(state)
        return Near(replace(state, rounds=state.rounds + 2), rests=True, moved=0.0)

    monkeypatch.setattr(solve, "near_rest", rests)
    state = _off_flat(half, 1e-3 * by_mm)
    after = solve.with_rough_surface(half.data, state, FULL)
    assert (after is state) is not wider
    if wider:
        (block,) = (each for each in asked[0].nuisance.blocks if each.block == SURFACE)
        np.testing.assert_allclose(block.prior_std, 1e-3 * by_mm)
        assert asked[0].nuisance.size == state.nuisance.size
        assert after.rounds == state.rounds + 2
        np.testing.assert_array_equal(after.estimate.sensors.values, state.estimate.sensors.values)


@pytest.mark.parametrize("farther_m", [0.0, 0.2])
def test_what_goes_on_to_be_another_surface_stays_as_it_was(
    half: Half, monkeypatch: pytest.MonkeyPatch, farther_m: float
) -> None:
    """And what hardly comes to rest is taken. Mutations: taken all the same; only what rests; its rounds not counted."""

    def ends(_: Any, state: Estimation, *__: Any, **___: Any) -> Near:
        there = state.estimate.sensors.moved(np.full(state.nuisance.size, farther_m))
        moved = replace(state.estimate, sensors=there)
        return Near(replace(state, estimate=moved, rounds=9), rests=farther_m > 0.0, moved=0.0)

    monkeypatch.setattr(solve, "near_rest", ends)
    state = _off_flat(half, 0.012)
    after = solve.with_rough_surface(half.data, state, FULL)
    assert (after.nuisance is state.nuisance) is (farther_m > 0.0)
    assert after.rounds == 9


@pytest.mark.parametrize(
    ("by_mm", "level", "words"),
    [(0.03, "info", "flat by 0.030 mm"), (5.0, "info", "flat by 5.0 mm"), (12.0, "warning", "a door stood ajar")],
)
def test_a_person_is_warned_of_what_no_wall_is(
    half: Half, monkeypatch: pytest.MonkeyPatch, by_mm: float, level: str, words: str
) -> None:
    """Mutations: never more than a word by the way; what it may be left out."""
    said: list[tuple[str, str, str]] = []
    monkeypatch.setattr(type(half.data.run), "say", lambda _, *what: said.append(what))
    bent_surfaces.say_uneven(half.data, _off_flat(half, 1e-3 * by_mm), RULES)
    ((told, code, text),) = said
    assert (told, code) == (level, "planes.uneven")
    assert words in text


TURN_RAD, MOVE_M, LATER_S = np.array([0.002, 0.0, -0.001]), np.array([0.006, -0.002, 0.0]), 1e-5


@pytest.mark.parametrize(
    ("by_m", "moved", "rests", "counts"),
    [(0.012, 0.05, False, True), (0.012, 0.3, False, False), (0.2, 0.05, False, False), (0.2, 0.05, True, False)],
)
def test_how_far_the_answer_went_with_shapes_that_did_not_rest_is_kept(
    half: Half, monkeypatch: pytest.MonkeyPatch, by_m: float, moved: float, rests: bool, counts: bool
) -> None:
    """The state itself stays as it was. Seen: a street's ground, off flat by a centimetre, put the answer 3.6 sigmas off.

    Mutations: nowhere near rest, too; what no wall is, too; before less after; the frame of the turn; forgotten.
    """
    bent = _off_flat(half, by_m)
    e = bent.estimate
    there = replace(
        e,
        R_imu_lidar=e.R_imu_lidar @ exp(TURN_RAD),
        p_imu_lidar=e.p_imu_lidar + MOVE_M,
        time_offset_s=e.time_offset_s + LATER_S,
    )
    near = Near(replace(bent, estimate=there, rounds=9), rests=rests, moved=moved)
    flat = half.state
    monkeypatch.setattr(solve, "admit_surface", lambda *_: bent)
    for step in ("settle_with_tones", "settle", "with_walks_told", "settle_without_doubtful"):
        monkeypatch.setattr(solve, step, lambda _, state, *__: state)
    monkeypatch.setattr(
        solve, "near_rest", lambda _, state, *__, **___: near if state is bent else Near(flat, True, 0.0)
    )
    after = solve.settled(half.data, flat, FULL)
    assert after.estimate is flat.estimate
    assert after.rounds == 9
    expected = np.array([*TURN_RAD, *MOVE_M, LATER_S]) if counts else np.zeros(7)
    np.testing.assert_allclose(after.shape_shift, expected, atol=1e-12)
