"""What scenes are made from, read from disk and kept at hand: decoded recordings, solved motions."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from app.arrays.recording import has_recording, read_recording
from app.arrays.trajectory import read_trajectory
from app.errors import ApiError
from app.jobs.functions import recording_arrays
from app.jobs.service import JobService
from app.planes.service import PlaneService
from app.scene.build import Solved
from app.storage.files import DataFolder
from app.storage.records import JobRecord, RecordingRecord
from calib_core.result import CalibrationResult
from calib_core.types import FloatArray, Recording

Kept = TypeVar("Kept")

#: Decoded recordings are memory maps and cost little; motions are small.
KEPT = 8


class Shelf(Generic[Kept]):
    """The last few things made, by name."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: OrderedDict[str, Kept] = OrderedDict()

    def get(self, name: str, make: Callable[[], Kept]) -> Kept:
        """The thing of that name, made if it is not there."""
        with self._lock:
            if name not in self._kept:
                self._kept[name] = make()
                while len(self._kept) > KEPT:
                    self._kept.popitem(last=False)
            self._kept.move_to_end(name)
            return self._kept[name]


@dataclass(frozen=True)
class SolvedJob:
    """A job that has an answer, and what it left."""

    job_id: str
    solved: Solved


class SceneSources:
    """Loads what a recording's scene shows."""

    def __init__(self, files: DataFolder, jobs: JobService, planes: PlaneService) -> None:
        self._files = files
        self._jobs = jobs
        self._planes = planes
        self._recordings: Shelf[Recording] = Shelf()
        self._solved: Shelf[Solved] = Shelf()

    def recording(self, record: RecordingRecord) -> Recording | None:
        """The decoded recording, or None until it has been read."""
        try:
            folder = recording_arrays(self._files.cache(record))
        except ApiError:
            return None
        return self._recordings.get(str(folder), lambda: read_recording(folder)) if has_recording(folder) else None

    def solved(self, record: RecordingRecord, job_id: str | None) -> SolvedJob | None:
        """What the named solve left, or the latest with an answer; None where there is none."""
        for job in self._jobs.records_of(record.id):
            if job.kind != "solve" or job.state != "done" or (job_id is not None and job.id != job_id):
                continue
            if (self._files.job(job.id) / "trajectory.npz").is_file():
                return SolvedJob(job.id, self._solved.get(job.id, lambda job=job: self._load(record, job)))  # type: ignore[misc]
        return None

    def _load(self, record: RecordingRecord, job: JobRecord) -> Solved:
        folder = self._files.job(job.id)
        result = CalibrationResult.model_validate_json((folder / "result.json").read_text(encoding="utf-8"))
        matrix: FloatArray = np.eye(4) if result.T_imu_lidar is None else np.array(result.T_imu_lidar.matrix)
        return Solved(
            trajectory=read_trajectory(folder / "trajectory.npz"),
            planes=result.quality.planes,
            colors=self._colors(record.id, [plane.name for plane in result.quality.planes]),
            T_imu_lidar=matrix,
        )

    def _colors(self, recording_id: str, names: list[str]) -> list[int]:
        """Palette places: a plane keeps the colour it had when it was confirmed."""
        try:
            _, history = self._planes.current(recording_id)
        except ApiError:
            return list(range(len(names)))
        known = {patch.name: patch.color for patch in history.current.patches}
        return [known.get(name, place) for place, name in enumerate(names)]
