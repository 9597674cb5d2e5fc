"""Rounds of the solve (III-A): the problem of one linearisation, and its weights at an estimate."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_core.paper.lidar_factor import CalibrationState, LidarMeasurements
from calib_core.paper.preintegration import ScanPreintegration, preintegrate_scans
from calib_core.paper.prepare import Run
from calib_core.paper.problem import PaperProblem, PaperState
from calib_core.paper.weights import balanced_weights, distance_variance, identity_weights
from calib_core.types import FloatArray, IntArray


@dataclass(frozen=True)
class Round:
    """A problem and what it was linearised about. plane_of_point: (N,).   time_offset_s: the expansion's."""

    problem: PaperProblem
    preintegration: ScanPreintegration
    plane_of_point: IntArray
    gyro_bias: FloatArray
    accel_bias: FloatArray
    time_offset_s: float


def expand(run: Run, about: Round | None, state: PaperState) -> tuple[Round, PaperState]:
    """Preintegration about the prior, or about a previous round's estimate, whose corrections then start at zero."""
    c = state.shared
    if about is None:
        gyro_bias, accel_bias, offset_s = np.zeros(3), np.zeros(3), run.time_offset_s
    else:
        gyro_bias = about.gyro_bias + c.gyro_bias_delta
        accel_bias = about.accel_bias + c.accel_bias_delta
        offset_s = about.time_offset_s + c.time_delta_s
        state = PaperState(CalibrationState(c.R_imu_lidar, c.p_imu_lidar, np.zeros(3), np.zeros(3), 0.0), state.knots)
    timeline = run.timeline
    preintegration = preintegrate_scans(
        run.source,
        timeline.start_s,
        timeline.duration_s,
        time_offset_prior_s=offset_s,
        gyro_bias_prior=gyro_bias,
        accel_bias_prior=accel_bias,
        rate_hz=run.options.upsampling_hz,
        as_printed=run.options.eq_3 == "printed",
    )
    problem, plane = _problem(run, preintegration)
    return Round(problem, preintegration, plane, gyro_bias, accel_bias, offset_s), state


def _problem(run: Run, preintegration: ScanPreintegration) -> tuple[PaperProblem, IntArray]:
    """The measurements of all scans, covariances at identity; and the plane of each point."""
    timeline = run.timeline
    # The first scan made the map; measuring it against itself would say nothing.
    scans = run.front.scans[1:]
    knot_of_position = {int(position): knot for knot, position in enumerate(timeline.position)}
    knot = np.concatenate([np.full(scan.plane.size, knot_of_position[scan.position]) for scan in scans])
    plane = np.concatenate([scan.plane for scan in scans])
    elapsed = np.concatenate([scan.elapsed_s for scan in scans])
    if run.options.motion_in_sweep == "none":
        elapsed = np.zeros_like(elapsed)
    measurements = LidarMeasurements(
        np.concatenate([scan.points_lidar for scan in scans]),
        np.array([each.normal for each in run.front.planes])[plane],
        np.array([each.offset_m for each in run.front.planes])[plane],
        elapsed,
        preintegration.at(knot, elapsed),
    )
    links = preintegration.to_next().first(timeline.start_s.size - 1)
    problem = PaperProblem(
        measurements,
        knot,
        links,
        timeline.duration_s[:-1],
        run.gravity_world,
        identity_weights(plane.size, len(scans), timeline.start_s.size - 1),
        run.options.fixed_states is not None,
    )
    return problem, plane


def reweighted(run: Run, rounds: Round, state: PaperState) -> Round:
    """The same round with the noise propagated at an estimate and the factors balanced (III-A, III-B)."""
    problem = rounds.problem
    pre = problem.lidar.preintegrated
    variance = distance_variance(problem.lidar_factors(state), pre, problem.lidar.points_lidar, run.range_std_m)
    covariances = np.stack([problem.links.cov_R, problem.links.cov_v, problem.links.cov_p])
    weights = balanced_weights(1.0 / variance, len(run.front.scans) - 1, covariances)
    return replace(rounds, problem=replace(problem, weights=weights))
