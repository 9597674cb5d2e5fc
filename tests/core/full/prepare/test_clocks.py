"""The first look at every scan, against each scan by itself in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.full.prepare.clocks import look, sampled
from calib_core.types import POINT_DTYPE, ComplexArray, ImuData, LidarInfo, PointArray, Recording, Scan

PERIOD_S = 0.1


def _recording(sizes: list[int]) -> Recording:
    rng = np.random.default_rng(3)
    scans = []
    for k, n in enumerate(sizes):
        points = np.zeros(n, POINT_DTYPE)
        t = np.sort(rng.uniform(0.0, PERIOD_S, n))
        turn = 2.0 * np.pi * t / PERIOD_S + 0.1 * k
        away = rng.uniform(1.0, 9.0, n) * (rng.random(n) > 0.1)  # some in the lidar itself
        points["xyz"] = np.stack([away * np.cos(turn), away * np.sin(turn), rng.normal(size=n)], axis=1)
        points["offset_ns"] = np.rint(t * 1e9)
        scans.append(Scan(k, 10**9 + k * 100_000_000, points))
    imu = ImuData(np.arange(3, dtype=np.int64), np.zeros((3, 3)), np.zeros((3, 3)))
    return Recording("r", imu, scans, LidarInfo("/points"), scans_total=len(scans))


def _facing(points: PointArray) -> ComplexArray:
    """The twin, of one scan."""
    sample = points[sampled(len(points))].astype(POINT_DTYPE)
    x, y = sample["xyz"][:, :2].astype(np.float64).T
    seen = np.hypot(x, y) > 0.0
    if not seen.any():
        return np.zeros(2, complex)
    looks = np.exp(1j * np.arctan2(y, x))[seen]
    middle = 0.5e-9 * points["offset_ns"].max()
    turn = np.exp(2j * np.pi / PERIOD_S * (1e-9 * sample["offset_ns"][seen] - middle))
    return np.array([np.mean(looks * turn.conj()), np.mean(looks * turn)])


@pytest.mark.parametrize("count", [1, 31, 33, 70])
def test_every_scan_is_looked_at_as_by_itself(count: int) -> None:
    """Of differing sizes, some empty. Mutations: a scan's sample shifted by the empty one before it; the middle of the first
    sweep of a block for all; the last block left out.
    """
    sizes = [(700, 0, 2500, 1, 999)[k % 5] for k in range(count)]
    recording = _recording(sizes)
    seen = look(recording)
    assert seen.points.tolist() == sizes
    sweeps = [1e-9 * scan.points["offset_ns"].max(initial=0) for scan in recording.scans]
    np.testing.assert_allclose(seen.sweep_s, sweeps, rtol=1e-12)
    assert seen.stamps_ns.tolist() == [scan.stamp_ns for scan in recording.scans]
    expected = np.array([_facing(scan.points) for scan in recording.scans]).T
    np.testing.assert_allclose(seen.facing, expected, atol=1e-12)
    samples = [scan.points[sampled(len(scan.points))]["xyz"] for scan in recording.scans]
    ranges_m = np.linalg.norm(np.concatenate(samples), axis=1)
    assert (seen.nearest_m, seen.farthest_m) == pytest.approx((ranges_m.min(), ranges_m.max()), rel=1e-6)


@pytest.mark.parametrize("count", [0, 1, 999, 1000, 1001, 2500, 38_400])
def test_a_scans_sample_keeps_no_step_with_its_lasers(count: int) -> None:
    """Distinct, in order, all over the scan, of lasers that fire in turn as many of each as chance has it.

    Mutations: every so many-th point; the drawn part left out.
    """
    places = sampled(count)
    assert len(places) == min(count, 1000)
    assert np.all(np.diff(places) > 0)
    if count >= 2500:
        assert places[0] < count / 1000
        assert places[-1] >= count - count / 1000
        for lasers in (2, 3, 4, 16, 64):
            shares = np.bincount(places % lasers, minlength=lasers) / 1000
            assert np.abs(shares - 1 / lasers).max() < 4.0 * np.sqrt(1 / lasers / 1000)
