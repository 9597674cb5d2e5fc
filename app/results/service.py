"""Results of jobs: the document, exports, thickness, the report page, and the history of runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
from fastapi import Response
from pydantic import BaseModel, ValidationError

from app.errors import BadRequest, Conflict
from app.jobs.orders import READING, StoredRequest
from app.jobs.service import JobService
from app.jobs.state_machine import SENTENCES
from app.results.command import Found, command_of, found_by
from app.results.companions import Beside
from app.results.report import report_page
from app.schemas.common import ErrorFacts
from app.schemas.evidence import Evidence
from app.schemas.jobs import Job, SolveOutcome
from app.schemas.results import AnswerDifference, Command, Run, Runs, ScanQuality, Thickness
from app.storage.files import DataFolder
from app.storage.records import JobRecord, RecordingRecord
from calib_core import api
from calib_core.audit.report import AuditReport
from calib_core.result import CalibrationResult
from calib_core.settings import ReadSettings

_Model = TypeVar("_Model", bound=BaseModel)


class ResultService:
    """Reads what solves left behind.   below: the path of a source in the folder of recordings that is offered, or None."""

    def __init__(
        self, files: DataFolder, jobs: JobService, *, below: Callable[[Path], str | None] = lambda _: None
    ) -> None:
        self._files = files
        self._jobs = jobs
        self._below = below

    def document(self, job: JobRecord) -> CalibrationResult:
        """The result document."""
        return _result(self._path_of(job))

    def download(self, job: JobRecord) -> Response:
        """The result document as a file."""
        headers = {"Content-Disposition": f'attachment; filename="calibration-{job.id[:8]}.json"'}
        return Response(_text(self._path_of(job)), media_type="application/json", headers=headers)

    def export(self, job: JobRecord, format_name: str) -> str:
        """The extrinsic, or what was found of the sensors, as another program wants it."""
        if format_name not in api.export_names():
            raise BadRequest(
                "export.unknown", f"No export is called {format_name!r}; there are {', '.join(api.export_names())}."
            )
        return api.export(self.document(job), format_name)

    def thickness(self, job: JobRecord) -> Thickness:
        """Wall thickness before and after."""
        self._path_of(job)
        path = self._files.job(job.id) / "thickness.json"
        if not path.is_file():
            raise Conflict("result.no_answer", "The solve was refused, so there is no motion to take out of the scans.")
        return _read(path, Thickness.model_validate_json)

    def audit(self, job: JobRecord) -> AuditReport:
        """The report of an audit."""
        path = self._files.job(job.id) / "audit.json"
        if job.kind != "audit" or job.state != "done" or not path.is_file():
            raise Conflict("audit.not_there", f"This job has no audit's report: {SENTENCES[job.state]}")
        return _read(path, AuditReport.model_validate_json)

    def scans(self, job: JobRecord) -> ScanQuality:
        """How well each scan agrees with the planes."""
        self._path_of(job)
        path = self._files.job(job.id) / "scans.json"
        if not path.is_file():
            if self.document(job).status == "refused":
                raise Conflict(
                    "result.no_answer", "The solve was refused, so there is no motion to judge the scans by."
                )
            raise Conflict("result.no_scans", "This run did not measure its scans one by one; solve again to see them.")
        return _read(path, ScanQuality.model_validate_json)

    def command(self, job: JobRecord, recording: RecordingRecord, *, guest: bool = False) -> Command:
        """The same run on the command line.   guest: sees one recording by its name, and no folder."""
        path = self._files.job(job.id) / READING
        reading = _kept(path, ReadSettings) or ReadSettings.model_validate_json(recording.read_settings_json)
        found = Found(recording.name) if guest else found_by(recording, self._below(self._files.source(recording)))
        request = StoredRequest.model_validate_json(job.request_json)
        return command_of(self.document(job), reading, request, found=found)

    def report_page(self, job: JobRecord, recording: RecordingRecord, *, guest: bool = False) -> str:
        """The result as one page for people.   guest: sees the recording by its name, and no folder."""
        folder = self._files.job(job.id)
        beside = Beside(
            walls=_kept(folder / "thickness.json", Thickness),
            scans=_kept(folder / "scans.json", ScanQuality),
            evidence=_kept(folder / "evidence.json", Evidence),
            command=self.command(job, recording, guest=guest).text,
            made_at=job.ended_at,
        )
        return report_page(self.document(job), beside)

    def runs(self, recording_id: str) -> Runs:
        """The recording's solves, newest first, each answer compared with the latest one."""
        found = [self._found(job) for job in self._jobs.list_of(recording_id) if job.kind == "solve"]
        latest = next((result for _, result in found if result is not None and result.T_imu_lidar is not None), None)
        runs = [run.model_copy(update={"from_latest": _from_latest(result, latest)}) for run, result in found]
        return Runs(recording_id=recording_id, runs=runs)

    def _found(self, job: Job) -> tuple[Run, CalibrationResult | None]:
        """A solve and what it found: nothing where it has no result, or a damaged one, of which the others know nothing."""
        path = self._path(job.id)
        try:
            return Run(job=job), _result(path) if isinstance(job.result, SolveOutcome) and path.is_file() else None
        except Conflict as error:
            return Run(job=job, error=ErrorFacts(code=error.code, text=str(error))), None

    def _path_of(self, job: JobRecord) -> Path:
        if job.kind != "solve":
            raise Conflict("result.not_a_solve", f"A job of kind {job.kind} has no result; ask for that of a solve.")
        path = self._path(job.id)
        if job.state != "done" or not path.is_file():
            raise Conflict("result.not_there", f"This solve has no result: {SENTENCES[job.state]}")
        return path

    def _path(self, job_id: str) -> Path:
        return self._files.job(job_id) / "result.json"


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise _damaged() from error


def _read(path: Path, parse: Callable[[str], _Model]) -> _Model:
    """What a job left. Raises Conflict where it lies damaged on the disk: that is no defect, and nobody else's matter."""
    try:
        return parse(_text(path))
    except ValidationError as error:
        raise _damaged() from error


def _result(path: Path) -> CalibrationResult:
    return _read(path, CalibrationResult.from_json)


def _damaged() -> Conflict:
    return Conflict("result.unreadable", "What this run found lies damaged on the disk; run it again.")


def _kept(path: Path, model: type[_Model]) -> _Model | None:
    """What may stand beside an answer; None where it is not there."""
    return _read(path, model.model_validate_json) if path.is_file() else None


def _from_latest(result: CalibrationResult | None, latest: CalibrationResult | None) -> AnswerDifference | None:
    if result is latest or result is None or result.T_imu_lidar is None or latest is None or latest.T_imu_lidar is None:
        return None
    here, there = np.array(result.T_imu_lidar.matrix), np.array(latest.T_imu_lidar.matrix)
    turn = here[:3, :3].T @ there[:3, :3]
    # The sine keeps small angles that the cosine would round away.
    sine = 0.5 * np.linalg.norm([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    cosine = 0.5 * (np.trace(turn) - 1.0)
    return AnswerDifference(
        rotation_deg=float(np.degrees(np.arctan2(sine, cosine))),
        translation_m=float(np.linalg.norm(there[:3, 3] - here[:3, 3])),
        time_offset_s=api.time_offset_apart_s(result, latest),
    )
