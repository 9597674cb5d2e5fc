"""What the 3D scene of a recording shows; one scene for all browsers that look at the recording."""

from __future__ import annotations

from fastapi import APIRouter

from app.schemas.view import ChangeView, View
from app.server.deps import RecordingDep, ServicesDep

router = APIRouter(prefix="/api/recordings/{recording_id}/view", tags=["view"])


@router.get("")
def read_view(services: ServicesDep, recording: RecordingDep) -> View:
    """What is shown now."""
    return services.scenes.view(recording.id)


@router.post("")
def change_view(services: ServicesDep, recording: RecordingDep, change: ChangeView) -> View:
    """Show something else; all browsers are told."""
    return services.scenes.change_view(recording.id, change)
