"""The last stage: whether the end of the joint estimation can be true, what of it is known, and the answer made of both."""

from __future__ import annotations

import numpy as np

from calib_core.errors import Refused
from calib_core.full.assess.confidence import Confidence, confidence
from calib_core.full.assess.doubtful_choice import say_doubtful_choice
from calib_core.full.assess.given_values import PLANES
from calib_core.full.assess.gyroscope import gyroscope_axes
from calib_core.full.assess.materials import told_materials
from calib_core.full.assess.observability import Knowledge
from calib_core.full.assess.parts import parts_of
from calib_core.full.assess.plausibility import gravity_std, implausible
from calib_core.full.assess.sensors import sensor_findings, told_cost
from calib_core.full.assess.settings import PLAUSIBLE
from calib_core.full.assess.unestimated_shifts import told_considered
from calib_core.full.assess.weak_sentences import advice, weak_directions
from calib_core.full.initialise.offset_profile import offset_profile
from calib_core.full.initialise.start import LidarTrack
from calib_core.full.joint.estimation import Solved
from calib_core.full.joint.residuals import plane_residuals
from calib_core.full.run import Clocks, Run
from calib_core.method import Answer
from calib_core.presets import random_walks
from calib_core.result import Evidence, Message, PlaneQuality
from calib_core.settings import ImuNoise
from calib_core.solver.arrow import NotPositiveDefinite
from calib_core.solver.broken_down import arithmetic_or_refused
from calib_core.solver.levenberg import Outcome
from calib_core.types import Trajectory

_NO_ANSWER = (
    "the joint solve found no stable answer: the planes or the motion do not fit the data; leave out planes that can move or "
    "bend, or choose others that face three different directions"
)


@arithmetic_or_refused()
def weigh(run: Run, solved: Solved, *, is_choice: bool) -> Confidence:
    """What is known of the calibration. is_choice: whether planes were chosen by a person, and what is wrong with them is said.

    Raises Refused where the answer cannot be true, or determines no rotation.
    """
    minimum = solved.minimum
    if minimum.solution is None or minimum.outcome is Outcome.SINGULAR or not np.isfinite(minimum.cost):
        raise Refused("solve.diverged", _NO_ANSWER)
    points = int(solved.observations.count.sum())
    chi2 = 2.0 * minimum.cost / max(points, 1)
    if points < PLAUSIBLE.fewest_points or chi2 > PLAUSIBLE.worst_chi2:
        raise Refused(
            "solve.inconsistent",
            f"with the best answer the residuals of {points} points are {np.sqrt(chi2):.1f} times their noise; the stamps, the "
            "per-point times or the planes are probably wrong: check them with `unsweep inspect`",
        )
    wrong = implausible(run, solved)
    if wrong is not None:
        raise Refused("solve.inconsistent", wrong)
    try:
        trust = confidence(run, solved)
    except NotPositiveDefinite as error:  # its sensors' own parameters can be such that nothing is determined any more
        raise Refused("solve.diverged", _NO_ANSWER) from error
    require_rotation(trust.knowledge)
    if is_choice:
        # Where planes are held wrong, others seem to move and to bend.
        held_wrong = any(each.what.startswith(PLANES) for each in trust.contradicted)
        say_doubtful_choice(run, solved, faults_count=not held_wrong, torn=trust.is_torn)
    return trust


def require_rotation(knowledge: Knowledge) -> None:
    """Raises Refused where nothing of the rotation is known."""
    if not knowledge.rotation_known:
        raise Refused(
            "motion.undetermined", "the motion determines no component of the rotation; turn about two axes at least"
        )


def answer(run: Run, solved: Solved, trust: Confidence, lidar: LidarTrack) -> Answer:
    """The answer in the map frame, as the document wants it. lidar: as it was followed before the solve."""
    e, knowledge = solved.estimate, trust.knowledge
    sensors = sensor_findings(solved, trust.considered, trust.sensors_unexplained, torn=trust.is_torn)
    counted = told_considered(sensors.parameters, knowledge.covariance)
    materials = () if trust.is_torn else told_materials(solved)
    told = (*sensors.sentences, *materials, *counted, *told_cost(run, solved, trust.considered))
    imu, clock = e.sensors.imu(), sensors.find("clock_rate")
    rate = run.recording.imu.gyro_rad_s
    turning_std_rad_s = np.sqrt(np.mean((rate - rate.mean(axis=0)) ** 2, axis=0))
    planes, weak = plane_qualities(solved), weak_directions(knowledge)
    total = sum(plane.points for plane in planes)
    scans = len(np.unique(solved.observations.scan)), len(run.recording.scans)
    said = advice(knowledge, turning_std_rad_s, e.R_imu_lidar, scans, by_sensors=trust.weak_by_sensors)
    return Answer(
        R_imu_lidar=e.R_imu_lidar,
        p_imu_lidar=e.p_imu_lidar,
        time_offset_ns=run.clocks.offset_ns(e.time_offset_s),
        gyro_bias_rad_s=imu.gyro @ e.gyro_bias.mean(axis=0),
        accel_bias_m_s2=imu.accel @ e.accel_bias.mean(axis=0),
        gravity_m_s2=float(np.linalg.norm(e.gravity)),
        gravity_std_m_s2=gravity_std(solved),
        covariance=knowledge.covariance,
        is_weak=knowledge.is_weak or trust.is_torn or any(each.bends for each in trust.contradicted),
        weak_axes=knowledge.weak_axes,
        weak_directions=weak,
        advice=tuple(each.text for each in said),
        rms_m=float(np.sqrt(sum(p.rms_m**2 * p.points for p in planes) / max(total, 1))),
        points_used=total,
        scans_used=scans[0],
        scans_total=scans[1],
        planes=planes,
        iterations=solved.iterations,
        trajectory=trajectory_of(run.clocks, solved),
        remarks=(
            *(Message(code="observability.weak", level="warning", text=d.text) for d in weak),
            *(Message(code=code, level="info", text=text) for code, text in told),
        ),
        intrinsics=sensors.parameters,
        imu_frame=sensors.imu_frame,
        gyroscope_axes=None if trust.considered is not None else gyroscope_axes(solved, knowledge.covariance),
        clock_rate_ppm=None if clock is None else (clock.value, clock.std),
        time_offset_at_s=run.clocks.middle_s,
        imu_noise=noise_used(run),
        evidence=evidence(run, solved, trust, lidar),
        at_once=trust.apart.at_once,
    )


def evidence(run: Run, solved: Solved, trust: Confidence, lidar: LidarTrack) -> Evidence:
    """What parts of the recording answer, and what the turning alone says of the time offset."""
    e, imu = solved.estimate, run.recording.imu
    rate_ppm = e.sensors.clock_rate_ppm()
    return Evidence(
        parts=parts_of(trust.apart, e, run.clocks, rate_ppm, [plane.name for plane in solved.planes]),
        time_offset_profile=offset_profile(lidar, run.clocks.imu_s, imu.gyro_rad_s, e.time_offset_s),
    )


def noise_used(run: Run) -> ImuNoise:
    """The IMU's noise as the links' covariances have it, one number for its three axes."""
    density, walks = run.noise.density, random_walks(run.settings.imu_noise)
    return ImuNoise(
        gyroscope_noise_density_rad_s_sqrt_hz=float(np.mean(density.gyro_rad_s_sqrt_hz)),
        accelerometer_noise_density_m_s2_sqrt_hz=float(np.mean(density.accel_m_s2_sqrt_hz)),
        gyroscope_random_walk=walks[0],
        accelerometer_random_walk=walks[1],
    )


def plane_qualities(solved: Solved) -> tuple[PlaneQuality, ...]:
    """The planes in the map frame, and how well their points lie on them."""
    e = solved.estimate
    R0, p0 = solved.map_pose
    normals, offsets_m = e.normals @ R0, e.offsets_m + e.normals @ p0
    residuals = plane_residuals(solved.problem, e)
    return tuple(
        PlaneQuality(
            name=plane.name,
            normal=normal.tolist(),
            offset_m=float(offset_m),
            points=points,
            rms_m=rms_m,
            outline_m=None if plane.outline_m is None else plane.outline_m.tolist(),
        )
        for plane, normal, offset_m, (rms_m, points) in zip(solved.planes, normals, offsets_m, residuals, strict=True)
    )


def trajectory_of(clocks: Clocks, solved: Solved) -> Trajectory:
    """The lidar's solved motion at every knot, in the map frame."""
    e = solved.estimate
    knots = solved.problem.readings.knots_s
    poses = solved.problem.motion(e).lidar_at(knots, e.R_imu_lidar, e.p_imu_lidar)
    linked = solved.problem.readings.linked
    valid = np.concatenate([linked, [True]]) & np.concatenate([[True], linked])
    R0, p0 = solved.map_pose
    times_s = clocks.as_stamped(knots + e.time_offset_s, e.sensors.clock_rate_ppm())
    return Trajectory(clocks.lidar_epoch_ns, times_s, R0.T @ poses.R, (poses.p - p0) @ R0, valid, clocks.late_ns)
