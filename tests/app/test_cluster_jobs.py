"""The web application's jobs on a real cluster: a scheduler and two workers with their nannies, as `dask` starts them."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

import pytest

from app.errors import Unavailable
from app.fleet import launcher as launching
from app.fleet.launcher import ClusterLauncher
from app.jobs.orders import Begun, Failed, Finished, Order, Stopped
from app.jobs.processes import Processes
from tests.app.support.cluster import dask_processes
from tests.app.support.live import FAKE_JOBS, serving
from tests.app.support.processes import is_alive

GRACE_S = 0.3


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    """Of a scheduler with two workers."""
    with dask_processes(tmp_path_factory.mktemp("cluster"), 2, nannies=True) as (found, _):
        yield found


@pytest.fixture
def client(address):
    """Somebody else's connection, to look behind."""
    distributed = pytest.importorskip("distributed")
    with distributed.Client(address, set_as_default=False) as found:
        found.wait_for_workers(2)
        yield found


def cluster_of(address, **more):
    return ClusterLauncher(address, grace_s=GRACE_S, entry=FAKE_JOBS, **more)


def messages(live, job_id):
    """What a browser is told of a job from its beginning to its end."""
    return [message for _, message in live.events(f"/api/jobs/{job_id}/events", until=lambda _: False)]


def said(live, job_id):
    """Codes of the sentences that were told."""
    return [message["code"] for message in messages(live, job_id) if message["event"] == "log"]


def order_in(folder, name="room.bag", kind="solve"):
    return Order(
        job_id="1" * 32, kind=kind, recording_name=name, source=folder, cache=folder, folder=folder / ("1" * 32)
    )


def test_jobs_tell_and_leave_the_same_as_processes_here(address, client, tmp_path):
    """Oracle: the same recording through processes of the server. Steps come as they are made, files lie where they lay.

    Mutations: a relay that drops the last step; dask's word heeded that its workers, daemons, may have no children.
    """
    told = {}
    for name, launcher in (("here", None), ("there", cluster_of(address))):
        with serving(tmp_path / name, launcher=launcher) as live:
            job_id = live.start(live.ready())
            assert live.finish(job_id)["state"] == "done"
            found = messages(live, job_id)
            told[name] = [m for m in found if m["event"] == "log" and m["code"] != "job.waiting"]
            told[f"{name}, last step"] = [m for m in found if m["event"] == "iteration"][-1]
            files = live.services.files.job(job_id)
            told[f"{name} files"] = sorted(path.name for path in files.iterdir())
            assert live.http.get(f"/api/results/{job_id}").json()["status"] == "calibrated"
    assert told["there"] == told["here"] != []
    assert told["there, last step"] == told["here, last step"]
    assert told["here, last step"]["iteration"] == 4
    assert told["there files"] == told["here files"]
    assert "worker.log" in told["here files"]


def test_bounds_and_ends_are_those_of_processes_here(address, client, tmp_path):
    """Mutations: no time limit; one that ends no process that does not look; the limits left out of the order that the worker
    writes anew; a process's death taken for its success.
    """
    too_long = dict.fromkeys(("slow.bag", "stubborn.bag"), "job.too_long")
    # Their ends come by themselves, on a slow machine after more than two seconds.
    others = {"greedy.bag": "job.memory", "crash.bag": "job.died", "defect.bag": "defect"}
    for ends, limit_s in ((too_long, 2.0), (others, 120.0)):
        launcher = cluster_of(address, memory_bytes=2 * 2**30)
        with serving(tmp_path / str(limit_s), launcher=launcher, solve_limit_s=limit_s) as live:
            started = {name: live.start(live.upload(name)) for name in ends}
            ended = {name: live.finish(job_id) for name, job_id in started.items()}
            assert {name: job["state"] for name, job in ended.items()} == dict.fromkeys(ends, "failed")
            assert {name: job["error"]["code"] for name, job in ended.items()} == ends
    assert "than the 2.1 GB a job may have" in ended["greedy.bag"]["error"]["text"]


def test_a_cancelled_job_is_over_there_too(address, client, tmp_path):
    """By the wish, and by force. Mutation: a task taken back that nobody heeds."""
    with serving(tmp_path, launcher=cluster_of(address)) as live:
        started = [live.start(live.upload(name)) for name in ("slow.bag", "deaf.bag")]
        live.wait(lambda: [live.job(job_id)["text"] for job_id in started] == ["thinking"] * 2)
        children = [pid for found in client.run(children_of_worker).values() for pid in found]
        for job_id in started:
            assert live.http.post(f"/api/jobs/{job_id}/cancel").status_code == 200
        assert [live.finish(job_id)["state"] for job_id in started] == ["cancelled"] * 2
        assert len(children) == 2
        assert not any(is_alive(pid) for pid in children)


def children_of_worker():
    """Processes of jobs that the worker that is asked has started."""
    import multiprocessing

    return [process.pid for process in multiprocessing.active_children()]


def test_the_job_of_a_killed_worker_is_run_again_and_its_process_is_gone(address, client, tmp_path):
    """Mutations: a process that outlives its worker; a dead worker's job taken for ended; what it had told told as if nothing
    had happened.
    """
    with serving(tmp_path, launcher=cluster_of(address)) as live:
        recording_id = live.upload("lost.bag")
        live.wait(lambda: set(live.job_states(recording_id).values()) == {"done"})
        job_id = live.start(recording_id)
        marker = live.services.files.job(job_id) / "process"
        live.wait(lambda: marker.exists() and marker.read_text())
        process = int(marker.read_text())
        begun = client.run(children_of_worker)
        (parent,) = [pid for worker, pid in client.run(os.getpid).items() if process in begun[worker]]
        os.kill(parent, signal.SIGKILL)
        assert live.finish(job_id)["state"] == "done"
        assert said(live, job_id).count("job.moved") == 1
        live.wait(lambda: not is_alive(process))


def test_a_server_that_starts_again_has_every_job_and_runs_what_waited(address, client, tmp_path):
    """Two run, one waits, the server stops. Mutations: jobs that go on at the workers; slots of the settings instead of the
    workers' threads.
    """
    with serving(tmp_path, launcher=cluster_of(address), concurrent_jobs=1) as live:
        recording_id = live.upload("slow.bag")
        live.wait(lambda: live.job_states(recording_id) == {"inspect": "done", "planes": "done"})
        *running, waiting = [live.start(recording_id) for _ in range(3)]
        live.wait(lambda: [live.job(job_id)["text"] for job_id in running] == ["thinking"] * 2)
        assert live.job(waiting)["state"] == "queued"
        processes = [pid for found in client.run(children_of_worker).values() for pid in found]
    with serving(tmp_path, launcher=cluster_of(address), concurrent_jobs=1) as live:
        assert [live.job(job_id)["state"] for job_id in running] == ["interrupted"] * 2
        live.wait(lambda: live.job(waiting)["text"] == "thinking")
        assert len(processes) == 2
        live.wait(lambda: not any(is_alive(pid) for pid in processes))


def test_a_worker_that_cannot_do_it_says_what_to_do(address, client, tmp_path, monkeypatch):
    """Mutations: a data directory that is not there made there; an order of another version tried."""
    cluster = cluster_of(address)
    (unseen,) = [p for p in cluster.launch(order_in(tmp_path / "elsewhere")).parcels() if isinstance(p, Failed)]
    assert unseen.error.code == "job.unseen"
    assert not (tmp_path / "elsewhere").exists()
    monkeypatch.setattr(launching, "__version__", "0.0.1")
    (other,) = [p for p in cluster.launch(order_in(tmp_path)).parcels() if isinstance(p, Failed)]
    assert other.error.code == "job.other_version"
    assert "the server 0.0.1" in other.error.text
    cluster.close()


def test_the_end_of_a_job_that_says_nothing_is_waited_for(address, client, tmp_path):
    """What it works on may be deleted next. Mutation: a task that was taken back counted as ended."""
    cluster = ClusterLauncher(address, grace_s=2.0, entry=FAKE_JOBS)
    job = cluster.launch(order_in(tmp_path, "lost.bag"))
    marker = tmp_path / ("1" * 32) / "process"

    def stop():
        while not (marker.exists() and marker.read_text()):
            time.sleep(0.02)
        job.ask_to_stop()

    stopper = threading.Thread(target=stop)
    stopper.start()
    assert not [parcel for parcel in job.parcels() if isinstance(parcel, Finished | Failed)]
    assert not is_alive(int(marker.read_text()))
    stopper.join()
    cluster.close()


def test_paths_mean_the_same_to_a_worker_that_is_elsewhere(address, client, tmp_path, monkeypatch):
    """Mutation: `--data-dir data` handed on as it was typed."""
    (tmp_path / "data").mkdir()
    monkeypatch.chdir(tmp_path)
    cluster = cluster_of(address)
    *_, last = cluster.launch(order_in(Path("data"), kind="inspect")).parcels()
    assert isinstance(last, Finished)
    assert (tmp_path / "data" / ("1" * 32) / "report.json").is_file()
    cluster.close()


def test_what_a_job_said_before_its_end_is_heard_after_it(address, client, tmp_path, monkeypatch):
    """A machine so busy that the task has ended between the look at its messages, which found none, and the look at the task.

    Mutation: a task's end taken for the end of what it said.
    """
    hear = launching.ClusterJob._hear

    def hear_late(job):
        message = hear(job)
        while message is None and not job._future.done():
            time.sleep(0.01)
        return message

    monkeypatch.setattr(launching, "_LOOK_S", 0.01)
    monkeypatch.setattr(launching.ClusterJob, "_hear", hear_late)
    cluster = cluster_of(address)
    *_, last = cluster.launch(order_in(tmp_path, kind="inspect")).parcels()
    assert isinstance(last, Finished)
    cluster.close()


def test_a_scheduler_that_goes_away_ends_jobs_with_a_sentence(tmp_path, monkeypatch):
    """In the middle of a job, before the next one, and before the server starts. Mutation: dask's own error let out."""
    from app.fleet import cluster as joining

    with dask_processes(tmp_path, 1) as (found, started):
        cluster = cluster_of(found)
        monkeypatch.setattr(joining, "_CONNECT_S", 0.3)
        with serving(tmp_path / "data", launcher=cluster) as live:
            recording_id = live.upload("slow.bag")
            job_id = live.start(recording_id)
            live.wait(lambda: live.job(job_id)["text"] == "thinking")
            started[0].kill()
            assert live.finish(job_id)["error"]["code"] == "job.no_scheduler"
            later = live.finish(live.start(recording_id))
            assert (later["state"], later["error"]["code"]) == ("failed", "jobs.no_scheduler")
            assert found in later["error"]["text"]
    with pytest.raises(Unavailable, match="No dask scheduler answers"):
        cluster_of(found)


class LateJob:
    """A job that waits long for its worker and is quick then."""

    def __init__(self):
        self.asked = False

    def launch(self, _):
        return self

    def parcels(self):
        time.sleep(1.5)
        yield Begun()
        yield Stopped()

    def ask_to_stop(self):
        self.asked = True

    def terminate(self):
        pass


def test_waiting_for_a_worker_does_not_count_as_running(tmp_path):
    """Mutation: the limit's time counted from the launch."""
    job = LateJob()
    processes = Processes(job, grace_s=GRACE_S)
    ending = processes.run("1", order_in(tmp_path), limit_s=1.0, on_start=lambda: None, on_parcel=print)
    assert isinstance(ending, Stopped)
    assert not job.asked
