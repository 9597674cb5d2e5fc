"""The joint problem: what the factors cost together, and their normal equations about an estimate (state.py).

Between neighbouring knots the IMU's links (factors/imu.py), at knots the lidar's bins (lidar_factors.py), of what is shared the
priors (priors.py); and what holds whatever none of them does: the map's frame first of all.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from calib_core.factors.assembly import add_links_kernel
from calib_core.factors.imu import KNOT, PLACE, TURN, link_factors, link_residuals
from calib_core.full.joint.lidar_factors import LidarFactors
from calib_core.full.joint.motion import Motion
from calib_core.full.joint.priors import Priors, prior_rows
from calib_core.full.joint.sensors import SensorColumns
from calib_core.full.joint.settings import CHAIN
from calib_core.full.joint.state import (
    CALIBRATION,
    GRAVITY,
    ROTATION,
    TRANSLATION,
    BiasNodes,
    Bins,
    Estimate,
    Layout,
    no_bins,
)
from calib_core.full.joint.unseen import Unseen
from calib_core.geometry import hat
from calib_core.imu.preintegration import Links, NoiseDensity, UpsampledImu, preintegrate
from calib_core.solver.arrow import ArrowSolution, ArrowSystem
from calib_core.threads import workers
from calib_core.types import BoolArray, FloatArray


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
        bins = replace(no_bins(estimate.time_offset_s), nuisance=estimate.nuisance)
        return JointProblem(readings, nodes, links, bg, ba, bins, priors, gauge_knot)

    def layout(self, estimate: Estimate) -> Layout:
        """The shared columns for this number of nodes, planes and parameters of the sensors."""
        return Layout(len(self.nodes.times_s), len(estimate.normals), len(estimate.nuisance))

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
        residual = link_residuals(self.links, estimate.states, estimate.gravity, *self.bias_changes(estimate))
        lidar = self.lidar.cost(estimate)
        prior, _ = prior_rows(self.priors, self.nodes, estimate, self.layout(estimate))
        return 0.5 * float(np.sum(residual**2) + lidar + np.sum(prior**2))

    def moved(self, estimate: Estimate, solution: ArrowSolution) -> Estimate:
        """The estimate after a step."""
        fallen = self.unseen(estimate).falls(solution.step_shared[GRAVITY])
        return estimate.moved(solution.step + fallen, solution.step_shared, self.layout(estimate))

    def unseen(self, estimate: Estimate) -> Unseen:
        """The directions that no plane sees, and how knots fall along them; none where velocity is held."""
        unseen = Unseen.of(self.bins, estimate, self.readings, self.gauge_knot)
        return replace(unseen, runs=(), everywhere=np.zeros((3, 0))) if self.hold_velocity else unseen

    def linearise(self, estimate: Estimate) -> ArrowSystem:
        """The normal equations at an estimate, but for its cost, which whoever asks has looked at to come there."""
        layout = self.layout(estimate)
        known = layout.known_to_knots(*self.nodes.windows())
        system = ArrowSystem.zeros(len(self.readings.knots_s), KNOT, layout.size, known)
        # At the same time: both fill the knots' own blocks and the corner, of which the bins get some for themselves, but the
        # border in columns of their own.
        own = replace(
            system,
            diagonal=np.zeros_like(system.diagonal),
            gradient=np.zeros_like(system.gradient),
            corner=np.zeros_like(system.corner),
            gradient_shared=np.zeros_like(system.gradient_shared),
        )
        unseen = self.unseen(estimate)
        links = workers().submit(self._add_links, system, estimate, layout, unseen.seen)
        self.lidar.add_to(own, estimate, layout)
        links.result()
        unseen.let_fall(system, own, self._of_lidar(layout))
        unseen.hold(system)
        system.diagonal += own.diagonal
        system.gradient += own.gradient
        system.corner += own.corner
        system.gradient_shared += own.gradient_shared
        residual, jacobian = prior_rows(self.priors, self.nodes, estimate, layout)
        system.corner += jacobian.T @ jacobian
        system.gradient_shared += jacobian.T @ residual
        self._hold(system, estimate, layout)
        system.frozen = self.frozen
        return system

    def _hold(self, system: ArrowSystem, estimate: Estimate, layout: Layout) -> None:
        """What no factor holds stays where it is: the map's frame, knots between two silences, planes that no point sees."""
        every = np.arange(KNOT)
        if self.hold_velocity:
            system.diagonal[self.gauge_knot, every, every] += CHAIN.gauge
        elif not self.planes_hold_frame:
            self._hold_frame(system, estimate)
        else:
            # Planes that were not all in view leave the chain free to shift: held to a metre, m/s and rad it stays in place.
            system.diagonal[self.gauge_knot, every, every] += CHAIN.loose_gauge
        system.diagonal[:, every, every] += CHAIN.knot
        planes = np.arange(layout.every_plane().start, layout.every_plane().stop)
        system.corner[planes, planes] += CHAIN.plane

    def _hold_frame(self, system: ArrowSystem, estimate: Estimate) -> None:
        """The map frame is free to move as a whole: the lidar's pose at the gauge knot stays where it is.

        Not the IMU's: where its axes turn against the lidar, the whole map would have to turn with them, along an arc that a
        step of straight lines leaves by millimetres, and no step would be taken.
        """
        R, R_c, p_c = estimate.states.R[self.gauge_knot], estimate.R_imu_lidar, estimate.p_imu_lidar
        J = np.zeros((6, KNOT + CALIBRATION))
        turned, shifted = J[:3], J[3:]
        turned[:, TURN], turned[:, KNOT:][:, ROTATION] = R_c.T, np.eye(3)
        shifted[:, TURN], shifted[:, PLACE], shifted[:, KNOT:][:, TRANSLATION] = -R @ hat(p_c), np.eye(3), R
        held = CHAIN.gauge * J.T @ J
        system.diagonal[self.gauge_knot] += held[:KNOT, :KNOT]
        system.border[self.gauge_knot, :, :CALIBRATION] += held[:KNOT, KNOT:]
        system.corner[:CALIBRATION, :CALIBRATION] += held[KNOT:, KNOT:]

    def bias_changes(self, estimate: Estimate) -> tuple[FloatArray, FloatArray]:
        """Of every link since its integration, (L, 3) each; a changed intrinsic parameter is one of them."""
        gyro = self.nodes.at_links(estimate.gyro_bias) - self.links_gyro_bias
        accel = self.nodes.at_links(estimate.accel_bias) - self.links_accel_bias
        if len(self.sensors.imu_places):
            change = estimate.nuisance[self.sensors.imu_places] - self.sensors.links_at
            gyro = gyro + self.sensors.gyro @ change
            accel = accel + self.sensors.accel @ change
        return gyro, accel

    def _of_lidar(self, layout: Layout) -> BoolArray:
        """(S,) the shared columns that no link sees."""
        seen = np.ones(layout.size, np.bool_)
        seen[GRAVITY.start : layout.every_plane().start] = False
        seen[layout.nuisance().start + self.sensors.imu_places] = False
        return seen

    def links_at_once(self) -> Iterator[tuple[int, int]]:
        """First and last (exclusive) of links in parts: of an hour's recording the Jacobians of all would be gigabytes."""
        count, columns = len(self.links.DR), len(self.sensors.imu_places)
        at_once = CHAIN.links_at_once * CHAIN.columns_at_once // max(columns, CHAIN.columns_at_once)
        for first in range(0, count, at_once):
            yield first, min(first + at_once, count)

    def _add_links(self, system: ArrowSystem, estimate: Estimate, layout: Layout, seen: FloatArray) -> None:
        """seen: (3, 3) of gravity, what is not along a direction that no plane sees."""
        columns, (window, width) = layout.nuisance().start + self.sensors.imu_places, self.nodes.windows()
        gyro, accel = self.bias_changes(estimate)
        for first, last in self.links_at_once():
            some, ends = slice(first, last), slice(first, last + 1)
            f = link_factors(
                self.links.part(first, last), estimate.states.part(first, last + 1), estimate.gravity, gyro[some], accel[some]
            )  # fmt: skip
            own = np.zeros((len(f.residual), KNOT, len(columns)))
            if len(columns):
                own = f.r_D_gyro_bias @ self.sensors.gyro[some] + f.r_D_accel_bias @ self.sensors.accel[some]
            add_links_kernel(
                f.r_D_first, f.r_D_second, f.r_D_gravity @ seen, f.r_D_gyro_bias, f.r_D_accel_bias, own, f.residual,
                self.nodes.node[some], self.nodes.fraction[some], layout.nodes, GRAVITY.start, columns, window[ends], width,
                system.diagonal[ends], system.lower[some], system.border[ends], system.corner, system.gradient[ends],
                system.gradient_shared,
            )  # fmt: skip
