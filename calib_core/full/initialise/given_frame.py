"""In which scan's frame a person's planes are: the map's, which is the first scan's, or that of the scan the track begins with.

Planes are proposed in the scan whose planes face most ways. That need not be the first one: a rosette at rest sees two walls. Who
chooses among the proposals has planes in that scan's frame; who measured them, or takes them from a result, has them in the map.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib_core.events import Event, LogEvent, OnEvent
from calib_core.full.initialise.begin import begin
from calib_core.full.odometry.reference_cloud import propose_planes
from calib_core.full.planes.propose import find_reference, near_plane, scan_points
from calib_core.full.run import Run
from calib_core.types import FloatArray, Plane


def in_the_tracks_frame(run: Run, given: Sequence[Plane] | None) -> Sequence[Plane] | None:
    """The same planes in the frame of the scan that the track begins with. given: in that frame, or in the first scan's: in which
    of them they are is told by the scans' own points.
    """
    if given is None or all(plane.suggested for plane in given):
        return given
    scans = run.recording.scans
    first = next((k for k, scan in enumerate(scans) if len(scan.points)), 0)
    reference, _ = find_reference(scans, run.settings, should_cancel=run.should_cancel)
    if reference == first or _share_on(run, given, first) <= _share_on(run, given, reference):
        return given
    followed = begin(replace(run, on_event=_unless_said(run)), None, propose_planes(run.recording, run.settings))
    if followed.reference != reference:
        return given
    origin = next((m for m in followed.motions if m.position == first), None)
    if origin is None:
        return given
    at_s = (scans[reference].stamp_ns - scans[first].stamp_ns) * 1e-9
    run.say(
        "info",
        "planes.frame",
        f"the given {'plane lies' if len(given) == 1 else 'planes lie'} where the first scan shows planes, not where the scan at "
        f"{at_s:.1f} s does, from which the lidar is followed: taken to be in the first scan's frame, the map",
    )
    return [_moved(plane, origin.R, origin.p) for plane in given]


def _share_on(run: Run, planes: Sequence[Plane], position: int) -> float:
    """Which part of a scan's points lie on any of these planes, were they in its frame."""
    points_m = scan_points(run.recording.scans[position], run.settings.field_of_view_deg)
    on = np.zeros(len(points_m), np.bool_)
    for plane in planes:
        on |= near_plane(points_m, plane)
    return float(on.mean()) if len(on) else 0.0


def _moved(plane: Plane, R: FloatArray, p: FloatArray) -> Plane:
    """A plane of a scan in the frame in which that scan lies at R (3, 3), p (3,), its normal towards that frame's origin."""
    normal = R @ plane.normal
    offset_m = float(plane.offset_m - normal @ p)
    side = 1.0 if offset_m >= 0.0 else -1.0
    outline_m = None if plane.outline_m is None else plane.outline_m @ R.T + p
    return replace(plane, normal=side * normal, offset_m=side * offset_m, outline_m=outline_m)


def _unless_said(run: Run) -> OnEvent:
    def tell(event: Event) -> None:
        if not isinstance(event, LogEvent):  # the track is followed again, and says it then
            run.on_event(event)

    return tell
