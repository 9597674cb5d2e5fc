"""Evidence for a report: the room from above, distances by range and ring, and the IMU's readings foretold."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.results.imu_evidence import compare_imu, imu_motion
from app.results.plane_table import PlaneTable
from app.results.thinning import spread
from app.schemas.evidence import Binned, Evidence, Picture, Step
from calib_core import api
from calib_core.events import Event, IterationEvent, OnEvent
from calib_core.result import CalibrationResult
from calib_core.types import BoolArray, FloatArray, PointArray, Recording, Scan, Trajectory

#: Scans looked at, and points of each: a picture of 300 000 points is dense, and made in a second or two.
SCANS, POINTS = 60, 5000
#: A point this near to a plane is taken as one of it.
GATE_M = 0.15
#: Cells of the room's picture across its longer side, and of the corner's.
ROOM_CELLS, CORNER_CELLS = 420, 260
CORNER_SIDE_M = 1.3
#: A plane whose normal is within 25 deg of upright is floor, ceiling or a table: seen from above it hides the walls.
LEVEL_COSINE = 0.9
RANGE_BINS = 24
#: A ray within six degrees of a plane says little of the range.
GRAZING_COSINE = 0.1
#: Bins with fewer points say nothing.
FEWEST = 100


class StepListener:
    """Hands events on and remembers the solve's steps."""

    def __init__(self, on_event: OnEvent) -> None:
        self.steps: list[Step] = []
        self._on_event = on_event

    def __call__(self, event: Event) -> None:
        """Called by the solve. event: any of its events."""
        if isinstance(event, IterationEvent):
            names = Step.model_fields
            self.steps.append(Step.model_validate({name: getattr(event, name) for name in names}))
        self._on_event(event)


@dataclass(frozen=True)
class _Seen:
    """Points of some scans. before_m, after_m: (N, 3) map frame.   label: (N,) plane, -1 none.

    beyond_m: (N,) from it, positive where the lidar reads long, without what the solve took out of its points.
    """

    before_m: NDArray[np.float32]
    after_m: NDArray[np.float32]
    label: NDArray[np.int16]
    beyond_m: FloatArray
    range_m: FloatArray
    ring: FloatArray


def measure_evidence(
    recording: Recording, result: CalibrationResult, trajectory: Trajectory | None, steps: Sequence[Step]
) -> Evidence:
    """Everything that can be measured; only the steps where there is no answer."""
    evidence = Evidence(steps=list(steps))
    if trajectory is None or result.T_imu_lidar is None:
        return evidence
    table = PlaneTable.of(result.quality.planes)
    seen = _look(recording, trajectory, result, table)
    motion = imu_motion(trajectory, np.array(result.T_imu_lidar.matrix))
    ideal = api.ideal_readings(recording, result)
    imu, up = compare_imu(replace(recording, imu=ideal), motion, result.time_offset_ns or 0)
    if imu is not None:
        imu = imu.model_copy(update={"corrected": ideal is not recording.imu})
    if seen is None:
        return evidence.model_copy(update={"imu": imu})
    level = np.abs(table.normals @ up) > LEVEL_COSINE
    standing = (seen.label < 0) | ~np.append(level, False)[seen.label]
    flat = _from_above(up, table.normals[~level])
    before, after = (points[standing] @ flat.T.astype(np.float32) for points in (seen.before_m, seen.after_m))
    room = _picture(before, after, _frame_of(after), ROOM_CELLS) if len(after) else None
    corner = None if room is None else _picture(before, after, densest(after), CORNER_CELLS)
    on = seen.label >= 0
    ranged = np.isfinite(seen.range_m)
    by_range = _by(seen.range_m[ranged], seen.beyond_m[ranged], _range_edges(seen.range_m[ranged]))
    rings = np.unique(seen.ring[on])
    edges = np.append(rings, rings[-1] + 1) - 0.5 if len(rings) > 1 else np.zeros(0)
    return Evidence(
        steps=list(steps),
        room=room,
        corner=corner,
        by_range=by_range,
        by_ring=_by(seen.ring[on], seen.beyond_m[on], edges),
        imu=imu,
        ranges="as-published" if api.ideal_lasers(result) is None else "corrected",
    )


def _look(recording: Recording, trajectory: Trajectory, result: CalibrationResult, table: PlaneTable) -> _Seen | None:
    lasers = api.ideal_lasers(result)
    parts: list[_Seen] = []
    for place in spread(len(recording.scans), SCANS):
        scan = _thinned(recording.scans[place])
        if not len(scan.points) or not api.covers(trajectory, scan):
            continue
        after = api.map_points(scan, trajectory)
        # The pictures show what motion does to points as they came; distances are those that the solve saw.
        ideal = scan if lasers is None else lasers.corrected(scan)
        there = after if lasers is None else api.map_points(ideal, trajectory)
        label, dist_m = table.nearest(there, gate_m=GATE_M)
        measured_m, cosine = _rays(ideal, trajectory, there, label, table.normals)
        beyond_m = dist_m.astype(np.float64) * np.sign(cosine)
        if lasers is not None:
            beyond_m = lasers.straightened(beyond_m, cosine, ideal.points["xyz"].astype(np.float64))
        clear = (label >= 0) & (np.abs(cosine) > GRAZING_COSINE)
        # Not the range that was measured: bins of that would choose points by their noise, and the nearest bin would hold those
        # measured too near.
        range_m = np.where(clear, measured_m - beyond_m / np.where(clear, np.abs(cosine), 1.0), np.nan)
        ring = scan.points["ring"].astype(np.float64)
        parts.append(_Seen(api.raw_map_points(scan, trajectory), after, label, beyond_m, range_m, ring))
    if not parts:
        return None
    return _Seen(
        np.concatenate([part.before_m for part in parts]),
        np.concatenate([part.after_m for part in parts]),
        np.concatenate([part.label for part in parts]),
        np.concatenate([part.beyond_m for part in parts]),
        np.concatenate([part.range_m for part in parts]),
        np.concatenate([part.ring for part in parts]),
    )


def _rays(
    scan: Scan, trajectory: Trajectory, there_m: NDArray[np.float32], label: NDArray[np.int16], normals: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(N,) [m]: how long each point's ray is, and (N,) the cosine between it and its plane's normal; NaN without a plane."""
    here: PointArray = scan.points.copy()
    here["xyz"] = 0.0
    ray = there_m.astype(np.float64) - api.map_points(Scan(scan.index, scan.stamp_ns, here), trajectory)
    measured_m = np.linalg.norm(ray, axis=1)
    if not len(normals):
        return measured_m, np.full(len(ray), np.nan)
    cosine = np.sum(ray * normals[label], axis=1) / np.maximum(measured_m, 1e-6)
    return measured_m, np.where(label >= 0, cosine, np.nan)


def _thinned(scan: Scan) -> Scan:
    step = max(1, len(scan.points) // POINTS)
    points: PointArray = scan.points[::step]
    return Scan(index=scan.index, stamp_ns=scan.stamp_ns, points=points)


def _from_above(up: FloatArray, walls: FloatArray) -> FloatArray:
    """(2, 3): rows that take map coordinates to a plan, the first wall's normal along its x axis."""
    first = walls[0] if len(walls) else np.eye(3)[np.abs(up).argmin()]
    across = first - up * (first @ up)
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(up, across)])


def _frame_of(plan_m: NDArray[np.float32]) -> tuple[float, float, float]:
    """Left, bottom and side of the square that holds all but a few points."""
    low, high = np.percentile(plan_m, [0.5, 99.5], axis=0)
    side = float((high - low).max()) * 1.08
    left, bottom = 0.5 * (low + high) - 0.5 * side
    return float(left), float(bottom), side


def densest(plan_m: NDArray[np.float32]) -> tuple[float, float, float]:
    """The square of CORNER_SIDE_M around the spot where most points stand over one another."""
    cells = np.floor(plan_m / 0.05).astype(np.int64)
    first = cells.min(axis=0)
    # As single numbers: pairs are sorted ten times as slowly.
    rows = int(cells[:, 1].max() - first[1]) + 1
    spots, count = np.unique((cells[:, 0] - first[0]) * rows + cells[:, 1] - first[1], return_counts=True)
    middle = (first + divmod(int(spots[count.argmax()]), rows) + 0.5) * 0.05
    return float(middle[0] - CORNER_SIDE_M / 2), float(middle[1] - CORNER_SIDE_M / 2), CORNER_SIDE_M


def _picture(
    before: NDArray[np.float32], after: NDArray[np.float32], frame: tuple[float, float, float], cells: int
) -> Picture:
    left_m, bottom_m, side_m = frame
    edges = [np.linspace(low, low + side_m, cells + 1) for low in (left_m, bottom_m)]
    counts = [np.log1p(np.histogram2d(plan[:, 1], plan[:, 0], (edges[1], edges[0]))[0]) for plan in (before, after)]
    brightest = max(float(count.max()) for count in counts) or 1.0
    shown = [
        base64.b64encode(np.round(255 * count / brightest).astype(np.uint8).tobytes()).decode() for count in counts
    ]
    return Picture(
        left_m=left_m,
        bottom_m=bottom_m,
        cell_m=side_m / cells,
        width=cells,
        height=cells,
        before=shown[0],
        after=shown[1],
    )


def _range_edges(range_m: FloatArray) -> FloatArray:
    """Bins with as many points each."""
    if len(range_m) < FEWEST:
        return np.zeros(0)
    return np.unique(np.quantile(range_m, np.linspace(0, 1, RANGE_BINS + 1)))


def _by(value: FloatArray, dist_m: FloatArray, edges: FloatArray) -> Binned | None:
    if len(edges) < 2:
        return None
    place = np.clip(np.searchsorted(edges, value, side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(place, minlength=len(edges) - 1)
    enough: BoolArray = count >= FEWEST
    total = np.bincount(place, dist_m, len(edges) - 1)[enough] / count[enough]
    squares = np.bincount(place, dist_m**2, len(edges) - 1)[enough] / count[enough]
    middle = 0.5 * (edges[1:] + edges[:-1])
    return Binned(
        at=middle[enough].tolist(),
        mean_m=total.tolist(),
        rms_m=np.sqrt(squares).tolist(),
        points=count[enough].tolist(),
    )
