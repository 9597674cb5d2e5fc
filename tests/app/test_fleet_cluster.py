"""A fleet on a cluster: the same answers, workers that die, schedulers that are lost."""

from __future__ import annotations

import sys
import threading

import psutil
import pytest

from app.fleet.campaign import run_fleet, take_up
from app.fleet.orders import TRIES
from app.fleet.summary import read_rows
from calib_core.errors import InputError
from tests.app.support.cluster import dask_processes
from tests.app.support.fleet import FAKE, orders, wait_for
from tests.app.support.processes import is_alive


def begun_by(pid):
    """Processes that a process has started, and those that these have forked."""
    return {child.pid for child in psutil.Process(pid).children(recursive=True)}


def test_a_cluster_gives_the_same_and_a_killed_worker_loses_none(hall):
    """Real scheduler and workers; the one that has the recording is killed in the middle of it.

    Mutations: an executor that does not kill what is taken back; a child that outlives its worker.
    """
    cluster = pytest.importorskip("app.fleet.cluster")
    with dask_processes(hall, 2) as (address, started):
        executor = cluster.DaskCluster(address, FAKE)
        killed = []

        def kill():
            wait_for((hall / "sleepy.started").exists)
            child = int((hall / "sleepy.started").read_text())
            killed.append(child)
            next(process for process in started if child in begun_by(process.pid)).kill()

        killer = threading.Thread(target=kill)
        killer.start()
        rows = {row.name: row for row in run_fleet(orders(hall, "sleepy", "room", "refused"), hall, executor, print)}
        killer.join()
        assert {name: row.verdict for name, row in rows.items()} == {
            "sleepy": "calibrated",
            "room": "calibrated",
            "refused": "refused",
        }
        wait_for(lambda: not is_alive(killed[0]))
        stopping = cluster.DaskCluster(address, FAKE)
        stopping.start(orders(hall, "slow")[0].model_dump_json())
        wait_for((hall / "slow.started").exists)
        stopping.stop()
        wait_for(lambda: not is_alive(int((hall / "slow.started").read_text())))


@pytest.mark.parametrize("allowed", [1, 3])
def test_an_order_that_kills_its_workers_kills_three_and_no_more(hall, monkeypatch, allowed):
    """Real workers, which their nannies start again. dask gives it to the next one by itself, by its own count.

    Mutations: begun not counted, which kills twelve; the count not taken for tries; counted anew where dask gives it up.
    """
    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES", str(allowed))
    cluster = pytest.importorskip("app.fleet.cluster")
    with dask_processes(hall, 2, nannies=True) as (address, _):
        rows = {
            row.name: row for row in run_fleet(orders(hall, "murder"), hall, cluster.DaskCluster(address, FAKE), print)
        }
    assert (hall / "murder.begun").read_text() == "x" * TRIES
    assert (rows["murder"].verdict, rows["murder"].code, rows["murder"].tries) == ("failed", "job.lost", TRIES)
    assert "--memory-limit-mb" in rows["murder"].sentence


def test_a_worker_of_another_version_ends_the_fleet_before_it_has_an_answer(hall, monkeypatch):
    """Its answers would be in the same table. Mutations: no look at the version; a row of it, and the next one's."""
    cluster = pytest.importorskip("app.fleet.cluster")
    with dask_processes(hall, 1) as (address, _):
        monkeypatch.setattr(cluster, "__version__", "0.0.1")
        with pytest.raises(InputError, match=r"has unsweep .* and the command 0\.0\.1: install the same on both"):
            run_fleet(orders(hall, "room", "weak"), hall, cluster.DaskCluster(address, FAKE), print)
    assert read_rows(hall) == []


def test_a_scheduler_that_is_lost_ends_the_fleet_with_a_sentence_and_it_goes_on(hall):
    """What was finished stays, what ran is ended, the rest is run by the same call with another scheduler.

    Mutations: wait for ever; tell each recording's row that its worker was lost.
    """
    cluster = pytest.importorskip("app.fleet.cluster")
    asked = orders(hall, "room", "slow", "weak")
    with dask_processes(hall, 1) as (address, started):
        done = []

        def lose():
            wait_for(lambda: done and (hall / "slow.started").exists())
            started[0].kill()

        loser = threading.Thread(target=lose)
        loser.start()
        with pytest.raises(InputError, match="scheduler no longer answers"):
            run_fleet(asked, hall, cluster.DaskCluster(address, FAKE), done.append)
        loser.join()
    assert [row.name for row in read_rows(hall)] == ["room"]
    wait_for(lambda: not is_alive(int((hall / "slow.started").read_text())))
    kept, ahead, _, _ = take_up(asked, hall)
    assert ([row.name for row in kept], [order.name for order in ahead]) == (["room"], ["slow", "weak"])


def test_a_scheduler_without_a_worker_says_what_to_start(tmp_path):
    """Nothing would happen, without end. Mutations: said nothing; said with a worker there; "1 workers"."""
    cluster = pytest.importorskip("app.fleet.cluster")
    told = []
    for workers, where in ((0, "0 workers of"), (1, "1 worker of")):
        folder = tmp_path / str(workers)
        folder.mkdir()
        with dask_processes(folder, workers) as (address, _):
            client = cluster.connect(address)
            wait_for(lambda client=client, workers=workers: len(client.nthreads()) == workers)
            client.close()
            executor = cluster.DaskCluster(address, FAKE)
            assert executor.where == f"{where} {address}"
            executor.prepare(lambda code, text: told.append((code, text)))
            executor.stop()
            if not workers:
                assert told[0][0] == "fleet.no_worker"
                assert f"start `dask worker {address} --nworkers 1 --nthreads 1`" in told[0][1]
    assert len(told) == 1


def test_a_scheduler_that_is_not_there_and_dask_that_is_not_installed_are_a_sentence(monkeypatch):
    """Mutations: let dask's own error out; name no way to install it."""
    from app.fleet import cluster

    monkeypatch.setattr(cluster, "_CONNECT_S", 0.3)
    with pytest.raises(InputError, match=r"No dask scheduler answers at tcp://127\.0\.0\.1:9"):
        cluster.DaskCluster("tcp://127.0.0.1:9")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install unsweep\[fleet\]"):
        cluster.DaskCluster("tcp://127.0.0.1:9")
