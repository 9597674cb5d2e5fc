"""Stretches of time that contradict each other make an answer weak, however narrow its error bars are."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.full.assess.budget_sentences import say_shapes
from calib_core.full.assess.disagreement import Disagreement, is_torn
from calib_core.full.joint import solve
from calib_core.full.joint.estimation import Estimation, JointData, MapPlane, Solved
from calib_core.settings import CalibrateSettings
from calib_core.simulate import generate
from calib_core.types import FloatArray


@pytest.mark.parametrize(
    ("name", "ratio", "excess", "torn"),
    [("time", 8.4, 1.0, True), ("time", 4.9, 1.0, False), ("surfaces", 9.2, 1.0, False), ("time", 8.4, 0.0, False)],
)
def test_time_that_contradicts_itself(name: str, ratio: float, excess: float, torn: bool) -> None:
    """Sooner where a chosen plane did not stand still in the motion by all. Mutations: places on bent walls, too; whatever the
    ratio; what is within what noise allows; planes that nobody chose, or that stood still; a drift of the biases by itself.
    """
    calm = Disagreement("range", 1.1, np.zeros((7, 7)))
    found = [calm, Disagreement(name, ratio, excess * np.eye(7))]
    wall, cart = MapPlane("wall", chosen=True), MapPlane("cart", strayed=True)
    chosen = [wall, replace(cart, chosen=True)]
    assert is_torn(found, [wall, cart], wanders=True) is torn
    assert is_torn(found, chosen, wanders=False) is (name == "time" and excess > 0.0)
    assert is_torn(found, chosen, wanders=True)


@pytest.mark.parametrize(
    ("sigmas", "said"), [(0.0, ""), (0.5, ""), (0.8, "0.04 deg and 1.6 mm"), (3.0, "0.15 deg and 6 mm")]
)
def test_shapes_that_did_not_rest_are_said_where_they_did_much(sigmas: float, said: str) -> None:
    """Beside all else, in units of 1 deg, 10 mm and 1 ms. Mutations: metres as they are; said of next to nothing; against one
    axis where two go together.
    """
    heard: list[tuple[str, str]] = []
    run: Any = SimpleNamespace(say=lambda _, code, text: heard.append((code, text)))
    shift = sigmas * np.array([np.radians(0.05), 0.0, 0.0, 0.0, 2e-3, 0.0, 1e-5])
    # 0.1 deg and 4 mm, which go the one with the other's opposite: together they are as unlikely as three of either.
    others = np.diag([0.01, 0.01, 0.01, 0.16, 0.16, 0.16, 1e-4])
    others[0, 4] = others[4, 0] = -0.6 * 0.1 * 0.4
    say_shapes(run, shift, others)
    assert [code for code, _ in heard] == ["planes.shape"] * bool(said)
    assert all(said in text for _, text in heard)


def test_a_result_counts_what_shapes_did(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside all else. Mutation: said, and not counted."""
    shift = np.array([1e-3, 0.0, 0.0, 0.0, 8e-3, 0.0, 0.0])
    recording, _ = generate("handheld", seed=3, duration_s=6.0)
    finished = solve.finished

    def shifted(data: JointData, state: Estimation, *rest: Any) -> Solved:
        return finished(data, replace(state, shape_shift=shift), *rest)

    def covariance() -> FloatArray:
        result = calibrate(recording, CalibrateSettings(intrinsics="off", crispness=False)).result
        assert result.uncertainty is not None
        return np.array(result.uncertainty.covariance)

    before = covariance()
    monkeypatch.setattr(solve, "finished", shifted)
    added = covariance() - before
    assert added[0, 0] == pytest.approx(shift[0] ** 2, rel=0.02)
    assert added[4, 4] == pytest.approx(shift[4] ** 2, rel=0.02)
    assert added[0, 4] == pytest.approx(shift[0] * shift[4], rel=0.02)
    assert abs(added[3, 3]) < 1e-3 * before[3, 3]
