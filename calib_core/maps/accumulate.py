"""The room as one cloud: every scan laid into the map frame by a solved motion, one return kept in each voxel.

A voxel keeps a return as it was, not a mean: its time and ring stay those of one firing, and no point lies where none
was measured. The first return in the order of the recording is kept, so that the map does not depend on anything else.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib_core.deskew import map_points
from calib_core.errors import Cancelled
from calib_core.events import ShouldCancel, never_cancel
from calib_core.types import Float32Array, FloatArray, IntArray, Scan, Trajectory

#: One point of the map. time: [s] after the trajectory's epoch; double, for an hour in microseconds is more than float32.
MAP_DTYPE = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("time", "<f8"), ("ring", "<u2")])
#: Scans between two merges: bounds the memory at some hundred thousand points beside the map.
_MERGE_EVERY = 20
#: A scan may begin or end this long outside of the solved motion: the solve's own first and last knots.
_OVERHANG_S = 0.02
#: Voxels are counted from here, 2^20 of them each way: 52 km at 5 cm.
_HALF_GRID = 1 << 20


@dataclass(frozen=True)
class RoomMap:
    """points: (N,) MAP_DTYPE, map frame.   voxel_m: edge of the voxels, 0 for none."""

    points: NDArray[np.void]
    voxel_m: float

    @property
    def xyz_m(self) -> Float32Array:
        """(N, 3) [m]."""
        return np.stack([self.points[n] for n in "xyz"], axis=1)


def covers(trajectory: Trajectory, scan: Scan) -> bool:
    """Whether the motion is known, and not bridged, all through the sweep."""
    start_s = trajectory.begin_s(scan)
    end_s = start_s + (float(scan.points["offset_ns"].max()) * 1e-9 if scan.points.size else 0.0)
    t = trajectory.times_s
    if start_s < t[0] - _OVERHANG_S or end_s > t[-1] + _OVERHANG_S:
        return False
    first = max(int(np.searchsorted(t, start_s, side="right")) - 1, 0)
    last = min(int(np.searchsorted(t, end_s, side="left")), t.size - 1)
    return bool(trajectory.valid[first : last + 1].all())


def accumulate(
    scans: Iterable[Scan], trajectory: Trajectory, voxel_m: float, *, should_cancel: ShouldCancel = never_cancel
) -> RoomMap:
    """The map of scans that the trajectory covers; the caller leaves out the others.   voxel_m: above 0."""
    kept: list[NDArray[np.void]] = []
    for number, scan in enumerate(scans):
        if should_cancel():
            raise Cancelled("The map was stopped.")
        kept.append(_thinned(_laid(scan, trajectory), voxel_m))
        if number % _MERGE_EVERY == _MERGE_EVERY - 1:
            kept = [_thinned(np.concatenate(kept), voxel_m)]
    points = _thinned(np.concatenate(kept), voxel_m) if kept else np.empty(0, MAP_DTYPE)
    return RoomMap(points, voxel_m)


def voxels_of(xyz_m: Float32Array | FloatArray, voxel_m: float) -> IntArray:
    """(N,) one number for each point's voxel."""
    cells = np.floor(xyz_m.astype(np.float64) / voxel_m).astype(np.int64) + _HALF_GRID
    return (cells[:, 0] * (2 * _HALF_GRID) + cells[:, 1]) * (2 * _HALF_GRID) + cells[:, 2]


def _laid(scan: Scan, trajectory: Trajectory) -> NDArray[np.void]:
    laid = np.empty(scan.points.size, MAP_DTYPE)
    xyz_m = map_points(scan, trajectory)
    for axis, name in enumerate("xyz"):
        laid[name] = xyz_m[:, axis]
    laid["intensity"], laid["ring"] = scan.points["intensity"], scan.points["ring"]
    laid["time"] = trajectory.begin_s(scan) + scan.points["offset_ns"] * 1e-9
    return laid


def _thinned(points: NDArray[np.void], voxel_m: float) -> NDArray[np.void]:
    xyz_m = np.stack([points[n] for n in "xyz"], axis=1)
    _, first = np.unique(voxels_of(xyz_m, voxel_m), return_index=True)
    return points[np.sort(first)]
