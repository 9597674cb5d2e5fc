"""Biases that wander faster than they are said to: against walks drawn at random, and told by noisy readings of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.events import LogEvent
from calib_core.full.joint import bias_walks as walks
from calib_core.full.joint.bias_walks import say_walks, times_faster, wanders, with_usual_walks, with_walks_told
from calib_core.full.joint.residuals import misfit
from calib_core.full.joint.round import gathered
from calib_core.full.joint.state_views import layout_of
from calib_core.full.joint.tones import say_tones
from calib_core.message_log import MessageLog
from calib_core.solver.information import covariance
from calib_core.types import FloatArray
from tests.core.full.joint.conftest import Half

NODES, STEP_STD = 12, 0.7


def _estimated(rng: np.random.Generator, k: float, noise: float) -> tuple[FloatArray, FloatArray]:
    """What a walk k times as fast as it is said to be comes out as (N, 3), and with which covariance (3 N, 3 N) by what is said.

    noise: of what each node's bias is read with.
    """
    step = np.eye(NODES)[1:] - np.eye(NODES)[:-1]
    information = step.T @ step / STEP_STD**2 + np.eye(NODES) / noise**2
    true = np.cumsum(k * STEP_STD * rng.normal(size=(NODES, 3)), axis=0)
    spread = np.linalg.inv(information)
    read = true + noise * rng.normal(size=true.shape)
    return spread @ read / noise**2, np.kron(spread, np.eye(3))


@pytest.mark.parametrize(("k", "noise"), [(10.0, 1.0), (10.0, 3.0), (15.0, 3.0), (20.0, 0.1)])
def test_a_walk_that_is_faster_is_told_to_a_third(k: float, noise: float) -> None:
    """Mutations: by the squares of steps alone, without what is left of their variance; each axis' covariance taken node by node;
    the trace of A for that of its square."""
    rng = np.random.default_rng(1)
    told = [times_faster(*_estimated(rng, k, noise), np.full(NODES - 1, STEP_STD), off=1.0) for _ in range(40)]
    assert float(np.median(told)) == pytest.approx(k, rel=0.3)


def test_of_a_single_step_chance_makes_much() -> None:
    """Of which a third is known on each axis: sixteen of its variances, as a walk four times as fast makes, come once in a
    thousand, and that may count. Mutation: any excess counts."""
    rng = np.random.default_rng(5)
    left = 0.7 * STEP_STD**2
    spread = np.kron(np.array([[0.0, 0.0], [0.0, left]]), np.eye(3))
    steps = np.sqrt(0.3) * STEP_STD * rng.normal(size=(20_000, 3))
    told = [times_faster(np.stack([np.zeros(3), step]), spread, np.array([STEP_STD]), off=1.0) for step in steps]
    assert sum(each > 1.0 for each in told) <= 32


@pytest.mark.parametrize("noise", [0.1, 1.0, 3.0, 20.0])
def test_a_walk_as_it_is_said_to_be_stays(noise: float) -> None:
    """Mutation: the biases' own squares instead of their steps'."""
    rng = np.random.default_rng(2)
    told = {times_faster(*_estimated(rng, 1.0, noise), np.full(NODES - 1, STEP_STD), off=1.0) for _ in range(300)}
    assert told == {1.0}


def test_what_misfits_as_much_anywhere_is_no_walk() -> None:
    """Readings six times as wrong as they are said to be, of a walk that they hardly see: beyond all chance, and no walk, where
    all else is off by as much. Mutations: chance alone decides; what misfits taken from the walk twice.
    """
    rng = np.random.default_rng(4)
    spread = _estimated(rng, 1.0, 5.0)[1]
    wrong = [6.0 * _estimated(rng, 0.0, 5.0)[0] for _ in range(100)]
    told = [
        [times_faster(each, spread, np.full(NODES - 1, STEP_STD), off=off) for off in (1.0, 36.0)] for each in wrong
    ]
    assert sum(each > 1.0 for each, _ in told) > 50
    assert {each for _, each in told} == {1.0}
    # A walk that shows beside wrong readings is told as before, and not faster.
    spread = _estimated(rng, 1.0, 1.0)[1]
    both = [_estimated(rng, 15.0, 1.0)[0] + 6.0 * _estimated(rng, 0.0, 1.0)[0] for _ in range(200)]
    found = [times_faster(each, spread, np.full(NODES - 1, STEP_STD), off=37.0) for each in both]
    assert float(np.sqrt(np.mean(np.square(found)))) == pytest.approx(15.0, rel=0.04)


def test_a_drift_is_told_of_steps_that_are_hardly_known() -> None:
    """A gyroscope that warms up by 0.08 deg/s in eleven seconds behind a sparse lidar, read to 0.012 deg/s at each of six nodes
    of which a walk makes 0.0025 a step: a twentieth of steps' variance is known. It was off by 22 squares of its sigmas.

    Mutation: half of what steps make has to be told of them, as had to be.
    """
    rng = np.random.default_rng(6)
    nodes, walk_deg_s, noise_deg_s = 6, 0.0025, 0.012
    step = np.eye(nodes)[1:] - np.eye(nodes)[:-1]
    # No better than to a tenth of a degree a second altogether, as scales and what forces do answer for a constant.
    information = step.T @ step / walk_deg_s**2 + (np.eye(nodes) - 1.0 / nodes) / noise_deg_s**2 + 1e2
    spread = np.linalg.inv(information)
    for told in range(20):
        axes = rng.normal(size=3)
        drift = 0.08 * np.linspace(0.0, 1.0, nodes)[:, None] * axes / np.linalg.norm(axes)
        read = drift + noise_deg_s * rng.normal(size=drift.shape)
        values = spread @ (read - read.mean(axis=0)) / noise_deg_s**2
        k = times_faster(values, np.kron(spread, np.eye(3)), np.full(nodes - 1, walk_deg_s), off=1.0)
        assert 4.0 < k < 30.0, told


def test_nothing_is_told_beyond_what_walks_can_be() -> None:
    """Another fault has its own words. Mutation: no bound."""
    values, spread = _estimated(np.random.default_rng(3), 1e5, 1.0)
    assert times_faster(values, spread, np.full(NODES - 1, STEP_STD), off=1.0) == 1.0
    assert times_faster(values, spread, np.zeros(NODES - 1), off=1.0) == 1.0


def test_a_walk_that_is_told_is_the_priors_from_there_on_and_said(half: Half, monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutations: the gyroscope's told by the accelerometer's steps; said where nothing is; both said for one; told where
    something comes and goes that is no tone; where all is off by as much."""
    assert layout_of(half.data, half.state).nodes > 1
    still = replace(half.state.estimate, accel_bias=np.zeros_like(half.state.estimate.accel_bias))
    state = replace(half.state, estimate=still)
    assert with_walks_told(half.data, state) is state
    place = layout_of(half.data, state).accel_bias()
    assert state.information is not None
    spread = covariance(state.information).matrix[place, place]
    step_s = np.sqrt(np.diff(half.data.nodes.times_s))
    ramp = np.cumsum(np.ones_like(state.estimate.accel_bias), axis=0) * state.priors.accel_walk

    off = max(misfit(gathered(half.data, state), state.estimate), 1.0)

    def faster(times: float) -> float:
        return times_faster(times * ramp, spread, state.priors.accel_walk * step_s, off=off)

    times = next(each for each in np.geomspace(0.1, 1e4, 400) if faster(float(each)) > 1.0)
    wandering = replace(state, estimate=replace(state.estimate, accel_bias=times * ramp))
    told = with_walks_told(half.data, wandering)
    assert told.priors.gyro_walk == state.priors.gyro_walk
    assert told.priors.accel_walk == pytest.approx(faster(times) * state.priors.accel_walk)
    with monkeypatch.context() as bent:
        bent.setattr(walks, "misfit", lambda *_: 1e3)
        assert with_walks_told(half.data, wandering) is wandering
    assert with_walks_told(half.data, replace(wandering, untuned=True)).priors == state.priors
    said: list[str] = []

    def hear(event: object) -> None:
        assert isinstance(event, LogEvent)
        said.append(event.text)

    data = replace(half.data, run=replace(half.data.run, on_event=hear))
    say_walks(data, state)
    assert said == []
    say_walks(data, told)
    assert len(said) == 1
    assert said[0].startswith("the accelerometer's bias seems to drift ")
    assert [wanders(data.run, each) for each in (state, told)] == [False, True]
    assert with_walks_told(half.data, replace(wandering, minimum=None)) == replace(wandering, minimum=None)
    assert with_usual_walks(half.data.run, told).priors == state.priors


def test_what_an_earlier_end_said_of_walks_and_tones_is_not_said_of_the_last(half: Half) -> None:
    """Mutations: either one's sentences left there; all sentences gone."""
    log = MessageLog(lambda _: None)
    data = replace(half.data, run=replace(half.data.run, on_event=log, log=log))
    for code in ("imu.bias_walk", "imu.tone", "motion.unseen", "planes.dropped"):
        data.run.say("warning", code, "said at an earlier end")
    say_walks(data, half.state)
    assert [message.code for message in log.messages] == ["imu.tone", "motion.unseen", "planes.dropped"]
    say_tones(data, half.state)
    assert [message.code for message in log.messages] == ["planes.dropped"]
