"""The page that is the whole calibration: a recording in, the result document and the motion out.

Follow one recording: noise of its IMU -> reference planes -> lidar-only track -> start values -> joint rounds ->
what is known -> verdict. Every way in which that can fail ends in a result with status `refused` and its reason.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version

import numpy as np
from threadpoolctl import threadpool_limits

from calib_core.errors import SettingsError
from calib_core.events import LogEvent, OnEvent, ShouldCancel, StageEvent, ignore_event, never_cancel
from calib_core.full.assess.observability import Knowledge, advice, assess
from calib_core.full.assess.plausibility import gravity_std, implausible, inflation, standing_still
from calib_core.full.assess.residuals import euler_xyz_deg, plane_residuals, quaternion_xyzw, transform_matrix
from calib_core.full.calibrate import solve, start_values
from calib_core.full.joint.schedule import Solved
from calib_core.full.odometry.reference import follow
from calib_core.full.planes.propose import find_reference, propose_planes
from calib_core.full.prepare.excluded_spans import without_spans
from calib_core.full.prepare.imu_noise import ImuNoiseLevel, longest_still, measure_imu_noise
from calib_core.full.prepare.imu_stamps import as_taken
from calib_core.full.run import Clocks, Context, NoStart, read_clocks
from calib_core.gp.training import fit_hyper
from calib_core.imu.preintegration import NoiseDensity
from calib_core.maps.crispness import crispness_of
from calib_core.presets import find_imu_preset
from calib_core.result import (
    CalibrationResult,
    Message,
    Observability,
    PlaneQuality,
    Provenance,
    Quality,
    RecordingProvenance,
    Transform,
    Uncertainty,
)
from calib_core.settings import CalibrateSettings, ImuNoise
from calib_core.solver.levenberg import Outcome
from calib_core.types import InitialGuess, Plane, Recording, Trajectory

__all__ = ["Calibration", "calibrate", "find_reference"]

#: How far the mean squared residual of single points may stray before the solve has not explained the data.
_WORST_CHI2 = 4.0


@dataclass(frozen=True)
class Calibration:
    """The result document, and the motion (None where the calibration was refused)."""

    result: CalibrationResult
    trajectory: Trajectory | None


def calibrate(
    recording: Recording,
    settings: CalibrateSettings,
    *,
    planes: Sequence[Plane] | None = None,
    initial_guess: InitialGuess | None = None,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> Calibration:
    """The calibration of one recording.

    planes: in the map frame (the lidar frame at the first used scan's time); None: found.   Raises SettingsError and
    Cancelled; whatever the recording cannot give is a result with status `refused`.
    """
    started = time.monotonic()
    whole, recording = recording, without_spans(recording, settings.excluded_spans_s)
    log_of: list[Message] = [Message(code=f.code, level=f.level, text=f.text) for f in recording.findings]

    def listen(event: object) -> None:
        if isinstance(event, LogEvent):
            log_of.append(Message(code=event.code, level=event.level, text=event.text))
        on_event(event)  # type: ignore[arg-type]

    if settings.excluded_spans_s:
        left_out = len(whole.scans) - len(recording.scans)
        listen(LogEvent(level="info", code="scans.excluded", text=f"{left_out} scans were left out as asked"))
        _check_reference(whole, recording, settings, planes)
    # Small matrices by the thousand: a second BLAS thread only ever waits, and one thread gives one answer.
    with threadpool_limits(limits=1, user_api="blas"):
        if settings.method == "paper":
            from calib_core.paper.document import calibrate_published

            done = calibrate_published(
                recording, settings, planes, initial_guess, listen, should_cancel, log_of, started
            )
        else:
            done = _calibrate_full(recording, settings, planes, initial_guess, listen, should_cancel, log_of, started)
        return with_crispness(done, recording, settings)


def _check_reference(
    whole: Recording, kept: Recording, settings: CalibrateSettings, planes: Sequence[Plane] | None
) -> None:
    """Given planes live in the frame of the first usable scan: without that scan they mean nothing."""
    if planes is None:
        return
    before, _ = find_reference(whole.scans, settings)
    after, _ = find_reference(kept.scans, settings)
    if whole.scans[before].stamp_ns != kept.scans[after].stamp_ns:
        at_s = (whole.scans[before].stamp_ns - whole.scans[0].stamp_ns) * 1e-9
        raise SettingsError(
            f"Expected excluded spans without the scan at {at_s:.2f} s, in whose frame the given planes are; exclude "
            "another span, or leave the planes to be found."
        )


def _calibrate_full(  # noqa: PLR0911  each refusal is a way out
    recording: Recording,
    settings: CalibrateSettings,
    planes: Sequence[Plane] | None,
    guess: InitialGuess | None,
    on_event: OnEvent,
    should_cancel: ShouldCancel,
    messages: list[Message],
    started: float,
) -> Calibration:
    def refuse(code: str, text: str) -> Calibration:
        messages.append(Message(code=code, level="error", text=text))
        return Calibration(refused(recording, settings, messages, time.monotonic() - started), None)

    if len(recording.scans) < 10 or len(recording.imu.stamps_ns) < 50:
        return refuse(
            "recording.too_short",
            f"a calibration needs at least 10 scans and 50 IMU readings, the recording has {len(recording.scans)} and "
            f"{len(recording.imu.stamps_ns)}; record for half a minute or more",
        )
    ctx = make_context(recording, settings, on_event, should_cancel)
    try:
        reference, used_planes = _reference(ctx, planes)
        if not used_planes:
            return refuse(
                "planes.none", "no plane was found in any scan; record in front of walls and floor, at 1 to 20 m"
            )
        followed = follow(ctx, used_planes, reference, given=planes is not None)
        reference, used_planes, motions = followed.reference, followed.planes, followed.motions
        still = standing_still(motions, len(recording.scans))
        if still is not None:
            return refuse(*still)
        lidar, start = start_values(ctx, motions, used_planes, guess)
        add = planes is None
        solved = solve(ctx, lidar, motions, start, used_planes, reference, guess, may_add_planes=add)
        if len(motions) < len(recording.scans) and implausible(ctx, solved) is not None:
            ctx.say("warning", "planes.followed", "only the scans that the lidar alone could follow are used")
            solved = solve(
                ctx, lidar, motions, start, used_planes, reference, guess, may_add_planes=False, may_extend=False
            )
    except NoStart as error:
        return refuse(error.code, str(error))
    if (
        solved.minimum.solution is None
        or solved.minimum.outcome is Outcome.SINGULAR
        or not np.isfinite(solved.minimum.cost)
    ):
        return refuse(
            "solve.diverged", "the joint solve found no stable answer; the planes or the motion do not fit the data"
        )
    points = int(solved.micro.count.sum())
    chi2 = 2.0 * solved.minimum.cost / max(points, 1)
    if points < 1000 or chi2 > _WORST_CHI2:
        return refuse(
            "solve.inconsistent",
            f"the best answer leaves residuals {np.sqrt(chi2):.1f} times their noise on {points} points; the stamps, the "
            "per-point times or the planes are not what they seem: see `unsweep inspect`",
        )
    wrong = implausible(ctx, solved)
    if wrong is not None:
        return refuse("solve.inconsistent", wrong)
    frozen = not settings.estimate_time_offset
    knowledge = assess(
        solved.minimum.solution.information,
        solved.problem.priors,
        inflation=inflation(ctx, solved, frozen_offset=frozen),
        frozen_offset=frozen,
        offset_std_s=ctx.clocks.jitter_mean_std_s,
    )
    if not knowledge.rotation_known:
        return refuse(
            "motion.undetermined", "the motion determines no component of the rotation; turn about two axes at least"
        )
    result = _document(ctx, solved, knowledge, messages, time.monotonic() - started)
    return Calibration(result, trajectory_of(ctx.clocks, solved))


def with_crispness(done: Calibration, recording: Recording, settings: CalibrateSettings) -> Calibration:
    """The calibration with the crispness of its room in it, where that is asked for and can be measured."""
    if done.trajectory is None or not settings.crispness:
        return done
    measured = crispness_of(recording.scans, done.trajectory)
    quality = done.result.quality.model_copy(update={"crispness": measured})
    return replace(done, result=done.result.model_copy(update={"quality": quality}))


def make_context(
    recording: Recording, settings: CalibrateSettings, on_event: OnEvent, should_cancel: ShouldCancel
) -> Context:
    """Clocks, when the IMU's readings were taken, its noise and interpolation, once for the whole run."""
    on_event(StageEvent(stage="initialise", fraction=0.0, text="noise of the IMU"))
    recording, jitter_mean_std_s = as_taken(recording, settings, on_event)
    clocks = replace(read_clocks(recording), jitter_mean_std_s=jitter_mean_std_s)
    imu = recording.imu
    noise = _imu_noise(recording, settings, clocks, on_event)
    pool = ThreadPoolExecutor(1)
    values = np.hstack([imu.gyro_rad_s, imu.accel_m_s2])
    training = pool.submit(fit_hyper, clocks.imu_s, values, noise_std=noise.sample_std)
    pool.shutdown(wait=False)
    return Context(recording, settings, clocks, noise, training, on_event, should_cancel)


def _imu_noise(recording: Recording, settings: CalibrateSettings, clocks: Clocks, on_event: OnEvent) -> ImuNoiseLevel:
    """The noise the user gave, else measured: never a number taken on trust while the data can tell."""
    imu = recording.imu
    period = float(np.median(np.diff(clocks.imu_s)))
    given = settings.imu_noise
    if isinstance(given, str):
        preset = find_imu_preset(given)
        if preset is None:
            raise SettingsError(
                f"expected an IMU noise preset's name, found '{given}'; see `unsweep calibrate --help` for the names"
            )
        given = preset.noise
    if isinstance(given, ImuNoise):
        density = np.repeat(
            [given.gyroscope_noise_density_rad_s_sqrt_hz, given.accelerometer_noise_density_m_s2_sqrt_hz], 3
        )
        return ImuNoiseLevel(NoiseDensity(density[:3], density[3:]), density / np.sqrt(period), "the densities given")
    still = longest_still(clocks.imu_s, imu.gyro_rad_s, imu.accel_m_s2)
    level = measure_imu_noise(clocks.imu_s, imu.gyro_rad_s, imu.accel_m_s2, still)
    on_event(
        LogEvent(
            level="info",
            code="imu.noise",
            text=f"IMU noise from {level.source}: gyroscope {level.density.gyro_rad_s_sqrt_hz[0]:.2g} rad/s/sqrt(Hz), "
            f"accelerometer {level.density.accel_m_s2_sqrt_hz[0]:.2g} m/s2/sqrt(Hz)",
        )
    )
    return level


def _reference(ctx: Context, planes: Sequence[Plane] | None) -> tuple[int, list[Plane]]:
    """The reference scan and the planes to use: the user's, else those found around it."""
    if planes is not None:
        reference, _ = find_reference(ctx.recording.scans, ctx.settings, should_cancel=ctx.should_cancel)
        return reference, list(planes)
    proposals = propose_planes(ctx.recording, ctx.settings, on_event=ctx.on_event, should_cancel=ctx.should_cancel)
    return proposals.reference_scans[0], [patch.plane for patch in proposals.patches]


def trajectory_of(clocks: Clocks, solved: Solved) -> Trajectory:
    """The lidar's solved motion at every knot, in the map frame."""
    e = solved.estimate
    knots = solved.problem.readings.knots_s
    poses = solved.problem.motion(e).lidar_at(knots, e.R_imu_lidar, e.p_imu_lidar)
    linked = solved.problem.readings.linked
    valid = np.concatenate([linked, [True]]) & np.concatenate([[True], linked])
    R0, p0 = solved.map_pose
    return Trajectory(clocks.lidar_epoch_ns, knots + e.time_offset_s, R0.T @ poses.R, (poses.p - p0) @ R0, valid)


def _document(
    ctx: Context, solved: Solved, knowledge: Knowledge, messages: list[Message], duration_s: float
) -> CalibrationResult:
    """The result document of a solve."""
    e = solved.estimate
    cov = knowledge.covariance
    std = np.sqrt(np.diag(cov))
    gravity_std_m_s2 = gravity_std(solved)
    rate = ctx.recording.imu.gyro_rad_s
    residuals = plane_residuals(solved.problem, e)
    R0, p0 = solved.map_pose
    normals = e.normals @ R0
    offsets = e.offsets_m + e.normals @ p0
    total = sum(n for _, n in residuals)
    rms = float(np.sqrt(sum(r**2 * n for r, n in residuals) / max(total, 1)))
    offset_ns = ctx.clocks.offset_ns(e.time_offset_s)
    weak = knowledge.is_weak
    messages.extend(Message(code="observability.weak", level="warning", text=d.text) for d in knowledge.weak)
    return CalibrationResult(
        status="weak" if weak else "calibrated",
        messages=messages,
        T_imu_lidar=Transform(
            matrix=transform_matrix(e.R_imu_lidar, e.p_imu_lidar).tolist(),
            translation_m=e.p_imu_lidar.tolist(),
            quaternion_xyzw=quaternion_xyzw(e.R_imu_lidar),
            euler_xyz_deg=euler_xyz_deg(e.R_imu_lidar),
        ),
        time_offset_s=offset_ns * 1e-9,
        time_offset_ns=offset_ns,
        gyroscope_bias_rad_s=e.gyro_bias.mean(axis=0).tolist(),
        accelerometer_bias_m_s2=e.accel_bias.mean(axis=0).tolist(),
        gravity_m_s2=float(np.linalg.norm(e.gravity)),
        uncertainty=Uncertainty(
            rotation_std_deg=np.degrees(std[:3]).tolist(),
            translation_std_m=std[3:6].tolist(),
            time_offset_std_s=float(std[6]),
            gravity_std_m_s2=gravity_std_m_s2,
            covariance=cov.tolist(),
        ),
        observability=Observability(
            weak_directions=list(knowledge.weak),
            advice=advice(knowledge, np.sqrt(np.mean((rate - rate.mean(axis=0)) ** 2, axis=0)), e.R_imu_lidar),
        ),
        quality=Quality(
            point_to_plane_rms_m=rms,
            points_used=total,
            scans_used=len(np.unique(solved.micro.scan)),
            scans_total=ctx.recording.scans_total or len(ctx.recording.scans),
            planes=[
                PlaneQuality(
                    name=name,
                    normal=n.tolist(),
                    offset_m=float(w),
                    points=count,
                    rms_m=r,
                    outline_m=None if outline_m is None else outline_m.tolist(),
                )
                for name, n, w, (r, count), outline_m in zip(
                    solved.plane_names, normals, offsets, residuals, solved.outlines_m, strict=True
                )
            ],
            iterations=ctx.iterations,
            duration_s=duration_s,
        ),
        provenance=provenance(ctx.recording, ctx.settings),
    )


def provenance(recording: Recording, settings: CalibrateSettings) -> Provenance:
    """Where the result comes from."""
    return Provenance(
        recording=RecordingProvenance(
            name=recording.name,
            sha256=recording.sha256,
            duration_s=recording.duration_s,
            lidar_topic=recording.lidar.topic,
            imu_topic=recording.imu.topic,
            lidar_frame_id=recording.lidar.frame_id,
            imu_frame_id=recording.imu.frame_id,
        ),
        settings=settings.model_dump(mode="json"),
        software={"unsweep": _version("unsweep"), "numpy": np.__version__, "python": platform.python_version()},
    )


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"


def refused(
    recording: Recording, settings: CalibrateSettings, messages: list[Message], duration_s: float
) -> CalibrationResult:
    """The document of a recording that cannot give the answer; messages has the reasons."""
    return CalibrationResult(
        status="refused",
        messages=messages,
        T_imu_lidar=None,
        time_offset_s=None,
        time_offset_ns=None,
        gyroscope_bias_rad_s=None,
        accelerometer_bias_m_s2=None,
        gravity_m_s2=None,
        uncertainty=None,
        observability=Observability(),
        quality=Quality(
            point_to_plane_rms_m=0.0,
            points_used=0,
            scans_used=0,
            scans_total=recording.scans_total or len(recording.scans),
            planes=[],
            iterations=0,
            duration_s=duration_s,
        ),
        provenance=provenance(recording, settings),
    )
