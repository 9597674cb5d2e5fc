"""The lidar's factors: how bins of points see their planes at an estimate, what that moves with, and what it costs.

A bin of points at knot k sees plane j as a = [n_lidar, w_lidar, 1] (factors/planes_seen.py) and adds a' M a to twice the cost,
M its scatter; where the lasers' own parameters are unknowns, their moments add what these change (factors/laser_features.py).
"""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from calib_core.factors.assembly import add_bins_kernel
from calib_core.factors.laser_assembly import add_features_kernel, add_grams_kernel
from calib_core.factors.laser_features import feature_changes, features_squares
from calib_core.factors.planes_seen import COLUMNS, planes_seen_kernel
from calib_core.full.joint.sensors import SensorColumns
from calib_core.full.joint.state import BiasNodes, Bins, Estimate, Layout
from calib_core.geometry import exp, plane_axes
from calib_core.imu.preintegration import UpsampledImu
from calib_core.solver.arrow import ArrowSystem
from calib_core.threads import MOST_THREADS, workers
from calib_core.types import FloatArray, IntArray


@dataclass(frozen=True)
class LidarFactors:
    """Bins about their time offset, their lasers about the values with which the points were laid out.

    readings, nodes: the knots' times and rates of turning, and where the biases of these are states.
    """

    bins: Bins
    sensors: SensorColumns
    readings: UpsampledImu
    nodes: BiasNodes

    def cost(self, estimate: Estimate) -> float:
        """Sum of squares of everything."""
        a = self.planes_seen(estimate)
        total = np.einsum("bi,bij,bj->", a, self.bins.scatter, a, optimize=True)
        if len(self.bins.lasers.laser):
            total += float(features_squares(self.bins.lasers, a, self.laser_changes(estimate), self.bins.plane).sum())
        return float(total)

    def add_to(self, system: ArrowSystem, estimate: Estimate, layout: Layout) -> None:
        """Adds the bins' share of the normal equations."""
        seen = self.bins_seen(estimate)
        lasers = self._lasers_begun(system, estimate, layout, *seen) if len(self.bins.lasers.laser) else []
        for part in [*self._bins_begun(system, layout, *seen), *lasers]:
            one = part.result()
            if one.gradient is not system.gradient:
                system.gradient += one.gradient
            system.corner += one.corner
            system.gradient_shared += one.gradient_shared

    def _bins_begun(
        self, system: ArrowSystem, layout: Layout, a: FloatArray, J: FloatArray
    ) -> list[Future[ArrowSystem]]:
        """The bins' share in parts, each with knots of its own. As many on any number of threads: the sums are the same."""
        b = self.bins
        Ma = (b.scatter @ a[..., None])[..., 0]
        clock, squeezed = layout.nuisance().start + self.sensors.clock_place, layout.squeezed(self.nodes.windows()[1])

        def one(first: int, last: int) -> ArrowSystem:
            own, mine = _with_own_sums(system), slice(first, last)
            add_bins_kernel(
                b.knot[mine], b.plane[mine], J[mine], b.scatter[mine], Ma[mine], layout.every_plane().start, clock, squeezed,
                own.diagonal, own.border, own.corner, own.gradient, own.gradient_shared,
            )  # fmt: skip
            return own

        return [workers().submit(one, first, last) for first, last in _parts(b.knot)]

    def _lasers_begun(
        self, system: ArrowSystem, estimate: Estimate, layout: Layout, a: FloatArray, J: FloatArray
    ) -> list[Future[ArrowSystem]]:
        """The lasers' share in parts, at the same time as the bins': each fills columns and knots of the border that nobody
        else does, and has the rest for itself.
        """
        lasers, bins = self.bins.lasers, self.bins
        change = self.laser_changes(estimate)
        places, start = self.sensors.laser_places, layout.nuisance().start
        column_of, by_feature = np.where(places >= 0, start + places, -1), feature_changes(change, lasers.features)
        add_grams_kernel(lasers.grams, lasers.of_laser, column_of, by_feature, system.corner, system.gradient_shared)

        def one(first: int, last: int) -> ArrowSystem:
            own = replace(_with_own_sums(system), gradient=np.zeros_like(system.gradient))
            add_features_kernel(
                lasers.bin, bins.knot, bins.plane, lasers.laser, J, a, lasers.cross, column_of, by_feature,
                layout.every_plane().start,
                start + self.sensors.clock_place, layout.squeezed(self.nodes.windows()[1]),
                own.gradient, own.border, own.corner, own.gradient_shared, first, last,
            )  # fmt: skip
            return own

        return [workers().submit(one, first, last) for first, last in _parts(bins.knot[lasers.bin])]

    def sums(self, estimate: Estimate) -> FloatArray:
        """Sum of weighted distances of every bin's points, (B,) [1/m]."""
        a = self.planes_seen(estimate)
        total = np.einsum("bi,bi->b", self.bins.scatter[:, 3, :], a)
        if len(self.bins.lasers.laser):
            lasers = self.bins.lasers
            change = feature_changes(self.laser_changes(estimate), lasers.features)[lasers.laser]
            total += self._by_bin(np.einsum("bf,bf->b", change, lasers.cross[:, :, 3]))
        return total

    def squares(self, estimate: Estimate) -> FloatArray:
        """Sum of weighted squared distances of every plane's points, (P,)."""
        a, planes = self.planes_seen(estimate), len(estimate.normals)
        own = np.einsum("bi,bij,bj->b", a, self.bins.scatter, a, optimize=True)
        total = np.bincount(self.bins.plane, own, planes).astype(np.float64)
        if len(self.bins.lasers.laser):
            more = features_squares(self.bins.lasers, a, self.laser_changes(estimate), self.bins.plane)
            total[: len(more)] += more
        return total

    def _by_bin(self, of_cluster: FloatArray) -> FloatArray:
        """Summed over the lasers' clusters (C,) of each bin: (B,)."""
        return np.bincount(self.bins.lasers.bin, of_cluster, len(self.bins.plane)).astype(np.float64)

    def laser_changes(self, estimate: Estimate) -> FloatArray:
        """(L, 13) of each laser's columns since the points were laid out."""
        change = np.append(estimate.nuisance - self.bins.nuisance, 0.0)  # the last is of what is not in play, -1
        return np.asarray(change[self.sensors.laser_places])

    def planes_seen(self, estimate: Estimate) -> FloatArray:
        """A = [n_lidar, w_lidar, 1] of every bin, (B, 5)."""
        return self._seen(estimate, 0)[0]

    def bins_seen(self, estimate: Estimate) -> tuple[FloatArray, FloatArray]:
        """A of every bin (B, 5) and the Jacobian of its first four (B, 4, 19), or 20 with the clocks' rate."""
        return self._seen(estimate, COLUMNS + (self.sensors.clock_place >= 0))

    def _seen(self, estimate: Estimate, columns: int) -> tuple[FloatArray, FloatArray]:
        e, knot, plane = estimate, self.bins.knot, self.bins.plane
        a, J = np.empty((len(knot), 5)), np.empty((len(knot) if columns else 0, 4, columns))
        lever_s = self._clock_lever_s(e, knot) if columns > COLUMNS else np.zeros(0)
        planes_seen_kernel(
            knot, plane, e.states.R, e.states.p, e.states.v, self._rates(e), self._later_s(e, knot),
            e.R_imu_lidar, e.p_imu_lidar, e.normals, e.offsets_m, plane_axes(e.normals), lever_s, a, J,
        )  # fmt: skip
        return a, J

    def bin_poses(self, estimate: Estimate) -> tuple[FloatArray, FloatArray]:
        """The IMU's poses at the bins: R (B, 3, 3), p (B, 3)."""
        knot, s = self.bins.knot, estimate.states
        delta = self._later_s(estimate, knot)[:, None]
        return s.R[knot] @ exp(-self._rates(estimate)[knot] * delta), s.p[knot] - s.v[knot] * delta

    def _rates(self, estimate: Estimate) -> FloatArray:
        """(K, 3) [rad/s] at which the IMU turns at its knots."""
        return np.asarray(self.readings.knot_gyro - self.nodes.at_knots(estimate.gyro_bias))

    def _later_s(self, estimate: Estimate, knot: IntArray) -> FloatArray:
        """(B,) by how much earlier than at their making bins of these knots look their poses up."""
        delta = estimate.time_offset_s - self.bins.time_offset_s + self._clock_shift_s(estimate, knot)
        return np.zeros(len(knot)) + delta

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


def _with_own_sums(system: ArrowSystem) -> ArrowSystem:
    """The same system, but for what all knots share, which begins at nothing."""
    return replace(system, corner=np.zeros_like(system.corner), gradient_shared=np.zeros_like(system.gradient_shared))


def _parts(knot: IntArray) -> list[tuple[int, int]]:
    """Where each part of rows begins and ends, none of which shares a knot with another. knot: ascending, one a row."""
    edges = np.searchsorted(knot, knot[(np.arange(1, MOST_THREADS) * len(knot)) // MOST_THREADS])
    return list(pairwise((0, *edges.tolist(), len(knot))))
