"""The room as a surface, by Open3D: strays left out, normals towards the lidar, a mesh where points are.

Every call runs on one thread: with several, Open3D's answers change in the last digits from run to run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from calib_core.errors import InputError
from calib_core.maps.accumulate import RoomMap
from calib_core.maps.library import load_open3d
from calib_core.types import CountArray, Float32Array, FloatArray

#: A point farther from its 20 neighbours than the mean of all such distances by two standard deviations is a stray.
_NEIGHBOURS, _STRAY_STD = 20, 2.0
#: Normals look over three voxels: one holds a point, and three are a patch of about 30.
_NORMAL_REACH_VOXELS, _NORMAL_NEIGHBOURS = 3.0, 30
#: A screened Poisson surface closes every gap; what is farther from a point than this was not seen.
_SEEN_WITHIN_VOXELS = 1.25
#: And what is so far off the surface at the nearest point is where it bulges out past the rim.
_SEEN_OFF_VOXELS = 0.5
#: Depth of the octree: 2^9 cells across a room of 20 m are 4 cm each, and deeper ones take minutes.
_DEEPEST = 9
_FEWEST_POINTS = 100
#: Passes of a smoothing that does not shrink (Taubin), before flat parts are made of fewer triangles.
_SMOOTHED = 15
#: Points are laid on what their neighbours agree on: neighbours count whose normals are alike (1 - cosine: 18 deg), by this
#: far off along the normal (about two standard deviations of a lidar's ranges), in so many passes over each.
_ALIKE, _OFF_M, _PASSES = 0.05, 0.03, 3
#: A piece of surface smaller than this, in voxels, hangs in the air between strays.
_SMALLEST_VOXELS = 25


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


def laid_flat(xyz_m: FloatArray, normals: FloatArray, reach_m: float) -> tuple[FloatArray, FloatArray]:
    """Points and unit normals (N, 3), the lidar's noise taken out where surfaces are smooth, edges left sharp.

    A return has a centimetre or two of noise, and a surface through such points is lumpy whatever is smoothed afterwards.
    Each normal becomes the mean of its neighbours' that look the same way, each point goes along its own to the plane of the
    neighbours that it lies with: what is round the corner looks another way and has no say. No plane of the solve is asked,
    so that walls which the calibration leaves thick do not come out thin.
    """
    distance_m, near = cKDTree(xyz_m).query(xyz_m, _NORMAL_NEIGHBOURS, distance_upper_bound=reach_m)
    beside = np.isfinite(distance_m)
    near = np.where(beside, near, 0)

    def alike() -> FloatArray:
        turned = 1.0 - np.einsum("ni,nki->nk", normals, normals[near])
        weights: FloatArray = np.where(beside, np.exp(-np.maximum(turned, 0.0) / _ALIKE), 0.0)
        return weights

    for _ in range(_PASSES):
        mean = np.einsum("nk,nki->ni", alike(), normals[near])
        normals = mean / np.linalg.norm(mean, axis=1, keepdims=True)
    weights = alike()
    for _ in range(_PASSES):
        off_m = np.einsum("ni,nki->nk", normals, xyz_m[near] - xyz_m[:, None])
        counts = weights * np.exp(-0.5 * np.square(off_m / _OFF_M))
        xyz_m = xyz_m + normals * (np.sum(counts * off_m, axis=1) / np.sum(counts, axis=1))[:, None]
    return xyz_m, normals


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
    laid_m, towards = laid_flat(xyz_m, normals.astype(np.float64), _NORMAL_REACH_VOXELS * room.voxel_m)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(laid_m))
    cloud.normals = o3d.utility.Vector3dVector(towards)
    span_m = float(np.ptp(xyz_m, axis=0).max())
    depth = int(np.clip(np.ceil(np.log2(span_m / room.voxel_m)), 5, _DEEPEST))
    surface, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=depth, n_threads=1)
    corners_m = np.asarray(surface.vertices)
    away_m, beside = cKDTree(laid_m).query(corners_m)
    off_m = np.abs(np.sum((corners_m - laid_m[beside]) * towards[beside], axis=1))
    surface.remove_vertices_by_mask(
        (away_m > _SEEN_WITHIN_VOXELS * room.voxel_m) | (off_m > _SEEN_OFF_VOXELS * room.voxel_m)
    )
    piece, _, area_m2 = (np.asarray(each) for each in surface.cluster_connected_triangles())
    surface.remove_triangles_by_mask(area_m2[piece] < _SMALLEST_VOXELS * room.voxel_m**2)
    surface.remove_unreferenced_vertices()
    if triangles is not None and len(surface.triangles) > triangles:
        surface = surface.filter_smooth_taubin(_SMOOTHED).simplify_quadric_decimation(triangles)
    surface.compute_vertex_normals()
    return Mesh(
        np.asarray(surface.vertices, np.float32),
        np.asarray(surface.triangles, np.int32),
        np.asarray(surface.vertex_normals, np.float32),
    )
