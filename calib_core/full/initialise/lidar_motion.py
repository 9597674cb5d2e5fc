"""The motion a solve starts from: the lidar followed by all structure that is found, with the gyroscope where that is little.

    planes of the reference scan
    -> lidar-only track, led by the IMU from the first motion that it has not felt (inertial_guide.py)
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
from calib_core.full.initialise.clock_rate import require_one_rate
from calib_core.full.initialise.inertial_guide import Guide, ImuMotion
from calib_core.full.initialise.inertial_motion import (
    GyroTurning,
    OwnTurns,
    TrackCheck,
    Unturned,
    check_track,
    told_rotation,
)
from calib_core.full.initialise.proposed_planes import choice_among, joined, matched
from calib_core.full.initialise.rotation import rotation_start
from calib_core.full.initialise.settings import AGREEING
from calib_core.full.initialise.start import LidarTrack, RotationStart
from calib_core.full.initialise.tracking_failures import refuse_lost, refuse_standing_clouds, say_open
from calib_core.full.odometry.motion_prior import Turning
from calib_core.full.odometry.reference import Followed, follow
from calib_core.full.odometry.reference_cloud import propose_planes
from calib_core.full.odometry.register import ScanMotion
from calib_core.full.odometry.within_sweeps import require_measured_scans, require_measured_sweeps
from calib_core.full.planes.propose import no_planes
from calib_core.full.run import Run
from calib_core.types import Plane, PlaneProposals

#: A track, and how it compares with the IMU; None where that cannot be told.
Known = tuple[Followed, TrackCheck | None]
#: Lag and rotation from turns between neighbouring scans, and how well they agree; found once, by whoever asks first.
Pairs = Callable[[], tuple[list[RotationStart], Agreement]]
_BY_IMU = "the lidar's motion was tracked with the IMU's help: with its planes alone the track went wrong"


def begin(
    run: Run, given: Sequence[Plane] | None, proposals: PlaneProposals | None = None, *, at_fault: float = 0.0
) -> Followed:
    """The lidar's motion, and the planes it was followed by.

    given: the person's planes, in the frame of the reference scan: the motion is told in that frame then, if they are a choice.
    proposals: the planes found, where that was done before.   at_fault: so much of the motion may have gone as the IMU has not
    felt it.   Raises Refused with what could not be followed, ClocksApart where the clocks run at different rates.
    """
    found = proposals or propose_planes(
        run.recording, run.settings, on_event=run.on_event, should_cancel=run.should_cancel
    )
    reference = found.reference_scans[0]
    proposed = tuple(patch.plane for patch in found.patches)
    given = choice_among(proposed, given)
    planes = joined(proposed, given or [])
    if not planes:
        raise no_planes(run.recording.scans)
    near = follow(run, planes, reference, guide=partial(Guide, run), may_leave=False)
    if not near.led:
        require_one_rate(run, lidar_track(run, near))
    led = _led_throughout(run, near, planes, reference, at_fault) if near.led else None
    best, agreed = led or _by_planes(run, planes, reference, at_fault, None if near.led else near)
    refuse_lost(run, best, agreed)
    require_measured_scans(run, best)
    say_open(run, best)
    best = replace(best, away=best.reference != reference)
    if given is not None and best.away:
        best = best.seen_from(reference) or _from_where_planes_are(run, best, planes, reference)
    if best.reference == reference:
        of_proposal = tuple(matched(best.planes, proposed).tolist())
        return replace(best, proposals=proposed, of_proposal=of_proposal, late=tuple(k < 0 for k in of_proposal))
    scans = run.recording.scans
    at_s = run.recording.skipped_s + (scans[best.reference].stamp_ns - scans[0].stamp_ns) * 1e-9
    run.say(
        "info",
        "track.reference",
        f"the planes are those of the scan at {at_s:.1f} s, from which the lidar can be followed over {best.seen} of "
        f"{len(scans)} scans",
    )
    return best


def _from_where_planes_are(run: Run, best: Followed, planes: Sequence[Plane], reference: int) -> Followed:
    """The track from the reference, to which the best one does not lead: by the planes alone, or by the turns that it told."""
    alone = follow(run, planes, reference, may_leave=False)
    rotation = told_rotation(run, lidar_track(run, best))
    if alone.leads_on(run) or rotation is None or rotation.open_axis_imu is not None:
        return alone
    tracks = [alone]
    for coasts in (False, True):
        turning = GyroTurning.of(run, rotation, coasts=coasts)
        tracks.append(follow(run, planes, reference, turning=turning, may_leave=False))
    most = max(tracks, key=lambda track: track.worth(run))
    if most is alone:
        return alone
    run.say("info", "track.aided", _BY_IMU)
    lidar = lidar_track(run, most)
    own = told_rotation(run, lidar)
    if own is None or own.open_axis_imu is not None:
        return most
    return _with_steps(run, (most, check_track(run, most.motions, lidar, own)), planes, reference)[0]


def _led_throughout(
    run: Run, near: Followed, planes: Sequence[Plane], reference: int, at_fault: float
) -> tuple[Followed, Agreement] | None:
    """The track that the IMU has led from where its planes led it astray; None where it does not go with the IMU throughout."""
    imu_s, gyro_rad_s = run.clocks.imu_s, run.recording.imu.gyro_rad_s
    lidar = lidar_track(run, near)
    agreed = agreement(lidar, imu_s, gyro_rad_s)
    rotation = told_rotation(run, lidar)
    whole = near.seen >= AGREEING.whole * len(run.recording.scans)
    if not whole or agreed.correlation < AGREEING.trusted or rotation is None or rotation.open_axis_imu is not None:
        return None
    found = check_track(run, near.motions, lidar, rotation)
    known: Known = near, found
    best, left = known if found.faults <= at_fault * near.seen else _with_steps(run, known, planes, reference)
    if left is None or left.faults > at_fault * best.seen:
        return None
    run.say("info", "track.aided", _BY_IMU)
    return best, agreed


def _by_planes(
    run: Run, planes: Sequence[Plane], reference: int, at_fault: float, near: Followed | None
) -> tuple[Followed, Agreement]:
    """The track by planes, with the IMU where that does not lead throughout or has gone astray. near: it, where known."""
    if near is None:  # it was led by the IMU, and not rightly
        near = follow(run, planes, reference, may_leave=False)
        require_one_rate(run, lidar_track(run, near))
    first = _led_on(run, near, planes, reference)
    pairs = cache(partial(pairs_start, run))  # some seconds
    aided, agreed = _aided(run, first, planes, reference, pairs)
    if aided is first and not first.leads_on(run):
        aided, agreed = _with_one_way_open(run, first, agreed, planes, reference)
    best = aided
    if agreed is not NO_AGREEMENT:
        best = _felt(run, aided, planes, reference, at_fault, pairs)
    if best is not aided:
        run.say("info", "track.aided", _BY_IMU)
    elif not isinstance(best.turning, OwnTurns) and (
        best is not first or (first is not near and first.reference == reference)
    ):
        text = "the lidar's motion was tracked with the gyroscope's help: its planes alone do not determine it"
        run.say("info", "track.aided", text)
    return best, agreed


def _led_on(run: Run, near: Followed, planes: Sequence[Plane], reference: int) -> Followed:
    """The track where it leads on; where it breaks off, by the gyroscope's turning under the rotation that it tells.

    From other scans only where that does not lead throughout: each of them costs a track.
    """
    if near.leads_on(run):
        return near
    imu_s, gyro_rad_s = run.clocks.imu_s, run.recording.imu.gyro_rad_s
    lidar = lidar_track(run, near)
    own = agreement(lidar, imu_s, gyro_rad_s)
    if own.is_of_a_unit and own.correlation > AGREEING.trusted:
        starts = rotation_start(lidar, imu_s, gyro_rad_s)
        again = _turned(run, planes, reference, starts, may_leave=False)
        if again is not None and again.seen >= AGREEING.whole * len(run.recording.scans):
            # Rates within the sweeps are the gyroscope's from here on, and tell no more whether the clouds are raw.
            require_measured_sweeps(run, check_track(run, near.motions, lidar, starts[0]).sound)
            return again
    return follow(run, planes, reference, known=near)


def _aided(
    run: Run, first: Followed, planes: Sequence[Plane], reference: int, pairs: Pairs
) -> tuple[Followed, Agreement]:
    """The track, followed again with the gyroscope's turning where it goes astray or breaks off; and what speaks for it."""
    imu_s, gyro_rad_s = run.clocks.imu_s, run.recording.imu.gyro_rad_s
    rates = gyro_rad_s - np.median(gyro_rad_s, axis=0)
    if float(np.sqrt(np.mean(np.sum(rates**2, axis=1)))) < AGREEING.least_turning_rad_s:
        return _unturned(run, first, planes, reference), NO_AGREEMENT
    whole = first.seen >= AGREEING.whole * len(run.recording.scans)
    lidar = lidar_track(run, first)
    own = agreement(lidar, imu_s, gyro_rad_s)
    if own.correlation < AGREEING.trusted:  # a gyroscope in another unit is not meant
        refuse_standing_clouds(run, first, rates)
    if not own.is_of_a_unit:
        own = NO_AGREEMENT
    trusted = own.correlation > AGREEING.trusted
    if trusted and whole:
        return first, own
    if trusted:
        starts, agreed = _starts_of_trusted(run, lidar, own, pairs)
    else:
        part, of_part = agreeing_part(lidar, imu_s, gyro_rad_s)
        of_its_own = [] if part is None else rotation_start(part, imu_s, gyro_rad_s)
        again = _turned(run, planes, reference, of_its_own)
        if again is not None and again.seen >= AGREEING.whole * len(run.recording.scans):
            with_it = agreement(lidar_track(run, again), imu_s, gyro_rad_s)
            if with_it.is_of_a_unit and with_it.correlation > AGREEING.trusted:
                return again, with_it
        starts, agreed = pairs()
        if agreed.correlation < max(own.correlation, AGREEING.believed):
            if part is None:
                return first, max(own, agreed, key=lambda a: a.correlation)
            return (first if again is None else again), of_part
    again = _turned(run, planes, reference, starts)
    if again is None or (trusted and again.worth(run) < AGREEING.better * first.worth(run)):
        return first, agreed
    return again, agreed


def _with_one_way_open(
    run: Run, first: Followed, agreed: Agreement, planes: Sequence[Plane], reference: int
) -> tuple[Followed, Agreement]:
    """The track whose turns its planes tell while one direction stays open, where it goes with the gyroscope and leads further.

    A vehicle on the floor of a corridor turns about one axis alone: no rotation makes its gyroscope's turns the lidar's.
    """
    coasting = follow(run, planes, reference, turning=OwnTurns(), may_leave=False)
    own = agreement(lidar_track(run, coasting), run.clocks.imu_s, run.recording.imu.gyro_rad_s)
    if own.correlation < AGREEING.trusted or not own.is_of_a_unit or coasting.worth(run) <= first.worth(run):
        return first, agreed
    return coasting, own


def _starts_of_trusted(
    run: Run, lidar: LidarTrack, own: Agreement, pairs: Pairs
) -> tuple[list[RotationStart], Agreement]:
    """Of a track that goes with the gyroscope; of pairs of scans where it broke off before it had turned about two axes."""
    starts = rotation_start(lidar, run.clocks.imu_s, run.recording.imu.gyro_rad_s)
    if not tell_turns(starts):
        of_pairs, agreed = pairs()
        if agreed.correlation > AGREEING.trusted:
            return of_pairs, agreed
    return starts, own


def _turned(
    run: Run, planes: Sequence[Plane], reference: int, starts: Sequence[RotationStart], *, may_leave: bool = True
) -> Followed | None:
    """The track by the gyroscope's turns under the best of these starts; None where it does not fit or leaves an axis open.

    may_leave: for another reference, and for a track along which one direction stays open, where that leads further.
    """
    if not tell_turns(starts):
        return None
    found = follow(run, planes, reference, turning=GyroTurning.of(run, starts[0]), may_leave=may_leave)
    if not may_leave or found.leads_on(run):
        return found
    return _or_coasting(run, found, planes, reference, GyroTurning.of(run, starts[0], coasts=True))


def _or_coasting(run: Run, found: Followed, planes: Sequence[Plane], reference: int, turning: Turning) -> Followed:
    """A track, or the one along which a direction may stay open where that leads further. turning: of the latter."""
    coasting = follow(run, planes, reference, turning=turning, may_leave=False)
    return coasting if coasting.worth(run) > found.worth(run) else found


def _unturned(run: Run, first: Followed, planes: Sequence[Plane], reference: int) -> Followed:
    """The track of a lidar that does not turn, as its gyroscope does not; the one by planes alone where that leads further.

    Left to its points, a lidar of few lasers that sees no floor turns to and fro by degrees instead of moving up and down: its
    walls fit as well. The rotation, the lag and the lever arm that such a track starts the solve with are false.
    """
    found = follow(run, planes, reference, turning=Unturned(), may_leave=False)
    if not found.leads_on(run):
        found = _or_coasting(run, found, planes, reference, Unturned(coasts=True))
    return found if found.seen >= first.seen else first


def _felt(
    run: Run, first: Followed, planes: Sequence[Plane], reference: int, at_fault: float, pairs: Pairs
) -> Followed:
    """The track, followed again where more than that share of it went as the IMU has not felt it; the one that goes with the
    IMU best.
    """
    lidar = lidar_track(run, first)
    rotation = told_rotation(run, lidar)
    if rotation is not None and rotation.open_axis_imu is not None:
        return first  # a turn that is open tells no steps
    known: Known = first, None if rotation is None else check_track(run, first.motions, lidar, rotation)
    if known[1] is not None:
        if known[1].faults <= at_fault * first.seen:
            return first
        # Rates within the sweeps are the gyroscope's from here on, and tell no more whether the clouds are raw.
        require_measured_sweeps(run, known[1].sound)
    known = _with_steps(run, known, planes, reference)
    if known[1] is None or len(known[1].leaps) > 0:
        known = _turned_rightly(run, known, planes, reference, pairs)
    return _from_a_sound_stretch(run, known, planes, reference)[0]


def _from_a_sound_stretch(run: Run, known: Known, planes: Sequence[Plane], reference: int) -> Known:
    """The track led by what its longest stretch without a fault tells, where the whole of it is too wrong to tell anything."""
    found = known[1]
    if found is None or found.tells:
        return known
    part = found.sound_stretch
    lidar = track_of(run, part)
    rotation = told_rotation(run, lidar)
    if rotation is None or rotation.open_axis_imu is not None:
        return known
    told = check_track(run, part, lidar, rotation)
    for _ in range(AGREEING.again):
        if not told.tells:
            break
        # Some seconds of motion tell a second more to within what is taken for felt, and those the next ones.
        before, known = known, _sounder(run, known, planes, reference, ImuMotion.of(run, told))
        if known is before or known[1] is None or known[0].leads_on(run):
            break
        told = known[1]
    return _with_steps(run, known, planes, reference)


def _with_steps(run: Run, known: Known, planes: Sequence[Plane], reference: int) -> Known:
    """The track by turns and steps at once as long as most of it is right, which tells both, and it goes better with the IMU."""
    for _ in range(AGREEING.again):
        found = known[1]
        if found is None or found.faults == 0 or not found.tells:
            break
        after = _sounder(run, known, planes, reference, found.felt(run, coasts=known[0].coasts))
        if after[0] is known[0]:
            break
        known = after
    return known


def _turned_rightly(run: Run, known: Known, planes: Sequence[Plane], reference: int, pairs: Pairs) -> Known:
    """The track by the gyroscope's turns under its own rotation, or where that mends too little under that of neighbouring scans.

    What was followed tells too little of the rotation then, or has led it astray.
    """
    before = known[1]
    if before is not None:
        known = _sounder(run, known, planes, reference, GyroTurning.of(run, before.rotation, coasts=known[0].coasts))
        known = _with_steps(run, known, planes, reference)
        if known[1] is not None and known[1].faults <= AGREEING.fewer * before.faults:
            return known
    starts, agreed = pairs()
    if agreed.correlation > AGREEING.trusted and starts and starts[0].residual < AGREEING.fits:
        turning = GyroTurning.of(run, starts[0], coasts=known[0].coasts)
        known = _sounder(run, known, planes, reference, turning)
    return _with_steps(run, known, planes, reference)


def _sounder(run: Run, known: Known, planes: Sequence[Plane], reference: int, turning: Turning) -> Known:
    """The track by other turns, where it goes with the IMU at more scans than the one that is known."""
    best, found = known
    if best.reference != reference:  # its steps are told in its own frame
        planes, reference = best.planes, best.reference
    again = follow(run, planes, reference, turning=turning, may_leave=False)
    lidar = lidar_track(run, again)
    rotation = told_rotation(run, lidar)
    if rotation is None or rotation.open_axis_imu is not None:
        return known
    other = check_track(run, again.motions, lidar, rotation)
    if found is not None and (other.tells, again.seen - other.faults) <= (found.tells, best.seen - found.faults):
        return known
    return again, other


def lidar_track(run: Run, followed: Followed) -> LidarTrack:
    """The track on the lidar's clock."""
    return track_of(run, followed.motions)


def track_of(run: Run, motions: Sequence[ScanMotion]) -> LidarTrack:
    """These motions on the lidar's clock."""
    positions = np.array([m.position for m in motions])
    return LidarTrack.of(motions, run.clocks.scan_s[positions], run.clocks.sweep_s[positions])
