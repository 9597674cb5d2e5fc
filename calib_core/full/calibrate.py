"""The default method, one recording from arrays to a joint estimate: track, start, associate, solve, look again.

    clocks -> planes of the reference scan -> lidar-only track -> time offset, rotation, gravity, lever arm
    -> knots -> rounds of (associate all points, solve jointly, preintegrate again) -> fixed point

The rounds tighten: the first uses a fifth of the points within a hand's breadth of a plane, the next learn how far
each plane reaches and how noisy the lidar is, the last use every point within four standard deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib_core.factors.imu import KnotStates
from calib_core.full.initialise.axis_signs import axis_complaint, unit_complaint
from calib_core.full.initialise.single_axis import turns_about, upright
from calib_core.full.initialise.start import (
    LidarTrack,
    LinearStart,
    RotationStart,
    Start,
    acceleration_start,
    linear_start,
    rotation_start,
)
from calib_core.full.joint.priors import PriorRow, Priors
from calib_core.full.joint.schedule import Rounds, Solved
from calib_core.full.joint.state import BiasNodes, Estimate
from calib_core.full.odometry.register import ScanMotion
from calib_core.full.odometry.track import track
from calib_core.full.prepare.nuisance import nuisance_of
from calib_core.full.run import Context, NoStart
from calib_core.imu.preintegration import knot_spacing_s, upsample
from calib_core.types import FloatArray, InitialGuess, Plane

#: Between the nodes of the biases: closer in a short recording, where it costs nothing.
_NODES_S = 5.0
_CLOSEST_NODES_S, _FEW_NODES = 2.5, 14
#: With less turning than this (rms) the gyroscope says nothing of the rotation, and the accelerometer has to.
LEAST_TURNING_RAD_S = 0.03
#: Of an IMU that nobody has named: gyroscope [rad/s per sqrt(s)], accelerometer [m/s2 per sqrt(s)]. Three times what good
#: ones are said to have. A walk taken for smaller than it is bends the whole trajectory; one taken for larger costs nothing.
USUAL_WALK = (3e-5, 3e-4)
#: Turns about the only axis that are tried where it stays open.
_TURNS = 24
_AXES = ("rx", "ry", "rz", "tx", "ty", "tz", "dt")


def track_lidar(ctx: Context, planes: Sequence[Plane], reference: int) -> list[ScanMotion]:
    """The lidar-only motion around the reference scan."""
    ctx.stage("track", 0.0, "following the planes from scan to scan")
    return track(ctx.recording.scans, planes, reference, on_progress=lambda f: ctx.stage("track", f))


def start_values(
    ctx: Context, motions: Sequence[ScanMotion], planes: Sequence[Plane], guess: InitialGuess | None
) -> tuple[LidarTrack, Start]:
    """Time offset, rotation, gravity, lever arm and accelerometer bias from the lidar-only motion.

    planes: those that were followed; where the turn about the only axis stays open, it is taken so that they are plumb
    and level.
    """
    ctx.stage("initialise", 0.0, "time offset and rotation")
    positions = np.array([m.position for m in motions])
    lidar = LidarTrack.of(motions, ctx.clocks.scan_s[positions], ctx.clocks.sweep_s[positions])
    imu = ctx.recording.imu
    turning = float(np.sqrt(np.mean(np.sum(lidar.omega_rad_s**2, axis=1))))
    candidates = rotation_start(lidar, ctx.clocks.imu_s, imu.gyro_rad_s) if turning > LEAST_TURNING_RAD_S else []
    if not candidates:
        candidates = acceleration_start(lidar, ctx.clocks.imu_s, imu.accel_m_s2)
    if guess is not None:
        candidates = _guided(ctx, candidates, guess)
    if not candidates:
        raise NoStart(
            "start.no_overlap", "the lidar and the IMU share no stretch of time long enough to compare their motion"
        )
    magnitude = ctx.settings.gravity.magnitude_m_s2

    def trial(rotation: RotationStart) -> Start:
        linear = linear_start(lidar, ctx.clocks.imu_s, imu.accel_m_s2, rotation, gravity_m_s2=magnitude)
        return Start(rotation, linear)

    trials: list[Start] = []
    best = candidates[0].residual
    for candidate in candidates:
        if candidate.residual > max(2.0 * best, best + 0.1):
            continue
        rotations = [candidate.R_imu_lidar]
        if candidate.open_axis_imu is not None:
            rotations = turns_about(candidate.open_axis_imu, candidate.R_imu_lidar, _TURNS)
        trials.extend(trial(replace(candidate, R_imu_lidar=R)) for R in rotations)
    chosen = upright(trials, np.array([plane.normal for plane in planes]), trial)
    if chosen is not min(trials, key=lambda t: t.misfit):
        ctx.say(
            "info",
            "start.open_turn",
            "all turning is about one axis and the accelerations hardly tell how the IMU is turned about it: the solve starts "
            "where the planes are plumb and level",
        )
    ctx.stage("initialise", 1.0)
    rotation, linear = chosen.rotation, chosen.linear
    if guess is None or guess.R_imu_lidar is None:
        _refuse_misread_imu(ctx, lidar, max(candidates, key=lambda c: c.correlation), linear)
    if guess is not None and guess.p_imu_lidar is not None:
        linear = replace(linear, p_imu_lidar=guess.p_imu_lidar)
    return lidar, Start(rotation, linear)


def _refuse_misread_imu(ctx: Context, lidar: LidarTrack, rotation: RotationStart, linear: LinearStart) -> None:
    """Raise NoStart where the IMU's unit or signs cannot be those of the lidar's motion."""
    imu_s, imu = ctx.clocks.imu_s, ctx.recording.imu
    if complaint := unit_complaint(lidar, imu_s, imu):
        raise NoStart("imu.gyroscope_unit", complaint)
    if complaint := axis_complaint(lidar, imu_s, imu, rotation, linear, ctx.settings.gravity.magnitude_m_s2):
        raise NoStart("imu.axis_signs", complaint)


def _guided(ctx: Context, found: list[RotationStart], guess: InitialGuess) -> list[RotationStart]:
    """What the user already knows replaces what was found."""
    offset = ctx.clocks.offset_s(guess.time_offset_ns) if guess.time_offset_ns is not None else None
    base = found[0] if found else RotationStart(0.0, np.eye(3), np.zeros(3), 1.0, 0.0, None)
    if offset is not None:
        near = [c for c in found if abs(c.time_offset_s - offset) < 0.05]
        base = replace(near[0] if near else base, time_offset_s=offset)
    if guess.R_imu_lidar is not None:
        base = replace(base, R_imu_lidar=guess.R_imu_lidar, open_axis_imu=None)
    return [base]


def first_estimate(
    lidar: LidarTrack, start: Start, knots_s: FloatArray, planes: Sequence[Plane], nodes: int
) -> Estimate:
    """Knot states from the lidar track and the start values."""
    R_c, p_c = start.rotation.R_imu_lidar, start.linear.p_imu_lidar
    t = knots_s + start.rotation.time_offset_s
    R_lidar, p_lidar = lidar.at(t)
    R = R_lidar @ R_c.T
    middle = lidar.start_s + lidar.sweep_s / 2
    v = np.stack([np.interp(t, middle, lidar.v_m_s[:, i]) for i in range(3)], axis=1)
    omega = np.stack([np.interp(t, middle, lidar.omega_rad_s[:, i]) for i in range(3)], axis=1)
    arm = R_c.T @ p_c
    return Estimate(
        states=KnotStates(R, p_lidar - (R_lidar @ arm), v - (R_lidar @ np.cross(omega, arm)[..., None])[..., 0]),
        R_imu_lidar=R_c,
        p_imu_lidar=p_c,
        time_offset_s=start.rotation.time_offset_s,
        gravity=start.linear.gravity,
        gyro_bias=np.repeat(start.rotation.gyro_bias[None], nodes, axis=0),
        accel_bias=np.repeat(start.linear.accel_bias[None], nodes, axis=0),
        normals=np.array([p.normal for p in planes]),
        offsets_m=np.array([p.offset_m for p in planes]),
    )


def knots_over(imu_s: FloatArray, first_s: float, last_s: float, time_offset_s: float) -> FloatArray:
    """Knots on the IMU's clock that cover a span of the lidar's, as far as the IMU does. imu_s: (Q,) its samples.

    Their grid begins with the IMU's first sample, so that it does not depend on where the search for the offset started.
    """
    spacing = knot_spacing_s(imu_s)
    origin = float(imu_s[0])
    low = max(origin, first_s - time_offset_s - 3 * spacing)
    high = min(float(imu_s[-1]), last_s - time_offset_s + 3 * spacing)
    first, last = int(np.ceil((low - origin) / spacing - 1e-6)), int(np.floor((high - origin) / spacing + 1e-6))
    return np.asarray(origin + spacing * np.arange(first, last + 1), dtype=np.float64)


def bias_nodes(knots_s: FloatArray) -> BiasNodes:
    """Where biases that walk are estimated. knots_s: (K,).

    Between nodes a walk strays from the straight line by half of what it walks in that time.
    """
    few = float(knots_s[-1] - knots_s[0]) / (_FEW_NODES - 1)
    return BiasNodes.spread(knots_s, float(np.clip(few, _CLOSEST_NODES_S, _NODES_S)))


def standing_priors(ctx: Context, start: Estimate, guess: InitialGuess | None) -> Priors:
    """The contract's standing prior, the user's own, gravity's and the bias walks'."""
    settings = ctx.settings
    rows = [PriorRow(i, 0.0, 1.0) for i in range(3)] + [PriorRow(3 + i, 0.0, 10.0) for i in range(3)]
    rows.append(PriorRow(6, start.time_offset_s, 10.0))
    for prior in settings.priors:
        column = _AXES.index(prior.axis)
        value = prior.value
        if prior.axis == "dt":
            value = ctx.clocks.offset_s(round(prior.value * 1e9))
        rows.append(PriorRow(column, value, prior.std))
    reference = guess.R_imu_lidar if guess is not None and guess.R_imu_lidar is not None else start.R_imu_lidar
    walk = USUAL_WALK
    noise = settings.imu_noise
    if noise is not None and not isinstance(noise, str):
        walk = (noise.gyroscope_random_walk, noise.accelerometer_random_walk)
    return Priors(
        reference,
        tuple(rows),
        settings.gravity.magnitude_m_s2,
        settings.gravity.std_m_s2,
        gyro_walk=walk[0],
        accel_walk=walk[1],
    )


def solve(
    ctx: Context,
    lidar: LidarTrack,
    motions: Sequence[ScanMotion],
    start: Start,
    planes: Sequence[Plane],
    reference: int,
    guess: InitialGuess | None,
    *,
    may_add_planes: bool = True,
    may_extend: bool = True,
) -> Solved:
    """All rounds of association and joint solve."""
    offset = start.rotation.time_offset_s
    tracked_from, tracked_to = float(lidar.start_s[0]), float(lidar.start_s[-1] + lidar.sweep_s[-1])
    whole = knots_over(ctx.clocks.imu_s, tracked_from, float(ctx.clocks.scan_s[-1] + ctx.clocks.sweep_s[-1]), offset)
    inside = int(np.searchsorted(whole, tracked_to - offset + 2 * knot_spacing_s(ctx.clocks.imu_s)))
    if inside < 20:
        raise NoStart(
            "start.too_short",
            f"the lidar's planes and the IMU share only {max(tracked_to - tracked_from, 0.0):.1f} s; "
            "at least a few seconds are needed",
        )
    imu = ctx.recording.imu
    ctx.stage("associate", 0.0, "interpolating the IMU")
    readings = upsample(ctx.clocks.imu_s, imu.gyro_rad_s, imu.accel_m_s2, whole, ctx.hyper)
    nodes = bias_nodes(whole) if ctx.settings.bias_model == "random-walk" else BiasNodes.spread(whole, None)
    estimate = first_estimate(lidar, start, whole[:inside], planes, len(nodes.times_s))
    covered = (ctx.clocks.scan_s > whole[0] + offset - 0.5) & (ctx.clocks.scan_s < whole[-1] + offset)
    rounds = Rounds(
        ctx=ctx,
        readings=readings,
        nodes=nodes,
        priors=standing_priors(ctx, estimate, guess),
        estimate=estimate,
        first=0,
        last=inside,
        gauge=int(np.argmin(np.abs(whole[:inside] + offset - ctx.clocks.scan_s[reference]))),
        positions=[m.position for m in motions if covered[m.position]],
        reference=reference,
        names=[plane.name for plane in planes],
        outlines_m=[plane.outline_m for plane in planes],
        may_add_planes=may_add_planes,
        may_extend=may_extend,
        chosen=nuisance_of(ctx.recording, ctx.settings),
    )
    return rounds.run()
