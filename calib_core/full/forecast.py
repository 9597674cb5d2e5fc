"""What a solve of a recording would know, before it is run: the same information, at a fraction of the price.

How well a calibration is determined depends on the motion, the planes and the noise, hardly on the answer itself. So a
sample of every scan's points gives planes and a lidar-only track, the track gives start values, the IMU smooths the
motion with the calibration held at them, and the joint problem is linearised there once:

    information(7 x 7) = what remains of J' J after eliminating knots, biases, gravity and planes

with every sampled point counting for as many as it stands for. The very rules that judge a solve judge this
(observability.py), so that both call the same directions weak.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from threadpoolctl import threadpool_limits

from calib_core.calibrate import make_context
from calib_core.errors import Cancelled
from calib_core.events import OnEvent, ShouldCancel, StageEvent, ignore_event, never_cancel
from calib_core.factors.lidar_plane import Gate
from calib_core.full.assess.observability import Knowledge, advice, assess
from calib_core.full.calibrate import (
    bias_nodes,
    first_estimate,
    knots_over,
    standing_priors,
    start_values,
)
from calib_core.full.initialise.begin import begin
from calib_core.full.initialise.start import LidarTrack, Start
from calib_core.full.joint.association import gather
from calib_core.full.joint.propagate import extend
from calib_core.full.joint.schedule import Rounds
from calib_core.full.joint.state import CALIBRATION
from calib_core.full.odometry.reference import Followed
from calib_core.full.odometry.register import ScanMotion
from calib_core.full.planes.propose import propose_planes, scan_points
from calib_core.full.run import Context, NoStart
from calib_core.geometry import log
from calib_core.imu.preintegration import upsample
from calib_core.planes.segment import segment_planes
from calib_core.settings import CalibrateSettings
from calib_core.solver.arrow import NotPositiveDefinite, solve_arrow
from calib_core.types import FloatArray, PlaneProposals, Recording, Scan

#: Points of a scan that stand for all of them: fifteen thousand a second say where the lidar is.
SAMPLED_POINTS = 1500
#: A solve's knots for each of ours. What the readings say of a calibration builds up over tenths of a second.
_COARSER = 2
#: Less motion than this over the whole recording is standing still, as the solve has it.
_LEAST_TURN_RAD = np.radians(1.0)
_LEAST_MOVE_M = 0.05
_FEW_SCANS = 8
NO_PLANES = PlaneProposals(
    (), np.zeros((0, 3), np.float32), np.zeros(0, np.int16), np.zeros(0, np.float32), (0,), static=False
)
#: A rest of the recording shorter than this, beyond what was tracked, is not worth going after.
_WORTH_S = 1.0
#: Nor is more than this gone after: what follows is taken to say as much a second.
_CARRIED_S = 20.0


@dataclass(frozen=True)
class Outlook:
    """What a solve would find to work with, and to know.

    proposals: the expected planes.   gravity: (3,) [m/s2] in their frame.   knowledge: None where `reason` says why, under
    the stable `code`.   advice: what to record for what would stay unknown.   covered_s: seconds of motion that could be
    followed.   range_std_m: the lidar's noise, seen on the planes.
    """

    proposals: PlaneProposals
    gravity: FloatArray | None = None
    knowledge: Knowledge | None = None
    code: str = ""
    reason: str = ""
    advice: tuple[str, ...] = ()
    covered_s: float = 0.0
    range_std_m: float | None = None


def sample_scan(scan: Scan, count: int) -> Scan:
    """The scan with at most `count` of its points, spread evenly whatever the interleaving, in their own order."""
    n = len(scan.points)
    if n <= count:
        return scan
    pick = np.unique((np.arange(count) * 0.6180339887498949 % 1.0 * n).astype(np.int64))
    return Scan(scan.index, scan.stamp_ns, scan.points[pick])


def forecast(
    recording: Recording,
    points_per_scan: Sequence[int],
    settings: CalibrateSettings | None = None,
    *,
    share: float = 1.0,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> Outlook:
    """The outlook of a recording whose scans may be samples, each evenly spread over the whole scan.

    points_per_scan: (M,) of the whole scans.   share: of the whole recording that these scans are; the rest is taken to
    say as much a second.   Scans that may serve as the reference should hold ten thousand points. Raises Cancelled.
    """

    def tell(fraction: float, text: str) -> None:
        if should_cancel():
            raise Cancelled("Inspecting was stopped.")
        on_event(StageEvent(stage="inspect", fraction=fraction, text=text))

    settings = settings or CalibrateSettings()
    # Small matrices by the thousand: a second BLAS thread only ever waits.
    with threadpool_limits(limits=1, user_api="blas"):
        tell(0.1, "looking for planes")
        proposals = NO_PLANES
        if _shows_planes(recording.scans):
            proposals = propose_planes(recording, settings, should_cancel=should_cancel)
        try:
            if not proposals.patches:
                raise NoStart(
                    "planes.none", "no plane was found in any scan; record in front of walls and floor, at 1 to 20 m"
                )
            return _look(recording, np.asarray(points_per_scan), share, settings, proposals, tell, should_cancel)
        except NoStart as error:
            return Outlook(proposals, code=error.code, reason=str(error))


def _shows_planes(scans: Sequence[Scan]) -> bool:
    """Whether any of a few scans, spread over all, shows a plane: where none does, the search for a reference is long."""
    spread = np.unique(np.linspace(0, len(scans) - 1, _FEW_SCANS).astype(np.int64))
    return any(segment_planes(scan_points(scans[int(position)])) for position in spread)


def _look(
    recording: Recording,
    points_per_scan: FloatArray,
    share: float,
    settings: CalibrateSettings,
    proposals: PlaneProposals,
    tell: Callable[[float, str], None],
    should_cancel: ShouldCancel,
) -> Outlook:
    """Track, start values, smoothed motion, information. Raises NoStart."""
    if len(recording.scans) < 10 or len(recording.imu.stamps_ns) < 50:
        raise NoStart(
            "recording.too_short",
            f"a forecast needs at least 10 scans and 50 IMU readings, the recording has {len(recording.scans)} and "
            f"{len(recording.imu.stamps_ns)}",
        )
    ctx = make_context(recording, settings, ignore_event, should_cancel)
    tell(0.3, "following the planes from scan to scan")
    first = proposals.reference_scans[0]
    followed = begin(ctx, None, proposals)
    _require_motion(followed.motions)
    tell(0.6, "first values of the calibration")
    lidar, start = start_values(ctx, followed.motions, followed.planes, None)
    tell(0.7, "what a solve would know")
    sampled = [sample_scan(scan, SAMPLED_POINTS) for scan in recording.scans]
    stands_for = points_per_scan / np.array([max(len(scan.points), 1) for scan in sampled])
    ctx = replace(ctx, recording=replace(recording, scans=sampled))
    preview = _preview(ctx, lidar, start, followed, stands_for)
    knowledge = preview.knowledge(share)
    covered_s = len(preview.estimate.states.p) * preview.readings.spacing_s
    if not knowledge.rotation_known:
        raise NoStart(
            "motion.undetermined", "the motion determines no component of the rotation; turn about two axes at least"
        )
    rate = recording.imu.gyro_rad_s
    turning = np.sqrt(np.mean((rate - rate.mean(axis=0)) ** 2, axis=0))
    said = tuple(advice(knowledge, turning, preview.estimate.R_imu_lidar))
    tell(1.0, "")
    range_std_m = preview.lidar_noise.range_std_m
    # In another reference scan's frame gravity says nothing of the proposals' planes.
    gravity = start.linear.gravity if followed.reference == first else None
    return Outlook(proposals, gravity, knowledge, advice=said, covered_s=covered_s, range_std_m=range_std_m)


def _require_motion(motions: Sequence[ScanMotion]) -> None:
    """Raises NoStart where the lidar stands still throughout."""
    first = motions[0]
    turn = max(float(np.linalg.norm(log(first.R.T @ m.R))) for m in motions)
    move = max(float(np.linalg.norm(m.p - first.p)) for m in motions)
    if turn < _LEAST_TURN_RAD and move < _LEAST_MOVE_M:
        raise NoStart(
            "motion.none",
            f"the lidar stood still: it turned {np.degrees(turn):.2f} deg and moved {move * 1e3:.0f} mm in the whole recording",
        )


@dataclass
class _Preview(Rounds):
    """Rounds that go no further than the motion.

    stands_for: (M,) points of a scan that each sampled one stands for.   looked: share of the recording's knots that are
    gone after.
    """

    stands_for: FloatArray = field(default_factory=lambda: np.ones(1))
    looked: float = 1.0

    def knowledge(self, share: float) -> Knowledge:
        """What the joint problem would know of the calibration, at the smoothed motion. Raises NoStart."""
        self.associate(Gate(extra_m=0.12), stride=2)
        problem, _ = self.solve(2, frozen=tuple(range(CALIBRATION)))
        self.hold(problem)
        enough = len(self.readings.knots_s) - _WORTH_S / self.readings.spacing_s
        if self.last < enough:
            extend(self)
            if self.last > enough:
                share *= self.looked
        else:
            # Start values are off by what is noise in a start; those along an open direction may lie anywhere, and a
            # solve holds them at zero: either would pass for noise of the lidar, or bend what is known of the rest.
            self.associate(Gate(extra_m=0.06), stride=2)
            self.solve(3)
        self.learn(Gate(extra_m=0.02))
        # A gate that is wider than the noise would count its width as noise.
        self.associate(Gate(), stride=1)
        assert self.micro is not None
        weight = self.stands_for[self.micro.scan][:, None]
        whole = replace(self.micro, scatter=self.micro.scatter * weight)
        problem = self.problem()
        problem = replace(problem, bins=gather(whole, problem.motion(self.estimate), self.estimate))
        try:
            information = solve_arrow(problem.linearise(self.estimate)).information
        except NotPositiveDefinite as error:
            raise NoStart("solve.diverged", "the planes and the motion that were found do not fit together") from error
        frozen = not self.ctx.settings.estimate_time_offset
        return assess(
            information,
            problem.priors,
            inflation=float(np.sqrt(share)),
            frozen_offset=frozen,
            offset_std_s=self.ctx.clocks.jitter_mean_std_s * float(np.sqrt(share)),
        )


def _preview(
    ctx: Context,
    lidar: LidarTrack,
    start: Start,
    followed: Followed,
    stands_for: FloatArray,
) -> _Preview:
    """The joint problem over the tracked scans, on a coarse chain of knots. Raises NoStart where they are too few."""
    offset = start.rotation.time_offset_s
    tracked_from, tracked_to = float(lidar.start_s[0]), float(lidar.start_s[-1] + lidar.sweep_s[-1])
    whole = knots_over(ctx.clocks.imu_s, tracked_from, float(ctx.clocks.scan_s[-1] + ctx.clocks.sweep_s[-1]), offset)[
        ::_COARSER
    ]
    inside = int(np.searchsorted(whole, tracked_to - offset))
    if inside < 20:
        raise NoStart(
            "start.too_short",
            f"the lidar's planes and the IMU share only {max(tracked_to - tracked_from, 0.0):.1f} s; "
            "at least a few seconds are needed",
        )
    total = len(whole)
    whole = whole[: inside + round(_CARRIED_S / (whole[1] - whole[0]))]
    imu = ctx.recording.imu
    readings = upsample(ctx.clocks.imu_s, imu.gyro_rad_s, imu.accel_m_s2, whole, ctx.hyper)
    nodes = bias_nodes(whole)
    estimate = first_estimate(lidar, start, whole[:inside], followed.planes, len(nodes.times_s))
    scan_s, reference = ctx.clocks.scan_s, followed.reference
    covered = (scan_s > whole[0] + offset - 0.5) & (scan_s < whole[-1] + offset)
    return _Preview(
        ctx=ctx,
        readings=readings,
        nodes=nodes,
        priors=standing_priors(ctx, estimate, None),
        estimate=estimate,
        first=0,
        last=inside,
        gauge=int(np.argmin(np.abs(whole[:inside] + offset - scan_s[reference]))),
        positions=[m.position for m in followed.motions if covered[m.position]],
        reference=reference,
        names=[plane.name for plane in followed.planes],
        outlines_m=[plane.outline_m for plane in followed.planes],
        may_add_planes=False,
        may_extend=True,
        stands_for=stands_for,
        looked=len(whole) / total,
    )
