"""The stage of the start values: time offset, rotation, gravity, lever arm and accelerometer bias from both motions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from calib_core.errors import Refused
from calib_core.full.initialise.agreement import mean_rate
from calib_core.full.initialise.axis_signs import axis_complaint, gravity_complaint, unit_complaint
from calib_core.full.initialise.initial_guess import start_from_guess, with_lever_arm
from calib_core.full.initialise.linear import linear_start, linear_steps
from calib_core.full.initialise.rigid_mount import require_rigid
from calib_core.full.initialise.rotation import acceleration_start, is_worse, rotation_start
from calib_core.full.initialise.settings import AGREEING, ROTATING
from calib_core.full.initialise.single_axis import turns_about, upright
from calib_core.full.initialise.start import LidarTrack, LinearStart, RotationStart, Start
from calib_core.full.odometry.register import ScanMotion
from calib_core.full.odometry.settings import FOLLOWING
from calib_core.full.odometry.within_sweeps import require_measured_sweeps
from calib_core.full.run import Run
from calib_core.types import InitialGuess, Plane, Recording

#: Rounds by which the time offset may be off as well that are told.
_TOLD = 3


def initialise(
    run: Run, motions: Sequence[ScanMotion], planes: Sequence[Plane], guess: InitialGuess | None
) -> tuple[LidarTrack, Start]:
    """Time offset, rotation, gravity, lever arm and accelerometer bias from the lidar-only motion.

    planes: those that were followed; where all turning is about one axis, and the turn about it stays open, it is chosen so that
    they are plumb and level.   guess: what is known beforehand, which is taken where the motions do not refute it.
    Returns the track as arrays, and the start. Raises Refused where the motions have nothing in common, the IMU's unit or axes
    cannot be as they seem, or lidar and IMU are not fixed to one another.
    """
    run.stage("initialise", 0.0, "time offset and rotation")
    _require_gravity(run)
    positions = np.array([m.position for m in motions])
    lidar = LidarTrack.of(motions, run.clocks.scan_s[positions], run.clocks.sweep_s[positions])
    _require_measured_sweeps(run, lidar, motions)
    imu = run.recording.imu
    candidates = rotation_start(lidar, run.clocks.imu_s, imu.gyro_rad_s) if _turns(run, lidar) else []
    if not candidates:
        candidates = acceleration_start(lidar, run.clocks.imu_s, imu.accel_m_s2)
    is_turned_as_guessed = False
    if guess is not None:
        start, is_turned_as_guessed = start_from_guess(run, lidar, candidates, guess)
        candidates = [start]
    if not candidates:
        raise _nothing_to_compare(run.recording, len(motions))
    magnitude = run.settings.gravity.magnitude_m_s2

    def trial(rotation: RotationStart) -> Start:
        linear = linear_start(lidar, run.clocks.imu_s, imu.accel_m_s2, rotation, gravity_m_s2=magnitude)
        return Start(rotation, linear)

    trials: list[Start] = []
    best = min(candidate.residual for candidate in candidates)
    for candidate in candidates:
        if is_worse(candidate.residual, best):
            continue
        rotations = [candidate.R_imu_lidar]
        if candidate.open_axis_imu is not None:
            rotations = turns_about(candidate.open_axis_imu, candidate.R_imu_lidar, ROTATING.open_turns)
        trials.extend(trial(replace(candidate, R_imu_lidar=R)) for R in rotations)
    trials = _of_nearest_lag(run, of_the_turns_lag(trials))
    chosen = upright(
        trials,
        np.array([plane.normal for plane in planes]),
        partial(linear_steps, lidar, run.clocks.imu_s, imu.accel_m_s2, gravity_m_s2=magnitude),
    )
    if chosen is not min(trials, key=lambda t: t.misfit):
        run.say(
            "info",
            "start.open_turn",
            "all rotation is about one axis, and the accelerations hardly tell how the IMU is turned about it: the solve starts "
            "where walls are plumb, floors level and the lidar stands upright",
        )
    run.stage("initialise", 1.0)
    rotation, linear = chosen.rotation, chosen.linear
    if not is_turned_as_guessed:
        _refuse_misread_imu(run, lidar, max(candidates, key=lambda c: c.correlation), linear)
    require_rigid(run, lidar, rotation)
    steps = linear_steps(lidar, run.clocks.imu_s, imu.accel_m_s2, rotation, gravity_m_s2=magnitude)
    if steps.astray.any():
        linear = steps.start
    if guess is not None and guess.p_imu_lidar is not None:
        as_given = linear_steps(
            lidar, run.clocks.imu_s, imu.accel_m_s2, rotation,
            gravity_m_s2=magnitude, lever_arm_m=guess.p_imu_lidar,
        )  # fmt: skip
        linear = with_lever_arm(run, linear, as_given.start, guess.p_imu_lidar)
    return lidar, Start(rotation, linear)


def of_the_turns_lag(trials: Sequence[Start]) -> list[Start]:
    """The trials, without those of lags that explain the accelerations hardly better than the lag that explains the turns best,
    and the turns clearly worse.

    What turns about one axis, on planes that leave a direction open, has accelerations that tell next to nothing: a lag of
    a round of its way was taken by a hundredth, of which the turns left two thirds more, and the answer was off by eight seconds.
    """
    best = min(trials, key=lambda t: t.misfit)
    turned = min(trials, key=lambda t: t.rotation.residual).rotation
    if best.rotation.residual <= ROTATING.alike * turned.residual:
        return list(trials)
    of_turns = [t for t in trials if t.rotation.residual <= ROTATING.alike * turned.residual]
    return of_turns if min(t.misfit for t in of_turns) <= ROTATING.alike * best.misfit else list(trials)


def _of_nearest_lag(run: Run, trials: Sequence[Start]) -> list[Start]:
    """The trials; of a motion that repeats itself, and fits as well a period earlier or later, only those of the lag that is
    nearest to the stamps' own. The others are said.
    """
    best = min(trials, key=lambda t: t.misfit)
    nearest = next((t.rotation for t in trials if t.rotation.repeats_s), None)
    if nearest is None or best.rotation.time_offset_s not in (nearest.time_offset_s, *nearest.repeats_s):
        return list(trials)
    most = ROTATING.alike * best.misfit
    alike = {t.rotation.time_offset_s for t in trials if t.misfit <= most}
    own_s = nearest.time_offset_s
    others = sorted(alike & set(nearest.repeats_s), key=abs)
    if own_s not in alike or not others:
        return list(trials)
    more = "" if len(others) <= _TOLD else " and more"
    told = ", ".join(f"{lag_s - own_s:+.2f} s" for lag_s in others[:_TOLD])
    run.say(
        "warning",
        "start.repeats",
        f"the motion repeats itself: a time offset that differs by {told}{more} fits as well, and the one nearest to the stamps' "
        "own is used; if the clocks may be that far apart, give the time offset, or record a move that comes only once",
    )
    return [t for t in trials if t.rotation.time_offset_s == own_s]


def _turns(run: Run, lidar: LidarTrack) -> bool:
    """Whether both sensors turn: what a still lidar's sweeps show is noise, which a still gyroscope tells from turning."""
    shown = float(np.sqrt(np.mean(np.sum(lidar.omega_rad_s**2, axis=1))))
    return min(shown, _felt_turning_rad_s(run, lidar)) > AGREEING.least_turning_rad_s


def _felt_turning_rad_s(run: Run, lidar: LidarTrack) -> float:
    """What the gyroscope turns by (rms), beside its bias."""
    imu_s, gyro_rad_s = run.clocks.imu_s, run.recording.imu.gyro_rad_s
    # Over as long as from scan to scan: what shakes the gyroscope faster turns no lidar.
    width_s = max(float(np.median(np.diff(lidar.start_s))), AGREEING.shortest_span_s)
    rates = mean_rate(imu_s, gyro_rad_s - np.median(gyro_rad_s, axis=0), imu_s, imu_s + width_s)
    return float(np.sqrt(np.nanmean(rates**2)))


def _require_measured_sweeps(run: Run, lidar: LidarTrack, motions: Sequence[ScanMotion]) -> None:
    """Raises Refused where points' times are wrong. Where the gyroscope feels nothing, what seems to turn from sweep to sweep is
    the track's error, and in no sweep.
    """
    if _felt_turning_rad_s(run, lidar) > AGREEING.least_turning_rad_s:
        require_measured_sweeps(run, motions)


def _require_gravity(run: Run) -> None:
    """Raise Refused where what the accelerometer shows is gravity in another unit."""
    if complaint := gravity_complaint(run.clocks.imu_s, run.recording.imu, run.settings.gravity.magnitude_m_s2):
        raise Refused("imu.accelerometer_unit", complaint)


def _refuse_misread_imu(run: Run, lidar: LidarTrack, rotation: RotationStart, linear: LinearStart) -> None:
    """Raise Refused where the IMU's unit or signs cannot be those of the lidar's motion."""
    imu_s, imu = run.clocks.imu_s, run.recording.imu
    if complaint := unit_complaint(lidar, imu_s, imu):
        raise Refused("imu.gyroscope_unit", complaint)
    doubted = any(finding.code == "imu.axis_signs" for finding in run.recording.findings)
    magnitude = run.settings.gravity.magnitude_m_s2
    if complaint := axis_complaint(lidar, imu_s, imu, rotation, linear, magnitude, doubted=doubted):
        raise Refused("imu.axis_signs", complaint)


def _nothing_to_compare(recording: Recording, followed: int) -> Refused:
    """Why no start is found at all: the lidar was soon lost, it is too short, or its stamps are those of another time."""
    scans = len(recording.scans)
    seconds = 1e-9 * (recording.scans[-1].stamp_ns - recording.scans[0].stamp_ns)
    if followed < FOLLOWING.followed_share * scans:
        return Refused(
            "planes.lost",
            f"the lidar could be followed over only {followed} of {scans} scans, too few to compare its motion with the IMU's; "
            "move more slowly, and keep three planes that face different directions in view",
        )
    if seconds < ROTATING.overlap_s:
        after = f", from {recording.skipped_s:.1f} s of the recording on," if recording.skipped_s else ""
        return Refused(
            "start.no_overlap",
            f"{seconds:.1f} s of scans{after} are too few to compare the lidar's motion with the IMU's: take more of "
            "it, or record 20 s",
        )
    return Refused(
        "start.no_overlap",
        "the stamps of lidar and IMU overlap too little to compare their motion: they are of different times; see "
        "`unsweep inspect`, or give the time offset",
    )
