"""Scans made on other threads while the next are read: what comes of them is what one after the other would have given."""

from __future__ import annotations

import time

import numpy as np
import pytest

from calib_core.doctor import examination
from calib_core.doctor.examination import Examination, Taking
from calib_core.doctor.sampling import SampledScans
from calib_core.planes.sample import sample_scan
from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.scans import ScanCounts
from calib_core.readers.timing.point_time import PointTiming
from calib_core.settings import ReadSettings
from calib_core.types import POINT_DTYPE, Scan

CLOUDS, BAD, EMPTY = 60, 4, 9


def _made(_cloud: RawCloud, position: int, *_: object) -> tuple[Scan | None, ScanCounts]:
    """Twenty thousand points, later ones sooner; one that is none, one without a good point."""
    time.sleep(0.002 if position % 3 == 0 else 0.0)
    if position == BAD:
        raise ValueError
    counts = ScanCounts(position, 0, 0)
    if position == EMPTY:
        return None, counts
    points = np.zeros(20_000 + position, POINT_DTYPE)
    points["offset_ns"] = np.arange(len(points))
    return Scan(position, 10**9 + position * 10**8, points), counts


def test_scans_come_in_order_and_are_thinned_by_the_number_they_have(monkeypatch: pytest.MonkeyPatch) -> None:
    """After a cloud that is none, every number is one less, and other scans are the dense ones.

    Mutations: what was thinned taken whatever its number; ended as they are ready; the last ones not waited for; the bad one's
    header counted.
    """
    monkeypatch.setattr(examination, "make_scan", _made)
    state = Examination()
    state.timing = PointTiming("time", "s", "header-first", 0.0, 1.0)
    sampled = SampledScans(CLOUDS, 0.1)
    taking = Taking(state, sampled, ReadSettings(), every=7)
    for position in range(CLOUDS):
        taking.take(RawCloud(position, position + 5, "", np.zeros(0), 0, 1))
    taking.finish()
    twin = SampledScans(CLOUDS, 0.1)
    for position in (p for p in range(CLOUDS) if p not in {BAD, EMPTY}):
        scan = _made(RawCloud(0, 0, "", np.zeros(0), 0, 1), position)[0]
        assert scan is not None
        twin.scans.append(sample_scan(scan, twin.count()))
        twin.points.append(len(scan.points))
    assert sampled.points == twin.points
    assert [scan.index for scan in sampled.scans] == [scan.index for scan in twin.scans]
    for one, other in zip(sampled.scans, twin.scans, strict=True):
        np.testing.assert_array_equal(one.points, other.points)
    assert 5 < sum(len(scan.points) > 10_000 for scan in sampled.scans) < 20
    assert state.n_malformed == 1
    assert state.positions == state.header_ns == [p for p in range(CLOUDS) if p != BAD]
    assert [counts for _, counts in state.examined] == [ScanCounts(p, 0, 0) for p in range(0, CLOUDS, 7)]
