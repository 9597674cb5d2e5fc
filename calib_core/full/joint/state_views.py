"""What the present state says: the motion, the scans as they are seen by it, the problem about it. Nothing here changes it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.factors.support import cells_within
from calib_core.full.joint.estimation import Estimation, JointData, LastLinked, lidar_pose
from calib_core.full.joint.motion import Motion
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.sensors import sensor_columns, true_readings
from calib_core.full.joint.settings import CHAIN
from calib_core.full.joint.state import TIME_OFFSET, Estimate, Layout
from calib_core.full.joint.view import View
from calib_core.imu.preintegration import UpsampledImu
from calib_core.types import BoolArray, FloatArray


def outlined_cells(data: JointData, state: Estimation) -> BoolArray | None:
    """The cells (P, rows, columns) that the given outlines leave to their planes; None where there is no outline."""
    if all(plane.outline_m is None for plane in state.planes):
        return None
    # Planes that are held hold the frame too; otherwise it has drifted with the motion, and the outlines with it.
    R, p = map_pose(data, state) if data.run.settings.estimate_planes else (np.eye(3), np.zeros(3))
    here = [None if plane.outline_m is None else plane.outline_m @ R.T + p for plane in state.planes]
    return cells_within(state.estimate.normals, here)


def map_pose(data: JointData, state: Estimation) -> tuple[FloatArray, FloatArray]:
    """The frame of the track in that of the solve, by the present estimate: R (3, 3), p (3,)."""
    return lidar_pose(motion_of(data, state), state.estimate, _scan_s(data, state, data.reference))


def first_used_s(data: JointData, state: Estimation) -> float:
    """When the lidar defines the map that is told: the first used scan's time, by a clock that runs at the IMU's rate."""
    assert state.observations is not None
    return _scan_s(data, state, int(state.observations.scan.min()))


def _scan_s(data: JointData, state: Estimation, position: int) -> float:
    rate_ppm = state.estimate.sensors.clock_rate_ppm()
    return float(data.run.clocks.at_rate(rate_ppm).scan_s[position])


def present_view(data: JointData, state: Estimation) -> View:
    """The scans under the present estimate."""
    return data.laid_out.of(data.run, motion_of(data, state), state.estimate)


def readings_of(data: JointData, state: Estimation) -> UpsampledImu:
    """The readings over the estimated knots, without the IMU's own scale, axes and delay and what shook it unseen, as these are
    thought to be."""
    e = state.estimate
    if not e.sensors.blocks.blocks:
        return data.readings.part(0, state.knots)
    last = _linked(data, e)
    if last.readings is None:
        asked = data.asked.at(data.run, data.readings, e.sensors.imu().accel_delay_s)
        last.readings = true_readings(asked.part(0, state.knots), e.sensors, e.states.R)
    return last.readings


def _linked(data: JointData, estimate: Estimate) -> LastLinked:
    """What the last step has made about this estimate, if it was that."""
    return data.linked.about(estimate, data.readings, data.nodes, data.run.noise, data.run.clocks)


def motion_of(data: JointData, state: Estimation) -> Motion:
    """The motion that the present estimate describes."""
    e = state.estimate
    nodes, readings = data.nodes.part(0, state.knots), readings_of(data, state)
    return Motion(readings, e.states, nodes.at_knots(e.gyro_bias), nodes.at_knots(e.accel_bias), e.gravity)


def problem_of(data: JointData, state: Estimation) -> JointProblem:
    """The joint problem over the knots estimated so far, linked about the present biases and sensors."""
    e, last = state.estimate, _linked(data, state.estimate)
    if last.problem is None:
        nodes, readings = data.nodes.part(0, state.knots), readings_of(data, state)
        last.problem = replace(
            JointProblem.linked(readings, nodes, e, state.priors, data.run.noise.density, gauge_knot=data.gauge),
            sensors=sensor_columns(e.sensors, readings, e.states.R, data.run.clocks.middle_s),
        )
    held = not data.run.settings.estimate_planes
    problem = replace(last.problem, priors=state.priors, gauge_knot=data.gauge, planes_hold_frame=held)
    return replace(problem, frozen=frozen_columns(data, problem, e))


def with_tones_beside(data: JointData, problem: JointProblem, state: Estimation) -> JointProblem:
    """The problem for a state with tones among its unknowns that were not there, none of which is of any size yet: the readings,
    their links, what else the IMU has and what is gathered stay as they are."""
    e, imu = state.estimate, problem.sensors.imu
    sensors = sensor_columns(e.sensors, problem.readings, e.states.R, data.run.clocks.middle_s, imu)
    return replace(problem, priors=state.priors, sensors=sensors)


def layout_of(data: JointData, state: Estimation) -> Layout:
    """Where each shared unknown has its columns."""
    return Layout(len(data.nodes.times_s), len(state.planes), state.nuisance.size)


def frozen_columns(data: JointData, problem: JointProblem, estimate: Estimate) -> tuple[int, ...]:
    """The shared columns that the settings hold fixed, or that hardly any point says anything of."""
    settings, layout = data.run.settings, problem.layout(estimate)
    frozen: list[int] = []
    if not settings.estimate_time_offset:
        frozen.append(TIME_OFFSET)
    if not settings.estimate_planes:
        for j in range(layout.planes):
            columns = layout.plane(j)
            frozen.extend(range(columns.start, columns.stop))
    if settings.intrinsics == "consider":
        frozen.extend(range(layout.nuisance().start, layout.nuisance().start + data.sensors.size))
    frozen.extend(hardly_seen_columns(problem, layout))
    return tuple(frozen)


def hardly_seen_columns(problem: JointProblem, layout: Layout) -> list[int]:
    """The columns of planes that some points lie on, too few to tell them."""
    points = np.bincount(problem.bins.plane, problem.bins.count, layout.planes)
    few = np.flatnonzero((points > 0) & (points < CHAIN.fewest_points))
    return [column for j in few.tolist() for column in range(layout.plane(j).start, layout.plane(j).stop)]
