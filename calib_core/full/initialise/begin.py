"""The motion a solve starts from: the lidar followed by all structure that is found, with the gyroscope where that is little.

    planes of the reference scan -> lidar-only track, led by the IMU from the first motion that it has not felt (guide.py)
    -> does its turning go with the gyroscope's?
    where it does not, or breaks off: turns between neighbouring scans -> lag and rotation -> the track again with the
    gyroscope's turning

Which planes count in the solve is another question: a person's choice neither helps nor hurts here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np

from calib_core.full.initialise.agreement import (
    NO_AGREEMENT,
    Agreement,
    agreeing_part,
    agreement,
)
from calib_core.full.initialise.by_pairs import pairs_start, tell_turns
from calib_core.full.initialise.felt import GyroTurning, Judged, judged, told_rotation
from calib_core.full.initialise.guide import Guide, Led
from calib_core.full.initialise.proposed import choice_among, joined, matched
from calib_core.full.initialise.rotation import rotation_start
from calib_core.full.initialise.settings import AGREEING
from calib_core.full.initialise.start import LidarTrack, RotationStart
from calib_core.full.initialise.unfollowed import refuse_lost, refuse_standing_clouds, say_open
from calib_core.full.odometry.reference import Followed, follow
from calib_core.full.odometry.reference_cloud import propose_planes
from calib_core.full.odometry.register import ScanMotion
from calib_core.full.odometry.turning import Turning
from calib_core.full.odometry.within_sweeps import require_measured_scans, require_measured_sweeps
from calib_core.full.planes.propose import no_planes
from calib_core.full.run import Run
from calib_core.types import Plane, PlaneProposals

#: A track, and how it stands beside the IMU where that can be told.
Known = tuple[Followed, Judged | None]
#: Lag and rotation from turns between neighbouring scans, and how well they agree; found once, by whoever asks first.
Pairs = Callable[[], tuple[list[RotationStart], Agreement]]
_BY_IMU = "the lidar's motion was tracked with the IMU's help: by its planes alone it had gone astray"


def begin(
    ctx: Run, given: Sequence[Plane] | None, proposals: PlaneProposals | None = None, *, at_fault: float = 0.0
) -> Followed:
    """The lidar's motion, and the planes it was followed by.

    given: the person's planes, in the frame of the reference scan: the motion is told in that frame then, if they are a choice.
    proposals: the planes found, where that was done before.   at_fault: so much of the motion may have gone as the IMU has not
    felt it.   Raises Refused with what could not be followed.
    """
    found = proposals or propose_planes(
        ctx.recording, ctx.settings, on_event=ctx.on_event, should_cancel=ctx.should_cancel
    )
    reference = found.reference_scans[0]
    proposed = tuple(patch.plane for patch in found.patches)
    given = choice_among(proposed, given)
    planes = joined(proposed, given or [])
    if not planes:
        raise no_planes(ctx.recording.scans)
    near = follow(ctx, planes, reference, guide=partial(Guide, ctx), may_leave=False)
    led = _led_throughout(ctx, near, planes, reference, at_fault) if near.led else None
    best, agreed = led or _by_planes(ctx, planes, reference, at_fault, None if near.led else near)
    refuse_lost(ctx, best, agreed)
    require_measured_scans(ctx, best)
    say_open(ctx, best)
    best = replace(best, away=best.reference != reference)
    if given is not None and best.away:
        best = best.seen_from(reference) or follow(ctx, planes, reference, may_leave=False)
    if best.reference == reference:
        of_proposal = tuple(matched(best.planes, proposed).tolist())
        return replace(best, proposals=proposed, of_proposal=of_proposal, late=tuple(k < 0 for k in of_proposal))
    scans = ctx.recording.scans
    at_s = (scans[best.reference].stamp_ns - scans[0].stamp_ns) * 1e-9
    ctx.say(
        "info",
        "track.reference",
        f"the planes are those of the scan at {at_s:.1f} s, from which the lidar can be followed over {best.seen} of "
        f"{len(scans)} scans",
    )
    return best


def _led_throughout(
    ctx: Run, near: Followed, planes: Sequence[Plane], reference: int, at_fault: float
) -> tuple[Followed, Agreement] | None:
    """The track that the IMU has led from where its planes led it astray; None where it does not go with the IMU throughout."""
    imu_s, gyro_rad_s = ctx.clocks.imu_s, ctx.recording.imu.gyro_rad_s
    lidar = lidar_track(ctx, near)
    agreed = agreement(lidar, imu_s, gyro_rad_s)
    rotation = told_rotation(ctx, lidar)
    whole = near.seen >= AGREEING.whole * len(ctx.recording.scans)
    if not whole or agreed.correlation < AGREEING.trusted or rotation is None or rotation.open_axis_imu is not None:
        return None
    found = judged(ctx, near.motions, lidar, rotation)
    known: Known = near, found
    best, left = known if found.faults <= at_fault * near.seen else _with_steps(ctx, known, planes, reference)
    if left is None or left.faults > at_fault * best.seen:
        return None
    ctx.say("info", "track.aided", _BY_IMU)
    return best, agreed


def _by_planes(
    ctx: Run, planes: Sequence[Plane], reference: int, at_fault: float, near: Followed | None
) -> tuple[Followed, Agreement]:
    """The track by planes, with the IMU where that does not lead throughout or has gone astray. near: it, where known."""
    near = near or follow(ctx, planes, reference, may_leave=False)
    first = _led_on(ctx, near, planes, reference)
    pairs = cache(partial(pairs_start, ctx))  # some seconds
    aided, agreed = _aided(ctx, first, planes, reference, pairs)
    best = aided
    if agreed is not NO_AGREEMENT:
        best = _felt(ctx, aided, planes, reference, at_fault, pairs)
    if best is not aided:
        ctx.say("info", "track.aided", _BY_IMU)
    elif best is not first or (first is not near and first.reference == reference):
        text = "the lidar's motion was tracked with the gyroscope's help: its planes alone tell too little"
        ctx.say("info", "track.aided", text)
    return best, agreed


def _led_on(ctx: Run, near: Followed, planes: Sequence[Plane], reference: int) -> Followed:
    """The track where it leads on; where it breaks off, by the gyroscope's turning under the rotation that it tells.

    From other scans only where that does not lead throughout: each of them costs a track.
    """
    if near.leads_on(ctx):
        return near
    imu_s, gyro_rad_s = ctx.clocks.imu_s, ctx.recording.imu.gyro_rad_s
    lidar = lidar_track(ctx, near)
    own = agreement(lidar, imu_s, gyro_rad_s)
    if own.is_of_a_unit and own.correlation > AGREEING.trusted:
        starts = rotation_start(lidar, imu_s, gyro_rad_s)
        again = _turned(ctx, planes, reference, starts, may_leave=False)
        if again is not None and again.seen >= AGREEING.whole * len(ctx.recording.scans):
            # Rates within the sweeps are the gyroscope's from here on, and tell no more whether the clouds are raw.
            require_measured_sweeps(ctx, judged(ctx, near.motions, lidar, starts[0]).sound)
            return again
    return follow(ctx, planes, reference, known=near)


def _aided(
    ctx: Run, first: Followed, planes: Sequence[Plane], reference: int, pairs: Pairs
) -> tuple[Followed, Agreement]:
    """The track, followed again with the gyroscope's turning where it goes astray or breaks off; and what speaks for it."""
    imu_s, gyro_rad_s = ctx.clocks.imu_s, ctx.recording.imu.gyro_rad_s
    rates = gyro_rad_s - np.median(gyro_rad_s, axis=0)
    if float(np.sqrt(np.mean(np.sum(rates**2, axis=1)))) < AGREEING.least_turning_rad_s:
        return first, NO_AGREEMENT
    whole = first.seen >= AGREEING.whole * len(ctx.recording.scans)
    lidar = lidar_track(ctx, first)
    own = agreement(lidar, imu_s, gyro_rad_s)
    if own.correlation < AGREEING.trusted:  # a gyroscope in another unit is not meant
        refuse_standing_clouds(ctx, first, rates)
    if not own.is_of_a_unit:
        own = NO_AGREEMENT
    trusted = own.correlation > AGREEING.trusted
    if trusted and whole:
        return first, own
    if trusted:
        starts, agreed = _starts_of_trusted(ctx, lidar, own, pairs)
    else:
        part, of_part = agreeing_part(lidar, imu_s, gyro_rad_s)
        of_its_own = [] if part is None else rotation_start(part, imu_s, gyro_rad_s)
        again = _turned(ctx, planes, reference, of_its_own)
        if again is not None and again.seen >= AGREEING.whole * len(ctx.recording.scans):
            with_it = agreement(lidar_track(ctx, again), imu_s, gyro_rad_s)
            if with_it.is_of_a_unit and with_it.correlation > AGREEING.trusted:
                return again, with_it
        starts, agreed = pairs()
        if agreed.correlation < max(own.correlation, AGREEING.believed):
            if part is None:
                return first, max(own, agreed, key=lambda a: a.correlation)
            return (first if again is None else again), of_part
    again = _turned(ctx, planes, reference, starts)
    if again is None or (trusted and again.worth(ctx) < AGREEING.better * first.worth(ctx)):
        return first, agreed
    return again, agreed


def _starts_of_trusted(
    ctx: Run, lidar: LidarTrack, own: Agreement, pairs: Pairs
) -> tuple[list[RotationStart], Agreement]:
    """Of a track that goes with the gyroscope; of pairs of scans where it broke off before it had turned about two axes."""
    starts = rotation_start(lidar, ctx.clocks.imu_s, ctx.recording.imu.gyro_rad_s)
    if not tell_turns(starts):
        of_pairs, agreed = pairs()
        if agreed.correlation > AGREEING.trusted:
            return of_pairs, agreed
    return starts, own


def _turned(
    ctx: Run, planes: Sequence[Plane], reference: int, starts: Sequence[RotationStart], *, may_leave: bool = True
) -> Followed | None:
    """The track by the gyroscope's turns under the best of these starts; None where it does not fit or leaves an axis open.

    may_leave: for another reference, and for a track along which one direction stays open, where that leads further.
    """
    if not tell_turns(starts):
        return None
    found = follow(ctx, planes, reference, turning=GyroTurning.of(ctx, starts[0]), may_leave=may_leave)
    if not may_leave or found.leads_on(ctx):
        return found
    coasting = follow(ctx, planes, reference, turning=GyroTurning.of(ctx, starts[0], coasts=True), may_leave=False)
    return coasting if coasting.worth(ctx) > found.worth(ctx) else found


def _felt(
    ctx: Run, first: Followed, planes: Sequence[Plane], reference: int, at_fault: float, pairs: Pairs
) -> Followed:
    """The track, followed again where more than that share of it went as the IMU has not felt it; the one that goes with the
    IMU best.
    """
    lidar = lidar_track(ctx, first)
    rotation = told_rotation(ctx, lidar)
    if rotation is not None and rotation.open_axis_imu is not None:
        return first  # a turn that is open tells no steps
    known: Known = first, None if rotation is None else judged(ctx, first.motions, lidar, rotation)
    if known[1] is not None:
        if known[1].faults <= at_fault * first.seen:
            return first
        # Rates within the sweeps are the gyroscope's from here on, and tell no more whether the clouds are raw.
        require_measured_sweeps(ctx, known[1].sound)
    known = _with_steps(ctx, known, planes, reference)
    if known[1] is None or len(known[1].leaps) > 0:
        known = _turned_rightly(ctx, known, planes, reference, pairs)
    return _from_a_sound_stretch(ctx, known, planes, reference)[0]


def _from_a_sound_stretch(ctx: Run, known: Known, planes: Sequence[Plane], reference: int) -> Known:
    """The track led by what its longest stretch without a fault tells, where the whole of it is too wrong to tell anything."""
    found = known[1]
    if found is None or found.tells:
        return known
    part = found.sound_stretch
    lidar = track_of(ctx, part)
    rotation = told_rotation(ctx, lidar)
    if rotation is None or rotation.open_axis_imu is not None:
        return known
    of_part = judged(ctx, part, lidar, rotation)
    if not of_part.tells:
        return known
    return _with_steps(ctx, _sounder(ctx, known, planes, reference, Led.of(ctx, of_part)), planes, reference)


def _with_steps(ctx: Run, known: Known, planes: Sequence[Plane], reference: int) -> Known:
    """The track by turns and steps at once as long as most of it is right, which tells both, and it goes better with the IMU."""
    for _ in range(AGREEING.again):
        found = known[1]
        if found is None or found.faults == 0 or not found.tells:
            break
        after = _sounder(ctx, known, planes, reference, found.felt(ctx, coasts=known[0].coasts))
        if after[0] is known[0]:
            break
        known = after
    return known


def _turned_rightly(ctx: Run, known: Known, planes: Sequence[Plane], reference: int, pairs: Pairs) -> Known:
    """The track by the gyroscope's turns under its own rotation, or where that mends too little under that of neighbouring scans.

    What was followed tells too little of the rotation then, or has led it astray.
    """
    before = known[1]
    if before is not None:
        known = _sounder(ctx, known, planes, reference, GyroTurning.of(ctx, before.rotation, coasts=known[0].coasts))
        known = _with_steps(ctx, known, planes, reference)
        if known[1] is not None and known[1].faults <= AGREEING.fewer * before.faults:
            return known
    starts, agreed = pairs()
    if agreed.correlation > AGREEING.trusted and starts and starts[0].residual < AGREEING.fits:
        turning = GyroTurning.of(ctx, starts[0], coasts=known[0].coasts)
        known = _sounder(ctx, known, planes, reference, turning)
    return _with_steps(ctx, known, planes, reference)


def _sounder(ctx: Run, known: Known, planes: Sequence[Plane], reference: int, turning: Turning) -> Known:
    """The track by other turns, where it goes with the IMU at more scans than the one that is known."""
    best, found = known
    if best.reference != reference:  # its steps are told in its own frame
        planes, reference = best.planes, best.reference
    again = follow(ctx, planes, reference, turning=turning, may_leave=False)
    lidar = lidar_track(ctx, again)
    rotation = told_rotation(ctx, lidar)
    if rotation is None or rotation.open_axis_imu is not None:
        return known
    other = judged(ctx, again.motions, lidar, rotation)
    if found is not None and (other.tells, again.seen - other.faults) <= (found.tells, best.seen - found.faults):
        return known
    return again, other


def lidar_track(ctx: Run, followed: Followed) -> LidarTrack:
    """The track on the lidar's clock."""
    return track_of(ctx, followed.motions)


def track_of(ctx: Run, motions: Sequence[ScanMotion]) -> LidarTrack:
    """These motions on the lidar's clock."""
    positions = np.array([m.position for m in motions])
    return LidarTrack.of(motions, ctx.clocks.scan_s[positions], ctx.clocks.sweep_s[positions])
