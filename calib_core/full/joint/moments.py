"""What associating leaves of the points: moments of each slice of time and plane, moved to knots and summed there.

A slice's moments are exact for every later pose of it, so that points are gone through once an association, and a motion that
has moved since only moves moments: to the nearest knot, where those of one plane become one factor. The lasers' moments, of which
there are many times as many, stay as they were made, each with the pose that would move it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from calib_core.factors.laser_features import LaserFactors, LaserSums, summed_grams
from calib_core.factors.laser_kernels import add_ones_kernel
from calib_core.factors.lidar_plane import move_and_sum
from calib_core.full.joint.motion import Motion
from calib_core.full.joint.sensor_state import SensorState
from calib_core.full.joint.settings import CHAIN
from calib_core.full.joint.state import Bins, Estimate, no_bins
from calib_core.growing import Growing
from calib_core.paged import heed_pages, paged, set_aside
from calib_core.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class LaserMicro:
    """Moments of many scans for the lidar's own parameters. time_s, scan: (B,) of their groups' middles, lidar clock."""

    time_s: FloatArray
    scan: IntArray
    sums: LaserSums

    def weighted(self, of_scan: FloatArray) -> LaserMicro:
        """With every point counted as many times as its scan says: (M,)."""
        weight = of_scan[self.scan].astype(np.float32)[:, None, None]
        sums = replace(self.sums, cross=self.sums.cross * weight, gram=self.sums.gram * weight[:, 0])
        return replace(self, sums=sums)

    def put_in_order(self, knot: IntArray, planes: int) -> None:
        """By knot (B,), and plane within a knot, in place: scans follow one another but for those that share a knot, and moments
        are then used where they lie, and never copied.
        """
        order = np.argsort(knot * planes + self.sums.plane, kind="stable")
        moved = np.flatnonzero(order != np.arange(len(order)))
        of = self.sums
        for each in (self.time_s, self.scan, of.group, of.plane, of.laser, of.cross, of.gram):
            each[moved] = each[order[moved]]
            heed_pages(each.nbytes)

    def part(self, some: slice | IntArray) -> LaserMicro:
        """Some of them."""
        of = self.sums
        sums = LaserSums(of.group[some], of.plane[some], of.laser[some], of.cross[some], of.gram[some])
        return LaserMicro(self.time_s[some], self.scan[some], sums)


@dataclass(frozen=True)
class Micro:
    """Micro-bins of many scans. time_s: (B,) slice centres, lidar clock. scan: (B,) position. plane, scatter, count as there.

    lasers: None where the lidar is taken for ideal.   apart: where its points lie laser by laser nevertheless, for whoever asks;
    None where nobody has.   laid_out_at: the sensors as they were thought to be when the points were laid out, and time_offset_s.
    """

    time_s: FloatArray
    scan: IntArray
    plane: IntArray
    scatter: FloatArray
    count: IntArray
    lasers: LaserMicro | None = None
    apart: LaserMicro | None = None
    laid_out_at: SensorState = SensorState()  # noqa: RUF009  frozen
    time_offset_s: float = 0.0

    @staticmethod
    def joined(parts: Iterable[Micro]) -> Micro:
        """Those of several scans in a row, each gone once it is in place: moments are most of what a solve holds."""
        own, lasers, apart = Growing("time_s", "scan", "plane", "scatter", "count"), _GrowingLasers(), _GrowingLasers()
        laid_out_at, time_offset_s = SensorState(), 0.0
        for part in parts:
            own.append(part)
            lasers.append(part.lasers)
            apart.append(part.apart)
            laid_out_at, time_offset_s = part.laid_out_at, part.time_offset_s
        time_s, scan, plane, scatter, count = own.arrays()
        return Micro(time_s, scan, plane, scatter, count, lasers.micro(), apart.micro(), laid_out_at, time_offset_s)

    def part(self, some: BoolArray) -> Micro:
        """Those of a mask (B,), without the lasers' moments."""
        return Micro(self.time_s[some], self.scan[some], self.plane[some], self.scatter[some], self.count[some])


class _GrowingLasers:
    """Moments of lasers, scan after scan; groups are counted in each part."""

    def __init__(self) -> None:
        self._own, self._sums = Growing("time_s", "scan"), Growing("group", "plane", "laser", "cross", "gram")

    def append(self, part: LaserMicro | None) -> None:
        if part is not None:
            self._own.append(part)
            self._sums.append(part.sums)

    def micro(self) -> LaserMicro | None:
        """All of them; None of none."""
        own, sums = self._own.arrays(), self._sums.arrays()
        return LaserMicro(own[0], own[1], LaserSums(*sums)) if own else None


def gather(micro: Micro, motion: Motion, estimate: Estimate) -> Bins:
    """Micro-bins moved to their nearest knots under the current motion and summed: one bin a knot and plane."""
    # One pose a slice, shared by the planes seen in it.
    time_s, of_slice = _instants(micro.time_s)
    # With lasers told apart, slices stay with the knots that their lasers' moments were put together for.
    offset_s = estimate.time_offset_s if micro.lasers is None else micro.time_offset_s
    knot = motion.nearest_knot(time_s - offset_s)
    R, p, usable = to_knots(time_s, knot, motion, estimate)
    use = np.flatnonzero(usable[of_slice])
    of_slice = of_slice[use]
    n_planes = len(estimate.normals)
    key = knot[of_slice] * n_planes + micro.plane[use]
    laid_out_at = micro.laid_out_at
    if len(key) == 0:
        return replace(no_bins(estimate.time_offset_s), laid_out_at=laid_out_at)
    keys, scatter = move_and_sum(micro.scatter, R, p, of_slice, key, use)
    count = np.bincount(np.searchsorted(keys, key), micro.count[use]).astype(np.int64)
    lasers = LaserFactors.empty()
    if micro.lasers is not None:
        lasers = gather_lasers(micro.lasers, motion, estimate, micro.time_offset_s, keys)
        scatter = agreeing(scatter, lasers)
    return Bins(keys // n_planes, keys % n_planes, scatter, count, estimate.time_offset_s, lasers, laid_out_at)


def to_knots(
    time_s: FloatArray, knot: IntArray, motion: Motion, estimate: Estimate
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """What takes hits of instants of the lidar's clock (S,) to their knots (S,): R (S, 3, 3), p (S, 3); and whether the motion is
    known there, (S,). Some instants at a time: whole, their poses would be most of what gathering holds."""
    (R, p), usable = paged((len(knot), 3, 3), (len(knot), 3)), np.empty(len(knot), np.bool_)
    knots = motion.lidar_at(motion.readings.knots_s, estimate.R_imu_lidar, estimate.p_imu_lidar)
    for first in range(0, len(knot), CHAIN.clusters_at_once):
        some = slice(first, first + CHAIN.clusters_at_once)
        poses = motion.lidar_at(time_s[some] - estimate.time_offset_s, estimate.R_imu_lidar, estimate.p_imu_lidar)
        R[some], p[some] = poses.seen_from(knots, knot[some])
        usable[some] = poses.usable
        heed_pages(R[some].nbytes + p[some].nbytes)
    return R, p, usable


def agreeing(scatter: FloatArray, lasers: LaserFactors) -> FloatArray:
    """Scatter matrices (B, 5, 5) shifted so that the mean hits are those of the lasers' moments.

    Offset and incidence of all lasers, rising together, shift every plane by as much: c + (1 - c) = 1. Where planes face three
    ways, that is a shift of the map, which no reading tells. The lasers' moments were kept in single precision: what that
    rounds, a micrometre a point, would pull this way on millions of points.
    """
    if len(lasers.laser) == 0:
        return scatter
    sums = np.zeros((len(scatter), 4))
    for first in range(0, len(lasers.laser), CHAIN.clusters_at_once):
        add_ones_kernel(lasers.clusters(first, first + CHAIN.clusters_at_once), sums)
    (out,) = paged(scatter.shape)
    for first in range(0, len(out), CHAIN.clusters_at_once):
        part = slice(first, first + CHAIN.clusters_at_once)
        out[part] = _about_means(scatter[part], sums[part])
        heed_pages(2 * out[part].nbytes)
    return out


def _about_means(scatter: FloatArray, sums: FloatArray) -> FloatArray:
    """Scatter matrices (B, 5, 5) shifted to the mean hits of these sums (B, 4), where there are any."""
    some = sums[:, 3] > 0.0
    shift = np.zeros((len(scatter), 3))
    shift[some] = sums[some, :3] / sums[some, 3, None] - scatter[some, 3, :3] / scatter[some, 3, 3, None]
    # S M S' with S the unit matrix but for the shift beside its ones.
    out = scatter.copy()
    out[:, :3] += shift[:, :, None] * scatter[:, 3, None, :]
    out[:, :, :3] += out[:, :, 3, None] * shift[:, None, :]
    return out


def gather_lasers(
    micro: LaserMicro, motion: Motion, estimate: Estimate, time_offset_s: float, bins: IntArray
) -> LaserFactors:
    """Moments as they are, with where the current motion has taken their hits: to their knots.

    time_offset_s: with which slices were put together to knots.   bins: (Q,) knot times planes plus plane of each bin,
    ascending; they are of the same points.
    """
    time_s, of_group = _instants(micro.time_s)
    knot = motion.nearest_knot(time_s - time_offset_s)
    R, p, usable = to_knots(time_s, knot, motion, estimate)
    key = knot[of_group] * len(estimate.normals) + micro.sums.plane
    use = in_order(key, usable[of_group])
    if use is not None:
        micro, key, of_group = micro.part(use), key[use], of_group[use]
    sums = micro.sums
    grams = summed_grams(sums.gram, sums.plane, sums.laser)
    bin_of, pose = set_aside(np.searchsorted(bins, key)), set_aside(of_group)
    return LaserFactors(bin_of, sums.laser, sums.cross, sums.gram, pose, R, p, *grams)


def in_order(key: IntArray, usable: BoolArray) -> IntArray | None:
    """Places of those that are usable, by ascending key (B,); None where they are all, and lie like that."""
    if usable.all() and not (np.diff(key) < 0).any():
        return None
    some = np.flatnonzero(usable)
    return np.asarray(some[np.argsort(key[some], kind="stable")])


def _instants(time_s: FloatArray) -> tuple[FloatArray, IntArray]:
    """The instants of bins in a row (B,), each once for those next to one another, and which of them each bin is of."""
    begins = np.append(True, time_s[1:] != time_s[:-1])[: len(time_s)]
    return time_s[begins], np.cumsum(begins) - 1
