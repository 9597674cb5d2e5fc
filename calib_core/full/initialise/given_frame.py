"""In which scan's frame a person's planes are: the map's, which is the first scan's, or that of the scan the track begins with.

Planes are proposed in the scan whose planes face most ways. That need not be the first one: a rosette at rest sees two walls. Who
chooses among the proposals has planes in that scan's frame; who measured them, or takes them from a result, has them in the map.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calib_core.events import Event, LogEvent, OnEvent
from calib_core.full.initialise.lidar_motion import begin
from calib_core.full.initialise.proposed_planes import matched
from calib_core.full.initialise.settings import AGREEING
from calib_core.full.odometry.reference_cloud import propose_planes
from calib_core.full.odometry.settings import TrackSettings
from calib_core.full.planes.propose import find_reference, near_plane, scan_points
from calib_core.full.run import Run
from calib_core.geometry import exp
from calib_core.types import FloatArray, Plane


class Placed(NamedTuple):
    """A person's planes in the frame of the scan that the track begins with. begins: that scan's position, where they tell it;
    None where its own planes do.
    """

    planes: Sequence[Plane] | None
    begins: int | None = None


def in_the_tracks_frame(run: Run, given: Sequence[Plane] | None) -> Placed:
    """The same planes in the frame of the scan that the track begins with. given: in that frame, or in the first scan's: in which
    of them they are is told by the scans' own points.

    From the first scan to the other they are carried by a track without them. Where that does not reach so far, or half of them
    do not come to lie where the other scan shows planes, it has told nothing of them: the track begins with the first scan then.
    """
    if given is None or all(plane.suggested for plane in given):
        return Placed(given)
    scans = run.recording.scans
    first = next((k for k, scan in enumerate(scans) if len(scan.points)), 0)
    reference, _ = find_reference(scans, run.settings, should_cancel=run.should_cancel)
    if reference == first or _share_on(run, given, first) <= _share_on(run, given, reference):
        return Placed(given)
    at_s = run.recording.skipped_s + (scans[reference].stamp_ns - scans[0].stamp_ns) * 1e-9
    text = (
        f"the given {'plane lies' if len(given) == 1 else 'planes lie'} where the first scan shows planes, not where the scan at "
        f"{at_s:.1f} s does"
    )
    carried = _carried(run, given, first, reference)
    if carried is not None:
        text = f"{text}, from which the lidar is followed: taken to be in the first scan's frame, the map"
        run.say("info", "planes.frame", text)
        return Placed(carried)
    text = f"{text}: taken to be in the first scan's frame, the map, and the lidar is followed from there"
    run.say("info", "planes.frame", text)
    return Placed(given, first)


def _carried(run: Run, given: Sequence[Plane], first: int, reference: int) -> list[Plane] | None:
    """Planes of the first scan in the frame of the reference, by a track of what is found there; None where it does not reach so
    far, or where less than half of them are among those found. A first scan that is not on it is where the lidar came from, as
    long as the track itself bridges what it does not see.
    """
    found = propose_planes(run.recording, run.settings)
    followed = begin(replace(run, on_event=_unless_said(run)), None, found)
    near = min(followed.motions, key=lambda m: abs(m.position - first))
    ago_s = float(run.clocks.scan_s[near.position] - run.clocks.scan_s[first])
    if followed.reference != reference or abs(ago_s) > TrackSettings().bridge_s:
        return None
    R, p = near.R @ exp(-ago_s * near.omega_rad_s), near.p - ago_s * near.v_m_s
    carried = [_moved(plane, R, p) for plane in given]
    is_found = matched(carried, [patch.plane for patch in found.patches]) >= 0
    return carried if is_found.mean() >= AGREEING.carried else None


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
