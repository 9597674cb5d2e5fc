"""The room that people look at and take away: the accumulated map without strays, with normals."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from calib_core.deskew import lidar_poses
from calib_core.errors import InputError
from calib_core.events import ShouldCancel, never_cancel
from calib_core.maps.accumulate import MAP_DTYPE, RoomMap, accumulate, covers
from calib_core.maps.files import StructArray
from calib_core.maps.surface import normals_of, without_strays
from calib_core.types import Float32Array, Scan, Trajectory


@dataclass(frozen=True)
class Room:
    """cloud: the map.   normals: (N, 3) unit, towards the lidar, map frame."""

    cloud: RoomMap
    normals: Float32Array

    def with_normals(self) -> StructArray:
        """(N,) the map's points with normal_x, normal_y and normal_z behind the other fields."""
        names = ("normal_x", "normal_y", "normal_z")
        joined = np.empty(len(self.cloud.points), [*MAP_DTYPE.descr, *((name, "<f4") for name in names)])
        for name in MAP_DTYPE.names or ():
            joined[name] = self.cloud.points[name]
        for axis, name in enumerate(names):
            joined[name] = self.normals[:, axis]
        return joined


def room_of(
    scans: Iterable[Scan], trajectory: Trajectory, voxel_m: float, *, should_cancel: ShouldCancel = never_cancel
) -> Room:
    """The room of the scans whose motion is known. Raises InputError where that is none of them."""
    cloud = accumulate((s for s in scans if covers(trajectory, s)), trajectory, voxel_m, should_cancel=should_cancel)
    if not cloud.points.size:
        raise no_map("this recording")
    cloud = without_strays(cloud)
    seen_from_m = lidar_poses(trajectory, cloud.points["time"])[1]
    return Room(cloud, normals_of(cloud, seen_from_m))


def no_map(name: str) -> InputError:
    """What is said where no motion is known to lay the scans together with."""
    return InputError(
        f"Expected the motion of {name} to lay its scans into one map, but its planes do not give it; record in front of "
        "walls and floor, or write the scans without a map.",
        code="map.no_motion",
    )
