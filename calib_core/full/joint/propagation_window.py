"""The last second of a propagated estimate: predicted by the IMU, then corrected by the points that lie on known planes.

Everything shared is held fixed: a second of points says nothing of a calibration that the whole has told. The sensors are
taken for ideal: an estimate is propagated before their own parameters are admitted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_core.factors.imu import KnotStates
from calib_core.full.joint.estimation import Estimation, JointData, view_of
from calib_core.full.joint.moments import Micro, gather
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.sensor_state import SensorState
from calib_core.full.joint.state import Estimate
from calib_core.full.joint.view import View
from calib_core.geometry import exp
from calib_core.imu.preintegration import Links, UpsampledImu
from calib_core.solver.levenberg import minimise
from calib_core.types import FloatArray


@dataclass(frozen=True, slots=True)
class Window:
    """Some knots in a row, their states and the problem over them. start: the first one's place among all knots."""

    estimate: Estimate
    problem: JointProblem
    start: int

    def view(self, data: JointData) -> View:
        """The scans under the window's motion."""
        ideal = replace(self.estimate, sensors=SensorState())
        return view_of(data.run, self.problem.motion(self.estimate), ideal)

    def scans_over(self, data: JointData) -> list[int]:
        """Positions of the scans that reach into the window."""
        clocks, knots_s = data.run.clocks, self.problem.readings.knots_s
        low, high = knots_s[0] + self.estimate.time_offset_s, knots_s[-1] + self.estimate.time_offset_s
        return [int(i) for i in np.flatnonzero((clocks.scan_s + clocks.sweep_s > low) & (clocks.scan_s < high))]

    def corrected(self, points: Micro, *, iterations: int, least_decrease: float) -> Window:
        """The window after a descent on these points."""
        bins = gather(points, self.problem.motion(self.estimate), self.estimate)
        problem = replace(self.problem, bins=bins)
        minimum = minimise(problem, self.estimate, max_iterations=iterations, tolerance=least_decrease)
        return Window(minimum.estimate, problem, self.start)

    def joined_to(self, state: Estimation) -> Estimation:
        """The whole estimate with the window's states in place of its own, and beyond them."""
        kept = state.estimate.states.part(0, self.start)
        states = KnotStates.joined(kept, self.estimate.states)
        return replace(state, estimate=replace(state.estimate, states=states))


def predict(data: JointData, state: Estimation, start: int, end: int) -> Window:
    """The knots from `start` (not before the first) to `end`; those beyond the last estimated one predicted."""
    start = max(0, start)
    e = state.estimate
    nodes, readings = data.nodes.part(start, end), data.readings.part(start, end)
    problem = JointProblem.linked(readings, nodes, e, state.priors, data.run.noise.density, gauge_knot=0)
    problem = replace(problem, hold_velocity=True, frozen=tuple(range(problem.layout(e).size)))
    states = predicted(e.states.part(start, state.knots), problem.links, readings, state.knots - start, e.gravity)
    return Window(replace(e, states=states), problem, start)


def predicted(known: KnotStates, links: Links, readings: UpsampledImu, count: int, gravity: FloatArray) -> KnotStates:
    """States continued over the links beyond the first `count` knots; where the IMU was silent, at constant velocity and rate."""
    R, p, v = [*known.R], [*known.p], [*known.v]
    h = links.h_s
    for k in range(count - 1, len(links.DR)):
        turn, Dv, Dp = links.DR[k], links.Dv[k], links.Dp[k]
        if not readings.linked[k]:
            turn = exp(readings.knot_gyro[k] * h)
            Dv, Dp = -R[-1].T @ gravity * h, -R[-1].T @ gravity * (0.5 * h**2)
        p.append(p[-1] + v[-1] * h + 0.5 * h**2 * gravity + R[-1] @ Dp)
        v.append(v[-1] + h * gravity + R[-1] @ Dv)
        R.append(R[-1] @ turn)
    return KnotStates(np.array(R), np.array(p), np.array(v))
