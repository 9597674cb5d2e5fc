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
from calib_core.full.initialise.proposed_planes import choice_among, matched
from calib_core.full.initialise.settings import AGREEING
from calib_core.full.odometry.reference_cloud import propose_planes
from calib_core.full.odometry.settings import TrackSettings
from calib_core.full.planes.propose import find_reference, near_plane, scan_points
from calib_core.full.run import Run
from calib_core.geometry import exp
from calib_core.method import Question
from calib_core.settings import CalibrateSettings
from calib_core.types import FloatArray, Plane, Recording, Scan


class Placed(NamedTuple):
    """A person's planes in the frame of the scan that the track begins with. begins: that scan's position, where they tell it;
    None where its own planes do.
    """

    planes: Sequence[Plane] | None
    begins: int | None = None


def of_part(question: Question, whole: Recording, part: Recording) -> Question | None:
    """The same question about a part of a recording. Its planes stay in the scan in which they are told, of whose place in the
    part the search for that scan knows nothing: among fewer scans it may end at another one.

    Proposals that nobody has touched are no choice of the part either. None where planes are given and their scan is not in the
    part: they mean nothing.
    """
    planes = question.planes
    if planes is None:
        return question
    told = told_in(question, whole)
    told_at_ns = whole.scans[told].stamp_ns
    reference, _ = find_reference(part.scans, question.settings)
    if part.scans[reference].stamp_ns != told_at_ns and all(plane.suggested for plane in planes):
        proposed = propose_planes(whole, question.settings, position=told, should_cancel=question.should_cancel)
        if choice_among([patch.plane for patch in proposed.patches], planes) is None:
            return replace(question, planes=None)
    if _position_of(part.scans, told_at_ns) is None:
        first = part.scans[_first(part.scans)]
        is_in_first = first.stamp_ns == whole.scans[_first(whole.scans)].stamp_ns and _lie_in(
            first, planes, question.settings, rather_than=whole.scans[told]
        )
        return replace(question, told_at_ns=first.stamp_ns) if is_in_first else None
    return replace(question, told_at_ns=told_at_ns)


def told_in(question: Question, whole: Recording) -> int:
    """The position of the scan of the whole in whose frame the question's planes are, unless they lie where the first scan shows
    some.
    """
    told = None if question.told_at_ns is None else _position_of(whole.scans, question.told_at_ns)
    return find_reference(whole.scans, question.settings)[0] if told is None else told


def in_the_tracks_frame(run: Run, given: Sequence[Plane] | None, told_at_ns: int | None = None) -> Placed:
    """The same planes in the frame of the scan that the track begins with. given: in that frame, or in the first scan's: in which
    of them they are is told by the scans' own points.   told_at_ns: stamp of the scan that the given planes are told in, where
    scans were left out (`of_part`); the track begins there. None: it is the one with which the track would begin anyway.

    From the first scan to the other they are carried by a track without them. Where that does not reach so far, or half of them
    do not come to lie where the other scan shows planes, it has told nothing of them: the track begins with the first scan then.
    """
    by_hand = given is not None and not all(plane.suggested for plane in given)
    if given is None or not (by_hand or told_at_ns is not None):
        return Placed(given)
    scans, settings = run.recording.scans, run.settings
    first = _first(scans)
    reference, _ = find_reference(scans, settings, should_cancel=run.should_cancel)
    told = None if told_at_ns is None else _position_of(scans, told_at_ns)
    told = reference if told is None else told
    if told != first and not (by_hand and _lie_in(scans[first], given, settings, rather_than=scans[told])):
        return Placed(given, None if told == reference else told)
    if reference == first:
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


def _lie_in(scan: Scan, planes: Sequence[Plane], settings: CalibrateSettings, *, rather_than: Scan) -> bool:
    """Whether planes are in a scan's frame rather than in another's: more of its points lie on them, were they in its own."""
    return _share_on(scan, planes, settings) > _share_on(rather_than, planes, settings)


def _share_on(scan: Scan, planes: Sequence[Plane], settings: CalibrateSettings) -> float:
    """Which part of a scan's points lie on any of these planes, were they in its frame."""
    points_m = scan_points(scan, settings.field_of_view_deg)
    on = np.zeros(len(points_m), np.bool_)
    for plane in planes:
        on |= near_plane(points_m, plane)
    return float(on.mean()) if len(on) else 0.0


def _first(scans: Sequence[Scan]) -> int:
    """The first scan with points."""
    return next((k for k, scan in enumerate(scans) if len(scan.points)), 0)


def _position_of(scans: Sequence[Scan], stamp_ns: int) -> int | None:
    """The position of the scan of that stamp; None where it was left out."""
    return next((k for k, scan in enumerate(scans) if scan.stamp_ns == stamp_ns), None)


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
