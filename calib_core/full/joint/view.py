"""Scans as an estimate sees them: their points laid out by its motion, met with its planes, collapsed; scan by scan or many.

Which points are given to which plane is decided in association.py, by what is seen here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calib_core.factors.fused import LaserGroups, scan_moments
from calib_core.factors.laser_features import LaserErrors, LaserSums, collapse_features, steps_to_middles
from calib_core.factors.lidar_plane import (
    SLICE_S,
    Gate,
    Hits,
    LidarNoise,
    MicroBins,
    SlicePoses,
    collapse,
    find_hits,
)
from calib_core.factors.support import PlaneExtents
from calib_core.full.joint.moments import LaserMicro, Micro
from calib_core.full.joint.motion import Motion
from calib_core.full.joint.settings import SURVEYING
from calib_core.full.joint.state import Estimate
from calib_core.full.joint.thinning import thinned
from calib_core.full.prepare.nuisance import LASER_BLOCKS, LIDAR_BLOCKS, SURFACE, Nuisance
from calib_core.full.run import Clocks
from calib_core.paged import Shelf, heed_pages
from calib_core.settings import CalibrateSettings
from calib_core.types import (
    POINT_DTYPE,
    BoolArray,
    Float32Array,
    FloatArray,
    IntArray,
    LaserArray,
    PointArray,
    Scan,
)


@dataclass(frozen=True)
class View:
    """What associating needs to know: scans and their clock, the motion, the extrinsic, the planes.

    poses: of the scans whose slices were laid out together (`lay_out`); others are computed as they are asked for.
    thinned: hits of thinned scans, for whoever asks next; of whole scans they would be too many to keep.   few: the points
    of thinned scans, which lie on the shelf; both are handed on from view to view.   apart: so many lasers are told apart beside
    the factors where they are taken for ideal, 0 for none.
    """

    scans: Sequence[Scan]
    clocks: Clocks
    motion: Motion
    estimate: Estimate
    settings: CalibrateSettings
    threads: int = 1
    poses: dict[int, SlicePoses] = field(default_factory=dict)
    thinned: dict[tuple[object, ...], Hits] = field(default_factory=dict)
    few: dict[int, tuple[int, PointArray]] = field(default_factory=dict)
    shelf: Shelf = field(default_factory=Shelf)
    apart: int = 0

    @property
    def nuisance(self) -> Nuisance:
        """The sensors' own parameters in play."""
        return self.estimate.sensors.blocks

    def points(self, position: int, stride: int) -> PointArray:
        """Every so many-th point of a scan: taken from the whole once, however often they are asked for."""
        if stride == 1:
            return self.scans[position].points
        last = self.few.get(position)
        if last is None or last[0] != stride:
            points = self.scans[position].points
            last = self.few[position] = stride, self.shelf.put(points[thinned(points, stride, position)])
        heed_pages(last[1].nbytes)
        return last[1]

    def lay_out(self, positions: Sequence[int]) -> None:
        """The slices' poses of many scans in one go: scan by scan, the arrays would be too short to be worth a call."""
        e = self.estimate
        missing = [i for i in positions if i not in self.poses]
        if not missing:
            return
        counts, centres = self._centres(missing)
        every = self.motion.lidar_at(centres - e.time_offset_s, e.R_imu_lidar, e.p_imu_lidar)
        for i, end, n in zip(missing, np.cumsum(counts).tolist(), counts.tolist(), strict=True):
            own = slice(end - n, end)
            self.poses[i] = SlicePoses(
                every.R[own], every.p[own], every.omega_rad_s[own], every.v_m_s[own], every.usable[own]
            )

    def _slices(self, positions: Sequence[int]) -> IntArray:
        """As many slices as each scan's last point needs, and one to spare for rounding."""
        return (self.clocks.sweep_s[list(positions)] / SLICE_S).astype(np.int64) + 2

    def _centres(self, positions: Sequence[int]) -> tuple[IntArray, FloatArray]:
        """How many slices each scan has, and the centres of those of all in a row, lidar clock."""
        counts = self._slices(positions)
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        return counts, np.repeat(self.clocks.scan_s[list(positions)], counts) + (within + 0.5) * SLICE_S

    def hits(self, positions: Sequence[int], gate: Gate, stride: int = 1) -> Hits:
        """Where the points of scans meet the planes, point by point; slices are counted through all of them."""
        key = (*positions, stride, gate.min_cosine)
        if key in self.thinned:
            return self.thinned[key]
        clouds = [self.points(i, stride) for i in positions]
        points = clouds[0] if len(clouds) == 1 else np.concatenate(clouds)
        e = self.estimate
        errors = self._errors()
        hits = find_hits(
            self._corrected(points, errors),
            points["offset_ns"] * 1e-9,
            SlicePoses.joined([self.slice_poses(i) for i in positions]),
            np.vstack([e.normals, e.aside_normals]),
            np.append(e.offsets_m, e.aside_offsets_m),
            gate,
            first_slice=np.repeat(self._first_slices(positions), [len(cloud) for cloud in clouds]),
            field_of_view_deg=self.settings.field_of_view_deg,
            published_m=points["xyz"],
        )
        hits.plane[hits.plane >= len(e.normals)] = -1
        if errors is not None and errors.slant().any():
            on = hits.plane >= 0
            hits.d[on] = errors.straightened(hits.d[on], hits.cosine[on], hits.x_hit[on], hits.plane[on])
        if self.nuisance.surface is not None:
            # Before its plane a surface is met so much earlier; beyond the last patch, as if there were none.
            surface = self.nuisance.surface
            hits.d[:] -= surface.heights_m(surface.between(hits), e.sensors.of(SURFACE))
        if stride > 1 and len(points) + sum(len(each.plane) for each in list(self.thinned.values())) <= SURVEYING.kept:
            self.thinned[key] = hits
        return hits

    def _errors(self) -> LaserErrors | None:
        """The lidar's own parameters as they are thought to be now; None where it is taken for ideal."""
        if not self.nuisance.blocks:
            return None
        return self.estimate.sensors.lasers(len(self.estimate.normals))

    def _corrected(self, points: PointArray, errors: LaserErrors | None) -> Float32Array:
        """Where points (N,) would lie were it not for their lasers' errors, (N, 3)."""
        if errors is None or not errors.any():
            return np.asarray(points["xyz"])
        return errors.corrected(points["xyz"], self.lasers_of(points))

    def lasers_of(self, points: PointArray) -> LaserArray:
        """(N,) which laser each point is of: 0 where they are not told apart."""
        if self.nuisance.lasers:
            return np.asarray(points["ring"])
        return np.zeros(len(points), np.uint16)

    def collapsed(
        self, positions: Sequence[int], hits: Hits, keep: BoolArray, weight: FloatArray, stride: int
    ) -> Micro:
        """The kept points' moments, with those for the lidar's own parameters where any of these is in play."""
        bins = collapse(hits, keep, weight, len(self.estimate.normals))
        if not self._lidar_in_play():
            return self.micro(positions, bins)
        groups = self._laser_groups(positions, max(self.nuisance.lasers, 1))
        laser = np.concatenate([self.lasers_of(self.points(i, stride)) for i in positions])
        surface = self.nuisance.surface
        sums = collapse_features(
            hits, keep, weight, self.estimate.normals, laser=laser, lasers=groups.lasers, group=groups.group,
            middle=groups.middle, between=None if surface is None else surface.between(hits),
        )  # fmt: skip
        return self._with_lasers(positions, bins, hits.poses, groups, sums)

    def _laser_groups(self, positions: Sequence[int], lasers: int, *, first_only: bool = False) -> LaserGroups:
        """Slices go together that go to one knot, as they do when they are gathered."""
        counts, centre_s = self._centres(positions)
        knot = self.motion.nearest_knot(centre_s - self.estimate.time_offset_s)
        begins = np.concatenate([[True], np.diff(knot) != 0])
        begins[np.cumsum(counts)[:-1]] = True
        first = np.flatnonzero(begins)
        middle = (first + np.append(first[1:], len(knot)) - 1) // 2
        return LaserGroups(lasers, np.cumsum(begins) - 1, middle, first_only)

    def _with_lasers(
        self, positions: Sequence[int], bins: MicroBins, poses: SlicePoses, groups: LaserGroups, sums: LaserSums
    ) -> Micro:
        """Moments of all points and of each laser's, both by groups of slices, so that the ones are the sum of the others.

        Where one kind followed the motion slice by slice and the other group by group, what a shift of the map does to them
        would differ by a millionth, and millions of points would pull offset and incidence of all lasers, which together are
        such a shift where planes face three ways, as far as that takes.
        """
        micro = self.micro(
            positions, bins.together(*steps_to_middles(poses, groups.group, groups.middle), groups.group, groups.middle)
        )
        return replace(micro, lasers=self._of_groups(positions, groups, sums))

    def _of_groups(self, positions: Sequence[int], groups: LaserGroups, sums: LaserSums) -> LaserMicro:
        """Moments by groups of slices of scans in a row, each with its time and scan."""
        if self.nuisance.materials:
            beyond = 0 if self.nuisance.surface is None else len(self.nuisance.surface.corners) * groups.lasers
            sums = sums.by_plane(groups.lasers, beyond)
        return LaserMicro(*self._instants(positions, groups.middle[sums.group]), sums)

    def whole_scans(
        self, positions: Sequence[int], noise: LidarNoise, gate: Gate, extents: PlaneExtents | None
    ) -> Micro:
        """All points of a few scans, laid on planes and collapsed in one go."""
        e, poses = self.estimate, SlicePoses.joined([self.slice_poses(i) for i in positions])
        groups, in_play = None, self._lidar_in_play()
        if in_play:
            groups = self._laser_groups(positions, max(self.nuisance.lasers, 1))
        elif self.apart:
            groups = self._laser_groups(positions, self.apart, first_only=True)
        bins, sums = scan_moments(
            self._as_one(positions),
            poses,
            (np.vstack([e.normals, e.aside_normals]), np.append(e.offsets_m, e.aside_offsets_m), len(e.normals)),
            noise,
            gate,
            extents,
            errors=self._errors(),
            told_apart=self.nuisance.lasers > 0 or not in_play,
            groups=groups,
            field_of_view_deg=self.settings.field_of_view_deg,
        )
        if groups is None or sums is None:
            return self.micro(positions, bins)
        if not in_play:
            return replace(self.micro(positions, bins), apart=self._of_groups(positions, groups, sums))
        return self._with_lasers(positions, bins, poses, groups, sums)

    def _as_one(self, positions: Sequence[int]) -> PointArray:
        """The points of a few scans as if of one, whose slices are those of all in a row."""
        clouds = [self.scans[i].points for i in positions]
        if len(clouds) == 1:
            return clouds[0]
        points = np.concatenate(clouds)
        before = np.repeat(self._first_slices(positions), [len(cloud) for cloud in clouds])
        points["offset_ns"] += (before * round(SLICE_S * 1e9)).astype(np.int32)
        points.flags.writeable = False  # as a scan's own are, or loops would be compiled for either
        return points

    def most_as_one(self, positions: Sequence[int]) -> int:
        """How many of the scans may be taken as one: their times have room for two seconds, and lasers' moments take memory."""
        longest_s = int(self._slices(positions).max(initial=1)) * SLICE_S
        most = int(np.iinfo(POINT_DTYPE["offset_ns"]).max * 1e-9 / longest_s)
        lasers = max(self.nuisance.lasers, 1) if self._lidar_in_play() else self.apart
        if lasers:
            groups = int(longest_s / self.motion.readings.spacing_s) + 2
            most = min(most, SURVEYING.clusters // (groups * len(self.estimate.normals) * lasers))
        return max(1, most)

    def _lidar_in_play(self) -> bool:
        """Whether any of the lidar's own parameters is an unknown."""
        return any(self.nuisance.start(block) >= 0 for block in (*LASER_BLOCKS, *LIDAR_BLOCKS, SURFACE))

    def _first_slices(self, positions: Sequence[int]) -> IntArray:
        """Where each scan's slices begin when those of all are in a row."""
        counts = self._slices(positions)
        return np.cumsum(counts) - counts

    def micro(self, positions: Sequence[int], bins: MicroBins) -> Micro:
        """Bins of scans whose slices are in a row, each with its time and scan."""
        return Micro(*self._instants(positions, bins.slice_index), bins.plane, bins.scatter, bins.count)

    def _instants(self, positions: Sequence[int], slice_index: IntArray) -> tuple[FloatArray, IntArray]:
        """The centres of slices that are counted through scans, and of which scan each is."""
        first = self._first_slices(positions)
        which = np.searchsorted(first, slice_index, side="right") - 1
        scan = np.asarray(positions, np.int64)[which]
        return self.clocks.scan_s[scan] + (slice_index - first[which] + 0.5) * SLICE_S, scan

    def slice_poses(self, position: int) -> SlicePoses:
        """The lidar at the centres of a scan's slices."""
        self.lay_out([position])
        poses = self.poses[position]
        heed_pages(poses.R.nbytes)
        return poses

    def cloud(self, position: int, count: int) -> tuple[FloatArray, IntArray]:
        """About so many points of a scan, straightened, in the frame of the solve: (M, 3), and their places in it: (M,)."""
        scan = self.scans[position]
        place = thinned(scan.points, max(1, len(scan.points) // count), position)
        points = scan.points[place]
        poses = self.slice_poses(position)
        index = (points["offset_ns"] * 1e-9 / SLICE_S).astype(np.int64)
        usable = poses.usable[index]
        index = index[usable]
        xyz = self._corrected(points, self._errors())[usable].astype(np.float64)
        there = (poses.R[index] @ xyz[..., None])[..., 0] + poses.p[index]
        return there, place[usable]

    def strays(self, position: int, count: int, away_m: float) -> FloatArray:
        """Points of a scan that lie on no plane, in the frame of the solve: (M, 3), from a sample of so many points."""
        cloud, place = self.cloud(position, count)
        points = self.scans[position].points
        stride = max(1, len(points) // count)
        hits = self.hits([position], Gate(), stride)
        free = (hits.plane < 0) | (np.abs(hits.d) > away_m)
        return cloud[free[np.searchsorted(thinned(points, stride, position), place)]]
