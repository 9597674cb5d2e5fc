"""Clouds that a grid thinned, told from those that lidars send."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.events import ignore_event, never_cancel
from calib_core.full.prepare.prepare import prepare
from calib_core.full.prepare.sieve import in_words, sieve_of
from calib_core.readers.clouds.decoders import cloud_decoder
from calib_core.readers.container.opening import open_recording
from calib_core.settings import CalibrateSettings
from calib_core.simulate import SCENARIOS, Truth, generate
from calib_core.types import POINT_DTYPE, PointArray, Recording, Scan

PERIOD_S = 0.1


def _thinned(points: PointArray, cell_m: float, how: str = "first") -> PointArray:
    """The first of each cell; or their mean, with their mean time or the first one's."""
    place = np.floor(points["xyz"].astype(np.float64) / cell_m).astype(np.int64) @ np.array([1 << 40, 1 << 20, 1])
    _, first, cell = np.unique(place, return_index=True, return_inverse=True)
    left, count = points[first].copy(), np.bincount(cell)
    if how != "first":
        for i in range(3):
            left["xyz"][:, i] = np.bincount(cell, points["xyz"][:, i].astype(np.float64)) / count
    if how == "mean":
        left["offset_ns"] = np.bincount(cell, points["offset_ns"].astype(np.float64)) / count
    return np.asarray(left[np.argsort(left["offset_ns"], kind="stable")])


def _all(recording: Recording, cell_m: float, how: str = "first") -> list[Scan]:
    return [replace(scan, points=_thinned(scan.points, cell_m, how)) for scan in recording.scans]


@pytest.fixture(scope="module")
def sent() -> dict[str, Recording]:
    """VLP-16, OS1-64, a rosette and an XT-32, as they send."""
    names = ("handheld", "ouster", "livox", "outdoor")
    return {name: generate(SCENARIOS[name], seed=3, duration_s=2.0)[0] for name in names}


@pytest.mark.parametrize("scenario", ["handheld", "ouster", "livox", "outdoor"])
def test_the_grid_is_found_whatever_its_size_and_no_lidar_is_one(sent: dict[str, Recording], scenario: str) -> None:
    """Mutations: the smallest size that fits (a grid's halves and fifths do); no look beside it (twenty thousand points 20 cm
    apart are no grid); one that begins at the first point.
    """
    recording = sent[scenario]
    assert sieve_of(recording.scans, PERIOD_S) is None
    for cell_m, how in ((0.03, "mean"), (0.1, "first"), (0.25, "mean"), (0.4, "first")):
        found = sieve_of(_all(recording, cell_m, how), PERIOD_S)
        assert found is not None
        assert found.cell_m == pytest.approx(cell_m)
    fewer = [replace(scan, points=scan.points[::9]) for scan in recording.scans]
    coarse = [scan.points.copy() for scan in recording.scans]
    for points in coarse:
        points["xyz"] = np.round(points["xyz"] / 0.02) * 0.02
    told = [replace(scan, points=points) for scan, points in zip(recording.scans, coarse, strict=True)]
    assert sieve_of(fewer, PERIOD_S) is None
    assert sieve_of(told, PERIOD_S) is None


def test_points_too_far_apart_to_share_cells_are_no_grids_work() -> None:
    """Two thousand points in a hall: hardly any share a cell of 10 cm, in its grid or beside it. Mutation: no look beside it."""
    rng = np.random.default_rng(0)
    scans = []
    for k in range(20):
        points = np.zeros(2000, POINT_DTYPE)
        points["xyz"] = rng.uniform(-20.0, 20.0, (2000, 3))
        scans.append(Scan(k, k * 100_000_000, points))
    assert sieve_of(scans, PERIOD_S) is None
    assert sieve_of([], PERIOD_S) is None


def test_a_rotor_tells_whether_times_are_their_points_own(sent: dict[str, Recording]) -> None:
    """A VLP-16's first points and mean points at their mean times look where it turns; means with the first one's time are late.
    A rosette tells nothing. Scans that packets cut are no whole turns. Mutations: no directions asked; one way round alone (an
    Ouster turns the other way); turns of a scan's length alone.
    """
    for scenario, how, late in (
        ("handheld", "first", False), ("handheld", "mean", False), ("handheld", "mean of the first's time", True),
        ("ouster", "first", False), ("livox", "first", True),
    ):  # fmt: skip
        found = sieve_of(_all(sent[scenario], 0.1, how), 0.9953 * PERIOD_S)
        assert found is not None
        assert (found.passing_s > 0.0) == late
        assert found.std_s == pytest.approx(found.passing_s * np.sqrt(0.125))
        assert "grid of 10 cm" in in_words(found, "/points")


def test_real_lidars_are_no_grids(real_data: Path) -> None:
    """VLP-16 and VLP-32 packets, decoded; thinned by 5 and 20 cm they are. Mutation: any share of points in one cell."""
    for name in ("vlp16", "vlp32"):
        folder = next(p for p in (real_data / "velodyne_ros2_packets" / name).iterdir() if p.is_dir())
        with open_recording(folder) as recording:
            topic = recording.topics[0]
            decode = cloud_decoder(topic)
            clouds = [decode(message).points for message in recording.messages([topic.name])]
        scans = []
        for k, cloud in enumerate(clouds):
            seen = np.stack([cloud[axis] for axis in "xyz"], axis=1)
            seen = seen[np.linalg.norm(np.nan_to_num(seen), axis=1) > 0.3]
            points = np.zeros(len(seen), POINT_DTYPE)
            points["xyz"] = seen
            scans.append(Scan(k, k * 100_000_000, points))
        assert sieve_of(scans, PERIOD_S) is None
        for cell_m in (0.05, 0.2):
            found = sieve_of([replace(scan, points=_thinned(scan.points, cell_m)) for scan in scans], PERIOD_S)
            assert found is not None
            assert found.cell_m == pytest.approx(cell_m)


def test_the_answer_says_it_allows_for_it_and_can_be_told_otherwise(noisy: tuple[Recording, Truth]) -> None:
    """Mutations: said whatever was asked for; not said; the time offset's part left out."""
    recording, truth = noisy
    thinned = replace(recording, scans=_all(recording, 0.1))
    result = calibrate(thinned, CalibrateSettings(intrinsics="off", crispness=False)).result
    (said,) = [m.text for m in result.messages if m.code == "points.thinned"]
    assert "the clouds of /velodyne_points were thinned by a grid of 10 cm" in said
    assert result.uncertainty is not None
    assert result.T_imu_lidar is not None
    away = np.array(result.T_imu_lidar.translation_m) - truth.p_imu_lidar
    assert np.linalg.norm(away / np.asarray(result.uncertainty.translation_std_m)) < 4.0
    for cloud, sieve_m in (("detect", 0.1), ("as-sent", 0.0)):
        settings = CalibrateSettings.model_validate({"cloud": cloud})
        assert prepare(thinned, settings, ignore_event, never_cancel).sieve_m == pytest.approx(sieve_m)
    late = replace(recording, scans=_all(recording, 0.1, "mean of the first's time"))
    assert prepare(late, CalibrateSettings(), ignore_event, never_cancel).clocks.steps_std_s > 1e-4
