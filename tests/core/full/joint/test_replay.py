"""A state that was written down is the state: a step from it gives the same, bit for bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib_core.errors import Refused
from calib_core.full.joint.estimation import MapPlane
from calib_core.full.joint.policies import Propagation
from calib_core.full.joint.propagate import advance, begin
from calib_core.full.joint.replay import load_estimation, save_estimation
from calib_core.full.joint.round import one_round
from calib_core.full.joint.schedule import FULL
from calib_core.full.joint.sensor_state import SensorState
from calib_core.full.prepare.nuisance import Nuisance, NuisanceBlock
from tests.core.full.joint.conftest import Half
from tests.core.full.joint.same import same


def test_a_state_comes_back_as_it_was(half: Half, tmp_path: Path) -> None:
    """Every field: outlines, held directions, support, points, the minimum with its information.

    Mutations: leave a field out; write arrays as numbers of JSON; read tuples as lists; one kind of word for all blocks.
    """
    planes = (MapPlane("given", np.arange(9.0).reshape(3, 3)), *half.state.planes[1:])
    sensors = Nuisance(
        (NuisanceBlock("clock_rate", ("all",), np.ones(1)), NuisanceBlock("surface", ("0", "1"), np.ones(2)))
    )
    state = replace(begin(half.data, half.state, FULL, Propagation()).state, planes=planes)
    state = replace(state, estimate=replace(state.estimate, sensors=SensorState(sensors, np.array([4.0, 1e-3, -2e-3]))))
    save_estimation(state, tmp_path / "state")
    again = load_estimation(tmp_path / "state")
    assert state.support is not None
    assert state.minimum is not None
    assert same(again, state)
    assert not same(again, replace(state, rounds=state.rounds + 1))


def test_a_step_can_be_run_again_from_what_was_written(half: Half, tmp_path: Path) -> None:
    """The piece after the tracked half, and a round that is refused: from the file as from memory, bit for bit.

    Mutation: round numbers when writing.
    """
    save_estimation(half.state, tmp_path / "state")
    policy, end = Propagation(), half.state.knots + 30
    ends = [
        advance(half.data, begin(half.data, state, FULL, policy), end, FULL, policy)[0]
        for state in (half.state, load_estimation(tmp_path / "state"))
    ]
    assert same(ends[0].state, ends[1].state)
    assert same(ends[0].drift, ends[1].drift)
    no_more = replace(half.data, most_rounds=half.state.rounds)
    said = []
    for state in (half.state, load_estimation(tmp_path / "state")):
        with pytest.raises(Refused) as refused:
            one_round(no_more, state, FULL.coarse[0], FULL.sampling)
        said.append(str(refused.value))
    assert said[0] == said[1]
