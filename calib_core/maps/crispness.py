"""How crisp the accumulated room is, without knowing a plane: entropy and thickness of small neighbourhoods.

The map's points are taken in cubes; the points of one cube have a covariance S with eigenvalues l1 <= l2 <= l3:

    mean map entropy      mean over points of 1/2 ln |2 pi e S|      [nat], lower is crisper
    mean plane variance   mean over points of l1                      [m2], its root is how thick surfaces are

Corners, edges and bushes have their share in both, before and after alike: differences tell, not values. The same
points are measured each time, those that have neighbours enough in every map; each map is divided anew, so that none is
favoured. A grid's place is chance, so four grids are laid and their means taken.

Both measures are known in the field for maps without ground truth. Neither knows of planes, of the solve's residuals
or of the truth, so they are evidence of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calib_core.deskew import map_points, raw_map_points
from calib_core.maps.accumulate import covers, voxels_of
from calib_core.result import Crispness, RoomCrispness
from calib_core.threads import workers
from calib_core.types import BoolArray, Float32Array, FloatArray, IntArray, Scan, Trajectory

#: Edge of the cubes: ten times a lidar's noise, so that a wall is thin in it, and small against furniture. Of 0.2, 0.4 and
#: 0.8 m the smallest told extrinsics 0.5 deg apart best.
CUBE_M = 0.2
#: Fewer points in a cube say little about three axes.
_LEAST_POINTS = 20
#: Fewer cubes are no room.
_LEAST_CUBES = 50
#: Scans spread over the recording, and points of each: 0.5 s of work, and what chance leaves is below 0.001 nat.
_SCANS, _POINTS = 60, 2500
#: The four grids, as fractions of a cube.
_GRIDS = ((0.0, 0.0, 0.0), (0.5, 0.5, 0.0), (0.5, 0.0, 0.5), (0.0, 0.5, 0.5))
#: Entropy of points that all lie in one place; cubes with such are not infinitely crisp.
_THINNEST_M2 = 1e-10

Laying = Callable[[Scan, Trajectory], Float32Array]


def sampled(scans: Sequence[Scan], trajectory: Trajectory) -> list[Scan]:
    """Scans spread over the recording that the trajectory covers, thinned: what every measure of it looks at."""
    places = np.unique(np.linspace(0, len(scans) - 1, _SCANS).astype(np.int64)) if len(scans) else np.zeros(0, np.int64)
    thinned = []
    for place in places:
        scan = scans[int(place)]
        if scan.points.size and covers(trajectory, scan):
            step = max(1, scan.points.size // _POINTS)
            thinned.append(Scan(scan.index, scan.stamp_ns, scan.points[::step]))
    return thinned


def crispness_of(scans: Sequence[Scan], trajectory: Trajectory) -> Crispness | None:
    """Of the raw scans and with the motion taken out; None where too little of the room was seen."""
    chosen = sampled(scans, trajectory)
    maps_m = [laid(chosen, trajectory, raw_map_points), laid(chosen, trajectory)]
    measured = compare_rooms(maps_m)
    if measured is None:
        return None
    before, after = measured
    moved_rms_m = float(np.sqrt(np.mean(np.sum((maps_m[1] - maps_m[0]) ** 2, axis=1))))
    return Crispness(before=before, after=after, text=_sentence(before, after, moved_rms_m))


def laid(chosen: Sequence[Scan], trajectory: Trajectory, laying: Laying = map_points) -> FloatArray:
    """(N, 3) [m]: the points of the chosen scans in the map frame, in their order."""
    parts = [laying(scan, trajectory) for scan in chosen]
    return np.concatenate(parts).astype(np.float64) if parts else np.zeros((0, 3))


def compare_rooms(maps_m: Sequence[FloatArray]) -> list[RoomCrispness] | None:
    """One for each map of the same points, over the points that have neighbours enough in all of them.

    maps_m: (N, 3) [m] each, the same points in the same order.   None where they are no room.
    """
    if not maps_m or not len(maps_m[0]):
        return None
    totals = np.zeros((len(maps_m), 4))  # points that count, their entropies, thinnest variances, cubes
    shifted = [workers().submit(_neighbourhoods, xyz_m + CUBE_M * np.array(by)) for by in _GRIDS for xyz_m in maps_m]
    for first in range(0, len(shifted), len(maps_m)):
        rooms = [room.result() for room in shifted[first : first + len(maps_m)]]
        counted = np.all([room.n_points[room.cube] >= _LEAST_POINTS for room in rooms], axis=0)
        totals += [room.sums_over(counted) for room in rooms]
    if totals[:, 3].min() < _LEAST_CUBES * len(_GRIDS):
        return None
    return [
        RoomCrispness(
            mean_entropy_nat=float(entropy / points),
            thickness_std_m=float(np.sqrt(variance / points)),
            points=int(points) // len(_GRIDS),
            cubes=int(cubes) // len(_GRIDS),
        )
        for points, entropy, variance, cubes in totals
    ]


@dataclass(frozen=True, slots=True)
class _Neighbourhoods:
    """Cubes of a map. cube: (N,) of each point.   n_points, entropy_nat, thinnest_m2: (K,) of each cube."""

    cube: IntArray
    n_points: IntArray
    entropy_nat: FloatArray
    thinnest_m2: FloatArray

    def sums_over(self, counted: BoolArray) -> tuple[float, float, float, float]:
        """Points, their cubes' entropies and thinnest variances, and how many cubes. counted: (N,) which points."""
        cube = self.cube[counted]
        there = np.zeros(len(self.entropy_nat), np.bool_)
        there[cube] = True
        return cube.size, self.entropy_nat[cube].sum(), self.thinnest_m2[cube].sum(), int(np.count_nonzero(there))


def _neighbourhoods(xyz_m: FloatArray) -> _Neighbourhoods:
    _, cube = np.unique(voxels_of(xyz_m, CUBE_M), return_inverse=True)
    spread, count = _covariances(xyz_m, cube)
    variances = np.maximum(np.linalg.eigvalsh(spread), _THINNEST_M2)
    entropy = 0.5 * (3.0 * np.log(2.0 * np.pi * np.e) + np.log(variances).sum(axis=1))
    return _Neighbourhoods(cube, count, entropy, variances[:, 0])


def _covariances(xyz_m: FloatArray, cube: IntArray) -> tuple[FloatArray, IntArray]:
    """(K, 3, 3) [m2] of the points of each cube, and their numbers (K,)."""
    count = np.bincount(cube)
    centre_m = np.stack([np.bincount(cube, xyz_m[:, a]) for a in range(3)], axis=1) / count[:, None]
    from_centre_m = xyz_m - centre_m[cube]
    spread = np.empty((count.size, 3, 3))
    for a in range(3):
        for b in range(a, 3):
            spread[:, a, b] = spread[:, b, a] = np.bincount(cube, from_centre_m[:, a] * from_centre_m[:, b])
    return spread / np.maximum(count - 1, 1)[:, None, None], count


def _sentence(before: RoomCrispness, after: RoomCrispness, moved_rms_m: float) -> str:
    """In words. moved_rms_m: by how much de-skewing moves the points, which the cubes do not know."""
    gained = before.mean_entropy_nat - after.mean_entropy_nat
    thick = (
        f"in cubes of {CUBE_M:.1f} m, corners and clutter included, points lie {1e3 * after.thickness_std_m:.1f} mm (rms) off "
        f"their own surface instead of {1e3 * before.thickness_std_m:.1f} mm, and the map's entropy is {abs(gained):.3f} nat"
    )
    if gained > 0.0:
        return f"Without regard to any plane, the room is crisper de-skewed: {thick} lower."
    return (
        f"Without regard to any plane, the room is no crisper de-skewed: {thick} higher. Cubes of {CUBE_M:.1f} m do not see a "
        "smear wider than they are, nor one that is little beside noise and clutter, and de-skewing moves the points by "
        f"{1e3 * moved_rms_m:.0f} mm (rms): this measure alone does not tell whether the answer fits."
    )
