"""Results of solves: the document, other programs' formats, wall thickness, a report to print, and the history."""

from __future__ import annotations

from fastapi import APIRouter, Response
from fastapi.responses import HTMLResponse, PlainTextResponse

from app.recordings.kept_report import frames_of
from app.results.extrinsic_text import parse_extrinsic
from app.scene.share import answer_page
from app.schemas.results import Command, ExtrinsicText, Runs, ScanQuality, Thickness
from app.schemas.view import OldExtrinsic
from app.server.deps import GuestDep, JobDep, RecordingDep, ServicesDep, WishedRecordingDep
from calib_core.result import CalibrationResult

router = APIRouter(prefix="/api", tags=["results"])


@router.get("/results/{job_id}")
def read_result(services: ServicesDep, job: JobDep) -> CalibrationResult:
    """The result document, schema unsweep.calibration/1. 409 until the job is done."""
    return services.results.document(job)


@router.get("/results/{job_id}/download")
def download_result(services: ServicesDep, job: JobDep) -> Response:
    """The result document as a file, byte for byte what `unsweep calibrate --output` writes."""
    return services.results.download(job)


@router.get("/results/{job_id}/export/{format_name}", response_class=PlainTextResponse)
def export_result(services: ServicesDep, job: JobDep, format_name: str) -> str:
    """The answer as another program wants it; names as in GET /api/info. 422 where the result lacks what it takes."""
    return services.results.export(job, format_name)


@router.get("/results/{job_id}/thickness")
def read_thickness(services: ServicesDep, job: JobDep) -> Thickness:
    """Wall thickness per plane before and after. 409 where the job gave no answer."""
    return services.results.thickness(job)


@router.get("/results/{job_id}/scans")
def read_scans(services: ServicesDep, job: JobDep) -> ScanQuality:
    """How well each scan agrees with the planes, to find a bad one. 409 where the job gave no answer."""
    return services.results.scans(job)


@router.get("/results/{job_id}/command")
def read_command(services: ServicesDep, job: JobDep, guest: GuestDep) -> Command:
    """The same calibration on the command line, and the files it needs."""
    return services.results.command(job, services.recordings.get(job.recording_id), guest=guest)


@router.get("/results/{job_id}/scene.html", response_class=HTMLResponse)
def download_map(services: ServicesDep, job: JobDep, *, dark: bool = False) -> HTMLResponse:
    """The de-skewed map, the path and both sensors' frames as one self-contained 3D page to share."""
    record = services.recordings.get(job.recording_id)
    page = answer_page(services.sources, record, job.id, limit=services.settings.displayed_points, dark=dark)
    headers = {"Content-Disposition": f'attachment; filename="scene-{job.id[:8]}.html"'}
    return HTMLResponse(page, headers=headers)


@router.post("/extrinsic")
def read_extrinsic(wish: ExtrinsicText, meant_for: WishedRecordingDep) -> OldExtrinsic:
    """An extrinsic from a result, a URDF, an odometry's settings, a matrix, or a position and a quaternion, as the view takes it.

    `recording_id`: which recording it is meant for; the frames of its sensors are looked for among a URDF's links.
    """
    frames = ("", "") if meant_for is None else frames_of(meant_for)
    return parse_extrinsic(wish.text, wish.direction, frames)


@router.get("/results/{job_id}/report", response_class=HTMLResponse)
def read_report(services: ServicesDep, job: JobDep, guest: GuestDep) -> str:
    """The result as one self-contained page for people, to keep or print."""
    return services.results.report_page(job, services.recordings.get(job.recording_id), guest=guest)


@router.get("/recordings/{recording_id}/runs")
def list_runs(services: ServicesDep, recording: RecordingDep) -> Runs:
    """All solves of this recording, newest first, and how their answers differ from the latest."""
    return services.results.runs(recording.id)
