"""Where the joint estimation begins: knots, bias nodes, priors, and the first estimate from start values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib_core.errors import Refused
from calib_core.factors.imu import KnotStates
from calib_core.factors.lidar_plane import LidarNoise
from calib_core.full.initialise.start import LidarTrack, Start
from calib_core.full.joint.estimation import Estimation, JointData, MapPlane
from calib_core.full.joint.policies import PlaneSet
from calib_core.full.joint.priors import PriorRow, Priors
from calib_core.full.joint.schedule import Schedule
from calib_core.full.joint.state import CALIBRATION, BiasNodes, Estimate
from calib_core.full.joint.undetermined import is_turning_felt
from calib_core.full.odometry.reference import Followed
from calib_core.full.prepare.nuisance import unknowns_of
from calib_core.full.run import Run
from calib_core.imu.preintegration import knot_spacing_s, upsample
from calib_core.imu.quantisation import allowed_for_steps, coarse_density2
from calib_core.planes.same_plane import same_surface
from calib_core.presets import random_walks
from calib_core.result import COVARIANCE_ORDER
from calib_core.types import BoolArray, FloatArray, InitialGuess, Plane


@dataclass(frozen=True, slots=True)
class Beginning:
    """Knots, bias nodes and standing priors."""

    #: derived: the variance of a walk about the line between its nodes is a sixth of what it gathers from one to the next,
    #: and MEMS biases wander over tens of seconds;
    nodes_s: float = 5.0
    #: judged: closer in a short recording, where it costs nothing,
    closest_nodes_s: float = 2.5
    #: judged: which is one with fewer nodes than this. Time alone depends on it.
    few_nodes: int = 14
    #: derived: the contract's standing prior, so wide that it tells nothing a rig could contradict: 1 rad, 10 m, 10 s.
    standing_std: tuple[float, ...] = (1.0, 1.0, 1.0, 10.0, 10.0, 10.0, 10.0)
    #: judged: with fewer tracked knots (0.2 s) there is nothing to hold a calibration against. Only which reason is told
    #: depends on it.
    fewest_knots: int = 20
    #: derived: knots beyond the tracked sweeps' end, so that the last points have one on either side.
    overhang_knots: int = 2
    #: data sheets: 2 cm of a range are usual (calib_core/presets/lidar.py), of a surface the rest of their accuracy; of a
    #: lidar of which nothing is known yet. Measured in the rounds, and forgotten.
    unknown_range_std_m: float = 0.02
    unknown_surface_std_m: float = 0.005


BEGINNING = Beginning()
_RULES = PlaneSet()


def begin(
    run: Run,
    followed: Followed,
    lidar: LidarTrack,
    start: Start,
    guess: InitialGuess | None,
    schedule: Schedule,
    *,
    every: int = 1,
    most_s: float | None = None,
    beyond: int = BEGINNING.overhang_knots,
) -> tuple[JointData, Estimation, float]:
    """The data of the joint problem, what is known at first, and the share of the recording that is gone after.

    every: knots that are left out to go faster, one of so many stays.   most_s: beyond what was tracked; None for all.
    beyond: knots after the tracked sweeps' end.   Raises Refused where the lidar and the IMU share too little.
    """
    clocks, imu = run.clocks, run.recording.imu
    offset_s = start.rotation.time_offset_s
    tracked_from, tracked_to = float(lidar.start_s[0]), float(lidar.start_s[-1] + lidar.sweep_s[-1])
    whole = knots_over(clocks.imu_s, tracked_from, float(clocks.scan_s[-1] + clocks.sweep_s[-1]), offset_s)[::every]
    overhang_s = beyond * knot_spacing_s(clocks.imu_s)
    covered = (clocks.scan_s > whole[0] + offset_s - 0.5) & (clocks.scan_s < whole[-1] + offset_s)
    reference = followed.reference
    if not covered[reference]:
        reference = nearest_covered(followed, covered & (clocks.scan_s >= whole[0] + offset_s))
    if reference != followed.reference:
        followed, lidar, start = in_frame_of(reference, followed, lidar, start)
    inside = int(np.searchsorted(whole, tracked_to - offset_s + overhang_s))
    if inside < BEGINNING.fewest_knots:
        raise Refused(
            "start.too_short",
            f"the lidar's planes and the IMU share only {max(tracked_to - tracked_from, 0.0):.1f} s; "
            "at least a few seconds are needed",
        )
    total = len(whole)
    if most_s is not None:
        whole = whole[: inside + round(most_s / (whole[1] - whole[0]))]
    run.stage("solve", 0.0, "interpolating the IMU")
    readings = upsample(clocks.imu_s, imu.gyro_rad_s, imu.accel_m_s2, whole, run.hyper)
    readings = allowed_for_steps(readings, clocks.imu_s, coarse_density2(clocks.imu_s, imu))
    if run.restored is not None:
        readings = run.restored.allowed_for(readings, clocks.imu_s, run.noise.density)
    nodes = bias_nodes(whole) if run.settings.bias_model == "random-walk" else BiasNodes.spread(whole, None)
    estimate = first_estimate(lidar, start, whole[:inside], followed.planes, len(nodes.times_s))
    estimate = put_aside(estimate, followed.dropped)
    gauge = int(np.argmin(np.abs(whole[:inside] + offset_s - clocks.scan_s[followed.reference])))
    state = Estimation(
        estimate=estimate,
        priors=standing_priors(run, estimate, guess),
        planes=map_planes(followed),
        positions=tuple(m.position for m in followed.motions if covered[m.position]),
        lidar_noise=LidarNoise(
            BEGINNING.unknown_range_std_m, BEGINNING.unknown_surface_std_m, run.farthest_m, run.sieve_m, run.nearest_m
        ),
    )
    spacing_s = readings.spacing_s
    most_rounds = schedule.most_rounds(inside * spacing_s, len(whole) * spacing_s, run.settings.max_rounds)
    sensors = unknowns_of(run)
    data = JointData(
        run,
        readings,
        nodes,
        gauge,
        followed.reference,
        estimate,
        schedule.limits,
        most_rounds,
        sensors,
        followed.dropped,
        turned=is_turning_felt(clocks.imu_s, imu.gyro_rad_s, run.noise.density.gyro_rad_s_sqrt_hz),
        only_axis_imu=start.rotation.open_axis_imu,
    )
    return data, state, len(whole) / total


def nearest_covered(followed: Followed, covered: BoolArray) -> int:
    """The scan whose frame is the map's where the IMU was not yet recorded at the one that the planes are of, or no longer: of
    those that are followed the nearest at which it was, covered (M,); the same one where there is none.
    """
    known = [m.position for m in followed.motions if covered[m.position]]
    return min(known, key=lambda position: abs(position - followed.reference), default=followed.reference)


def in_frame_of(
    position: int, followed: Followed, lidar: LidarTrack, start: Start
) -> tuple[Followed, LidarTrack, Start]:
    """What is known before the joint estimation, told in the frame of another of the scans that were followed."""
    origin = next(m for m in followed.motions if m.position == position)
    moved = followed.seen_from(position)
    assert moved is not None
    R, p = origin.R, origin.p
    track = replace(lidar, R=R.T @ lidar.R, p=(lidar.p - p) @ R, v_m_s=lidar.v_m_s @ R, unseen=R.T @ lidar.unseen @ R)
    return moved, track, replace(start, linear=replace(start.linear, gravity=R.T @ start.linear.gravity))


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


def map_planes(track: Followed) -> tuple[MapPlane, ...]:
    """What the joint estimation has to know of each plane, but for where it is."""
    shown_m = {plane.name: float(plane.offset_m) for plane in track.proposals}
    return tuple(
        MapPlane(
            plane.name,
            plane.outline_m,
            chosen=not plane.suggested,
            late=is_late,
            found_m=shown_m.get(plane.name, float(plane.offset_m)),
        )
        for plane, is_late in zip(track.planes, track.late or [False] * len(track.planes), strict=True)
    )


def put_aside(estimate: Estimate, others: Sequence[Plane]) -> Estimate:
    """With planes that do not count put aside: a floor that somebody dropped is there all the same, and what of it lies near a
    wall is not the wall's. One that is parallel to a plane that counts, and near it, would claim that one's points.

    others: in the frame of the estimate.
    """
    normals, offsets_m = np.array([p.normal for p in others]).reshape(-1, 3), np.array([p.offset_m for p in others])
    twice = same_surface(
        normals, offsets_m, of=(estimate.normals, estimate.offsets_m),
        within_deg=_RULES.same_normal_deg, within_m=_RULES.same_surface_m,
    ).any(axis=1)  # fmt: skip
    return replace(
        estimate,
        aside_normals=np.vstack([estimate.aside_normals, normals[~twice]]),
        aside_offsets_m=np.append(estimate.aside_offsets_m, offsets_m[~twice]),
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
    few = float(knots_s[-1] - knots_s[0]) / (BEGINNING.few_nodes - 1)
    return BiasNodes.spread(knots_s, float(np.clip(few, BEGINNING.closest_nodes_s, BEGINNING.nodes_s)))


def standing_priors(run: Run, start: Estimate, guess: InitialGuess | None) -> Priors:
    """The contract's standing prior, the user's own, gravity's and the bias walks'."""
    settings = run.settings
    means = np.zeros(CALIBRATION)
    means[-1] = start.time_offset_s
    standing = [
        PriorRow(i, float(mean), std) for i, (mean, std) in enumerate(zip(means, BEGINNING.standing_std, strict=True))
    ]
    given = []
    for prior in settings.priors:
        column = COVARIANCE_ORDER.index(prior.axis)
        value = prior.value
        if prior.axis == "dt":
            value = run.clocks.offset_s(round(prior.value * 1e9))
        given.append(PriorRow(column, value, prior.std))
    reference = guess.R_imu_lidar if guess is not None and guess.R_imu_lidar is not None else start.R_imu_lidar
    walk = random_walks(settings.imu_noise)
    return Priors(
        reference,
        tuple(standing),
        settings.gravity.magnitude_m_s2,
        settings.gravity.std_m_s2,
        given=tuple(given),
        gyro_walk=walk[0],
        accel_walk=walk[1],
    )
