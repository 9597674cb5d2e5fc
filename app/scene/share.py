"""An answer as one self-contained 3D page: the map it makes, the way the lidar took, both sensors' frames."""

from __future__ import annotations

from app.errors import Conflict
from app.scene.apply import ShownScene
from app.scene.build import Solved, solved_stage
from app.scene.inspect import Look, Motions, build_inspection
from app.scene.sources import SceneSources
from app.storage.records import RecordingRecord
from calib_core.types import Recording


def answer_page(sources: SceneSources, record: RecordingRecord, job_id: str, *, limit: int, dark: bool) -> str:
    """The page of a solve; Conflict where it has no answer."""
    found, recording = sources.solved(record, job_id), sources.recording(record)
    if found is None or recording is None or len(recording.scans) == 0:
        raise Conflict("result.no_answer", "This run has no answer to make a scene of; solve first.")
    return shared_page(recording, found.solved, limit=limit, dark=dark)


def shared_page(recording: Recording, solved: Solved, *, limit: int, dark: bool) -> str:
    """The page. It needs no server: it can be sent to anybody."""
    look = Look(
        place=0,
        show="deskewed",
        against="raw",
        extent="map",
        color_by="plane",
        wipe=0.5,
        limit=limit,
        stage=solved_stage(recording, solved),
    )
    content = build_inspection(recording, look, Motions(solved, solved.trajectory, None), None)
    shown = ShownScene(on_patch=lambda _: None, on_ray=lambda _, __, ___: None)
    try:
        shown.show(content, dark=dark)
        return shown.export_html()
    finally:
        shown.close()
