"""One source for each number and word that a person sees: limits, verdict, strength of the planes."""

from __future__ import annotations

import numpy as np
import pytest

from app.planes.operations import apply
from app.planes.state import suggested
from app.planes.strength import foreseen, information, share_left
from app.results.verdict import DISAGREEMENT, solve_outcome, verdict
from app.schemas.planes import Confirm, Drop
from app.weak_limits import AXIS_NAMES, WEAK_DEG, WEAK_M, WEAK_S
from calib_core.doctor.report import Forecast, ParameterForecast
from calib_core.full.assess.observability import LIMITS, UNITS
from calib_core.result import COVARIANCE_ORDER, Message
from tests.app.support import world

PROPOSALS = world.make_proposals()
FORECAST = Forecast(
    parameters=(
        ParameterForecast(name="rx", std=0.01, unit="deg", weak=False),
        ParameterForecast(name="tz", std=0.004, unit="m", weak=False),
        ParameterForecast(name="dt", std=0.0001, unit="s", weak=False),
    )
)


def test_the_limits_shown_are_those_that_the_estimator_judges_by():
    """Oracle: the estimator's own. Mutation: 0.02 deg for 0.5."""
    np.testing.assert_allclose(LIMITS * UNITS, [np.radians(WEAK_DEG)] * 3 + [WEAK_M] * 3 + [WEAK_S])
    assert tuple(AXIS_NAMES) == COVARIANCE_ORDER


def test_strength_is_the_weakest_forecast_and_never_rises_when_a_plane_goes():
    """Law over all orders of dropping, from any start. Mutations: the mean of n n^T instead of the sum; capped at nothing."""
    start = suggested(PROPOSALS)
    whole = foreseen(FORECAST, start, start)
    assert whole is not None
    assert (whole.name, whole.std, whole.limit) == ("Position z", pytest.approx(0.004), WEAK_M)
    rng = np.random.default_rng(1)
    for _ in range(20):
        planes, before = start, whole.std
        for place in rng.permutation(len(start.patches)):
            planes = apply(planes, Drop(op="drop", index=int(place)), proposals=PROPOSALS, grow=lambda *_: None)
            now = foreseen(FORECAST, planes, start)
            assert now is None or now.std >= before - 1e-12
            before = np.inf if now is None else now.std
        assert before == np.inf
    everything = start
    for place in range(len(start.patches)):
        everything = apply(everything, Confirm(op="confirm", index=place), proposals=PROPOSALS, grow=lambda *_: None)
    assert foreseen(FORECAST, everything, start) == whole  # more than was foreseen is not promised
    assert foreseen(None, start, start) is None
    half = information(start) * 0.25
    assert share_left(half, information(start)) == pytest.approx(0.25)


def test_what_disagrees_is_in_the_first_sentence_and_in_the_colour():
    """Mutation: the colour by status alone."""
    result = world.make_result()
    assert (solve_outcome(result).tone, "disagree" in verdict(result)) == ("good", False)
    said = Message(code=DISAGREEMENT, level="warning", text="the parts disagree 9.2 times")
    doubtful = result.model_copy(update={"messages": [*result.messages, said]})
    outcome = solve_outcome(doubtful)
    assert outcome.tone == "doubtful"
    assert outcome.verdict.startswith("Calibrated, but its parts disagree")
    assert DISAGREEMENT in outcome.codes
    assert outcome.planes_used == len(result.quality.planes)
    refused = doubtful.model_copy(update={"status": "refused", "T_imu_lidar": None, "uncertainty": None})
    assert solve_outcome(refused).tone == "bad"
