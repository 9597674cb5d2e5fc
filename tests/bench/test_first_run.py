"""A first run after an installation: what of it is counted, and with which loops it begins."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from bench.first_run import Pair, metrics_of, pairs
from bench.metrics import slips
from bench.passes import Cost


def cost(whole_s: float, cpu_s: float) -> Cost:
    return Cost({}, whole_s, 3, 500.0, cpu_s)


def test_the_quickest_first_run_is_held_against_the_quickest_second() -> None:
    """By hand. Mutations: the slowest; second over first; loops of the last turn; no limit by CPU."""
    turns = [
        Pair(cost(6.0, 8.0), cost(4.0, 7.9), 2),
        Pair(cost(5.0, 9.0), cost(4.8, 7.0), 0),
        Pair(cost(7.0, 7.77), cost(5.0, 7.5), 0),
    ]
    metrics = {metric.key: metric for metric in metrics_of({"default": turns})}
    assert metrics["first_run.default"].value == pytest.approx(1.25)
    assert metrics["first_run.default_cpu"].value == pytest.approx(1.11)
    assert metrics["first_run.default_loops"].value == 2
    assert {metric.aim for metric in metrics.values()} == {0.0, 1.1}
    # What the baseline has does not help: the ratio is asked for as it is; by the clock it is said only.
    assert {slip.key for slip in slips(metrics.values(), metrics)} == {
        "first_run.default_cpu",
        "first_run.default_loops",
    }


def test_each_turn_begins_with_the_loops_as_installed(tmp_path: Path) -> None:
    """A program that writes a loop, and one of an installed name anew, where it finds them not done.

    Mutations: the installed folder itself is used, so that the second turn finds all done; no folder of its own; only new names
    are counted.
    """
    installed = tmp_path / "loops"
    (installed / "a").mkdir(parents=True)
    (installed / "a" / "old.nbc").write_bytes(b"old")
    os.utime(installed / "a" / "old.nbc", ns=(10**18, 10**18))
    done: list[bool] = []

    def run(words: Sequence[str], around: Mapping[str, str]) -> Cost:
        assert words == ["calibrate"]
        loops = Path(around["NUMBA_CACHE_DIR"])
        done.append((loops / "new.nbc").is_file())
        (loops / "new.nbc").write_bytes(b"new")
        (loops / "new.nbi").write_bytes(b"index")
        if not done[-1]:
            (loops / "a" / "old.nbc").write_bytes(b"anew")
        return cost(float(len(done)), 1.0)

    found = list(pairs(installed, ["calibrate"], 2, run))
    assert done == [False, True, False, True]
    assert [each.loops for each in found] == [2, 2]
    assert [(each.first.whole_s, each.second.whole_s) for each in found] == [(1.0, 2.0), (3.0, 4.0)]
    assert (installed / "a" / "old.nbc").read_bytes() == b"old"
