"""The joint problem: knots, calibration, biases, gravity and planes, their factors, and one step of their estimate.

State (perturbations in the order of the shared columns): R_imu_lidar Exp(theta), p_imu_lidar, time offset, gravity in the
map frame, gyro and accelerometer bias at nodes every few seconds (linear in between), each plane's normal n + B eta in its
own two axes and its offset; and per knot the IMU's R Exp(phi), p, v.

How a bin of points at knot k sees plane j, and what moves that: factors/planes_seen.py.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from calib_core.factors.assembly import add_bins_kernel, add_links_kernel
from calib_core.factors.imu import link_factors, link_residuals
from calib_core.factors.laser_features import LaserFactors, feature_changes, features_squares
from calib_core.factors.laser_kernels import add_features_kernel
from calib_core.factors.planes_seen import planes_seen_kernel
from calib_core.full.joint.motion import Motion
from calib_core.full.joint.priors import Priors, prior_rows
from calib_core.full.joint.sensors import SensorColumns
from calib_core.full.joint.settings import CHAIN
from calib_core.full.joint.state import (
    CALIBRATION,
    GRAVITY,
    ROTATION,
    TIME_OFFSET,
    TRANSLATION,
    BiasNodes,
    Bins,
    Estimate,
    Layout,
)
from calib_core.geometry import exp, hat, plane_axes
from calib_core.imu.preintegration import Links, UpsampledImu
from calib_core.solver.arrow import ArrowSolution, ArrowSystem
from calib_core.threads import workers
from calib_core.types import FloatArray, IntArray

#: Columns of a bin's derivative: nine of its knot, the seven, three of its plane; the clocks' rate comes beside them.
_BIN_COLUMNS = 19


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

    def layout(self, estimate: Estimate) -> Layout:
        """The shared columns for this number of nodes, planes and parameters of the sensors."""
        return Layout(len(self.nodes.times_s), len(estimate.normals), len(estimate.nuisance))

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
        a = self.planes_seen(estimate)
        lidar = np.einsum("bi,bij,bj->", a, self.bins.scatter, a, optimize=True)
        if len(self.bins.lasers.laser):
            seen = self._seen_by_lasers(estimate)
            lidar += float(features_squares(self.bins.lasers, seen, self.laser_changes(estimate)).sum())
        prior, _ = prior_rows(self.priors, self.nodes, estimate, self.layout(estimate))
        return 0.5 * float(np.sum(residual**2) + lidar + np.sum(prior**2))

    def linearise(self, estimate: Estimate) -> ArrowSystem:
        """The normal equations at an estimate."""
        layout = self.layout(estimate)
        system = ArrowSystem.zeros(len(self.readings.knots_s), 9, layout.size)
        # At the same time: both fill the knots' own blocks and the corner, of which the bins get some for themselves, but the
        # border in columns of their own.
        own = replace(
            system,
            diagonal=np.zeros_like(system.diagonal),
            gradient=np.zeros_like(system.gradient),
            corner=np.zeros_like(system.corner),
            gradient_shared=np.zeros_like(system.gradient_shared),
        )
        links = workers().submit(self._add_links, system, estimate, layout)
        self._add_bins(own, estimate, layout)
        links.result()
        system.diagonal += own.diagonal
        system.gradient += own.gradient
        system.corner += own.corner
        system.gradient_shared += own.gradient_shared
        system.cost += own.cost
        residual, jacobian = prior_rows(self.priors, self.nodes, estimate, layout)
        system.corner += jacobian.T @ jacobian
        system.gradient_shared += jacobian.T @ residual
        system.cost += 0.5 * float(residual @ residual)
        every, pose, vel = np.arange(9), np.arange(6), np.arange(6, 9)
        if self.hold_velocity:
            system.diagonal[self.gauge_knot, every, every] += CHAIN.gauge
        elif not self.planes_hold_frame:
            self._hold_frame(system, estimate)
        else:
            # Planes that were not all in view leave the chain free to shift: held to a metre, m/s and rad it stays in place.
            system.diagonal[self.gauge_knot, every, every] += CHAIN.loose_gauge
        system.diagonal[:, vel, vel] += CHAIN.knot
        system.diagonal[:, pose, pose] += CHAIN.knot
        planes = np.arange(layout.every_plane().start, layout.every_plane().stop)
        system.corner[planes, planes] += CHAIN.plane  # a plane that no point sees stays where it is
        system.frozen = self.frozen
        return system

    def _hold_frame(self, system: ArrowSystem, estimate: Estimate) -> None:
        """The map frame is free to move as a whole: the lidar's pose at the gauge knot stays where it is.

        Not the IMU's: where its axes turn against the lidar, the whole map would have to turn with them, along an arc that a
        step of straight lines leaves by millimetres, and no step would be taken.
        """
        R, R_c, p_c = estimate.states.R[self.gauge_knot], estimate.R_imu_lidar, estimate.p_imu_lidar
        J = np.zeros((6, 9 + CALIBRATION))
        shared = J[:, 9:]
        J[:3, :3], shared[:3, ROTATION] = R_c.T, np.eye(3)
        J[3:, :3], J[3:, 3:6], shared[3:, TRANSLATION] = -R @ hat(p_c), np.eye(3), R
        held = CHAIN.gauge * J.T @ J
        system.diagonal[self.gauge_knot] += held[:9, :9]
        system.border[self.gauge_knot, :, :CALIBRATION] += held[:9, 9:]
        system.corner[:CALIBRATION, :CALIBRATION] += held[9:, 9:]

    def moved(self, estimate: Estimate, solution: ArrowSolution) -> Estimate:
        """The estimate after a step."""
        s = solution.step_shared
        layout = self.layout(estimate)
        planes = s[layout.every_plane()].reshape(-1, 3)
        axes = plane_axes(estimate.normals)
        normals = estimate.normals + np.einsum("pi,pij->pj", planes[:, :2], axes)
        # Turning a normal about the origin and renormalising: the offset follows the same scale.
        length = np.linalg.norm(normals, axis=1)
        # Gravity turns, and its magnitude changes, each by what the step says: a magnitude that is given to a ten-millionth
        # would let no step pass that adds to its square.
        gravity = estimate.gravity + s[GRAVITY]
        magnitude = float(np.linalg.norm(estimate.gravity))
        gravity *= (magnitude + float(estimate.gravity @ s[GRAVITY]) / magnitude) / float(np.linalg.norm(gravity))
        return replace(
            estimate,
            states=estimate.states.moved(solution.step),
            R_imu_lidar=estimate.R_imu_lidar @ exp(s[ROTATION]),
            p_imu_lidar=estimate.p_imu_lidar + s[TRANSLATION],
            time_offset_s=estimate.time_offset_s + float(s[TIME_OFFSET]),
            gravity=gravity,
            gyro_bias=estimate.gyro_bias + s[layout.gyro_bias()].reshape(-1, 3),
            accel_bias=estimate.accel_bias + s[layout.accel_bias()].reshape(-1, 3),
            normals=normals / length[:, None],
            offsets_m=(estimate.offsets_m + planes[:, 2]),
            nuisance=estimate.nuisance + s[layout.nuisance()],
        )

    def bias_changes(self, estimate: Estimate) -> tuple[FloatArray, FloatArray]:
        """Of every link since its integration, (L, 3) each; a changed intrinsic parameter is one of them."""
        gyro = self.nodes.at_links(estimate.gyro_bias) - self.links_gyro_bias
        accel = self.nodes.at_links(estimate.accel_bias) - self.links_accel_bias
        if len(self.sensors.imu_places):
            change = estimate.nuisance[self.sensors.imu_places] - self.sensors.links_at
            gyro = gyro + self.sensors.gyro @ change
            accel = accel + self.sensors.accel @ change
        return gyro, accel

    def _clock_shift_s(self, estimate: Estimate, knot: IntArray) -> FloatArray | float:
        """How much later than at their making the bins of these knots are, by a changed rate of the clocks."""
        place = self.sensors.clock_place
        if place < 0:
            return 0.0
        return np.asarray((estimate.nuisance[place] - self.bins.nuisance[place]) * self._clock_lever_s(estimate, knot))

    def _clock_lever_s(self, estimate: Estimate, knot: IntArray) -> FloatArray:
        """Seconds of offset for a ppm of rate, at knots."""
        lidar_s = self.readings.knots_s[knot] + estimate.time_offset_s
        return np.asarray(1e-6 * (lidar_s - self.sensors.clock_middle_s))

    def sums(self, estimate: Estimate) -> FloatArray:
        """Sum of weighted distances of every bin's points, (B,) [1/m]."""
        a = self.planes_seen(estimate)
        total = np.einsum("bi,bi->b", self.bins.scatter[:, 3, :], a)
        if len(self.bins.lasers.laser):
            lasers = self.bins.lasers
            change = feature_changes(self.laser_changes(estimate))[lasers.laser]
            total += self._by_bin(np.einsum("bf,bf->b", change, lasers.cross[:, :, 3]))
        return total

    def squares(self, estimate: Estimate) -> FloatArray:
        """Sum of weighted squared distances of every bin's points, (B,)."""
        a = self.planes_seen(estimate)
        total = np.einsum("bi,bij,bj->b", a, self.bins.scatter, a, optimize=True)
        if len(self.bins.lasers.laser):
            seen = self._seen_by_lasers(estimate)
            total += self._by_bin(features_squares(self.bins.lasers, seen, self.laser_changes(estimate)))
        return np.asarray(total)

    def _by_bin(self, of_cluster: FloatArray) -> FloatArray:
        """Summed over the lasers' clusters (C,) of each bin: (B,)."""
        place = self.bin_of_pair()[self.bins.lasers.pair]
        return np.bincount(place, of_cluster, len(self.bins.plane)).astype(np.float64)

    def bin_of_pair(self) -> IntArray:
        """(Q,) the bin of each pair of a knot and a plane that the lasers' moments are of: they are of the same points."""
        lasers, bins = self.bins.lasers, self.bins
        planes = int(max(bins.plane.max(initial=0), lasers.plane.max(initial=0))) + 1
        keys = bins.knot * planes + bins.plane
        order = np.argsort(keys)
        place = np.searchsorted(keys[order], lasers.knot * planes + lasers.plane)
        return np.asarray(order[np.minimum(place, len(keys) - 1)])

    def laser_changes(self, estimate: Estimate) -> FloatArray:
        """(L, 8) of each laser's columns since the points were laid out."""
        change = estimate.nuisance - self.bins.nuisance
        places = self.sensors.laser_places
        return np.where(places >= 0, change[places], 0.0)

    def _add_links(self, system: ArrowSystem, estimate: Estimate, layout: Layout) -> None:
        f = link_factors(self.links, estimate.states, estimate.gravity, *self.bias_changes(estimate))
        system.cost += 0.5 * float(np.sum(f.residual**2))
        columns = layout.nuisance().start + self.sensors.imu_places
        own = np.zeros((len(f.residual), 9, len(columns)))
        if len(columns):
            own = f.r_D_gyro_bias @ self.sensors.gyro + f.r_D_accel_bias @ self.sensors.accel
        add_links_kernel(
            f.r_D_first, f.r_D_second, f.r_D_gravity, f.r_D_gyro_bias, f.r_D_accel_bias, own, f.residual,
            self.nodes.node, self.nodes.fraction, layout.nodes, GRAVITY.start, columns,
            system.diagonal, system.lower, system.border, system.corner, system.gradient, system.gradient_shared,
        )  # fmt: skip

    def planes_seen(self, estimate: Estimate) -> FloatArray:
        """A = [n_lidar, w_lidar, 1] of every bin, (B, 5)."""
        return self._seen(estimate, self.bins.knot, self.bins.plane, 0)[0]

    def _seen_by_lasers(self, estimate: Estimate) -> FloatArray:
        return self._seen(estimate, self.bins.lasers.knot, self.bins.lasers.plane, 0)[0]

    def bins_seen(self, estimate: Estimate) -> tuple[FloatArray, FloatArray]:
        """A of every bin (B, 5) and the Jacobian of its first four (B, 4, 19), or 20 with the clocks' rate."""
        return self._seen(estimate, self.bins.knot, self.bins.plane, self._columns)

    def lasers_seen(self, estimate: Estimate) -> tuple[FloatArray, FloatArray]:
        """The same of every pair of a knot and a plane that the lasers' moments are of."""
        lasers = self.bins.lasers
        return self._seen(estimate, lasers.knot, lasers.plane, self._columns)

    @property
    def _columns(self) -> int:
        return _BIN_COLUMNS + (self.sensors.clock_place >= 0)

    def _seen(self, estimate: Estimate, knot: IntArray, plane: IntArray, columns: int) -> tuple[FloatArray, FloatArray]:
        e = estimate
        a, J = np.empty((len(knot), 5)), np.empty((len(knot) if columns else 0, 4, columns))
        lever_s = self._clock_lever_s(e, knot) if columns > _BIN_COLUMNS else np.zeros(0)
        planes_seen_kernel(
            knot, plane, e.states.R, e.states.p, e.states.v, self._rates(e), self._later_s(e, knot),
            e.R_imu_lidar, e.p_imu_lidar, e.normals, e.offsets_m, plane_axes(e.normals), lever_s, a, J,
        )  # fmt: skip
        return a, J

    def _rates(self, estimate: Estimate) -> FloatArray:
        """(K, 3) [rad/s] at which the IMU turns at its knots."""
        return np.asarray(self.readings.knot_gyro - self.nodes.at_knots(estimate.gyro_bias))

    def _later_s(self, estimate: Estimate, knot: IntArray) -> FloatArray:
        """(B,) by how much earlier than at their making bins of these knots look their poses up."""
        delta = estimate.time_offset_s - self.bins.time_offset_s + self._clock_shift_s(estimate, knot)
        return np.zeros(len(knot)) + delta

    def bin_poses(self, estimate: Estimate) -> tuple[FloatArray, FloatArray]:
        """The IMU's poses at the bins: R (B, 3, 3), p (B, 3)."""
        knot, s = self.bins.knot, estimate.states
        delta = self._later_s(estimate, knot)[:, None]
        return s.R[knot] @ exp(-self._rates(estimate)[knot] * delta), s.p[knot] - s.v[knot] * delta

    def _add_bins(self, system: ArrowSystem, estimate: Estimate, layout: Layout) -> None:
        b = self.bins
        a, J = self.bins_seen(estimate)
        clock = layout.nuisance().start + self.sensors.clock_place
        Ma = (b.scatter @ a[..., None])[..., 0]
        system.cost += 0.5 * float(np.einsum("bi,bi->", a, Ma))
        add_bins_kernel(
            b.knot, b.plane, J, b.scatter, Ma, layout.every_plane().start, clock,
            system.diagonal, system.border, system.corner, system.gradient, system.gradient_shared,
        )  # fmt: skip
        if len(b.lasers.laser):
            self._add_lasers(system, estimate, layout, b.lasers)

    def _add_lasers(self, system: ArrowSystem, estimate: Estimate, layout: Layout, lasers: LaserFactors) -> None:
        a, J = self.lasers_seen(estimate)
        change = self.laser_changes(estimate)
        places, start = self.sensors.laser_places, layout.nuisance().start
        system.cost += 0.5 * float(features_squares(lasers, a, change).sum())
        add_features_kernel(
            lasers.pair, lasers.knot, lasers.plane, lasers.laser, J, a, lasers.cross, lasers.gram,
            np.where(places >= 0, start + places, -1), feature_changes(change), layout.every_plane().start,
            start + self.sensors.clock_place, system.gradient, system.border, system.corner, system.gradient_shared,
        )  # fmt: skip
