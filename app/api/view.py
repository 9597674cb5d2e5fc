"""What the 3D scene of a recording shows; one scene for all browsers that look at the recording."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from app.schemas.view import ChangeView, TabName, UnderPointer, View
from app.server.deps import RecordingDep, ServicesDep

Share = Annotated[float, Query(ge=0, le=1)]
Tab = Annotated[
    TabName | None,
    Query(description="the name under which a browser's tab opened its scene, /scene/{recording_id}/{tab}/"),
]

router = APIRouter(prefix="/api/recordings/{recording_id}/view", tags=["view"])


@router.get("")
def read_view(services: ServicesDep, recording: RecordingDep) -> View:
    """What is shown now."""
    return services.scenes.view(recording.id)


@router.post("")
def change_view(services: ServicesDep, recording: RecordingDep, change: ChangeView, tab: Tab = None) -> View:
    """Show something else; all browsers are told. With a `tab`, clicks in its scene mean from now on what this `mode` says."""
    view = services.scenes.change_view(recording.id, change, tab=tab)
    services.workflow.see_to_surface(recording, view)
    return view


@router.get("/under")
def read_under_pointer(services: ServicesDep, recording: RecordingDep, u: Share, v: Share) -> UnderPointer:
    """What is under the pointer; `u` and `v` are shares of the canvas from its upper left corner."""
    return UnderPointer(text=services.scenes.read_out(recording.id, (u, v)))
