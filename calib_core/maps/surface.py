"""The room as a surface, by Open3D: strays left out, normals towards the lidar, a mesh where points are.

Every call runs on one thread: with several, Open3D's answers change in the last digits from run to run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.errors import InputError
from calib_core.maps.accumulate import RoomMap
from calib_core.maps.library import load_open3d
from calib_core.types import CountArray, Float32Array, FloatArray

#: A point farther from its 20 neighbours than the mean of all such distances by two standard deviations is a stray.
_NEIGHBOURS, _STRAY_STD = 20, 2.0
#: Normals look over three voxels: one holds a point, and three are a patch of about 30.
_NORMAL_REACH_VOXELS, _NORMAL_NEIGHBOURS = 3.0, 30
#: A screened Poisson surface closes every gap; what is farther from a point than this was not seen.
_SEEN_WITHIN_VOXELS = 1.5
#: Depth of the octree: 2^9 cells across a room of 20 m are 4 cm each, and deeper ones take minutes.
_DEEPEST = 9
_FEWEST_POINTS = 100
#: Passes of a smoothing that does not shrink (Taubin), before flat parts are made of fewer triangles.
_SMOOTHED = 15


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh, map frame. vertices_m: (V, 3).   triangles: (T, 3) indices.   normals: (V, 3) unit."""

    vertices_m: Float32Array
    triangles: CountArray
    normals: Float32Array


def without_strays(room: RoomMap) -> RoomMap:
    """The map without points that stand alone."""
    o3d = load_open3d()
    if len(room.points) <= _NEIGHBOURS:
        return room
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(room.xyz_m.astype(np.float64)))
    _, kept = cloud.remove_statistical_outlier(_NEIGHBOURS, _STRAY_STD)
    return RoomMap(room.points[np.asarray(kept, np.int64)], room.voxel_m)


def normals_of(room: RoomMap, seen_from_m: FloatArray) -> Float32Array:
    """(N, 3) unit normals on the lidar's side.   seen_from_m: (N, 3) where the lidar was."""
    o3d = load_open3d()
    xyz_m = room.xyz_m.astype(np.float64)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(xyz_m))
    reach_m = _NORMAL_REACH_VOXELS * room.voxel_m
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=reach_m, max_nn=_NORMAL_NEIGHBOURS))
    normals = np.asarray(cloud.normals)
    away = np.sum(normals * (seen_from_m - xyz_m), axis=1) < 0.0
    return np.where(away[:, None], -normals, normals).astype(np.float32)


def mesh_of(room: RoomMap, normals: Float32Array, *, triangles: int | None = None) -> Mesh:
    """The surface through the map's points (screened Poisson), cut back to where points are.

    triangles: at most so many; the lidar's noise is smoothed away first, and flat parts are made of fewer (quadric error).
    None for as many as there are, where the points are.
    """
    o3d = load_open3d()
    if len(room.points) < _FEWEST_POINTS:
        raise InputError(
            f"Expected at least {_FEWEST_POINTS} points to lay a surface through, but the map has {len(room.points)}; "
            "choose smaller voxels or a longer recording.",
            code="mesh.too_few",
        )
    xyz_m = room.xyz_m.astype(np.float64)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(xyz_m))
    cloud.normals = o3d.utility.Vector3dVector(normals.astype(np.float64))
    span_m = float(np.ptp(xyz_m, axis=0).max())
    depth = int(np.clip(np.ceil(np.log2(span_m / room.voxel_m)), 5, _DEEPEST))
    surface, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=depth, n_threads=1)
    corners = o3d.geometry.PointCloud(surface.vertices)
    far = np.asarray(corners.compute_point_cloud_distance(cloud)) > _SEEN_WITHIN_VOXELS * room.voxel_m
    surface.remove_vertices_by_mask(far)
    surface.remove_unreferenced_vertices()
    if triangles is not None and len(surface.triangles) > triangles:
        surface = surface.filter_smooth_taubin(_SMOOTHED).simplify_quadric_decimation(triangles)
    surface.compute_vertex_normals()
    return Mesh(
        np.asarray(surface.vertices, np.float32),
        np.asarray(surface.triangles, np.int32),
        np.asarray(surface.vertex_normals, np.float32),
    )
