"""Excluded spans: what lies in them cannot matter, and the rest still gives the answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from calib_core.calibrate import calibrate
from calib_core.errors import SettingsError
from calib_core.full.odometry.reference_cloud import propose_planes
from calib_core.full.prepare.excluded_spans import kept_places, without_spans
from calib_core.geometry import log
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import Recording, Scan

SPAN_S = (3.05, 3.45)
EXCLUDING = CalibrateSettings(excluded_spans_s=(SPAN_S,))


def _covered(scan: Scan) -> Scan:
    """The scan as a hand before the lens would give it: everything within half a metre."""
    points = scan.points.copy()
    points["xyz"] *= 0.5 / np.maximum(np.linalg.norm(points["xyz"], axis=1, keepdims=True), 1e-3)
    return replace(scan, points=points)


def _spoilt(recording: Recording) -> Recording:
    """The recording with every scan that touches the span covered; found here from stamps alone."""
    start_ns = recording.scans[0].stamp_ns
    low_ns, high_ns = (start_ns + round(s * 1e9) for s in SPAN_S)
    scans = []
    for scan in recording.scans:
        last_ns = scan.stamp_ns + int(scan.points["offset_ns"].max())
        scans.append(_covered(scan) if last_ns >= low_ns and scan.stamp_ns <= high_ns else scan)
    assert 4 <= sum(a is not b for a, b in zip(scans, recording.scans, strict=True)) <= 6
    return replace(recording, scans=scans)


def test_times_count_from_the_recordings_start_whatever_is_excluded(noisy: tuple[Recording, Truth]) -> None:
    """Seen: the offset said to hold 5.4 s after the start where only what came after 11 s was used. Mutations: from the first
    scan used, of the offset or of the stretches; from the first scan read, where the start was skipped, too.
    """
    recording = replace(noisy[0], skipped_s=4.0)
    stamps_s = np.array([scan.stamp_ns - recording.scans[0].stamp_ns for scan in recording.scans]) * 1e-9 + 4.0
    result = calibrate(recording, CalibrateSettings(excluded_spans_s=((0.0, 1.0),), crispness=False)).result
    kept_s = stamps_s[stamps_s > 5.0]
    assert result.time_offset_at_s == pytest.approx(0.5 * (kept_s[0] + kept_s[-1]), abs=0.06)
    assert result.evidence is not None
    blocks = result.evidence.parts.time_blocks
    assert blocks[0].t_start_s == pytest.approx(kept_s[0], abs=0.2)
    assert blocks[-1].t_end_s == pytest.approx(kept_s[-1], abs=0.2)


def test_what_is_excluded_cannot_matter(noisy: tuple[Recording, Truth]) -> None:
    """Two recordings that differ inside the span only give the same answer, bit for bit, and it is the truth.

    Fails with the excluded scans left to the search for planes, the track or any association: with
    `without_spans` handing its recording back.
    """
    recording, truth = noisy
    one = calibrate(recording, EXCLUDING).result
    other = calibrate(_spoilt(recording), EXCLUDING).result
    assert one.T_imu_lidar is not None
    assert other.T_imu_lidar is not None
    assert one.uncertainty is not None
    np.testing.assert_array_equal(one.T_imu_lidar.matrix, other.T_imu_lidar.matrix)
    assert one.uncertainty == other.uncertainty
    assert one.quality.scans_used < one.quality.scans_total == len(recording.scans)
    matrix = np.array(one.T_imu_lidar.matrix)
    error = np.concatenate([log(truth.R_imu_lidar.T @ matrix[:3, :3]), matrix[:3, 3] - truth.p_imu_lidar])
    std = np.sqrt(np.diag(np.array(one.uncertainty.covariance)))[:6]
    assert np.abs(error / std).max() < 5.0


@pytest.mark.parametrize(
    ("spans", "left"),
    [((), 60), (((0.95, 1.05),), 58), (((-5.0, -1.0),), 60), (((0.0, 0.01), (5.91, 9.0)), 58)],
)
def test_a_scan_goes_when_any_of_it_lies_in_a_span(
    noisy: tuple[Recording, Truth], spans: tuple[tuple[float, float], ...], left: int
) -> None:
    """Sweeps of 0.1 s one after the other, counted by hand. Mutations: only the first points' times compared; what is
    left counts from its own first scan."""
    recording = noisy[0]
    assert len(recording.scans) == 60
    assert len(kept_places(recording.scans, spans)) == left
    kept = without_spans(replace(recording, skipped_s=4.0), spans)
    assert (len(kept.scans), kept.imu) == (left, recording.imu)
    assert kept.skipped_s == pytest.approx(
        4.0 + 1e-9 * (kept.scans[0].stamp_ns - recording.scans[0].stamp_ns), abs=1e-9
    )


def test_nothing_left_is_refused(noisy: tuple[Recording, Truth]) -> None:
    """Fails with an empty recording going on to the estimator."""
    with pytest.raises(SettingsError, match="cover all 60 scans"):
        calibrate(noisy[0], CalibrateSettings(excluded_spans_s=((-1.0, 100.0),)))


def test_given_planes_keep_their_scan(noisy: tuple[Recording, Truth]) -> None:
    """Planes given in a scan's frame without that scan are refused. Fails with `of_part` giving
    the question back as it is."""
    recording = noisy[0]
    planes = [patch.plane for patch in propose_planes(recording, CalibrateSettings()).patches]
    with pytest.raises(SettingsError, match=r"the scan at 0\.00 s"):
        calibrate(recording, CalibrateSettings(excluded_spans_s=((-1.0, 0.5),)), planes=planes)


@pytest.mark.parametrize("span", [(2.0, 2.0), (3.0, 2.0), (float("nan"), 1.0), (0.0, float("inf"))])
def test_a_span_ends_after_it_starts(span: tuple[float, float]) -> None:
    """Fails with the ends not compared, or with ends that are no numbers."""
    with pytest.raises(ValidationError, match=r"ends after it starts|finite number"):
        CalibrateSettings(excluded_spans_s=(span,))
