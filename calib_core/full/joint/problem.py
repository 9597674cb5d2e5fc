"""The joint problem: what the factors cost together, and their normal equations about an estimate (state.py).

Between neighbouring knots the IMU's links (factors/imu.py), at knots the lidar's bins (lidar_factors.py), of what is shared the
priors (priors.py); and what holds whatever none of them does: the map's frame first of all (equations.py).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from calib_core.factors.imu import link_residuals
from calib_core.full.joint.equations import Datum, JointEquations
from calib_core.full.joint.lidar_factors import LidarFactors
from calib_core.full.joint.motion import Motion
from calib_core.full.joint.priors import Priors, prior_rows
from calib_core.full.joint.sensors import SensorColumns
from calib_core.full.joint.settings import CHAIN
from calib_core.full.joint.state import BiasNodes, Bins, Estimate, Layout, no_bins
from calib_core.full.joint.unseen_directions import Unseen
from calib_core.imu.preintegration import Links, NoiseDensity, UpsampledImu, preintegrate
from calib_core.solver.arrow import ArrowSolution
from calib_core.types import FloatArray


@dataclass(frozen=True)
class JointProblem:
    """Factors at one linearisation: links about their biases, bins about their time offset.

    gauge_knot: whose pose defines the map frame while solving, its velocity too where hold_velocity.   frozen: shared
    columns held fixed.   planes_hold_frame: frozen planes define the map frame, and no knot may.
    """

    readings: UpsampledImu
    nodes: BiasNodes
    links: Links
    links_gyro_bias: FloatArray
    links_accel_bias: FloatArray
    bins: Bins
    priors: Priors
    gauge_knot: int
    frozen: tuple[int, ...] = ()
    hold_velocity: bool = False
    planes_hold_frame: bool = False
    sensors: SensorColumns = field(default_factory=SensorColumns)

    @staticmethod
    def linked(
        readings: UpsampledImu,
        nodes: BiasNodes,
        estimate: Estimate,
        priors: Priors,
        density: NoiseDensity,
        *,
        gauge_knot: int,
    ) -> JointProblem:
        """The readings' links about the estimate's biases, and no points yet."""
        bg, ba = nodes.at_links(estimate.gyro_bias), nodes.at_links(estimate.accel_bias)
        links = preintegrate(readings, bg, ba, density)
        return JointProblem(readings, nodes, links, bg, ba, no_bins(estimate.time_offset_s), priors, gauge_knot)

    def layout(self, estimate: Estimate) -> Layout:
        """The shared columns for this number of nodes, planes and parameters of the sensors."""
        return Layout(len(self.nodes.times_s), len(estimate.normals), estimate.sensors.blocks.size)

    @property
    def lidar(self) -> LidarFactors:
        """The lidar's part of it."""
        return LidarFactors(self.bins, self.sensors, self.readings, self.nodes)

    def motion(self, estimate: Estimate) -> Motion:
        """The motion an estimate describes."""
        return Motion(
            self.readings,
            estimate.states,
            self.nodes.at_knots(estimate.gyro_bias),
            self.nodes.at_knots(estimate.accel_bias),
            estimate.gravity,
        )

    def cost(self, estimate: Estimate) -> float:
        """Half the sum of squares of everything."""
        links, changes, squares = self.seen_links(estimate), self.bias_changes(estimate), 0.0
        count = len(links.DR)
        for first in range(0, count, CHAIN.knots_at_once):
            last = min(first + CHAIN.knots_at_once, count)
            states, of = estimate.states.part(first, last + 1), (each[first:last] for each in changes)
            residual = link_residuals(links.part(first, last), states, estimate.gravity, *of)
            squares += float(np.sum(residual**2))
        lidar = self.lidar.cost(estimate)
        prior, _ = prior_rows(self.priors, self.nodes, estimate, self.layout(estimate))
        return 0.5 * float(squares + lidar + np.sum(prior**2))

    def moved(self, estimate: Estimate, solution: ArrowSolution) -> Estimate:
        """The estimate after a step."""
        moved = estimate.moved(solution.step, solution.step_shared, self.layout(estimate))
        carried = self.unseen(moved).carried(moved.states, self.links, moved.gravity, *self.bias_changes(moved))
        return replace(moved, states=carried)

    def seen_links(self, estimate: Estimate) -> Links:
        """The links by what they have along directions that some plane sees."""
        return self.unseen(estimate).without(self.links, estimate.states.R)

    def unseen(self, estimate: Estimate) -> Unseen:
        """The directions that no plane sees; none where velocity is held."""
        unseen = Unseen.of(self.bins, estimate, self.readings, self.gauge_knot)
        return replace(unseen, runs=(), everywhere=np.zeros((3, 0))) if self.hold_velocity else unseen

    def linearise(self, estimate: Estimate) -> JointEquations:
        """The normal equations at an estimate."""
        layout, datum = self.layout(estimate), Datum(self.gauge_knot, self.hold_velocity, self.planes_hold_frame)
        prior = prior_rows(self.priors, self.nodes, estimate, layout)
        changes, unseen = self.bias_changes(estimate), self.unseen(estimate)
        lidar = replace(self.lidar, held=tuple(column - layout.nuisance().start for column in self.frozen))
        return JointEquations(
            unseen.without(self.links, estimate.states.R), self.nodes, self.sensors, lidar, estimate, layout, *changes,
            prior, unseen, datum, self.frozen,
        )  # fmt: skip

    def bias_changes(self, estimate: Estimate) -> tuple[FloatArray, FloatArray]:
        """Of every link since its integration, (L, 3) each; a changed intrinsic parameter is one of them."""
        gyro = self.nodes.at_links(estimate.gyro_bias) - self.links_gyro_bias
        accel = self.nodes.at_links(estimate.accel_bias) - self.links_accel_bias
        if len(self.sensors.imu_places):
            change = estimate.sensors.since(self.sensors.links_at)[self.sensors.imu_places]
            if change.any():
                own = self.sensors.biases(change)
                gyro, accel = gyro + own[0], accel + own[1]
        return gyro, accel
