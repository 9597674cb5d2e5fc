"""Resumable uploads by the tus protocol, for browsers. An upload's id is its recording's id."""

from __future__ import annotations

from fastapi import APIRouter

from app.schemas.recordings import UploadTarget
from app.server.deps import RecordingDep, ServicesDep

router = APIRouter(prefix="/api/uploads", tags=["uploads"])


@router.get("/{recording_id}/recording")
def read_upload_target(services: ServicesDep, recording: RecordingDep) -> UploadTarget:
    """Which recording an upload becomes (the last part of its tus address), and how much has arrived."""
    received_bytes = services.recordings.received_bytes(recording)
    return UploadTarget(recording_id=recording.id, state=recording.state, received_bytes=received_bytes)
