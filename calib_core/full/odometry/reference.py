"""From where to follow the planes: the reference scan again without its motion, and other scans where it leads nowhere.

Planes found in a scan taken on the move are bent by that motion. Once its neighbours have told the motion, the scan is
straightened and its planes are found anew. Where the planes around a scan are soon lost, those are tried from which the
planes tell most, and the longest track is kept; the map frame is then that of its reference.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib_core.errors import Cancelled
from calib_core.full.odometry.motion_prior import Guide, Misled, Turning, rate_within, steadied
from calib_core.full.odometry.plane_map import PlaneMap
from calib_core.full.odometry.register import ScanMotion, straighten
from calib_core.full.odometry.settings import FOLLOWING
from calib_core.full.odometry.track import track
from calib_core.full.planes.propose import named_planes, scan_points
from calib_core.full.planes.settings import SEARCH
from calib_core.full.run import Run
from calib_core.geometry import log
from calib_core.planes.segment import determinacy, segment_planes
from calib_core.types import FloatArray, Plane

#: Who looks at a track, made anew for each.
Guided = Callable[[], Guide] | None


@dataclass(frozen=True)
class Followed:
    """A track, the planes it ended up with, and the scan in whose frame they are.

    reference: position of that scan in the recording.   motions: of the scans that were followed, in order of time.
    proposals: the planes that were proposed, as they were found; () where the map is not in their reference scan's frame.
    away: whether the planes were found in another scan than the proposals.   of_proposal: which proposal each of the planes is,
    -1 for none.   late: which of the planes came into view on the way, so that nobody was shown them.   Both () where it is not
    known.   dropped: planes that a person does not want: they must not come back.
    led: whether a guide has led it for any scan.   turning: what its turns were taken from; None where its planes told them.
    """

    reference: int
    planes: list[Plane]
    motions: list[ScanMotion]
    led: bool = False
    proposals: tuple[Plane, ...] = ()
    away: bool = False
    of_proposal: tuple[int, ...] = ()
    late: tuple[bool, ...] = ()
    dropped: Sequence[Plane] = ()
    turning: Turning | None = None

    @property
    def coasts(self) -> bool:
        """Whether it counts as followed where a direction stays open."""
        return self.turning is not None and self.turning.coasts

    @property
    def seen(self) -> int:
        """Scans whose motion was found, not bridged."""
        return sum(m.share > 0 for m in self.motions)

    @property
    def coasting(self) -> int:
        """Those of them whose points left a direction of their place open."""
        return sum(m.share > 0 and bool(m.unseen.any()) for m in self.motions)

    def leads_on(self, run: Run) -> bool:
        """Whether it covers so many scans that the joint estimation reaches the rest by the IMU."""
        return self.seen > FOLLOWING.enough * len(run.recording.scans)

    def seen_from(self, position: int) -> Followed | None:
        """The same motion and planes in the frame of another of its scans; None where that scan is not one of them."""
        origin = next((m for m in self.motions if m.position == position), None)
        if origin is None:
            return None
        R, p = origin.R, origin.p
        moved = [
            replace(m, R=R.T @ m.R, p=R.T @ (m.p - p), v_m_s=R.T @ m.v_m_s, unseen=R.T @ m.unseen @ R)
            for m in self.motions
        ]
        planes, dropped = (
            [
                replace(
                    q,
                    normal=R.T @ q.normal,
                    offset_m=float(q.offset_m + q.normal @ p),
                    outline_m=None if q.outline_m is None else (q.outline_m - p) @ R,
                )
                for q in some
            ]
            for some in (self.planes, self.dropped)
        )
        return replace(self, reference=position, planes=planes, motions=moved, dropped=dropped)

    def worth(self, run: Run) -> float:
        """How many scans a solve can use of it, to compare tracks by: those seen, and half of those that only the IMU carries it
        over, which lie behind its end or leave a direction open.

        The latter count only where some seconds of motion have settled the start values that this takes.
        """
        moving = [
            m.position
            for m in self.motions
            if m.share > 0
            and (
                np.linalg.norm(m.omega_rad_s) > FOLLOWING.moving_rad_s or np.linalg.norm(m.v_m_s) > FOLLOWING.moving_m_s
            )
        ]
        later = len(run.recording.scans) - 1 - self.motions[-1].position
        by_imu = (
            FOLLOWING.later * (later + self.coasting) if run.clocks.sweep_s[moving].sum() > FOLLOWING.settled_s else 0.0
        )
        return self.seen - self.coasting + by_imu


def follow(
    run: Run,
    planes: Sequence[Plane],
    reference: int,
    *,
    turning: Turning | None = None,
    guide: Guided = None,
    may_leave: bool = True,
    known: Followed | None = None,
) -> Followed:
    """The longest track. planes: of the reference scan, in its frame.   turning: where the lidar's turns are known.
    guide: a new one for each track from this scan.

    may_leave: for another reference scan where that leads further.   known: the track from this one, where that is there.
    """
    best = known or _longest_from(run, planes, reference, turning, guide)
    if not may_leave or best.leads_on(run):
        return best
    for _, position, found in _views(run, turning)[: FOLLOWING.starts]:
        if best.motions[0].position <= position <= best.motions[-1].position:
            continue
        other = _longest_from(run, found, position, turning)
        if other.worth(run) > FOLLOWING.better * best.worth(run):
            best = other
        if best.leads_on(run):
            break
    return best


def _views(run: Run, turning: Turning | None) -> list[tuple[float, int, list[Plane]]]:
    """Scans to start from with their planes, those first whose planes tell most of a position."""
    scans = run.recording.scans
    views = []
    for share in FOLLOWING.elsewhere:
        position = round(share * (len(scans) - 1))
        rate = rate_within(scans[position], turning)
        points = scan_points(scans[position], run.settings.field_of_view_deg)
        if rate is not None and run.settings.field_of_view_deg is None:
            tau = scans[position].points["offset_ns"] * 1e-9
            points = steadied(points, tau, scans[position], turning)
            points = straighten(points, tau, ScanMotion(position, np.eye(3), np.zeros(3), rate, np.zeros(3)))
        fits = segment_planes(points, seed=run.settings.random_seed)
        normals = np.array([f.normal for f in fits]).reshape(-1, 3)
        if len(fits) < SEARCH.fewest_planes or determinacy(normals) < SEARCH.least_determinacy:
            continue
        most = FOLLOWING.plane_points
        worth = np.array([most * n / (most + n) for n in (f.inliers.sum() for f in fits)])
        told = float(np.linalg.eigvalsh((normals * worth[:, None]).T @ normals)[0])
        views.append((told, position, named_planes(fits)))
    return sorted(views, key=lambda view: -view[0])


def _longest_from(
    run: Run, planes: Sequence[Plane], reference: int, turning: Turning | None, guide: Guided = None
) -> Followed:
    """The track from planes of the straightened reference scan where that moved; where its neighbours alone told that,
    and leads nowhere, from the planes as they are.
    """
    straight = _straightened_planes(run, planes, reference, turning)
    if not straight:
        return _attempt(run, planes, reference, turning, guide)
    best = _attempt(run, straight, reference, turning, guide)
    known = rate_within(run.recording.scans[reference], turning) is not None
    if known or best.seen > FOLLOWING.whole * len(run.recording.scans):
        return best
    other = _attempt(run, planes, reference, turning, guide)
    return best if best.seen >= other.seen else other


def _attempt(run: Run, planes: Sequence[Plane], reference: int, turning: Turning | None, guide: Guided) -> Followed:
    if run.should_cancel():
        raise Cancelled("the calibration was cancelled")
    run.stage("track", 0.0, "following the planes from scan to scan")
    looking = None if guide is None else guide()
    while True:
        known = PlaneMap.of(planes)
        try:
            motions = track(
                run.recording.scans, known, reference, turning=turning, guide=looking,
                on_progress=lambda f: run.stage("track", f),
            )  # fmt: skip
        except Misled as misled:
            turning = misled.turning
            continue
        led = looking is not None and looking.led
        if looking is not None and turning is None:
            turning = looking.leading  # from somewhere on
        return Followed(reference, known.planes(planes), motions, led=led, turning=turning)


def _straightened_planes(run: Run, planes: Sequence[Plane], reference: int, turning: Turning | None) -> list[Plane]:
    """The planes of the reference scan without its motion, which its neighbours tell, turns where nothing tells them better; none
    where it hardly moved.
    """
    scans, reach = run.recording.scans, FOLLOWING.around_scans
    motions = track(scans, planes, reference, turning=turning, within=range(reference - reach, reference + reach + 1))
    at = [m.position for m in motions].index(reference)
    around = motions[max(at - 1, 0) : at + 2]
    if len(around) < 2:
        return []
    first, last = around[0], around[-1]
    dt = (scans[last.position].stamp_ns - scans[first.position].stamp_ns) * 1e-9
    omega, v = log(first.R.T @ last.R) / dt, (last.p - first.p) / dt
    rate = rate_within(scans[reference], turning)
    if rate is not None:
        omega = rate
    sweep_s = float(run.clocks.sweep_s[reference])
    if np.linalg.norm(omega) * sweep_s < FOLLOWING.bent_rad and np.linalg.norm(v) * sweep_s < FOLLOWING.bent_m:
        return []
    points = scans[reference].points
    tau = points["offset_ns"] * 1e-9
    motion = ScanMotion(reference, np.eye(3), np.zeros(3), omega, v)
    open_ways = 1 if turning is not None and turning.coasts else 0
    steady = steadied(points["xyz"].astype(np.float64), tau, scans[reference], turning)
    return _planes_of(run, straighten(steady, tau, motion), open_ways)


def _planes_of(run: Run, points_m: FloatArray, open_ways: int) -> list[Plane]:
    """The planes of a scan, none where more ways than those are open between them. points_m: (N, 3)."""
    fits = segment_planes(points_m, seed=run.settings.random_seed)
    normals = np.array([f.normal for f in fits]).reshape(-1, 3)
    if len(fits) < SEARCH.fewest_planes - open_ways or determinacy(normals, open_ways) < SEARCH.least_determinacy:
        return []
    return named_planes(fits)
