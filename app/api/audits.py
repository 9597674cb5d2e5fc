"""Audits: an extrinsic in use held against a recording, before any solve."""

from __future__ import annotations

from fastapi import APIRouter

from app.schemas.audits import NewAudit
from app.schemas.jobs import Job
from app.server.deps import JobDep, RecordingDep, ServicesDep
from calib_core.audit.report import AuditReport

router = APIRouter(prefix="/api", tags=["audits"])


@router.post("/recordings/{recording_id}/audits", status_code=201)
def start_audit(services: ServicesDep, recording: RecordingDep, wish: NewAudit) -> Job:
    """Queue an audit. 422 where the text is no extrinsic."""
    return services.workflow.start_audit(recording, wish)


@router.get("/audits/{job_id}")
def read_audit(services: ServicesDep, job: JobDep) -> AuditReport:
    """The audit's report, schema unsweep.audit/1. 409 until the job is done."""
    return services.results.audit(job)
