"""Wall thickness before and after: the spread of a plane's points about it, the same points both times.

Points are chosen by their de-skewed place (within GATE_M of the plane and within no nearer one), then measured as the
driver published them (the sweep as one rigid body at its first point's pose) and de-skewed. Choosing once keeps the
gate from hiding how bad "before" was.

    dist = n . x + w        x_before = R(t_0) x_lidar + p(t_0)        x_after = R(t_i) x_lidar + p(t_i)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from app.planes.geometry import within_outline
from app.schemas.results import Thickness, WallThickness
from calib_core import api
from calib_core.result import PlaneQuality
from calib_core.types import FloatArray, Recording, Trajectory

#: Half the thickness of the slab around a plane whose de-skewed points are taken as the wall's.
GATE_M = 0.10
#: Scans looked at, spread over the recording: enough for numbers, quick for long recordings.
MAX_SCANS = 60
#: Histogram: half width and number of bins.
HISTOGRAM_HALF_M = 0.25
HISTOGRAM_BINS = 50


def nearest_plane(
    points_map: NDArray[np.float32],
    normals: FloatArray,
    offsets_m: FloatArray,
    *,
    gate_m: float,
    outlines_m: Sequence[FloatArray | None] = (),
) -> tuple[NDArray[np.int16], NDArray[np.float32]]:
    """Index of each point's nearest plane (-1: none within gate_m) and its signed distance to it [m].

    points_map: (N, 3).   normals: (K, 3), unit.   offsets_m: (K,).   Returns (N,) and (N,); NaN where there is none.
    outlines_m: (corners, 3) of each plane or None; points of a plane outside of its outline have none either.
    """
    if len(normals) == 0:
        return np.full(len(points_map), -1, dtype=np.int16), np.full(len(points_map), np.nan, dtype=np.float32)
    dist_m = points_map @ normals.T.astype(np.float32) + offsets_m.astype(np.float32)
    nearest = np.abs(dist_m).argmin(axis=1)
    chosen_m = np.take_along_axis(dist_m, nearest[:, None], axis=1)[:, 0]
    outside = ~(np.abs(chosen_m) <= gate_m)
    for plane, outline_m in enumerate(outlines_m):
        if outline_m is not None:
            mine = np.flatnonzero((nearest == plane) & ~outside)
            outside[mine] = ~within_outline(points_map[mine], normals[plane], outline_m)
    labels = nearest.astype(np.int16)
    labels[outside] = -1
    return labels, np.where(outside, np.float32(np.nan), chosen_m)


def measure_thickness(recording: Recording, trajectory: Trajectory, planes: Sequence[PlaneQuality]) -> Thickness:
    """Wall thickness per plane, over scans spread evenly through the recording, of which the motion is known."""
    normals = np.array([plane.normal for plane in planes], dtype=np.float64).reshape(-1, 3)
    offsets_m = np.array([plane.offset_m for plane in planes], dtype=np.float64)
    outlines_m = outlines_of(planes)
    before: list[list[NDArray[np.float32]]] = [[] for _ in planes]
    after: list[list[NDArray[np.float32]]] = [[] for _ in planes]
    for place in spread(len(recording.scans), MAX_SCANS):
        scan = recording.scans[place]
        if not api.covers(trajectory, scan):  # laid where the motion is not known, it would blur both maps alike
            continue
        labels, after_m = nearest_plane(
            api.map_points(scan, trajectory), normals, offsets_m, gate_m=GATE_M, outlines_m=outlines_m
        )
        rigid = api.raw_map_points(scan, trajectory)
        for k in range(len(planes)):
            chosen = labels == k
            before[k].append(rigid[chosen] @ normals[k].astype(np.float32) + np.float32(offsets_m[k]))
            after[k].append(after_m[chosen])
    edges_m = np.linspace(-HISTOGRAM_HALF_M, HISTOGRAM_HALF_M, HISTOGRAM_BINS + 1)
    walls = [_wall(plane.name, _joined(before[k]), _joined(after[k]), edges_m) for k, plane in enumerate(planes)]
    return Thickness(
        edges_m=edges_m.tolist(),
        walls=walls,
        before_rms_m=_rms(np.concatenate([_joined(part) for part in before]) if before else np.zeros(0)),
        after_rms_m=_rms(np.concatenate([_joined(part) for part in after]) if after else np.zeros(0)),
    )


def outlines_of(planes: Sequence[PlaneQuality]) -> list[FloatArray | None]:
    """The corners (K, 3) that each plane was restricted to in its solve; None where it was not."""
    return [None if plane.outline_m is None else np.array(plane.outline_m, dtype=np.float64) for plane in planes]


def spread(total: int, most: int) -> list[int]:
    """At most `most` places spread evenly over 0 .. total - 1."""
    if total <= most:
        return list(range(total))
    return [int(place) for place in np.linspace(0, total - 1, most)]


def _wall(name: str, before_m: NDArray[np.float32], after_m: NDArray[np.float32], edges_m: FloatArray) -> WallThickness:
    return WallThickness(
        name=name,
        points=len(after_m),
        before_rms_m=_rms(before_m),
        after_rms_m=_rms(after_m),
        before_histogram=np.histogram(before_m, edges_m)[0].tolist(),
        after_histogram=np.histogram(after_m, edges_m)[0].tolist(),
    )


def _joined(parts: list[NDArray[np.float32]]) -> NDArray[np.float32]:
    return np.concatenate(parts) if parts else np.zeros(0, dtype=np.float32)


def _rms(dist_m: NDArray[np.floating]) -> float:
    return float(np.sqrt(np.mean(np.square(dist_m, dtype=np.float64)))) if len(dist_m) else 0.0
