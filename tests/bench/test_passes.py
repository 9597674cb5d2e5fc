"""Ratios to one honest pass: what is counted as what, and what of it is judged."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from bench.metrics import slips
from bench.passes import Apart, Cost, cost_of, honest_pass, metrics_of, run_command
from calib_core import api
from calib_core.simulate import simulate
from calib_core.simulate.sensors import OS1_64, VLP_16, XT_32, Lidar
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
    """By hand. Mutations: seconds in place of ratios; the slowest turn; a stage of a tenth of a pass that is no longer judged."""
    turns = [
        Cost({"start": 1.0, "read": 0.02, "solve": 6.0}, 7.0, 3, 300.0),
        Cost({"start": 2.0, "read": 0.01, "solve": 4.0}, 6.0, 4, 280.0),
    ]
    inspect, ideal = [Cost({"start": 1.0}, 3.0, 0, 200.0)], [Cost({}, 6.0, 2, 1.0), Cost({}, 5.0, 2, 1.0)]
    apart = Apart(load_s=1.0, second_s=2.0, slider_s=0.1, scans=10)
    found = metrics_of(0.5, apart, turns, ideal, inspect, 140.0)
    metrics = {metric.key.removeprefix("passes."): metric for metric in found}
    values = {key: metric.value for key, metric in metrics.items()}
    assert values["whole"] == 12.0
    assert values["stage_start"] == 2.0
    assert values["stage_solve"] == 8.0
    assert values["iteration"] == 2.0
    assert values["decode"] == 2.0
    assert values["whole_ideal"] == 10.0
    assert values["second_solve"] == 4.0
    assert values["slider_over_scan"] == 2.0
    assert values["inspect"] == 6.0
    assert values["memory_over_bag"] == 2.0
    assert not metrics["pass_s"].is_judged()
    before = {metric.key: metric for metric in found}
    slow = metrics_of(0.2, apart, turns, ideal, inspect, 140.0)
    slipped = {slip.key for slip in slips(slow, before)}
    assert {"passes.whole", "passes.stage_solve"} <= slipped
    assert "passes.stage_read" not in slipped
    reads = [Cost({"start": 1.0, "read": 0.4, "solve": 4.0}, 6.0, 4, 280.0)]
    grown = metrics_of(0.5, apart, reads, ideal, inspect, 140.0)
    assert [slip.key for slip in slips(grown, before)] == ["passes.stage_read"]


@pytest.mark.parametrize("lidar", [VLP_16, XT_32, OS1_64], ids=["time", "timestamp", "t"])
def test_the_pass_reads_every_cloud(tmp_path: Path, lidar: Lidar) -> None:
    """A pass over a whole recording of sensors that name their points' time `time`, `timestamp` and `t`.

    Mutation: a field of another name is read.
    """
    bag = tmp_path / "room.bag"
    simulate(replace(SHORT, lidar=lidar), bag, seed=1, duration_s=0.5)
    spent = honest_pass(bag)
    assert spent.clock_s > 0.0
    assert spent.cpu_s > 0.0


@pytest.mark.slow
def test_a_run_is_a_whole_process_of_the_command_line(tmp_path: Path) -> None:
    """Mutations: a refused recording is timed as if it were solved; no memory, or no CPU; another environment than is given."""
    bag = tmp_path / "room.bag"
    api.simulate("paper-normal", bag, seed=0, duration_s=8.0)
    inspect = ["inspect", str(bag), "--json"]
    cost = run_command(inspect)
    assert 0.0 < cost.stages["start"] < cost.whole_s
    assert cost.cpu_s > 0.0
    assert cost.memory_mb > 100.0
    with pytest.raises(SystemExit, match="exit code"):
        run_command(inspect, {"PYTHONHOME": str(tmp_path)})
    still = tmp_path / "still.bag"
    api.simulate("static", still, seed=0, duration_s=4.0)
    with pytest.raises(SystemExit, match="exit code"):
        run_command(["calibrate", str(still), "--output", str(tmp_path / "none.json")])
