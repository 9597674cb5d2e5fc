"""Campaigns over a cluster: the same rows, none lost with a worker, and a sentence where there is no cluster."""

from __future__ import annotations

import os
import signal

from bench import campaign
from bench.__main__ import main
from bench.runs import _crashed
from tests.app.support.cluster import dask_processes


def halved(number):
    """Stands in for a run."""
    return number / 2


def killing(task):
    """The same, but for the first process that takes number 3, which is killed."""
    folder, number = task
    if number == 3:
        try:
            (folder / "killed").touch(exist_ok=False)
        except FileExistsError:
            return number / 2
        os.kill(os.getpid(), signal.SIGKILL)
    return number / 2


def solved(task):
    """A run without its minute of work."""
    scenario, seed, label = task
    return _crashed(scenario, seed, label, "full", RuntimeError("not run"))


def test_a_campaign_over_a_cluster_is_the_one_of_this_machine(tmp_path, monkeypatch, capsys):
    """Mutations: two like tasks done once (pure); a campaign that does not hand its scheduler on; what is done run again; what a
    killed worker had given up.
    """
    with dask_processes(tmp_path, 2) as (address, _):
        found = sorted(campaign.spread(halved, [1, 2, 2, 3], 1, address))
        assert found == sorted(campaign.spread(halved, [1, 2, 2, 3], 1)) == [0.5, 1.0, 1.0, 1.5]
        monkeypatch.setattr(campaign, "_solve", solved)
        words = ["monte-carlo", "room", "hall", "--seeds", "1-3", "--label", "a", "--folder", str(tmp_path)]
        for _ in range(2):
            assert main([*words, "--scheduler", address]) == 0
        assert len(campaign.read_runs(tmp_path)) == 6
        monkeypatch.setattr(campaign, "_solve", None)  # here nothing could be run
        assert main([*words, "--scheduler", address]) == 0
        rest = sorted(campaign.spread(killing, [(tmp_path, number) for number in (3, 4, 5)], 1, address))
        assert rest == [1.5, 2.0, 2.5]


def test_without_a_scheduler_there_is_a_sentence(tmp_path, monkeypatch, capsys):
    """Mutation: dask's own error let out."""
    from app.fleet import cluster

    monkeypatch.setattr(cluster, "_CONNECT_S", 0.3)
    words = ["monte-carlo", "room", "--label", "a", "--folder", str(tmp_path), "--scheduler", "tcp://127.0.0.1:9"]
    assert main(words) == 2
    assert "No dask scheduler answers at tcp://127.0.0.1:9" in capsys.readouterr().err
