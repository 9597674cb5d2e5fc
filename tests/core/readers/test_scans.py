"""Scans in memory and on disk are the same sequence."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.scans import MEMORY_BYTES, StoredScans, select_points
from calib_core.readers.timing.point_time import PointTiming
from calib_core.types import POINT_DTYPE, Scan


def scans(n: int) -> list[Scan]:
    rng = np.random.default_rng(0)
    made = []
    for k in range(n):
        points = np.zeros(int(rng.integers(1, 500)), POINT_DTYPE)
        points["xyz"] = rng.normal(size=(points.size, 3))
        points["offset_ns"] = np.arange(points.size)
        made.append(Scan(3 * k, 10**18 + k, points))
    return made


@pytest.mark.parametrize("memory_bytes", [0, 20_000, 1 << 30])
def test_storage_changes_nothing(memory_bytes: int) -> None:
    """Mutation: forget the scans before the switch to the file; seek by points instead of bytes."""
    given = scans(40)
    stored = StoredScans(memory_bytes)
    for scan in given:
        stored.append(scan)
    stored.finish()
    assert len(stored) == 40
    assert stored.n_points == sum(s.points.size for s in given)
    assert stored.stamps_ns == [s.stamp_ns for s in given]
    for a, b in zip(given, stored, strict=True):
        assert (a.index, a.stamp_ns) == (b.index, b.stamp_ns)
        np.testing.assert_array_equal(a.points, b.points)
    assert stored[-1].index == 117
    assert [s.index for s in stored[2:5]] == [6, 9, 12]
    with pytest.raises(IndexError):
        stored[40]
    stored.without([0, 39])
    assert [stored[0].index, stored[-1].index] == [3, 114]
    np.testing.assert_array_equal(stored[10].points, given[11].points)


@pytest.mark.parametrize("memory_bytes", [0, 20_000, 60_000, 1 << 30])
def test_scans_written_in_any_order_by_threads_come_in_the_order_they_were_added_in(memory_bytes: int) -> None:
    """Mutations: what is in memory written at the end of the file; a scan that was in memory when another had opened the file
    taken for one of the first.
    """
    given = scans(60)
    stored = StoredScans(memory_bytes)
    shuffled = np.random.default_rng(1).permutation(60)
    with ThreadPoolExecutor(4) as pool:
        places = dict(zip(shuffled.tolist(), pool.map(lambda k: stored.write(given[k]), shuffled), strict=True))
    for k in range(60):
        stored.add(places[k])
    stored.finish()
    for a, b in zip(given, stored, strict=True):
        assert (a.index, a.stamp_ns) == (b.index, b.stamp_ns)
        np.testing.assert_array_equal(a.points, b.points)


def test_many_points_are_never_held_in_memory() -> None:
    """Mutation: the limit compared with points instead of bytes."""
    many = MEMORY_BYTES // POINT_DTYPE.itemsize + 1
    for n_points, held in ((many, 0), (many - 1, 1)):
        stored = StoredScans.sized(n_points)
        stored.append(scans(1)[0])
        assert len(stored._arrays) == held


def test_beyond_the_limit_nothing_stays_in_memory() -> None:
    """Mutation: keep appending to the list after the switch to the file."""
    stored = StoredScans(10_000)
    for scan in scans(40):
        stored.append(scan)
    assert stored._arrays == []


def test_a_cloud_without_a_point_may_be_a_threads_first() -> None:
    """As where a driver starts before its lidar spins: it stopped the program as a defect. Mutation: columns made for none."""
    timing = PointTiming("time", "s", "header-first", low_ns=0.0, high_ns=1e8)
    points = np.zeros(0, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("time", "f4")])
    cloud = RawCloud(10**18, 10**18, "lidar", points, 0, 1)
    with ThreadPoolExecutor(1) as pool:
        selection = pool.submit(select_points, cloud, timing, 0.3, 100.0).result()
    assert selection.counts.sent == 0
    assert selection.scan(0) is None
