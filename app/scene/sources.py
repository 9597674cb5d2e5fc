"""What scenes are made from, read from disk and kept at hand: decoded recordings, solved motions."""

from __future__ import annotations

import itertools
import threading
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Generic, TypeVar
from zipfile import BadZipFile

import numpy as np

from app.arrays.first_cloud import first_cloud_file, read_first_cloud
from app.arrays.folder import DamagedArrays, forget_verified
from app.arrays.recording import has_recording, read_recording, recording_arrays
from app.arrays.surface import SURFACE, Surface, read_surface
from app.arrays.trajectory import TRAJECTORY, read_trajectory
from app.errors import ApiError
from app.jobs.orders import StoredRequest
from app.jobs.service import JobService
from app.jobs.stored_parts import readable_request
from app.locks import NamedLocks
from app.scene.build import Solved
from app.schemas.results import Thickness
from app.storage.files import DataFolder
from app.storage.records import JobRecord, RecordingRecord
from calib_core.result import CalibrationResult
from calib_core.types import FloatArray, PointArray, Recording

Kept = TypeVar("Kept")

#: Decoded recordings are memory maps and cost little; motions are small.
KEPT = 8


class Shelf(Generic[Kept]):
    """The last few things made, by name; a name starts with its recording's id.

    Making one keeps nobody waiting who wants another.
    """

    def __init__(self, kept: int = KEPT) -> None:
        self._most = kept
        self._lock = threading.Lock()
        self._kept: OrderedDict[str, Kept] = OrderedDict()
        self._making = NamedLocks()

    def get(self, name: str, make: Callable[[], Kept]) -> Kept:
        """The thing of that name, made if it is not there."""
        with self._making.hold(name):
            with self._lock:
                if name in self._kept:
                    self._kept.move_to_end(name)
                    return self._kept[name]
            made = make()
            with self._lock:
                self._kept[name] = made
                while len(self._kept) > self._most:
                    self._kept.popitem(last=False)
            return made

    def forget(self, recording_id: str) -> None:
        """Drop what was made of the recording: a map of a deleted file keeps its room on the disk."""
        with self._lock:
            for name in [name for name in self._kept if name.startswith(recording_id)]:
                del self._kept[name]


@dataclass(frozen=True)
class SolvedJob:
    """A job that has an answer, and what it left. surface: of its room, once it was laid."""

    job_id: str
    solved: Solved
    surface: Surface | None = None


class SceneSources:
    """Loads what a recording's scene shows."""

    def __init__(self, files: DataFolder, jobs: JobService) -> None:
        self._files = files
        self._jobs = jobs
        self._recordings: Shelf[Recording] = Shelf()
        self._solved: Shelf[Solved] = Shelf()
        self._surfaces: Shelf[Surface] = Shelf()

    def recording(self, record: RecordingRecord) -> Recording | None:
        """The decoded recording, or None until it has been read."""
        try:
            folder = recording_arrays(self._files.cache(record))
        except ApiError:
            return None

        def make() -> Recording:
            self._recordings.forget(record.id)  # as it was read before, with other settings
            return read_recording(folder)

        try:
            return self._recordings.get(f"{record.id}{folder}", make) if has_recording(folder) else None
        except DamagedArrays:  # as if it had not been read; whoever asks for its planes or times has it read again
            return None

    def forget(self, recording_id: str) -> None:
        """The recording is deleted."""
        for shelf in (self._recordings, self._solved, self._surfaces):
            shelf.forget(recording_id)
        forget_verified(self._files.recording(recording_id))

    def first_cloud(self, record: RecordingRecord) -> PointArray | None:
        """What was seen first of the recording, (N,) points; None until then."""
        try:
            return read_first_cloud(first_cloud_file(self._files.cache(record)))
        except ApiError:
            return None

    def solved(self, record: RecordingRecord, job_id: str | None) -> SolvedJob | None:
        """What the named solve left, or the latest with an answer; None where there is none."""
        for job in self._jobs.records_of(record.id):
            if job.kind != "solve" or job.state != "done" or (job_id is not None and job.id != job_id):
                continue
            if not (self._files.job(job.id) / TRAJECTORY).is_file():
                continue
            with suppress(OSError, ValueError, KeyError, BadZipFile):  # damaged on the disk: as if it had no answer
                return SolvedJob(
                    job.id, self._solved.get(f"{record.id}{job.id}", partial(self._load, job)), self._surface(job)
                )
        return None

    def surface_job(self, record: RecordingRecord, job_id: str) -> JobRecord | None:
        """The newest job that lays a surface through that solve's room."""
        for job in self._jobs.records_of(record.id):
            request = readable_request(job) if job.kind == "surface" else None
            if request is not None and request.surface_of == job_id:
                return job
        return None

    def _surface(self, job: JobRecord) -> Surface | None:
        path = self._files.job(job.id) / SURFACE
        if not path.is_file():
            return None
        with suppress(OSError, ValueError, KeyError, BadZipFile):
            return self._surfaces.get(f"{job.recording_id}{job.id}", partial(read_surface, path))
        return None

    def _load(self, job: JobRecord) -> Solved:
        folder = self._files.job(job.id)
        result = CalibrationResult.from_json((folder / "result.json").read_text(encoding="utf-8"))
        matrix: FloatArray = np.eye(4) if result.T_imu_lidar is None else np.array(result.T_imu_lidar.matrix)
        return Solved(
            trajectory=read_trajectory(folder / TRAJECTORY),
            planes=result.quality.planes,
            colors=self._colors(job, [plane.name for plane in result.quality.planes]),
            T_imu_lidar=matrix,
            time_offset_s=result.time_offset_s or 0.0,
            walls=_walls(folder / "thickness.json"),
        )

    def _colors(self, job: JobRecord, names: list[str]) -> list[int]:
        """Palette places: a plane keeps the colour it had when the solve was asked for; one found later gets the next."""
        ordered = StoredRequest.model_validate_json(job.request_json).planes or ()
        known = {plane.name: plane.color for plane in ordered if plane.color is not None}
        fresh = itertools.count(max(known.values(), default=-1) + 1)
        return [known[name] if name in known else next(fresh) for name in names]


def _walls(path: Path) -> Thickness | None:
    with suppress(OSError, ValueError):  # not there, or damaged: the scene is shown without
        return Thickness.model_validate_json(path.read_text(encoding="utf-8"))
    return None
