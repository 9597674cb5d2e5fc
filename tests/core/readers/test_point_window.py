"""Sweeps whose ends hardly return, and headers that are what the user says: no true point lost, no instant moved."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from calib_core.errors import PointTimeError
from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.scans import make_scan
from calib_core.readers.timing.point_time import detect_point_time
from calib_core.readers.timing.point_window import _usual_step
from calib_core.settings import ReadSettings
from tests.core.readers import build
from tests.core.readers.timed_cloud import N, cloud, expected

Values = Callable[[NDArray[np.float64], int], NDArray[np.float64]]
#: field type, values from (seconds into the sweep, sweep's start in ns), header after the sweep's start [ns]
REFERENCES: dict[str, tuple[str, Values, int]] = {
    "header first": ("<f4", lambda t, s: t, 0),
    "header last": ("<f4", lambda t, s: t - 0.1, 100_000_000),
    "absolute": ("<f8", lambda t, s: s + np.rint(t * 1e9), 0),
}


def with_blind_ends(clouds: list[RawCloud], blind: float, seen_every: int) -> list[RawCloud]:
    """Points of the first and last `blind` share of the sweep have no return, but in every seen_every-th scan."""
    made = []
    for k, c in enumerate(clouds):
        points = c.points.copy()
        if k % seen_every:
            edge = int(blind * points.size)
            for axis in "xyz":
                points[axis][:edge] = 0
                points[axis][-edge:] = 0
        made.append(RawCloud(c.header_ns, c.receive_ns, c.frame_id, points, c.width, c.height))
    return made


@pytest.mark.parametrize("blind", [0.08, 0.2])
@pytest.mark.parametrize("name", REFERENCES)
def test_ends_that_hardly_return_are_no_garbage(name: str, blind: float) -> None:
    """Mutation: leave `first + period_ns` (or `last - period_ns`) out of `_window_ns`."""
    kind, values, after = REFERENCES[name]
    plain = [cloud(k, "t", kind, values, build.EPOCH_NS + k * 100_000_000 + after) for k in range(N)]
    clouds = with_blind_ends(plain, blind, 13)
    timing, _ = detect_point_time(clouds, ReadSettings(), topic="/p")
    for k, c in enumerate(clouds):
        scan, counts = make_scan(c, k, timing, 0.3, 200.0)
        assert scan is not None
        assert counts.out_of_time == 0
        seen = c.points["x"] != 0
        got = scan.stamp_ns + scan.points["offset_ns"].astype(np.int64)
        assert np.abs(got - expected(k)[seen]).max() <= 257


def test_a_scan_with_most_points_at_its_start_keeps_its_end() -> None:
    """Mutation: leave the period out of `reach` (the window lies around each scan's own middle)."""
    kind, values, _ = REFERENCES["absolute"]
    clouds = with_blind_ends([cloud(k, "t", kind, values) for k in range(N)], 0.2, 13)
    timing, _ = detect_point_time(clouds, ReadSettings(), topic="/p")
    early = np.r_[clouds[13].points[:400], clouds[13].points[-50:]]
    scan, counts = make_scan(RawCloud(clouds[13].header_ns, 0, "l", early, early.size, 1), 13, timing, 0.3, 200.0)
    assert scan is not None
    assert counts.out_of_time == 0


def test_garbage_beyond_the_period_stays_out() -> None:
    """Mutation: a margin of half a period."""
    clouds = with_blind_ends([cloud(k, "t", "<f4", lambda t, s: t) for k in range(N)], 0.08, 13)
    timing, _ = detect_point_time(clouds, ReadSettings(), topic="/p")
    damaged = clouds[13].points.copy()
    damaged["t"][:5] = (0.13, -0.03, 0.2, 3.6, 1e9)
    _, counts = make_scan(RawCloud(clouds[13].header_ns, 0, "l", damaged, damaged.size, 1), 13, timing, 0.3, 200.0)
    assert counts.out_of_time == 5


@pytest.mark.parametrize("middle", [-0.05, -0.03, 0.02])
@pytest.mark.parametrize("blind", [0.0, 0.1])
@pytest.mark.parametrize("asked", ["header-first", "header-last"])
def test_the_header_is_where_the_user_says(middle: float, blind: float, asked: str) -> None:
    """Mutation: shift by the quantiles of the returned points; do not shift where the natural reading agrees."""
    clouds = [cloud(k, "t", "<f4", lambda t, s: t + middle) for k in range(N)]
    if blind:
        clouds = with_blind_ends(clouds, blind, 5)
    timing, _ = detect_point_time(clouds, ReadSettings(point_time_reference=asked), topic="/p")
    for k in (0, 5, 10):
        scan, _ = make_scan(clouds[k], k, timing, 0.3, 200.0)
        assert scan is not None
        got = scan.stamp_ns + scan.points["offset_ns"].astype(np.int64)
        at_header = got.min() if asked == "header-first" else got.max()
        assert abs(int(at_header) - (build.EPOCH_NS + k * 100_000_000)) <= 30


@pytest.mark.parametrize("epoch_ns", [0, -1_699_999_000_000_000_000])
@pytest.mark.parametrize(("asked", "after"), [("header-first", 0), ("header-last", 99_409_722)])
def test_a_said_header_moves_absolute_times_by_one_constant(epoch_ns: int, asked: str, after: int) -> None:
    """Mutation: take absolute values for relative ones where a reference is given."""

    def values(t: NDArray[np.float64], s: int) -> NDArray[np.float64]:
        return (s + epoch_ns) + np.rint(t * 1e9)

    clouds = [cloud(k, "stamp", "<f8", values, build.EPOCH_NS + k * 100_000_000 + after) for k in range(N)]
    timing, _ = detect_point_time(clouds, ReadSettings(point_time_reference=asked), topic="/p")
    for k, c in enumerate(clouds):
        scan, counts = make_scan(c, k, timing, 0.3, 200.0)
        assert scan is not None
        assert counts.out_of_time == 0
        got = scan.stamp_ns + scan.points["offset_ns"].astype(np.int64)
        assert np.abs(got - expected(k)).max() <= 600  # float64 holds 1.7e18 ns to a quarter of a microsecond


def test_relative_times_cannot_be_called_absolute() -> None:
    """Mutation: drop the refusal in `_timing` (all scans then lie in one place)."""
    clouds = [cloud(k, "t", "<f4", lambda t, s: t) for k in range(N)]
    with pytest.raises(PointTimeError, match=r"begin anew with every scan.*\.$"):
        detect_point_time(clouds, ReadSettings(point_time_reference="absolute"), topic="/p")


@pytest.mark.parametrize("kind", ["<f8", "<i8"])
@pytest.mark.parametrize("order", ["as taken", "by ring", "shuffled", "one value"])
def test_the_usual_step_is_that_of_the_distinct_values_in_order(order: str, kind: str) -> None:
    """Oracle: np.unique. Mutation: no sorting at all; steps of zero counted."""
    rng = np.random.default_rng(5)
    values = np.repeat(np.cumsum(rng.integers(1, 5, 400)), 3).astype(kind)
    if order == "by ring":
        values = np.ascontiguousarray(values.reshape(-1, 3).T).ravel()
    elif order == "shuffled":
        values = rng.permutation(values)
    elif order == "one value":
        values = values[:3]
    steps = np.diff(np.unique(values))
    assert _usual_step(values) == (float(np.median(steps)) if steps.size else 0.0)
