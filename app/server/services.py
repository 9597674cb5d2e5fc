"""The application's parts, wired once per application. Nothing here decides anything."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from functools import cached_property

from sqlalchemy import event

from app.bus import Bus
from app.errors import Conflict, facts_of
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
from app.scene.share import shared_page
from app.scene.sources import SceneSources
from app.schemas.jobs import Job
from app.schemas.recordings import NewShareLink, Sample, ServerFacts, ShareLink, WeakLimits
from app.schemas.view import ClickRefused, JobChanged, PlanesChanged, RecordingChanged, ViewChanged
from app.server.consequences import Consequences
from app.server.feed import RecordingFeed
from app.server.share import ShareLinks
from app.server.usual import usual_numbers
from app.server.workflow import Orders, Workflow
from app.settings import AppSettings
from app.storage.database import open_database, touch_database
from app.storage.files import SUFFIXES, DataFolder
from app.storage.records import JobRecord, RecordingRecord
from app.storage.store import DocumentStore, JobStore, RecordingStore
from app.weak_limits import AXIS_NAMES
from calib_core import __version__, api
from calib_core.presets import IMU_PRESETS, LIDAR_PRESETS
from calib_core.result import WEAK_DEG, WEAK_M, WEAK_S
from calib_core.settings import CalibrateSettings

#: Scenarios offered as samples, and their titles; the first is the one click away.
SAMPLES = {
    "paper-normal": "A room corner, 20 s",
    "one-axis": "Turning about one axis only",
    "vehicle": "A vehicle in a car park",
}


#: So long an answer of readyz holds: whoever may ask it may ask it as often as he likes.
READY_FOR_S = 1.0


class Services:
    """Everything a route may call. Made at the start of the application's life, closed at its end."""

    def __init__(self, settings: AppSettings, launcher: Launcher | None = None) -> None:
        self.settings = settings
        self._checking = threading.Lock()
        self._ready_at_s = float("-inf")
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
        self.workflow = Workflow(recording_store, self.files, self.jobs, self.planes, self.feed, bus, self.sources)
        self._subscribe(bus)

    def start(self) -> None:
        """Take up what an earlier server left."""
        self.files.remove_all_unpacked()
        self.jobs.recover()
        self.arrivals.resume(datetime.now(UTC))
        self.workflow.take_up()
        self._launcher.prepare()
        # The first page that is opened asks for it; twenty that were open when a server ended ask at once.
        threading.Thread(target=self.server_facts, name="facts", daemon=True).start()
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

    def check_ready(self) -> None:
        """Raise Unavailable or DiskFull unless store and data directory can be written. Asked often, tried seldom."""
        with self._checking:
            if time.monotonic() - self._ready_at_s > READY_FOR_S:
                touch_database(self._engine)
                self.files.check_writable()
                self._ready_at_s = time.monotonic()

    def server_facts(self) -> ServerFacts:
        """What a client needs to know before anything else."""
        return self._fixed_facts.model_copy(update={"recordings_folder": self.folder.offered})

    @cached_property
    def _fixed_facts(self) -> ServerFacts:
        """What does not change. Loads much of the library, once."""
        texts = api.scenarios()
        return ServerFacts(
            version=__version__,
            recordings_folder=False,
            max_upload_bytes=self.settings.max_upload_bytes,
            upload_suffixes=list(SUFFIXES),
            export_formats=list(api.export_names()),
            limits=WeakLimits(rotation_deg=WEAK_DEG, translation_m=WEAK_M, time_offset_s=WEAK_S),
            usual=usual_numbers(),
            solve_settings=CalibrateSettings(),
            axis_names=AXIS_NAMES,
            imu_presets=[preset.name for preset in IMU_PRESETS],
            lidar_presets=[preset.name for preset in LIDAR_PRESETS],
            samples=[Sample(scenario=name, title=title, text=texts[name]) for name, title in SAMPLES.items()],
        )

    def share(self, recording: RecordingRecord, wish: NewShareLink) -> ShareLink:
        """A link that shows the recording; Conflict on a server that everybody may use anyway."""
        if self.settings.token is None:
            raise Conflict(
                "share.open_server",
                "This server has no token, so whoever reaches it sees everything; send its address.",
            )
        until = datetime.now(UTC) + timedelta(hours=wish.hours)
        link = ShareLinks(self.settings.token).make(recording.id, until.timestamp())
        return ShareLink(path=f"/r/{recording.id}/recording?share={link}", until=until)

    def shared_scene(self, job: JobRecord, *, dark: bool) -> str:
        """A solve's answer as one 3D page; Conflict where it has none."""
        record = self.recordings.get(job.recording_id)
        found, recording = self.sources.solved(record, job.id), self.sources.recording(record)
        if found is None or recording is None or len(recording.scans) == 0:
            raise Conflict("result.no_answer", "This run has no answer to make a scene of; solve first.")
        return shared_page(recording, found.solved, limit=self.settings.displayed_points, dark=dark)

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
