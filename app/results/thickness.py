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

from app.results.plane_table import PlaneTable
from app.results.thinning import spread
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


def measure_thickness(recording: Recording, trajectory: Trajectory, planes: Sequence[PlaneQuality]) -> Thickness:
    """Wall thickness per plane, over scans spread evenly through the recording, of which the motion is known."""
    table = PlaneTable.of(planes)
    normals, offsets_m = table.normals.astype(np.float32), table.offsets_m.astype(np.float32)
    before: list[list[NDArray[np.float32]]] = [[] for _ in planes]
    after: list[list[NDArray[np.float32]]] = [[] for _ in planes]
    for place in spread(len(recording.scans), MAX_SCANS):
        scan = recording.scans[place]
        if not api.covers(trajectory, scan):  # laid where the motion is not known, it would blur both maps alike
            continue
        labels, after_m = table.nearest(api.map_points(scan, trajectory), gate_m=GATE_M)
        rigid = api.raw_map_points(scan, trajectory)
        for k in range(len(planes)):
            chosen = labels == k
            before[k].append(rigid[chosen] @ normals[k] + offsets_m[k])
            after[k].append(after_m[chosen])
    edges_m = np.linspace(-HISTOGRAM_HALF_M, HISTOGRAM_HALF_M, HISTOGRAM_BINS + 1)
    walls = [_wall(plane.name, _joined(before[k]), _joined(after[k]), edges_m) for k, plane in enumerate(planes)]
    return Thickness(
        edges_m=edges_m.tolist(),
        walls=walls,
        before_rms_m=_rms(np.concatenate([_joined(part) for part in before]) if before else np.zeros(0)),
        after_rms_m=_rms(np.concatenate([_joined(part) for part in after]) if after else np.zeros(0)),
    )


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
