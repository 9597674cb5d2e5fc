"""The lidar's factors: how bins of points see their planes at an estimate, what that moves with, and what it costs.

A bin of points at knot k sees plane j as a = [n_lidar, w_lidar, 1] (factors/planes_seen.py) and adds a' M a to twice the cost,
M its scatter; where the lasers' own parameters are unknowns, their moments add what these change (factors/laser_features.py).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_core.factors.assembly import add_bins_kernel, bins_times_kernel
from calib_core.factors.imu import KNOT
from calib_core.factors.laser_assembly import (
    add_features_kernel,
    add_grams_kernel,
    features_pull_kernel,
    features_times_kernel,
)
from calib_core.factors.laser_features import feature_changes, features_squares
from calib_core.factors.planes_seen import COLUMNS, OF_CALIBRATION, OF_CLOCK, OF_KNOT, OF_PLANE, planes_seen_kernel
from calib_core.full.joint.sensors import SensorColumns
from calib_core.full.joint.settings import CHAIN
from calib_core.full.joint.state import CALIBRATION, BiasNodes, Bins, Estimate, Layout
from calib_core.geometry import exp, plane_axes
from calib_core.imu.preintegration import UpsampledImu
from calib_core.solver.system import ArrowPart
from calib_core.threads import in_parts
from calib_core.types import FloatArray, IntArray


@dataclass(frozen=True)
class LidarFactors:
    """Bins about their time offset, their lasers about the values with which the points were laid out.

    readings, nodes: the knots' times and rates of turning, and where the biases of these are states.   held: of the sensors' own
    parameters those that do not move, of which no column is filled: 512 of 128 lasers would be a third of the work.
    """

    bins: Bins
    sensors: SensorColumns
    readings: UpsampledImu
    nodes: BiasNodes
    held: tuple[int, ...] = ()

    def cost(self, estimate: Estimate) -> float:
        """Sum of squares of everything."""
        a = self.planes_seen(estimate)
        total = np.einsum("bi,bij,bj->", a, self.bins.scatter, a, optimize=True)
        if len(self.bins.lasers.laser):
            total += float(features_squares(self.bins.lasers, a, self.laser_changes(estimate), self.bins.plane).sum())
        return float(total)

    def add_to(self, part: ArrowPart, start: int, estimate: Estimate, layout: Layout, rates: FloatArray) -> None:
        """Adds the bins' share of a part of the normal equations, of knots from `start` on. layout: of the part's columns.

        rates: of all knots.
        """
        mine = self.between(start, start + len(part.diagonal))
        b, lasers = mine.bins, mine.bins.lasers
        a, J = mine.bins_seen(estimate, rates)
        Ma = (b.scatter @ a[..., None])[..., 0]
        knot, planes, clock = (
            b.knot - start,
            layout.every_plane().start,
            layout.nuisance().start + self.sensors.clock_place,
        )
        add_bins_kernel(
            knot, b.plane, J, b.scatter, Ma, planes, clock,
            part.diagonal, part.border, part.corner, part.gradient, part.gradient_shared,
        )  # fmt: skip
        if len(lasers.laser):
            add_features_kernel(
                lasers.clusters(), knot, b.plane, J, a, self._laser_columns(layout), self.features_changed(estimate),
                planes, clock,
                part.gradient, part.border, part.corner, part.gradient_shared,
            )  # fmt: skip

    def add_common(self, corner: FloatArray, gradient_shared: FloatArray, estimate: Estimate, layout: Layout) -> None:
        """Adds what the lasers' own parameters share with one another, which is no knot's business."""
        lasers = self.bins.lasers
        if len(lasers.laser):
            columns, change = self._laser_columns(layout), self.features_changed(estimate)
            add_grams_kernel(lasers.grams, lasers.of_laser, columns, change, corner, gradient_shared)

    def add_times(
        self,
        out: FloatArray,
        first: int,
        last: int,
        estimate: Estimate,
        layout: Layout,
        rates: FloatArray,
        shared: FloatArray,
    ) -> None:
        """Adds to out (k, 9, m), of knots first..last (exclusive) and maybe more, what `add_to` has in their borders times
        columns shared (S, m)."""
        mine = self.between(first, last)
        b, lasers, m = mine.bins, mine.bins.lasers, shared.shape[1]
        J = mine.bins_seen(estimate, rates)[1]
        own = shared[layout.nuisance()]
        crossed = np.zeros((len(b.knot), 4, m))
        if len(lasers.laser):
            features_times_kernel(lasers.clusters(), self.features_following(own), crossed)
        clock = own[self.sensors.clock_place :][:1] if self.sensors.clock_place >= 0 else np.zeros((1, m))
        bins_times_kernel(
            b.knot - first, b.plane, J, b.scatter, shared[:CALIBRATION],
            shared[layout.every_plane()].reshape(-1, 3, m), clock, crossed, out,
        )  # fmt: skip

    def pull(
        self,
        first: int,
        last: int,
        estimate: Estimate,
        layout: Layout,
        rates: FloatArray,
        shared: FloatArray,
        along: FloatArray | None,
    ) -> FloatArray:
        """(k, 9) gradient of knots first..last (exclusive), and adds to that of the shared unknowns (S,), where the knots have
        moved by `along` (K, 9); without what lasers share with one another."""
        mine = self.between(first, last)
        b, lasers = mine.bins, mine.bins.lasers
        a, J = mine.bins_seen(estimate, rates)
        if along is not None:
            a[:, :4] += (J[:, :, OF_KNOT] @ along[b.knot][..., None])[..., 0]
        u = (b.scatter[:, :4] @ a[..., None])[..., 0]
        if len(lasers.laser):
            columns, change = self._laser_columns(layout), self.features_changed(estimate)
            features_pull_kernel(lasers.clusters(), a, columns, change, u, shared)
        pulls = (u[:, None] @ J)[:, 0]
        shared[:CALIBRATION] += pulls[:, OF_CALIBRATION].sum(axis=0)
        np.add.at(shared[layout.every_plane()].reshape(-1, 3), b.plane, pulls[:, OF_PLANE])
        if self.sensors.clock_place >= 0:
            shared[layout.nuisance().start + self.sensors.clock_place] += pulls[:, OF_CLOCK].sum()
        out = np.zeros((last - first, KNOT))
        np.add.at(out, b.knot - first, pulls[:, OF_KNOT])
        return out

    def between(self, first: int, last: int) -> LidarFactors:
        """Those of knots first..last (exclusive) alone, which keep their numbers; without what lasers share with one another."""
        b, lasers = self.bins, self.bins.lasers
        begin, end = (int(at) for at in np.searchsorted(b.knot, (first, last)))
        clusters = slice(*(int(at) for at in np.searchsorted(lasers.bin, (begin, end))))
        some = slice(begin, end)
        lasers = replace(
            lasers,
            bin=lasers.bin[clusters] - begin,
            laser=lasers.laser[clusters],
            cross=lasers.cross[clusters],
            gram=lasers.gram[clusters],
            pose=lasers.pose[clusters],
        )
        bins = replace(
            b, knot=b.knot[some], plane=b.plane[some], scatter=b.scatter[some], count=b.count[some], lasers=lasers
        )
        return replace(self, bins=bins)

    def _laser_columns(self, layout: Layout) -> IntArray:
        """(L, 14) shared columns of each laser's parameters, -1 for none that moves."""
        places = self.sensors.laser_places
        return np.where((places >= 0) & ~np.isin(places, self.held), layout.nuisance().start + places, -1)

    def features_changed(self, estimate: Estimate) -> FloatArray:
        """(L, F) of the features' coefficients since the points were laid out."""
        return feature_changes(self.laser_changes(estimate), self.bins.lasers.features)

    def features_following(self, columns: FloatArray) -> FloatArray:
        """(L, F, m) what the features' coefficients follow of columns (N, m) of the sensors' own parameters."""
        return feature_changes(self._by_laser(columns), self.bins.lasers.features)

    def sums(self, estimate: Estimate) -> FloatArray:
        """Sum of weighted distances of every bin's points, (B,) [1/m]."""
        a = self.planes_seen(estimate)
        total = np.einsum("bi,bi->b", self.bins.scatter[:, 3, :], a)
        if len(self.bins.lasers.laser):
            lasers = self.bins.lasers
            change, moved = self.features_changed(estimate), np.empty(len(lasers.laser))

            def of_clusters(first: int, last: int) -> None:
                of = lasers.clusters(first, last)
                moved[first:last] = np.einsum("bf,bf->b", change[of.laser], of.cross[:, :, 3])

            in_parts(len(moved), of_clusters, CHAIN.clusters_at_once)
            total += self._by_bin(moved)
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
        """(L, 14) of each laser's columns since the points were laid out."""
        return self._by_laser(estimate.sensors.since(self.bins.laid_out_at))

    def _by_laser(self, values: FloatArray) -> FloatArray:
        """(L, 14, ..) of each laser's columns, of values (N, ..) of the sensors' own parameters; zero of what is not in play."""
        nothing = np.zeros((1, *values.shape[1:]))  # in the last place, where -1 leads
        return np.asarray(np.concatenate([values, nothing])[self.sensors.laser_places])

    def planes_seen(self, estimate: Estimate) -> FloatArray:
        """A = [n_lidar, w_lidar, 1] of every bin, (B, 5)."""
        return self._seen(estimate, 0, self.rates(estimate))[0]

    def bins_seen(self, estimate: Estimate, rates: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """A of every bin (B, 5) and the Jacobian of its first four (B, 4, 19), or 20 with the clocks' rate. rates: where they are
        known."""
        columns = COLUMNS + (self.sensors.clock_place >= 0)
        return self._seen(estimate, columns, self.rates(estimate) if rates is None else rates)

    def _seen(self, estimate: Estimate, columns: int, rates: FloatArray) -> tuple[FloatArray, FloatArray]:
        e, knot, plane = estimate, self.bins.knot, self.bins.plane
        a, J = np.empty((len(knot), 5)), np.empty((len(knot) if columns else 0, 4, columns))
        lever_s = self._clock_lever_s(e, knot) if columns > COLUMNS else np.zeros(0)
        planes_seen_kernel(
            knot, plane, e.states.R, e.states.p, e.states.v, rates, self._later_s(e, knot),
            np.ascontiguousarray(e.R_imu_lidar), np.ascontiguousarray(e.p_imu_lidar),
            e.normals, e.offsets_m, np.array(plane_axes(e.normals), order="C"), lever_s, a, J,
        )  # fmt: skip
        return a, J

    def bin_poses(self, estimate: Estimate) -> tuple[FloatArray, FloatArray]:
        """The IMU's poses at the bins: R (B, 3, 3), p (B, 3)."""
        knot, s = self.bins.knot, estimate.states
        delta = self._later_s(estimate, knot)[:, None]
        return s.R[knot] @ exp(-self.rates(estimate)[knot] * delta), s.p[knot] - s.v[knot] * delta

    def rates(self, estimate: Estimate) -> FloatArray:
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
        change_ppm = estimate.sensors.clock_rate_ppm() - self.bins.laid_out_at.clock_rate_ppm()
        return np.asarray(change_ppm * self._clock_lever_s(estimate, knot))

    def _clock_lever_s(self, estimate: Estimate, knot: IntArray) -> FloatArray:
        """Seconds of offset for a ppm of rate, at knots."""
        lidar_s = self.readings.knots_s[knot] + estimate.time_offset_s
        return np.asarray(1e-6 * (lidar_s - self.sensors.clock_middle_s))
