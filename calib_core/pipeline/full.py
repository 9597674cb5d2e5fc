"""The default method, one recording from arrays to a joint estimate: track, start, associate, solve, look again.

    clocks -> planes of the reference scan -> lidar-only track -> time offset, rotation, gravity, lever arm
    -> knots -> rounds of (associate all points, solve jointly, preintegrate again) -> fixed point

The rounds tighten: the first uses a fifth of the points within a hand's breadth of a plane, the next learn how far
each plane reaches and how noisy the lidar is, the last use every point within four standard deviations.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calib_core.errors import Cancelled
from calib_core.events import IterationEvent, LogEvent, OnEvent, PlaneResidual, ShouldCancel, Stage, StageEvent
from calib_core.factors.bins import Gate, LidarNoise
from calib_core.factors.knots import KnotStates
from calib_core.geometry import exp
from calib_core.gp.regression import Hyper
from calib_core.gp.training import fit_hyper
from calib_core.imu.links import UpsampledImu, knot_spacing_s, preintegrate, upsample
from calib_core.pipeline.associate import Micro, View, associate, gather, measure_noise, survey
from calib_core.pipeline.initialise import LidarTrack, LinearStart, RotationStart, linear_start, rotation_start, turns_about
from calib_core.pipeline.joint import BiasNodes, Bins, Estimate, JointProblem, PriorRow, Priors
from calib_core.pipeline.noise import ImuNoiseLevel
from calib_core.pipeline.track import ScanMotion, track
from calib_core.planes.extent import PlaneExtents
from calib_core.settings import CalibrateSettings
from calib_core.solver.arrow import ArrowSolution
from calib_core.solver.levenberg import Minimum, Outcome, minimise
from calib_core.types import FloatArray, InitialGuess, Plane, Recording

BIAS_NODE_SPACING_S = 5.0
_AXES = ("rx", "ry", "rz", "tx", "ty", "tz", "dt")


@dataclass(frozen=True)
class Clocks:
    """Both clocks in seconds of their own epochs. lidar time = imu time + offset, |offset| small after coarse alignment.

    imu_s: (Q,).   scan_s: (M,) first points' times.   sweep_s: (M,) last point after the first.
    """

    lidar_epoch_ns: int
    imu_epoch_ns: int
    imu_s: FloatArray
    scan_s: FloatArray
    sweep_s: FloatArray

    def offset_ns(self, time_offset_s: float) -> int:
        """The contract's time offset in nanoseconds: exact epochs' difference plus the estimate."""
        return self.lidar_epoch_ns - self.imu_epoch_ns + round(time_offset_s * 1e9)

    def offset_s(self, time_offset_ns: int) -> float:
        """The inverse of `offset_ns`."""
        return (time_offset_ns - (self.lidar_epoch_ns - self.imu_epoch_ns)) * 1e-9


def read_clocks(recording: Recording) -> Clocks:
    """Clocks of a recording: the IMU's epoch is the lidar's, moved by the coarse offset."""
    stamps = np.array([scan.stamp_ns for scan in recording.scans], dtype=np.int64)
    epoch = int(stamps[0])
    imu_epoch = epoch - recording.coarse_offset_ns
    sweeps = np.array([int(s.points["offset_ns"].max()) * 1e-9 if len(s.points) else 0.0 for s in recording.scans])
    return Clocks(epoch, imu_epoch, (recording.imu.stamps_ns - imu_epoch) * 1e-9, (stamps - epoch) * 1e-9, sweeps)


@dataclass
class Context:
    """What every stage of one run needs: the recording, choices, and whom to tell."""

    recording: Recording
    settings: CalibrateSettings
    clocks: Clocks
    noise: ImuNoiseLevel
    hyper: Hyper
    on_event: OnEvent
    should_cancel: ShouldCancel
    threads: int = field(default_factory=lambda: max(1, min(4, len(os.sched_getaffinity(0)))))
    iterations: int = 0

    def stage(self, stage: Stage, fraction: float, text: str = "") -> None:
        """Report progress; stop where the caller asked to."""
        if self.should_cancel():
            raise Cancelled("the calibration was cancelled")
        self.on_event(StageEvent(stage=stage, fraction=min(max(fraction, 0.0), 1.0), text=text))

    def say(self, level: str, code: str, text: str) -> None:
        """A sentence for a person."""
        self.on_event(LogEvent.model_validate({"level": level, "code": code, "text": text}))


@dataclass(frozen=True)
class Start:
    """Start values of the joint solve."""

    rotation: RotationStart
    linear: LinearStart


@dataclass(frozen=True)
class Solved:
    """The end of the rounds. used: scans with at least one point in the solve."""

    problem: JointProblem
    estimate: Estimate
    minimum: Minimum[Estimate]
    micro: Micro
    lidar_noise: LidarNoise
    extents: PlaneExtents | None
    map_time_s: float
    rounds: int

    @property
    def map_pose(self) -> tuple[FloatArray, FloatArray]:
        """The lidar's pose at the first used scan's time, in the frame of the solve: R (3, 3), p (3,). It defines the map."""
        e = self.estimate
        pose = self.problem.motion(e).lidar_at(np.array([self.map_time_s - e.time_offset_s]), e.R_imu_lidar, e.p_imu_lidar)
        return pose.R[0], pose.p[0]


class NoStart(Exception):
    """No start values: the reason is in words and under a stable code."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(text)
        self.code = code


def track_lidar(ctx: Context, planes: Sequence[Plane], reference: int) -> list[ScanMotion]:
    """The lidar-only motion around the reference scan."""
    ctx.stage("track", 0.0, "following the planes from scan to scan")
    return track(ctx.recording.scans, planes, reference, on_progress=lambda f: ctx.stage("track", f))


def start_values(ctx: Context, motions: Sequence[ScanMotion], guess: InitialGuess | None) -> tuple[LidarTrack, Start]:
    """Time offset, rotation, gravity, lever arm and accelerometer bias from the lidar-only motion."""
    ctx.stage("initialise", 0.0, "time offset and rotation")
    positions = np.array([m.position for m in motions])
    lidar = LidarTrack.of(motions, ctx.clocks.scan_s[positions], ctx.clocks.sweep_s[positions])
    imu = ctx.recording.imu
    candidates = rotation_start(lidar, ctx.clocks.imu_s, imu.gyro_rad_s)
    if guess is not None:
        candidates = _guided(ctx, lidar, candidates, guess)
    if not candidates:
        raise NoStart("start.no_overlap", "the lidar and the IMU share no stretch of time long enough to compare their motion")
    magnitude = ctx.settings.gravity.magnitude_m_s2
    trials: list[tuple[float, RotationStart, LinearStart]] = []
    best = candidates[0].residual
    for candidate in candidates:
        if candidate.residual > max(2.0 * best, best + 0.1):
            continue
        rotations = [candidate.R_imu_lidar]
        if candidate.open_axis_imu is not None:
            rotations = turns_about(candidate.open_axis_imu, candidate.R_imu_lidar, 24)
        for R in rotations:
            trial = replace(candidate, R_imu_lidar=R)
            linear = linear_start(lidar, ctx.clocks.imu_s, imu.accel_m_s2, trial, gravity_m_s2=magnitude)
            trials.append((linear.rms * (1.0 + candidate.residual), trial, linear))
    trials.sort(key=lambda t: t[0])
    ctx.stage("initialise", 1.0)
    return lidar, Start(trials[0][1], trials[0][2])


def _guided(ctx: Context, lidar: LidarTrack, found: list[RotationStart], guess: InitialGuess) -> list[RotationStart]:
    """What the user already knows replaces what was found."""
    offset = ctx.clocks.offset_s(guess.time_offset_ns) if guess.time_offset_ns is not None else None
    base = found[0] if found else RotationStart(0.0, np.eye(3), np.zeros(3), 1.0, 0.0, None)
    if offset is not None:
        near = [c for c in found if abs(c.time_offset_s - offset) < 0.05]
        base = near[0] if near else replace(base, time_offset_s=offset)
    if guess.R_imu_lidar is not None:
        base = replace(base, R_imu_lidar=guess.R_imu_lidar, open_axis_imu=None)
    return [base]


def first_estimate(ctx: Context, lidar: LidarTrack, start: Start, knots_s: FloatArray, planes: Sequence[Plane], nodes: int) -> Estimate:
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


def knots_over(ctx: Context, first_s: float, last_s: float, time_offset_s: float) -> FloatArray:
    """Knots on the IMU's clock that cover a span of the lidar's, as far as the IMU does."""
    spacing = knot_spacing_s(ctx.clocks.imu_s)
    low = max(ctx.clocks.imu_s[0], first_s - time_offset_s - 3 * spacing)
    high = min(ctx.clocks.imu_s[-1], last_s - time_offset_s + 3 * spacing)
    count = int(np.floor((high - low) / spacing)) + 1
    return low + spacing * np.arange(max(count, 0))


def build_problem(ctx: Context, readings: UpsampledImu, estimate: Estimate, nodes: BiasNodes, priors: Priors, bins: Bins, gauge: int) -> JointProblem:
    """Links about the estimate's own biases."""
    bg, ba = nodes.at_links(estimate.gyro_bias), nodes.at_links(estimate.accel_bias)
    links = preintegrate(readings, bg, ba, ctx.noise.density)
    frozen: list[int] = []
    if not ctx.settings.estimate_time_offset:
        frozen.append(6)
    if not ctx.settings.estimate_planes:
        start = 10 + 6 * len(nodes.times_s)
        frozen.extend(range(start, start + 3 * len(estimate.normals)))
    return JointProblem(readings, nodes, links, bg, ba, bins, priors, gauge, tuple(frozen))


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
    walk = (1e-5, 1e-4)
    noise = settings.imu_noise
    if noise is not None and not isinstance(noise, str):
        walk = (noise.gyroscope_random_walk, noise.accelerometer_random_walk)
    return Priors(reference, tuple(rows), settings.gravity.magnitude_m_s2, settings.gravity.std_m_s2, gyro_walk=walk[0], accel_walk=walk[1])


def solve(ctx: Context, lidar: LidarTrack, motions: Sequence[ScanMotion], start: Start, planes: Sequence[Plane], reference: int, guess: InitialGuess | None) -> Solved:
    """All rounds of association and joint solve."""
    first, last = float(lidar.start_s[0]), float(lidar.start_s[-1] + lidar.sweep_s[-1])
    knots = knots_over(ctx, first, last, start.rotation.time_offset_s)
    if len(knots) < 20:
        raise NoStart("start.too_short", f"the lidar and the IMU overlap for {max(last - first, 0):.1f} s only; at least a few seconds are needed")
    imu = ctx.recording.imu
    ctx.stage("associate", 0.0, "interpolating the IMU")
    readings = upsample(ctx.clocks.imu_s, imu.gyro_rad_s, imu.accel_m_s2, knots, ctx.hyper)
    nodes = BiasNodes.spread(knots, BIAS_NODE_SPACING_S if ctx.settings.bias_model == "random-walk" else None)
    estimate = first_estimate(ctx, lidar, start, knots, planes, len(nodes.times_s))
    priors = standing_priors(ctx, estimate, guess)
    gauge = int(np.argmin(np.abs(knots + estimate.time_offset_s - first)))
    positions = [m.position for m in motions]
    lidar_noise = LidarNoise(0.02, 0.005)
    empty = np.zeros(0, np.int64)
    problem = build_problem(ctx, readings, estimate, nodes, priors, Bins(empty, empty, np.zeros((0, 5, 5)), empty, estimate.time_offset_s), gauge)
    rounds = _Rounds(ctx, problem, estimate, positions, lidar_noise, reference)
    return rounds.run()


@dataclass
class _Rounds:
    """The rounds' working state."""

    ctx: Context
    problem: JointProblem
    estimate: Estimate
    positions: list[int]
    lidar_noise: LidarNoise
    reference: int
    extents: PlaneExtents | None = None
    micro: Micro | None = None
    minimum: Minimum[Estimate] | None = None
    number: int = 0

    def run(self) -> Solved:
        """Coarse to fine, to the fixed point."""
        for extra, iterations in ((0.12, 12), (0.06, 10)):
            self._associate(Gate(extra_m=extra, margin_m=0.12), stride=5)
            self._solve(iterations)
        gate = Gate(extra_m=0.02, margin_m=0.10)
        self._learn(gate)
        self._associate(Gate(extra_m=0.01, margin_m=0.10), stride=5)
        self._solve(10)
        self._learn(Gate(margin_m=0.10))
        self._associate(Gate(margin_m=0.10), stride=1)
        for _ in range(self.ctx.settings.max_rounds):
            minimum = self._solve(15)
            if minimum.first_decrease < 1e-3 and minimum.outcome is not Outcome.SINGULAR:
                break
        assert self.micro is not None and self.minimum is not None
        return Solved(self.problem, self.estimate, self.minimum, self.micro, self.lidar_noise, self.extents, float(self.ctx.clocks.scan_s[self.reference]), self.number)

    def view(self) -> View:
        return View(self.ctx.recording.scans, self.ctx.clocks.lidar_epoch_ns, self.problem.motion(self.estimate), self.estimate, self.ctx.settings, self.ctx.threads)

    def _associate(self, gate: Gate, stride: int) -> None:
        done = [0]

        def count(_: int) -> None:
            done[0] += 1
            if done[0] % 20 == 0:
                self.ctx.stage("associate", done[0] / len(self.positions), f"round {self.number + 1}")

        self.micro = associate(self.view(), self.positions, self.lidar_noise, gate, self.extents, stride=stride, on_scan=count)

    def _learn(self, gate: Gate) -> None:
        view = self.view()
        self.extents = survey(view, self.positions, self.lidar_noise, gate, stride=7)
        step = max(1, len(self.positions) // 60)
        self.lidar_noise = measure_noise(view, self.positions[::step], self.lidar_noise, gate, self.extents)

    def _solve(self, iterations: int) -> Minimum[Estimate]:
        """Preintegrate and gather about the present estimate, then descend."""
        assert self.micro is not None
        self.number += 1
        p = self.problem
        bins = gather(self.micro, p.motion(self.estimate), self.estimate)
        self.problem = build_problem(self.ctx, p.readings, self.estimate, p.nodes, p.priors, bins, p.gauge_knot)
        self.minimum = minimise(self.problem, self.estimate, max_iterations=iterations, on_step=self._report)
        self.estimate = self.minimum.estimate
        return self.minimum

    def _report(self, estimate: Estimate, cost: float, solution: ArrowSolution) -> None:
        ctx = self.ctx
        ctx.iterations += 1
        if ctx.should_cancel():
            raise Cancelled("the calibration was cancelled")
        ctx.on_event(iteration_event(ctx, self.problem, estimate, cost, solution, self.number))


def iteration_event(ctx: Context, problem: JointProblem, estimate: Estimate, cost: float, solution: ArrowSolution, round_number: int) -> IterationEvent:
    """One accepted step, for whoever watches."""
    from calib_core.pipeline.report import euler_xyz_deg, plane_residuals, transform_matrix

    cov = np.linalg.pinv(solution.information, hermitian=True)[:7, :7]
    std = np.sqrt(np.maximum(np.diag(cov), 0.0))
    return IterationEvent(
        iteration=ctx.iterations,
        round=round_number,
        cost=cost,
        matrix=transform_matrix(estimate.R_imu_lidar, estimate.p_imu_lidar).tolist(),
        translation_m=estimate.p_imu_lidar.tolist(),
        euler_xyz_deg=euler_xyz_deg(estimate.R_imu_lidar),
        time_offset_s=ctx.clocks.offset_ns(estimate.time_offset_s) * 1e-9,
        rotation_std_deg=np.degrees(std[:3]).tolist(),
        translation_std_m=std[3:6].tolist(),
        time_offset_std_s=float(std[6]),
        planes=[PlaneResidual(name=f"plane {j + 1}", rms_m=rms, points=points) for j, (rms, points) in enumerate(plane_residuals(problem, estimate))],
    )
