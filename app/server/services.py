"""The application's parts, wired once per application. Nothing here decides anything."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import cached_property

from sqlalchemy import event

from app.bus import Bus
from app.errors import facts_of
from app.events import (
    ClickWasRefused,
    JobStepped,
    PlanesEdited,
    QueueMoved,
    RecordingDeleted,
    RecordingEdited,
    ShownChanged,
    ViewEdited,
)
from app.jobs.launch import Launcher, ProcessLauncher
from app.jobs.service import JobService
from app.planes.service import PlaneService
from app.recordings.arrivals import Arrivals
from app.recordings.folder import RecordingsFolder
from app.recordings.retention import Keeping
from app.recordings.service import RecordingService
from app.results.service import ResultService
from app.scene.compose import Composer
from app.scene.hub import SceneHub
from app.scene.sources import SceneSources
from app.schemas.jobs import Job
from app.schemas.recordings import ServerFacts
from app.schemas.view import ClickRefused, JobChanged, PlanesChanged, RecordingChanged, ViewChanged
from app.server.consequences import Consequences
from app.server.facts import server_facts
from app.server.feed import RecordingFeed
from app.server.readiness import Readiness
from app.server.workflow import Orders, Workflow
from app.settings import AppSettings
from app.storage.database import open_database
from app.storage.files import DataFolder
from app.storage.store import DocumentStore, JobStore, RecordingStore


class Services:
    """Everything a route may call. Made at the start of the application's life, closed at its end."""

    def __init__(self, settings: AppSettings, launcher: Launcher | None = None) -> None:
        self.settings = settings
        self.files = DataFolder(settings)
        self.files.prepare()
        try:
            self._launcher = launcher or self._choose_launcher()
            self._engine = open_database(settings.store_url())
        except BaseException:
            self.files.release()
            raise
        event.listen(self._engine, "begin", lambda _: self.files.keep_reserve())
        recording_store, documents = RecordingStore(self._engine), DocumentStore(self._engine)
        self.readiness = Readiness(self._engine, self.files)
        self.feed = RecordingFeed()
        self.folder = RecordingsFolder(settings.recordings_dir)
        bus = Bus()
        self.planes = PlaneService(recording_store, documents, self.files, bus)
        job_store = JobStore(self._engine)
        self.jobs = JobService(
            job_store,
            self.files,
            settings=settings,
            launcher=self._launcher,
            bus=bus,
            make_order=Orders(recording_store, self.files, settings.job_limits()).of,
            means=Consequences(job_store, self.files).of,
            looks_of=self.planes.looks,
        )
        self.recordings = RecordingService(recording_store, documents, self.files, self.folder, self.jobs, bus)
        self.arrivals = Arrivals(recording_store, self.files, self.recordings, bus, settings=settings)
        self.keeping = Keeping(recording_store, self.files, self.jobs, self.recordings, settings=settings)
        self.results = ResultService(self.files, self.jobs, below=self.folder.path_of)
        self.sources = SceneSources(self.files, self.jobs)
        self._composer = Composer(
            self.sources,
            self.planes,
            self.jobs,
            displayed_points=settings.displayed_points,
        )
        self.scenes = SceneHub(recording_store, documents, self.planes, self._composer, bus, settings=settings)
        self.workflow = Workflow(
            recording_store, self.files, self.jobs, self.planes, self.feed, bus, self.sources, self.folder
        )
        self._subscribe(bus)

    def start(self) -> None:
        """Take up what an earlier server left."""
        self.files.remove_all_unpacked()
        self.jobs.recover()
        self.arrivals.resume(datetime.now(UTC))
        self.workflow.take_up()
        self._launcher.prepare()
        # The first page that is opened asks for it; twenty that were open when a server ended ask at once.
        threading.Thread(target=lambda: self.facts, name="facts", daemon=True).start()
        self.scenes.start()
        self.keeping.start()

    def end_streams(self) -> None:
        """Let everybody who listens come to an end, so that the server can stop at once."""
        self.feed.close()
        self.jobs.logs.close()
        self.scenes.close()

    def close(self) -> None:
        """Stop jobs and scenes, close the store."""
        self.keeping.close()
        self.end_streams()
        self.jobs.close()
        self._launcher.close()
        self._engine.dispose()
        self.files.release()

    @cached_property
    def facts(self) -> ServerFacts:
        """What a client is told before anything else; worked out once, which takes a moment."""
        return server_facts(max_upload_bytes=self.settings.max_upload_bytes, recordings_folder=self.folder.offered)

    def _choose_launcher(self) -> Launcher:
        """Processes on this machine, or the cluster of a scheduler; Unavailable where none answers."""
        if self.settings.scheduler is None:
            return ProcessLauncher()
        from app.fleet.launcher import ClusterLauncher

        return ClusterLauncher(
            self.settings.scheduler,
            grace_s=self.settings.cancel_grace_s,
            memory_bytes=self.settings.job_memory_bytes,
        )

    def _subscribe(self, bus: Bus) -> None:
        """Who hears of what, beside the workflow: scenes that show it, browsers that look."""
        tell = self.feed.tell
        bus.subscribe(JobStepped, lambda event: self.scenes.refresh_live(event.recording_id))
        bus.subscribe(ShownChanged, lambda event: self.scenes.refresh(event.recording_id))
        bus.subscribe(QueueMoved, lambda event: self._tell_places(event.jobs))
        bus.subscribe(PlanesEdited, lambda event: tell(event.recording_id, PlanesChanged(revision=event.revision)))
        bus.subscribe(PlanesEdited, lambda event: self.scenes.refresh(event.recording_id))
        bus.subscribe(ViewEdited, lambda event: tell(event.recording_id, ViewChanged(view=event.view)))
        bus.subscribe(RecordingEdited, lambda event: tell(event.recording_id, RecordingChanged()))
        bus.subscribe(RecordingDeleted, lambda event: self._forget(event.recording_id))
        bus.subscribe(
            ClickWasRefused,
            lambda event: tell(event.recording_id, ClickRefused(error=facts_of(event.error)[1])),
        )

    def _tell_places(self, jobs: Sequence[Job]) -> None:
        for job in jobs:
            self.feed.tell(job.recording_id, JobChanged(job=job))

    def _forget(self, recording_id: str) -> None:
        self.scenes.open.close(recording_id)
        self.planes.forget(recording_id)
        self._composer.forget(recording_id)
        self.feed.tell(recording_id, RecordingChanged(deleted=True))
        self.feed.forget(recording_id)
