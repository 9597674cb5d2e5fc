"""The server's event loop waits for nothing: what looks into the store, waits for a lock or for the disk does so in a thread."""

from __future__ import annotations

import asyncio
import base64
import os
import subprocess
import sys
import threading
import traceback

import pytest
from anyio import to_thread
from sqlalchemy import Engine, event

from app.api import scene
from app.locks import NamedLocks
from app.server.process import SWITCH_INTERVAL_S

TUS = {"Tus-Resumable": "1.0.0"}


@pytest.fixture
def waits(shared_live, monkeypatch):
    """Places in the server's event loop from which something was done that may take long."""
    found = set()
    (serving,) = shared_live.server.servers
    own = serving.get_loop()

    def note(what):
        try:
            here = asyncio.get_running_loop()
        except RuntimeError:
            return
        if here is own:
            ours = [
                line for line in traceback.extract_stack() if "/app/" in line.filename and "tests" not in line.filename
            ]
            found.add((what, *(f"{line.filename.rpartition('/')[2]} {line.name}" for line in ours[-2:])))

    def noting(function, what):
        def noted(*arguments, **options):
            note(what)
            return function(*arguments, **options)

        return noted

    def asked(*_):
        note("store")

    event.listen(Engine, "before_cursor_execute", asked)
    monkeypatch.setattr(NamedLocks, "hold", noting(NamedLocks.hold, "lock"))
    for name in ("fsync", "fdatasync", "replace"):
        monkeypatch.setattr(os, name, noting(getattr(os, name), name))
    yield found
    event.remove(Engine, "before_cursor_execute", asked)


def test_nothing_waits_on_the_event_loop(shared_live, waits):
    """Every kind of request is made once: uploads whole and in parts, jobs, streams, planes, views, scenes, deletions.

    Oracle: which thread asks the store, takes a lock by name, or syncs a file. Mutations: a scene's watchers counted on the
    loop (a scene that was composed anew held up every request for 0.4 s); the record of a finished upload read there;
    `get_recording` a coroutine.
    """
    http = shared_live.http
    recording_id = shared_live.ready()
    here = f"/api/recordings/{recording_id}"
    job_id = shared_live.start(recording_id)
    shared_live.finish(job_id)
    for path in ("", "/planes", "/jobs", "/timeline", "/view", "/runs", "/scene.html"):
        assert http.get(here + path).status_code == 200, path
    for path in ("/api/info", "/api/recordings", "/api/storage", "/readyz", "/metrics", f"/api/results/{job_id}"):
        assert http.get(path).status_code == 200, path
    assert http.post(f"{here}/view", json={"mode": "planes"}).status_code == 200
    assert http.post(f"{here}/planes/operations", json={"op": "toggle", "index": 0}).status_code == 200
    assert http.patch(here, json={"note": "here"}).status_code == 200
    shared_live.events(f"/api/jobs/{job_id}/events", until=lambda _: False)
    with shared_live.scene(recording_id) as scene:
        assert len(scene.recv(timeout=20)) > 16
    shared_live.wait(lambda: shared_live.services.scenes.open.watchers(recording_id) == 0)
    name = base64.b64encode(b"parts.bag").decode()
    told = {**TUS, "Upload-Length": "6", "Upload-Metadata": f"filename {name}"}
    where = http.post("/api/uploads", headers=told).headers["location"]
    part = {**TUS, "Content-Type": "application/offset+octet-stream"}
    for offset in (0, 3):
        answer = http.patch(where, content=b"abc", headers={**part, "Upload-Offset": str(offset)})
        assert answer.status_code == 204
        assert http.head(where, headers=TUS).headers["upload-offset"] == str(offset + 3)
    abandoned = http.post("/api/uploads", headers=told).headers["location"]
    assert http.delete(abandoned, headers=TUS).status_code == 204
    assert http.delete(here).status_code == 204
    assert waits == set()


def test_who_waits_for_scenes_leaves_the_threads_to_others(shared_live, monkeypatch):
    """Forty-one browsers open a scene that is not made: somebody else is answered all the same. Oracle: an answer at all.

    Fails when scenes are opened in the threads that answer requests, of which there are forty.
    """
    recording_id = shared_live.ready()
    made = threading.Event()
    hub = shared_live.services.scenes
    real = hub.dial

    def slow(name):
        made.wait(120)
        return real(name)

    monkeypatch.setattr(hub, "dial", slow)

    def look():
        shared_live.scene(recording_id, open_timeout=60).close()

    browsers = [threading.Thread(target=look, daemon=True) for _ in range(41)]
    for browser in browsers:
        browser.start()
    try:
        shared_live.wait(lambda: len(shared_live.server.server_state.connections) >= len(browsers))
        assert shared_live.http.get("/api/recordings", timeout=60).status_code == 200
    finally:
        made.set()
        for browser in browsers:
            browser.join(60)


def test_browsers_that_come_together_arrive_a_few_at_a_time(shared_live, monkeypatch):
    """Five open a scene whose first picture is held back: two are being given it, the others wait. Oracle: a count of those
    that were greeted. Mutations: all at once; a place that is not given back when the picture has gone.
    """
    recording_id = shared_live.ready()
    hub, gate, greeted, dialled = shared_live.services.scenes, threading.Event(), [], []
    dial, greet, pass_on = hub.dial, scene._dialled, scene._downward

    def counted(name):
        line = dial(name)
        dialled.append(name)
        return line

    async def greeting(*arguments):
        greeted.append(1)
        return await greet(*arguments)

    async def held(*arguments):
        await to_thread.run_sync(gate.wait, 60)
        await pass_on(*arguments)

    monkeypatch.setattr(hub, "dial", counted)
    monkeypatch.setattr(scene, "_dialled", greeting)
    monkeypatch.setattr(scene, "_downward", held)
    monkeypatch.setattr(scene, "ARRIVING_S", 60.0)

    def look():
        with shared_live.scene(recording_id, open_timeout=60) as browser:
            seen.append(len(browser.recv(timeout=60)))

    seen = []
    browsers = [threading.Thread(target=look, daemon=True) for _ in range(5)]
    for browser in browsers:
        browser.start()
    try:
        shared_live.wait(lambda: len(dialled) == len(browsers) and len(greeted) >= scene.ARRIVING)
        assert shared_live.http.get("/healthz").status_code == 200  # what could have been greeted has been by now
        assert len(greeted) == scene.ARRIVING
    finally:
        gate.set()
        for browser in browsers:
            browser.join(60)
    assert len(greeted) == len(seen) == len(browsers)


FIRST_SCENE = """
import sys
from app.scene.apply import ShownScene, warm_up
from app.scene.items import Axes, Content
import numpy as np
warm_up()
before = set(sys.modules)
shown = ShownScene(on_patch=lambda *_: None, on_ray=lambda *_: None)
shown.show(Content((Axes("/axes", np.eye(3), np.zeros(3), 1.0),), ""), dark=True)
late = {name.partition(".")[0] for name in set(sys.modules) - before} & {"imageio", "PIL"}
shown.close()
print(sorted(late))
"""
JOB_ENDED = """
import sys
from pathlib import Path
from calib_core import api
api.discard_archives(Path(sys.argv[1]))
print(sorted({"numba", "llvmlite", "scipy", "open3d", "velodyne_decoder", "rosbags"} & set(sys.modules)))
"""


@pytest.mark.parametrize("program", [FIRST_SCENE, JOB_ENDED], ids=["first-scene", "job-ended"])
def test_nobody_waits_for_imports(tmp_path, program):
    """They hold Python's lock: two seconds of a compiler that the server never uses, when the first job had ended, and
    half a second of an image library for the first browser's scene were its slowest answers under load.

    Oracle: the modules of a new process. Mutations: `from calib_core.readers.load import load` in readers/__init__.py;
    `warm_up` that imports and encodes nothing.
    """
    answer = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "none")], capture_output=True, text=True, check=True
    )
    assert answer.stdout.splitlines()[-1] == "[]"


def test_threads_that_compute_give_way_to_requests(shared_live):
    """Oracle: the interpreter's own setting once a server runs. Mutation: `settle_process` never called."""
    assert shared_live.http.get("/healthz").status_code == 200
    assert sys.getswitchinterval() == pytest.approx(SWITCH_INTERVAL_S)
