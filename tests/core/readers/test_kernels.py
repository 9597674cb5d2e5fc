"""Masking and packing against the same in plain NumPy, bit for bit, whatever the fields' types and byte order."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.clouds.kernels import mark_valid, pack_points
from calib_core.readers.scans import load_loops, select_points
from calib_core.readers.timing.point_time import PointTiming, Reference
from calib_core.readers.timing.time_fields import Unit
from calib_core.types import POINT_DTYPE
from tests.core.readers.build import EPOCH_NS

NS = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0}
KINDS = ["<f4", "<f8", ">f4", ">f8"]
#: type of the time, unit, reference: what the layouts use, and their big-endian twins.
TIMES: list[tuple[str, Unit, Reference]] = [
    ("<f4", "s", "header-first"),
    ("<f4", "ms", "header-last"),
    (">f4", "us", "header-first"),
    ("<u4", "ns", "header-first"),
    (">u4", "ns", "header-first"),
    ("<i4", "ns", "header-first"),
    ("<f8", "s", "absolute"),
    (">f8", "ns", "absolute"),
]


def random_cloud(coordinate: str, kind: str, unit: Unit, reference: Reference, seed: int) -> NDArray[np.void]:
    """Unaligned points: some NaN, some at the origin, some beyond the range, some with garbage times."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 3000))
    dtype = np.dtype({
        "names": ["x", "y", "z", "intensity", "ring", "time"],
        "formats": [coordinate] * 3 + [str(rng.choice(["u1", "<u2", "<f4", ">u4"])), "<u2", kind],
        "offsets": [1, 10, 19, 30, 35, 38],
        "itemsize": 51,
    })  # fmt: skip
    points = np.zeros(n, dtype)
    for axis in "xyz":
        points[axis] = rng.normal(0, 20, n)
        points[axis][rng.random(n) < 0.05] = rng.choice([np.nan, np.inf, 0.0, 1e30])
    elapsed_s = np.sort(rng.uniform(0, 0.1, n)) - (0.1 if reference == "header-last" else 0.0)
    ns = elapsed_s * 1e9 + (EPOCH_NS if reference == "absolute" else 0)
    points["time"] = ns / NS[unit]
    garbage = rng.random(n) < 0.1
    points["time"][garbage] = points["time"][garbage] * 0 if kind[1] != "f" else np.nan
    points["intensity"], points["ring"] = rng.integers(0, 255, n), rng.integers(0, 65_000, n)
    return points


def slowly(
    points: NDArray[np.void], timing: PointTiming, nearest_m: float, farthest_m: float
) -> tuple[NDArray[np.bool_], NDArray[np.float32], NDArray[np.float64]]:
    """Which points count, their coordinates and rounded times, with NumPy's own operations and temporaries."""
    xyz = np.stack([points[axis].astype(np.float32) for axis in "xyz"], 1)
    squared = (xyz[:, 0] * xyz[:, 0] + xyz[:, 1] * xyz[:, 1]) + xyz[:, 2] * xyz[:, 2]
    values = points["time"].astype(np.float64)
    if timing.reference == "absolute":
        seen = np.sort(values[:: max(1, values.size // 256)])
        seen = seen[np.isfinite(seen) & (seen != 0)]
        values = values - (seen[seen.size // 2] if seen.size else 0.0)
    times = values * NS[timing.unit]
    keep = (squared >= np.float32(nearest_m) ** 2) & (squared <= np.float32(farthest_m) ** 2)
    keep &= (times >= timing.low_ns) & (times <= timing.high_ns)
    return keep, xyz, np.rint(times)


@pytest.mark.parametrize("coordinate", KINDS)
@pytest.mark.parametrize(("kind", "unit", "reference"), TIMES)
@np.errstate(invalid="ignore", over="ignore")
def test_selected_points_are_those_of_plain_numpy(coordinate: str, kind: str, unit: Unit, reference: Reference) -> None:
    """Mutation: `>` for `>=` at low_ns in `mark_valid`; a step of 5 words in `pack_points`; half up for half to even."""
    window = {"header-first": (0.0, 9e7), "header-last": (-9e7, 1e6), "absolute": (-4e7, 4e7)}[reference]
    timing = PointTiming("time", unit, reference, *window)
    kept = 0
    for seed in range(12):
        points = random_cloud(coordinate, kind, unit, reference, seed)
        cloud = RawCloud(EPOCH_NS, 0, "lidar", points, points.size, 1)
        got = select_points(cloud, timing, 1.0, 40.0)
        keep, xyz, times = slowly(points, timing, 1.0, 40.0)
        np.testing.assert_array_equal(got.keep, keep)
        assert got.counts.sent == points.size
        assert got.counts.sent - got.counts.no_return - got.counts.out_of_time == np.count_nonzero(keep)
        want = np.zeros(np.count_nonzero(keep), POINT_DTYPE)
        want["xyz"], want["intensity"], want["ring"] = xyz[keep], points["intensity"][keep], points["ring"][keep]
        want["offset_ns"] = times[keep] - times[keep].min(initial=np.inf)
        np.testing.assert_array_equal(got.points, want)
        kept += want.size
    assert kept > 3000
    ties = np.array([0.5, 1.5, 2.5, 1e7 + 0.5])
    points = np.zeros(4, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("t", "f8")])
    points["x"], points["t"] = 5.0, ties
    nanoseconds = PointTiming("t", "ns", "header-first", 0.0, 9e7)
    tied = select_points(RawCloud(EPOCH_NS, 0, "lidar", points, 4, 1), nanoseconds, 1.0, 40.0)
    np.testing.assert_array_equal(tied.points["offset_ns"], np.rint(ties))
    assert tied.stamp_ns == EPOCH_NS


def test_what_is_made_ready_is_what_clouds_need() -> None:
    """Oracle: the compiler's own lists after a cloud has been read. Mutation: float64 columns made ready."""
    points = random_cloud("<f4", "<f4", "s", "header-first", seed=1)
    timing = PointTiming("time", "s", "header-first", -1e9, 1e9)
    select_points(RawCloud(EPOCH_NS, 0, "lidar", points, points.size, 1), timing, 0.3, 200.0)
    needed = [[*loop.signatures] for loop in (mark_valid, pack_points)]
    load_loops()
    assert [[*loop.signatures] for loop in (mark_valid, pack_points)] == needed
