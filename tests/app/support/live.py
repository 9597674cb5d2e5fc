"""A real server on loopback in a thread, and a client for it."""

from __future__ import annotations

import json
import threading
import time
from contextlib import contextmanager

import httpx2
import viser
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from app.application import make_server
from app.cli.serving import listen
from app.jobs.launch import ProcessLauncher
from app.settings import AppSettings

FAKE_JOBS = "tests.app.support.fake_jobs:run"
PATIENCE_S = 40.0


class Live:
    """A running server."""

    def __init__(self, server, port, settings):
        self.server = server
        self.port = port
        self.settings = settings
        self.origin = f"http://127.0.0.1:{port}"
        headers = {"Authorization": f"Bearer {settings.token}"} if settings.token else {}
        self.http = httpx2.Client(base_url=self.origin, headers=headers, timeout=30, trust_env=False)

    @property
    def services(self):
        """The application's parts, to look behind the wire."""
        return self.server.config.app.state.services

    def scene(self, recording_id, **options):
        """Viser's own client's connection to a recording's scene, at the server's address."""
        spoken = [Subprotocol(f"viser-v{viser.__version__}")]
        options = {"origin": self.origin, "subprotocols": spoken, "max_size": None, "proxy": None, **options}
        return connect(f"ws://127.0.0.1:{self.port}/scene/{recording_id}", **options)

    def upload(self, name, content=b"some bytes"):
        """A recording uploaded in one request; its id."""
        answer = self.http.put("/api/recordings/upload", params={"name": name}, content=content)
        assert answer.status_code == 201, answer.text
        return answer.json()["id"]

    def ready(self, name="room.bag"):
        """A recording uploaded, inspected and with planes; its id."""
        recording_id = self.upload(name)
        both = {"inspect": "done", "planes": "done"}
        self.wait(lambda: self.job_states(recording_id) == both)
        return recording_id

    def job_states(self, recording_id):
        """State by kind of the newest job of each kind."""
        jobs = self.http.get(f"/api/recordings/{recording_id}/jobs").json()
        return {job["kind"]: job["state"] for job in reversed(jobs)}

    def start(self, recording_id, kind="solve", **more):
        """A job; its id."""
        answer = self.http.post(f"/api/recordings/{recording_id}/jobs", json={"kind": kind, **more})
        assert answer.status_code == 201, answer.text
        return answer.json()["id"]

    def job(self, job_id):
        """The job."""
        return self.http.get(f"/api/jobs/{job_id}").json()

    def finish(self, job_id):
        """The job, once it has ended."""
        self.wait(lambda: self.job(job_id)["state"] in {"done", "failed", "cancelled", "interrupted"})
        return self.job(job_id)

    def wait(self, condition):
        """Until the condition holds."""
        end = time.monotonic() + PATIENCE_S
        while not condition():
            if time.monotonic() > end:
                raise AssertionError("the server did not get there")
            time.sleep(0.02)

    def events(self, path, *, until, headers=None):
        """(id, message) of an event stream up to the first for which `until` holds, or its end."""
        found = []
        with self.http.stream("GET", path, headers=headers or {}) as answer:
            assert answer.status_code == 200, answer.read()
            event_id = None
            for line in answer.iter_lines():
                if line.startswith("id:"):
                    event_id = line[3:].strip()
                if line.startswith("data:"):
                    found.append([None, json.loads(line[5:])])
                if line == "" and found and found[-1][0] is None:
                    found[-1][0] = event_id
                    if until(found[-1][1]):
                        break
        return [(event_id, message) for event_id, message in found]


@contextmanager
def serving(data_dir, *, launcher=None, **settings):
    """A server over a data directory.   launcher: what runs its jobs; None: a process each, for the jobs of fake_jobs."""
    chosen = AppSettings(data_dir=data_dir, **{"cancel_grace_s": 0.3, "min_free_bytes": 0, **settings})
    bound = listen("127.0.0.1", 0)
    server = make_server(chosen, launcher=launcher or ProcessLauncher(FAKE_JOBS))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [bound]}, daemon=True)
    thread.start()
    live = Live(server, bound.getsockname()[1], chosen)
    live.wait(lambda: server.started)
    try:
        yield live
    finally:
        live.http.close()
        server.should_exit = True
        thread.join(PATIENCE_S)
        bound.close()
        assert not thread.is_alive(), "the server did not stop"
