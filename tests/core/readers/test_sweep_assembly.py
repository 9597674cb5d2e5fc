"""Clouds of a part of a sweep each, gathered again, against the sweeps that they were cut from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.load import load
from calib_core.readers.sweep_assembly import Gathering, _bearings, parts_of_a_scan
from calib_core.settings import ReadSettings
from calib_core.types import POINT_DTYPE, Recording, Scan
from tests.core.readers import build
from tests.core.readers.cut_sweeps import PERIOD_NS, cut_up


@pytest.mark.parametrize(
    ("period_s", "parts"), [(0.1, 1), (0.05, 1), (0.2, 1), (0.0, 1), (0.02, 5), (0.01, 10), (1.327e-3, 75)]
)
def test_a_tenth_of_a_second_makes_a_scan(period_s: float, parts: int) -> None:
    """Mutation: a rotor of 20 turns a second has two of them put together."""
    assert parts_of_a_scan(period_s, []) == parts


@pytest.mark.parametrize(
    ("seen_deg", "step_deg", "parts"),
    [
        (360, 360, 1),
        (180, 180, 2),
        (120, 120, 3),
        (200, 170, 2),
        (240, 240, 2),
        (300, 300, 1),
        (180, 0, 1),
        (120, 0, 1),
        (365, 365, 1),
        (178, 184, 2),
    ],
)
def test_clouds_of_a_part_of_a_turn_make_a_scan_together(seen_deg: float, step_deg: float, parts: int) -> None:
    """Each of so many degrees, so many farther round than the one before; every tenth return is missing.

    Mutations: five sixths of a turn put together; a rosette's half turns, which overlap, are not; what looks one way only is; a
    part told by how often it comes alone.
    """
    rng = np.random.default_rng(1)
    clouds = []
    for k in range(20):
        azimuth = np.deg2rad(k * step_deg + rng.uniform(0.0, seen_deg, 3000))
        points = np.zeros(azimuth.size, np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")]))
        points["x"], points["y"] = 5.0 * np.cos(azimuth), 5.0 * np.sin(azimuth)
        points["x"][::10] = np.nan
        stamp_ns = build.EPOCH_NS + k * PERIOD_NS // 2
        clouds.append(RawCloud(stamp_ns, stamp_ns, "lidar", points, points.size, 1))
    assert parts_of_a_scan(0.05, clouds) == parts


@pytest.mark.parametrize(
    ("period_s", "step_deg", "cut_deg", "parts"),
    [(0.05, 170, 360, 2), (0.1, 170, 360, 1), (0.05, 8.6, 360, 1), (0.05, 180, 80, 2), (0.05, 360, 80, 1)],
)
def test_a_rosettes_quick_clouds_make_a_scan_by_twos(
    period_s: float, step_deg: float, cut_deg: float, parts: int
) -> None:
    """Of 100 deg among boxes that hide a part of what is around, which no number of clouds sees all of, cut to a view.

    Mutations: slow ones, too, which are bent enough; what came into view as the lidar turned by 3 rad/s counts; of a view
    of which every other cloud shows all, and the others nothing, the larger half alone decides.
    """
    clouds = []
    for k in range(21):
        azimuth = np.deg2rad((k * step_deg + np.linspace(0.0, 100.0, 2000)) % 360.0)
        seen = (np.sin(3.0 * azimuth) > -0.5) & (azimuth < np.deg2rad(cut_deg))
        azimuth = azimuth[seen | (np.arange(azimuth.size) == 0)]
        points = np.zeros(azimuth.size, np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")]))
        points["x"], points["y"] = 5.0 * np.cos(azimuth), 5.0 * np.sin(azimuth)
        stamp_ns = build.EPOCH_NS + round(k * period_s * 1e9)
        clouds.append(RawCloud(stamp_ns, stamp_ns, "lidar", points, points.size, 1))
    assert parts_of_a_scan(period_s, clouds) == parts


def _read(folder: Path, clouds: list[build.Message]) -> Recording:
    bag = build.write_ros2(folder, build.in_order(clouds, build.still_imu(4.2, cdr=True)))
    return load(bag, ReadSettings())


@pytest.mark.parametrize("parts", [2, 5, 10])
@pytest.mark.parametrize("twice", [False, True])
def test_parts_make_the_sweep_that_they_were_cut_from(tmp_path: Path, parts: int, twice: bool) -> None:
    """To the nanosecond that the points' times are sent with. Mutations: offsets left those of the parts; the last scan lost; a
    part that is sent twice counts twice.
    """
    read = _read(tmp_path / "parts", cut_up(parts, twice=twice))
    whole = _read(tmp_path / "whole", build.velodyne_messages(40, cdr=True))
    assert len(read.scans) == read.scans_total == 40
    assert read.lidar.period_s == pytest.approx(0.1, rel=1e-3)
    assert f"{parts} at a time are taken as one scan" in {f.code: f.text for f in read.findings}["points.gathered"]
    assert ("points.sent_twice" in {f.code for f in read.findings}) == twice
    for one, other in zip(read.scans, whole.scans, strict=True):
        # A part's own times begin anew: single precision rounds them otherwise.
        assert abs(one.stamp_ns - other.stamp_ns) <= 8
        np.testing.assert_array_equal(one.points["xyz"], other.points["xyz"])
        np.testing.assert_allclose(one.points["offset_ns"], other.points["offset_ns"], atol=16)


def test_a_scan_with_lost_parts_is_what_is_left_of_it(tmp_path: Path) -> None:
    """A whole sweep and a half: the next one begins when its first part does. Mutation: parts are counted, not timed."""
    read = _read(tmp_path / "parts", cut_up(10, lost=frozenset(range(73, 88))))
    stamps = [(scan.stamp_ns - build.EPOCH_NS) / 1e6 for scan in read.scans]
    np.testing.assert_allclose(np.diff(stamps[:8]), 100.0, atol=1e-3)
    assert stamps[8] == pytest.approx(880.0, abs=1e-3)
    sizes = [scan.points.size for scan in read.scans]
    assert sizes[7] == pytest.approx(0.3 * sizes[0], rel=0.1)
    assert all(scan.points["offset_ns"].max() < PERIOD_NS for scan in read.scans)


def test_a_part_that_comes_late_does_not_go_back_in_time() -> None:
    """Mutation: it is put to the scan that is being gathered, at a time before its first point."""
    gathering = Gathering(95_000_000)
    done = [gathering.add(Scan(k, stamp, np.zeros(3, POINT_DTYPE))) for k, stamp in enumerate([50, 20, 70])]
    rest = gathering.rest()
    assert [None if scan is None else scan.stamp_ns for scan in done] == [None, 50, None]
    assert rest is not None
    assert rest.stamp_ns == 20
    np.testing.assert_array_equal(rest.points["offset_ns"], [0, 0, 0, 50, 50, 50])
    assert gathering.rest() is None


def test_a_part_of_the_stamp_before_is_the_same_again_or_another() -> None:
    """Either way the first counts. Mutations: each taken for the same again; for another."""
    gathering = Gathering(95_000_000)
    points, others = np.zeros(3, POINT_DTYPE), np.ones(3, POINT_DTYPE)
    for part in (points, points.copy(), others):
        assert gathering.add(Scan(0, 50, part)) is None
    assert (gathering.n_twice, gathering.n_unlike) == (1, 1)
    rest = gathering.rest()
    assert rest is not None
    np.testing.assert_array_equal(rest.points, points)


@pytest.mark.parametrize("gap", range(15))
def test_bearings_are_those_of_all_points(gap: int) -> None:
    """Points all round but for a gap, in which lies a lone one or none. Oracle: each point's bin by itself. Mutation: the few
    that are asked first taken for all.
    """
    azimuth = np.linspace(-np.pi, np.pi, 720, endpoint=False) + 1e-3
    azimuth[(azimuth > 0.5) & (azimuth < 0.5 + 0.02 * gap)] = 0.4
    if gap % 2:
        azimuth[gap] = 0.5 + 0.01 * gap
    points = np.zeros(720, [("x", "f4"), ("y", "f4"), ("z", "f4")])
    points["x"], points["y"] = np.cos(azimuth), np.sin(azimuth)
    seen = np.zeros(72, np.bool_)
    for x, y in zip(points["x"].tolist(), points["y"].tolist(), strict=True):
        seen[int((np.arctan2(y, x) + np.pi) / (2.0 * np.pi) * 72)] = True
    np.testing.assert_array_equal(_bearings(RawCloud(0, 0, "", points, 720, 1)), seen)
