"""What is measured beside a result, the same for the browser, the report and the command line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from app.results.evidence import measure_evidence
from app.results.scans import measure_scans
from app.results.thickness import measure_thickness
from app.schemas.evidence import Evidence, Step
from app.schemas.results import ScanQuality, Thickness
from calib_core import api
from calib_core.events import OnEvent, StageEvent, ignore_event
from calib_core.result import CalibrationResult
from calib_core.types import Recording, Trajectory


@dataclass(frozen=True)
class Beside:
    """What lies beside a result; None where it was not measured.

    command: that repeats the run.   made_at: when it was solved.
    """

    walls: Thickness | None = None
    scans: ScanQuality | None = None
    evidence: Evidence | None = None
    command: str | None = None
    made_at: datetime | None = None


def measure_beside(
    recording: Recording,
    result: CalibrationResult,
    trajectory: Trajectory | None,
    steps: Sequence[Step],
    *,
    excluded_spans_s: Sequence[tuple[float, float]] = (),
    on_event: OnEvent = ignore_event,
) -> Beside:
    """Walls, scans and evidence, of the scans that the solve used and whose motion is known all through (`api.covers`).

    recording: as it was read, whole.   excluded_spans_s: of its solve; their scans have no number, yet their place.
    """
    kept = api.without_spans(recording, excluded_spans_s)
    if trajectory is None:
        return Beside(evidence=measure_evidence(kept, result, None, steps))
    planes = result.quality.planes
    on_event(StageEvent(stage="deskew", fraction=0.0, text="measuring the walls"))
    walls = measure_thickness(kept, trajectory, planes)
    on_event(StageEvent(stage="deskew", fraction=0.25, text="holding each scan against the walls"))
    used = None if kept is recording else frozenset(scan.stamp_ns for scan in kept.scans)
    scans = measure_scans(recording, trajectory, planes, used_ns=used)
    on_event(StageEvent(stage="deskew", fraction=0.45, text="measuring what the plots show"))
    return Beside(walls=walls, scans=scans, evidence=measure_evidence(kept, result, trajectory, steps))
