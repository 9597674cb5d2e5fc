"""Points to planes under the current motion: every scan through factors/bins.py, and the noise and extents they show."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from scipy.optimize import nnls

from calib_core.factors.laser_features import LaserErrors, LaserFactors, LaserSums, collapse_features
from calib_core.factors.lidar_plane import (
    SLICE_S,
    Gate,
    Hits,
    LidarNoise,
    MicroBins,
    SlicePoses,
    cells_of,
    collapse,
    find_hits,
    move_and_sum,
    select,
)
from calib_core.factors.support import ExtentSurvey, PlaneExtents
from calib_core.full.joint.motion import Motion
from calib_core.full.joint.sensors import laser_errors
from calib_core.full.joint.state import Bins, Estimate
from calib_core.full.prepare.nuisance import LASER_BLOCKS, LIDAR_BLOCKS, Nuisance
from calib_core.full.run import Clocks
from calib_core.settings import CalibrateSettings
from calib_core.threads import workers
from calib_core.types import BoolArray, Float32Array, FloatArray, IntArray, LaserArray, PointArray, Scan

T = TypeVar("T")
#: Told how many of the scans are done.
OnScans = Callable[[int], None]
#: Points that are worth a call of their own.
_BATCH = 20_000
#: Returns of a cell are another surface's, a door's in its wall, where their mean is further from the plane than this many
#: standard deviations of one of them.
_OFF_SIGMAS = 2.0


def _ignore(_: int) -> None:
    """For callers who do not ask how far it is."""


@dataclass(frozen=True)
class LaserMicro:
    """Moments of many scans for the lidar's own parameters. time_s, scan: (B,) of their groups' middles, lidar clock."""

    time_s: FloatArray
    scan: IntArray
    sums: LaserSums

    def weighted(self, of_scan: FloatArray) -> LaserMicro:
        """With every point counted as many times as its scan says: (M,)."""
        weight = of_scan[self.scan].astype(np.float32)[:, None, None]
        return replace(self, sums=replace(self.sums, cross=self.sums.cross * weight, gram=self.sums.gram * weight))

    @staticmethod
    def joined(parts: Sequence[LaserMicro]) -> LaserMicro:
        """Those of several scans in a row."""
        return LaserMicro(
            np.concatenate([part.time_s for part in parts]),
            np.concatenate([part.scan for part in parts]),
            LaserSums.joined([part.sums for part in parts]),
        )


@dataclass(frozen=True)
class Micro:
    """Micro-bins of many scans. time_s: (B,) slice centres, lidar clock. scan: (B,) position. plane, scatter, count as there.

    lasers: None where the lidar is taken for ideal.   nuisance: (N,) the values with which the points were laid out, and
    time_offset_s.
    """

    time_s: FloatArray
    scan: IntArray
    plane: IntArray
    scatter: FloatArray
    count: IntArray
    lasers: LaserMicro | None = None
    nuisance: FloatArray = field(default_factory=lambda: np.zeros(0))
    time_offset_s: float = 0.0

    @staticmethod
    def joined(parts: Sequence[Micro]) -> Micro:
        """Those of several scans in a row."""
        return Micro(
            np.concatenate([part.time_s for part in parts]),
            np.concatenate([part.scan for part in parts]),
            np.concatenate([part.plane for part in parts]),
            np.concatenate([part.scatter for part in parts]),
            np.concatenate([part.count for part in parts]),
            LaserMicro.joined([part.lasers for part in parts if part.lasers is not None])
            if any(part.lasers is not None for part in parts)
            else None,
            parts[0].nuisance,
            parts[0].time_offset_s,
        )

    def part(self, some: BoolArray) -> Micro:
        """Those of a mask (B,), without the lasers' moments."""
        return Micro(self.time_s[some], self.scan[some], self.plane[some], self.scatter[some], self.count[some])


@dataclass(frozen=True)
class View:
    """What associating needs to know: scans and their clock, the motion, the extrinsic, the planes.

    poses: of the scans whose slices were laid out together (`lay_out`); others are computed as they are asked for.
    thinned: hits of thinned scans, for whoever asks next; of whole scans they would be too many to keep.
    """

    scans: Sequence[Scan]
    clocks: Clocks
    motion: Motion
    estimate: Estimate
    settings: CalibrateSettings
    threads: int = 1
    nuisance: Nuisance = Nuisance()  # noqa: RUF009  frozen
    poses: dict[int, SlicePoses] = field(default_factory=dict)
    thinned: dict[tuple[object, ...], Hits] = field(default_factory=dict)

    def lay_out(self, positions: Sequence[int]) -> None:
        """The slices' poses of many scans in one go: scan by scan, the arrays would be too short to be worth a call."""
        e = self.estimate
        missing = [i for i in positions if i not in self.poses]
        if not missing:
            return
        counts = [self._slices(i) for i in missing]
        centres = np.concatenate([self._centres(i, n) for i, n in zip(missing, counts, strict=True)])
        every = self.motion.lidar_at(centres - e.time_offset_s, e.R_imu_lidar, e.p_imu_lidar)
        for i, end, n in zip(missing, np.cumsum(counts), counts, strict=True):
            own = slice(end - n, end)
            self.poses[i] = SlicePoses(
                every.R[own], every.p[own], every.omega_rad_s[own], every.v_m_s[own], every.usable[own]
            )

    def _slices(self, position: int) -> int:
        """As many slices as the scan's last point needs, and one to spare for rounding."""
        return int(self.clocks.sweep_s[position] / SLICE_S) + 2

    def _centres(self, position: int, slices: int) -> FloatArray:
        return np.asarray(self.clocks.scan_s[position] + (np.arange(slices) + 0.5) * SLICE_S)

    def hits(self, positions: Sequence[int], gate: Gate, stride: int = 1) -> Hits:
        """Where the points of scans meet the planes, point by point; slices are counted through all of them."""
        key = (*positions, stride, gate.min_cosine)
        if key in self.thinned:
            return self.thinned[key]
        clouds = [self.scans[i].points[::stride] for i in positions]
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
        )
        hits.plane[hits.plane >= len(e.normals)] = -1
        if errors is not None and errors.incidence_m:
            hits.d[hits.plane >= 0] += errors.incidence_m * (1.0 + hits.cosine[hits.plane >= 0])
        if stride > 1:
            self.thinned[key] = hits
        return hits

    def _errors(self) -> LaserErrors | None:
        """The lidar's own parameters as they are thought to be now; None where it is taken for ideal."""
        if not self.nuisance.blocks:
            return None
        return laser_errors(self.nuisance, self.estimate.nuisance)

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

    def laser_micro(
        self, positions: Sequence[int], hits: Hits, keep: BoolArray, weight: FloatArray, stride: int
    ) -> LaserMicro | None:
        """The kept points' moments for the lidar's own parameters; None where none of these is in play."""
        if not any(self.nuisance.start(block) >= 0 for block in (*LASER_BLOCKS, *LIDAR_BLOCKS)):
            return None
        # Slices go together that go to one knot, as they do when they are gathered.
        counts = [self._slices(i) for i in positions]
        centre_s = np.concatenate([self._centres(i, n) for i, n in zip(positions, counts, strict=True)])
        knot = self.motion.nearest_knot(centre_s - self.estimate.time_offset_s)
        begins = np.concatenate([[True], np.diff(knot) != 0])
        begins[np.cumsum(counts)[:-1]] = True
        first = np.flatnonzero(begins)
        middle = (first + np.append(first[1:], len(knot)) - 1) // 2
        group = np.cumsum(begins) - 1
        laser = np.concatenate([self.lasers_of(self.scans[i].points[::stride]) for i in positions])
        sums = collapse_features(
            hits, keep, weight, self.estimate.normals, laser=laser, lasers=max(self.nuisance.lasers, 1),
            group=group, middle=middle,
        )  # fmt: skip
        scan = np.repeat(np.asarray(positions, np.int64), counts)[middle][sums.group]
        return LaserMicro(centre_s[middle][sums.group], scan, sums)

    def _first_slices(self, positions: Sequence[int]) -> IntArray:
        """Where each scan's slices begin when those of all are in a row."""
        return np.cumsum([0, *(self._slices(i) for i in positions[:-1])])

    def micro(self, positions: Sequence[int], bins: MicroBins) -> Micro:
        """Bins of scans whose slices are in a row, each with its time and scan."""
        first = self._first_slices(positions)
        which = np.searchsorted(first, bins.slice_index, side="right") - 1
        scan = np.asarray(positions, np.int64)[which]
        time_s = self.clocks.scan_s[scan] + (bins.slice_index - first[which] + 0.5) * SLICE_S
        return Micro(time_s, scan, bins.plane, bins.scatter, bins.count)

    def slice_poses(self, position: int) -> SlicePoses:
        """The lidar at the centres of a scan's slices."""
        self.lay_out([position])
        return self.poses[position]

    def cloud(self, position: int, count: int) -> tuple[FloatArray, IntArray]:
        """About so many points of a scan, straightened, in the frame of the solve: (M, 3), and their places in it: (M,)."""
        scan = self.scans[position]
        stride = max(1, len(scan.points) // count)
        points = scan.points[::stride]
        poses = self.slice_poses(position)
        index = (points["offset_ns"] * 1e-9 / SLICE_S).astype(np.int64)
        usable = poses.usable[index]
        index = index[usable]
        xyz = self._corrected(points, self._errors())[usable].astype(np.float64)
        there = (poses.R[index] @ xyz[..., None])[..., 0] + poses.p[index]
        return there, np.flatnonzero(usable) * stride

    def strays(self, position: int, count: int, away_m: float) -> FloatArray:
        """Points of a scan that lie on no plane, in the frame of the solve: (M, 3), from a sample of so many points."""
        cloud, place = self.cloud(position, count)
        hits = self.hits([position], Gate(), max(1, len(self.scans[position].points) // count))
        free = (hits.plane < 0) | (np.abs(hits.d) > away_m)
        return cloud[free[place // max(1, len(self.scans[position].points) // count)]]

    def over_scans(self, positions: Sequence[int], job: Callable[[int], T], on_scans: OnScans = _ignore) -> list[T]:
        """A job for each scan, on several threads where allowed; results in the order of the positions."""
        return self._over(positions, [[i] for i in positions], lambda batch: job(batch[0]), on_scans)

    def over_batches(
        self, positions: Sequence[int], stride: int, job: Callable[[Sequence[int]], T], on_scans: OnScans = _ignore
    ) -> list[T]:
        """A job for every few scans in a row: of thinned scans, a single one would not be worth the call."""
        batches: list[list[int]] = []
        room = 0
        for i in positions:
            points = len(self.scans[i].points) // stride
            if points > room or not batches:
                batches.append([])
                room = _BATCH
            batches[-1].append(i)
            room -= points
        return self._over(positions, batches, job, on_scans)

    def _over(
        self, positions: Sequence[int], tasks: Sequence[list[int]], job: Callable[[Sequence[int]], T], on_scans: OnScans
    ) -> list[T]:
        """The jobs' results in order; on_scans is told from the caller's own thread, which may stop it all by raising."""
        self.lay_out(positions)
        several = self.threads > 1 and len(tasks) > 1
        results = []
        done = 0
        for task, result in zip(tasks, workers().map(job, tasks) if several else map(job, tasks), strict=True):
            results.append(result)
            done += len(task)
            on_scans(done)
        return results


def associate(
    view: View,
    positions: Sequence[int],
    noise: LidarNoise,
    gate: Gate,
    extents: PlaneExtents | None,
    *,
    stride: int = 1,
    on_scans: OnScans = _ignore,
) -> Micro:
    """The micro-bins of the given scans. stride: use every so many-th point.   on_scans: told how many are done."""
    n_planes = len(view.estimate.normals)
    cap = view.settings.points_per_plane_per_scan

    def some(batch: Sequence[int]) -> Micro:
        hits = view.hits(batch, gate, stride)
        keep, weight = select(hits, noise, gate, extents)
        if cap is not None:
            keep = _capped(hits, keep, cap, seed=view.settings.random_seed + batch[0])
        micro = view.micro(batch, collapse(hits, keep, weight, n_planes))
        return replace(
            micro,
            lasers=view.laser_micro(batch, hits, keep, weight, stride),
            nuisance=view.estimate.nuisance,
            time_offset_s=view.estimate.time_offset_s,
        )

    if cap is None:
        return Micro.joined(view.over_batches(positions, stride, some, on_scans))
    return Micro.joined(view.over_scans(positions, lambda position: some([position]), on_scans))


def _capped(hits: Hits, keep: BoolArray, cap: int, seed: int) -> BoolArray:
    """At most so many points a plane, drawn evenly at random (pt/pl/sc)."""
    rng = np.random.default_rng(seed)
    out = np.zeros_like(keep)
    for plane in np.unique(hits.plane[keep]):
        mine = np.flatnonzero(keep & (hits.plane == plane))
        out[mine if len(mine) <= cap else rng.choice(mine, cap, replace=False)] = True
    return out


def gather(micro: Micro, motion: Motion, estimate: Estimate) -> Bins:
    """Micro-bins moved to their nearest knots under the current motion and summed: one bin a knot and plane."""
    # One pose a slice, shared by the planes seen in it.
    time_s, of_slice = np.unique(micro.time_s, return_inverse=True)
    imu_s = time_s - estimate.time_offset_s
    # With lasers told apart, slices stay with the knots that their lasers' moments were put together for.
    knot = motion.nearest_knot(imu_s if micro.lasers is None else time_s - micro.time_offset_s)
    poses = motion.lidar_at(imu_s, estimate.R_imu_lidar, estimate.p_imu_lidar)
    knots = motion.lidar_at(motion.readings.knots_s, estimate.R_imu_lidar, estimate.p_imu_lidar)
    Rk_t = np.swapaxes(knots.R[knot], 1, 2)
    R = Rk_t @ poses.R
    p = (Rk_t @ (poses.p - knots.p[knot])[..., None])[..., 0]
    use = np.flatnonzero(poses.usable[of_slice])
    of_slice = of_slice[use]
    n_planes = len(estimate.normals)
    key = knot[of_slice] * n_planes + micro.plane[use]
    # Points that were laid out for an ideal lidar are those of one whose parameters are zero.
    laid_out = micro.nuisance if len(micro.nuisance) else np.zeros(len(estimate.nuisance))
    if len(key) == 0:
        empty = np.zeros(0, np.int64)
        return Bins(empty, empty, np.zeros((0, 5, 5)), empty, estimate.time_offset_s, LaserFactors.empty(), laid_out)
    keys, scatter = move_and_sum(micro.scatter[use], R, p, of_slice, key)
    count = np.bincount(np.searchsorted(keys, key), micro.count[use]).astype(np.int64)
    lasers = LaserFactors.empty()
    if micro.lasers is not None:
        lasers = gather_lasers(micro.lasers, motion, estimate, micro.time_offset_s)
    return Bins(keys // n_planes, keys % n_planes, scatter, count, estimate.time_offset_s, lasers, laid_out)


def gather_lasers(micro: LaserMicro, motion: Motion, estimate: Estimate, time_offset_s: float) -> LaserFactors:
    """Moments moved to their knots under the current motion and summed: a knot, plane and laser each.

    time_offset_s: with which slices were put together to knots.
    """
    time_s, of_group = np.unique(micro.time_s, return_inverse=True)
    imu_s = time_s - estimate.time_offset_s
    knot = motion.nearest_knot(time_s - time_offset_s)
    poses = motion.lidar_at(imu_s, estimate.R_imu_lidar, estimate.p_imu_lidar)
    knots = motion.lidar_at(motion.readings.knots_s, estimate.R_imu_lidar, estimate.p_imu_lidar)
    back = np.swapaxes(knots.R[knot], 1, 2)
    move = np.zeros((len(time_s), 5, 5))
    move[:, :3, :3] = back @ poses.R
    move[:, :3, 3] = (back @ (poses.p - knots.p[knot])[..., None])[..., 0]
    move[:, 3, 3] = move[:, 4, 4] = 1.0
    use = np.flatnonzero(poses.usable[of_group])
    of_group, sums = of_group[use], micro.sums
    n_planes, lasers = len(estimate.normals), int(sums.laser.max(initial=0)) + 1
    keys, place = np.unique(
        (knot[of_group] * n_planes + sums.plane[use]) * lasers + sums.laser[use], return_inverse=True
    )
    moved = sums.cross[use] @ np.swapaxes(move[of_group], 1, 2)
    if len(keys) == 0:
        return LaserFactors.empty()
    order = np.argsort(place, kind="stable")
    first = np.searchsorted(place[order], np.arange(len(keys)))
    cross = np.add.reduceat(moved[order], first, axis=0)
    gram = np.add.reduceat(sums.gram[use][order].astype(np.float64), first, axis=0)
    pairs, pair = np.unique(keys // lasers, return_inverse=True)
    return LaserFactors(pairs // n_planes, pairs % n_planes, pair, keys % lasers, cross, gram)


def survey(
    view: View,
    positions: Sequence[int],
    noise: LidarNoise,
    gate: Gate,
    *,
    stride: int,
    within: BoolArray | None = None,
) -> PlaneExtents:
    """The cells of every plane, from where the scans' returns lie on and beside it.

    within: (P, rows, columns) that a plane may have at all; None for all.
    """
    total = ExtentSurvey.empty(view.estimate.normals)

    def some(batch: Sequence[int]) -> tuple[IntArray, IntArray, BoolArray, FloatArray]:
        hits = view.hits(batch, gate, stride)
        std = noise.distance_std_m(hits.cosine)
        close = np.flatnonzero((hits.plane >= 0) & (np.abs(hits.d) < 0.3 + gate.extra_m))
        cells = cells_of(hits, view.estimate.normals)
        on = np.abs(hits.d) < gate.sigmas * std + gate.extra_m
        off = hits.d[close] / (_OFF_SIGMAS * std[close] + gate.extra_m)
        return hits.plane[close], cells[close], on[close], off

    plane, cell, on, off = (
        np.concatenate(each) for each in zip(*view.over_batches(positions, stride, some), strict=True)
    )
    total.add(plane, cell, on, off)
    return total.finish(within)


def measure_noise(
    view: View, positions: Sequence[int], start: LidarNoise, gate: Gate, extents: PlaneExtents | None
) -> LidarNoise:
    """Range and surface noise from the spread of distances under different incidences.

    std^2(d) = range^2 c^2 + surface^2, fitted to robust variances in bands of c^2; neither below 0.1 mm.
    """
    wide = Gate(sigmas=6.0, extra_m=gate.extra_m, margin_m=gate.margin_m, min_cosine=gate.min_cosine)
    edges = np.linspace(0.0, 1.0, 13)

    def one(position: int) -> tuple[FloatArray, FloatArray, IntArray]:
        hits = view.hits([position], wide)
        keep, _ = select(hits, start, wide, extents)
        return hits.d[keep], hits.cosine[keep] ** 2, hits.plane[keep]

    parts = view.over_scans(positions, one)
    # Each scan's own mean on each plane is taken out: what remains is noise, not the pose's error.
    d = np.concatenate([_centred(p[0], p[2]) for p in parts])
    c2 = np.concatenate([p[1] for p in parts])
    if len(d) < 500:
        return start
    rows, variances, weights = [], [], []
    band = np.digitize(c2, edges)
    for b in np.unique(band):
        mine = d[band == b]
        if len(mine) > 100:
            variance = tapered_variance(mine)
            rows.append([float(c2[band == b].mean()), 1.0])
            variances.append(variance)
            weights.append(np.sqrt(len(mine)) / max(variance, 1e-12))
    return _split_variance(np.array(rows), np.array(variances), np.array(weights), start)


#: E[w u^2] / E[w] of a standard normal u under w = (1 - u^2 / 16)^2 within four: by numerical integration.
_TAPERED = 0.7708825578050007


def tapered_variance(d: FloatArray) -> float:
    """Variance of the normal law in the middle of a sample that has outliers, by weights that fall to zero at four sigma.

    The weights taper and agree with the variance that they give, so that it is a smooth function of every distance: one
    point more or less must not move the cost of the whole solve. The first guess is the median of the distances.
    """
    square = d**2
    variance = 1.4826**2 * float(np.median(square))
    for _ in range(30):
        before = variance
        weight = np.maximum(1.0 - square / max(16.0 * before, 1e-30), 0.0) ** 2
        variance = float(np.sum(weight * square)) / max(_TAPERED * float(np.sum(weight)), 1e-30)
        if abs(variance - before) <= 1e-12 * before:
            break
    return variance


def _centred(d: FloatArray, plane: IntArray) -> FloatArray:
    out = d.copy()
    for j in np.unique(plane):
        mine = plane == j
        if mine.sum() > 20:
            out[mine] -= np.median(d[mine])
    return out


def _split_variance(rows: FloatArray, variances: FloatArray, weights: FloatArray, start: LidarNoise) -> LidarNoise:
    """Non-negative weighted least squares of variance against [c^2, 1]."""
    if len(rows) == 0:
        return start
    if len(rows) == 1:
        return LidarNoise(_told(variances[0] / rows[0, 0]), 1e-4)
    solution, _ = nnls(rows * weights[:, None], variances * weights)
    return LidarNoise(_told(solution[0]), _told(solution[1]))


def _told(variance: float) -> float:
    """A standard deviation to three digits, no more than are known, and not below 0.1 mm.

    Further digits change with a single point that comes or goes, and the cost of the whole solve with them.
    """
    return max(float(f"{np.sqrt(variance):.3g}"), 1e-4)
