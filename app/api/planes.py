"""Planes of a recording: as everybody sees them, and the operations that edit them."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Body

from app.schemas.planes import Operation, Planes
from app.server.deps import RecordingDep, ServicesDep

router = APIRouter(prefix="/api/recordings/{recording_id}/planes", tags=["planes"])


@router.get("")
def read_planes(services: ServicesDep, recording: RecordingDep) -> Planes:
    """The planes now. 409 until they have been proposed."""
    return services.planes.read(recording.id)


@router.post("/operations")
def edit_planes(services: ServicesDep, recording: RecordingDep, operation: Annotated[Operation, Body()]) -> Planes:
    """Apply one operation; all browsers are told. 409 if `expected_revision` is not the current one."""
    return services.planes.apply(recording.id, operation)
