"""The application's parts, wired once per application. Nothing here decides anything."""

from __future__ import annotations

from datetime import UTC, datetime

from app.jobs.launch import Launcher, ProcessLauncher
from app.jobs.service import JobService
from app.planes.service import PlaneService
from app.recordings.folder import RecordingsFolder
from app.recordings.service import RecordingService
from app.results.limits import AXIS_NAMES, WEAK_DEG, WEAK_M, WEAK_S
from app.results.service import ResultService
from app.scene.compose import Composer
from app.scene.hub import SceneHub
from app.scene.share import shared_page
from app.scene.sources import SceneSources
from app.schemas.recordings import Limits, Sample, ServerFacts
from app.schemas.view import ClickRefused, PlanesChanged, RecordingChanged, ViewChanged
from app.server.errors import Conflict, facts_of
from app.server.feed import RecordingFeed
from app.server.settings import AppSettings
from app.server.workflow import Workflow
from app.storage.database import check_database, open_database
from app.storage.files import SUFFIXES, DataFolder
from app.storage.records import JobRecord
from app.storage.store import DocumentStore, JobStore, RecordingStore
from calib_core import __version__, api
from calib_core.presets import IMU_PRESETS

#: Scenarios offered as samples, and their titles; the first is the one click away.
SAMPLES = {
    "paper-normal": "A room corner, 20 s",
    "one-axis": "Turning about one axis only",
    "vehicle": "A vehicle in a car park",
}


class Services:
    """Everything a route may call. Made at the start of the application's life, closed at its end."""

    def __init__(self, settings: AppSettings, launcher: Launcher | None = None) -> None:
        self.settings = settings
        self.files = DataFolder(settings)
        self.files.prepare()
        url = settings.database_url or f"sqlite:///{settings.data_dir / 'unsweep.sqlite'}"
        self._engine = open_database(url)
        recording_store, documents = RecordingStore(self._engine), DocumentStore(self._engine)
        self.feed = RecordingFeed()
        self.folder = RecordingsFolder(settings.recordings_dir)
        self.workflow = Workflow(recording_store, self.files, self.feed)
        self._launcher = launcher or ProcessLauncher(spare=settings.spare_worker)
        self.jobs = JobService(
            JobStore(self._engine),
            self.files,
            settings=settings,
            launcher=self._launcher,
            make_order=self.workflow.make_order,
            on_change=self.workflow.job_changed,
        )
        self.planes = PlaneService(recording_store, documents, self.files)
        self.recordings = RecordingService(recording_store, self.files, self.folder, self.jobs, settings=settings)
        self.results = ResultService(self.files, self.jobs)
        self.sources = SceneSources(self.files, self.jobs)
        composer = Composer(
            self.sources,
            self.planes,
            self.jobs,
            displayed_points=settings.displayed_points,
        )
        self.scenes = SceneHub(recording_store, documents, self.planes, composer, settings=settings)
        self._connect()

    def start(self) -> None:
        """Take up what an earlier server left."""
        self.files.remove_all_unpacked()
        self.jobs.recover()
        self.recordings.resume(datetime.now(UTC))
        self._launcher.prepare()
        self.scenes.start()

    def end_streams(self) -> None:
        """Let everybody who listens come to an end, so that the server can stop at once."""
        self.feed.close()
        self.jobs.logs.close()
        self.scenes.close()

    def close(self) -> None:
        """Stop jobs and scenes, close the store."""
        self.end_streams()
        self.jobs.close()
        self._launcher.close()
        self._engine.dispose()

    def check_ready(self) -> None:
        """Raise Unavailable unless store and data directory can be used."""
        check_database(self._engine)
        self.files.check_writable()

    def server_facts(self) -> ServerFacts:
        """What a client needs to know before anything else."""
        texts = api.scenarios()
        return ServerFacts(
            version=__version__,
            recordings_folder=self.folder.offered,
            max_upload_bytes=self.settings.max_upload_bytes,
            upload_suffixes=list(SUFFIXES),
            export_formats=list(api.export_names()),
            limits=Limits(rotation_deg=WEAK_DEG, translation_m=WEAK_M, time_offset_s=WEAK_S),
            axis_names=AXIS_NAMES,
            imu_presets=[preset.name for preset in IMU_PRESETS],
            samples=[Sample(scenario=name, title=title, text=texts[name]) for name, title in SAMPLES.items()],
        )

    def shared_scene(self, job: JobRecord, *, dark: bool) -> str:
        """A solve's answer as one 3D page; Conflict where it has none."""
        record = self.recordings.get(job.recording_id)
        found, recording = self.sources.solved(record, job.id), self.sources.recording(record)
        if found is None or recording is None or len(recording.scans) == 0:
            raise Conflict("result.no_answer", "This run has no answer to make a scene of; solve first.")
        return shared_page(recording, found.solved, limit=self.settings.displayed_points, dark=dark)

    def _connect(self) -> None:
        """Tie services together that do not know each other."""
        self.jobs.looks_of = self.planes.looks
        self.workflow.connect(self.jobs, self.recordings, self.planes)
        self.workflow.on_shown_changed = self.scenes.refresh
        self.jobs.on_step = self.scenes.refresh_live

        def planes_changed(recording_id: str, revision: int) -> None:
            self.feed.tell(recording_id, PlanesChanged(revision=revision))
            self.scenes.refresh(recording_id)

        def recording_deleted(recording_id: str) -> None:
            self.scenes.close_scene(recording_id)
            self.planes.forget(recording_id)
            self.feed.tell(recording_id, RecordingChanged(deleted=True))
            self.feed.forget(recording_id)

        self.planes.on_changed = planes_changed
        self.recordings.on_deleted = recording_deleted
        self.recordings.on_changed = lambda recording_id: self.feed.tell(recording_id, RecordingChanged())
        self.scenes.on_refused = lambda recording_id, error: self.feed.tell(
            recording_id, ClickRefused(error=facts_of(error)[1])
        )
        self.scenes.on_view = lambda recording_id, view: self.feed.tell(recording_id, ViewChanged(view=view))
