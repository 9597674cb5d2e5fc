"""Figures for whoever watches over the server, at /metrics in Prometheus's text form. Read when asked, kept nowhere.

Requests are counted by method and status, never by path: a path holds ids, and ids are nobody's business.
"""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Iterable
from typing import get_args

from prometheus_client import CollectorRegistry, Counter, Histogram, generate_latest
from prometheus_client.metrics_core import GaugeMetricFamily, Metric
from prometheus_client.process_collector import ProcessCollector
from prometheus_client.registry import Collector
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.jobs.service import JobService
from app.scene.hub import SceneHub
from app.schemas.jobs import JobState
from app.storage.files import DataFolder

#: Seconds: nothing that a person waits for should be in the last ones.
BUCKETS_S = (0.005, 0.02, 0.1, 0.3, 1.0, 3.0, 10.0, 60.0)
METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})


class _State(Collector):
    """What there is at this moment."""

    def __init__(self, jobs: JobService, scenes: SceneHub, files: DataFolder) -> None:
        self._jobs = jobs
        self._scenes = scenes
        self._files = files

    def collect(self) -> Iterable[Metric]:
        """Jobs that are under way, open scenes, and the disk."""
        jobs = GaugeMetricFamily("unsweep_jobs", "Jobs under way, by state", labels=["state"])
        counted = self._jobs.count_under_way()
        for state in get_args(JobState):
            if state in {"queued", "running", "cancelling"}:
                jobs.add_metric([state], counted.get(state, 0))
        yield jobs
        scenes, browsers = self._scenes.open.count()
        yield GaugeMetricFamily("unsweep_scenes_open", "3D scenes that are open", value=scenes)
        yield GaugeMetricFamily("unsweep_scene_browsers", "Browsers connected to a 3D scene", value=browsers)
        disk = shutil.disk_usage(self._files.root)
        yield GaugeMetricFamily("unsweep_disk_free_bytes", "Free space on the data directory's disk", value=disk.free)
        yield GaugeMetricFamily("unsweep_threads", "Threads of the server", value=threading.active_count())


class Metrics:
    """The figures of one server."""

    def __init__(self) -> None:
        self._registry = CollectorRegistry()
        self.requests = Counter(
            "unsweep_http_requests", "Requests answered", ["method", "status"], registry=self._registry
        )
        self.seconds = Histogram(
            "unsweep_http_first_byte_seconds", "Until an answer began", buckets=BUCKETS_S, registry=self._registry
        )
        ProcessCollector(registry=self._registry)

    def watch(self, jobs: JobService, scenes: SceneHub, files: DataFolder) -> None:
        """Have the figures of these, too."""
        self._registry.register(_State(jobs, scenes, files))

    def text(self) -> bytes:
        """All figures now."""
        return generate_latest(self._registry)


class CountRequests:
    """Middleware: counts answers, and measures how long each took to begin."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self._app = app
        self._metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, with a look at the clock."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        began_s = time.perf_counter()
        method = scope["method"] if scope["method"] in METHODS else "other"

        async def counted(message: Message) -> None:
            if message["type"] == "http.response.start":
                self._metrics.requests.labels(method, str(message["status"])).inc()
                self._metrics.seconds.observe(time.perf_counter() - began_s)
            await send(message)

        await self._app(scope, receive, counted)
