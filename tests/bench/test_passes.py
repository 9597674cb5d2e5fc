"""Ratios to one honest pass: what is counted as what, and what of it is judged."""

from __future__ import annotations

import json
from pathlib import Path

from bench.metrics import slips
from bench.passes import Cost, cost_of, honest_pass, metrics_of
from calib_core.simulate import simulate
from tests.core.full.conftest import SHORT


def stage(name: str) -> str:
    return json.dumps({"event": "stage", "stage": name, "fraction": 0.5})


def test_time_belongs_to_the_stage_heard_of_last() -> None:
    """By hand. Mutations: only the first time a stage is heard of; the start counted as reading; the last stage open."""
    iteration = json.dumps({"event": "iteration", "cost": 1.0})
    heard = [(1.0, stage("read")), (3.0, stage("solve")), (4.5, iteration), (5.0, stage("read")), (5.5, iteration)]
    cost = cost_of(heard, 7.0, 100.0)
    assert cost.stages == {"start": 1.0, "read": 2.0 + 2.0, "solve": 2.0}
    assert sum(cost.stages.values()) == cost.whole_s == 7.0
    assert cost.iterations == 2


def test_ratios_are_of_the_quickest_turn_and_seconds_are_not_judged() -> None:
    """By hand. Mutations: seconds in place of ratios; the slowest turn; a stage of a tenth of a pass judged."""
    turns = [
        Cost({"start": 1.0, "read": 0.02, "solve": 6.0}, 7.0, 3, 300.0),
        Cost({"start": 2.0, "read": 0.01, "solve": 4.0}, 6.0, 4, 280.0),
    ]
    inspect = [Cost({"start": 1.0}, 3.0, 0, 200.0)]
    metrics = {metric.key.removeprefix("passes."): metric for metric in metrics_of(0.5, 1.0, turns, inspect, 140.0)}
    values = {key: metric.value for key, metric in metrics.items()}
    assert values["whole"] == 12.0
    assert values["stage_start"] == 2.0
    assert values["stage_solve"] == 8.0
    assert values["iteration"] == 2.0
    assert values["decode"] == 2.0
    assert values["inspect"] == 6.0
    assert values["memory_over_bag"] == 2.0
    assert not metrics["pass_s"].is_judged()
    assert not metrics["stage_read"].is_judged()
    slow = {metric.key: metric for metric in metrics_of(0.2, 1.0, turns, inspect, 140.0)}
    assert slips([slow["passes.whole"]], {"passes.whole": metrics["whole"]})


def test_the_pass_reads_every_cloud(tmp_path: Path) -> None:
    """A pass over a whole recording of a sensor that names its time `time`. Mutation: a field of another name is read."""
    bag = tmp_path / "room.bag"
    simulate(SHORT, bag, seed=1, duration_s=1.0)
    assert honest_pass(bag) > 0.0
