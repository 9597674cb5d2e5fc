"""From where the planes are followed, and what is made of scans that cannot be: simulated motion, known truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calib_core.errors import Refused
from calib_core.events import ignore_event, never_cancel
from calib_core.full.initialise.by_pairs import pairs_start
from calib_core.full.initialise.settings import AGREEING
from calib_core.full.odometry.reference import Followed, follow
from calib_core.full.odometry.register import Registered, ScanMotion, register
from calib_core.full.odometry.settings import TrackSettings
from calib_core.full.odometry.track import track
from calib_core.full.planes.propose import find_reference, named_planes
from calib_core.full.prepare.prepare import prepare
from calib_core.geometry import log
from calib_core.planes.segment import segment_planes
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import FloatArray, Recording
from tests.core.full.tracks import begun, track_errors


def _half_empty(recording: Recording) -> Recording:
    """Two and a half seconds of empty scans, more than a gyroscope bridges, after the first twelve of sixty."""
    scans = [replace(s, points=s.points[:0]) if 12 <= i < 37 else s for i, s in enumerate(recording.scans)]
    return replace(recording, scans=scans)


def test_another_reference_is_taken_where_the_first_leads_nowhere(noisy: tuple[Recording, Truth]) -> None:
    """When it was is told from the recording's first scan. Fails when the first reference's twelve scans are kept, the poses stay
    in the first one's frame, or the time counts from the first scan used.
    """
    recording = replace(_half_empty(noisy[0]), skipped_s=100.0)
    found, said = begun(recording, given=False)
    assert found.reference > 36
    at_s = 100.0 + 1e-9 * (recording.scans[found.reference].stamp_ns - recording.scans[0].stamp_ns)
    assert f"those of the scan at {at_s:.1f} s, from" in said["track.reference"]
    assert [m.position for m in found.motions] == list(range(37, len(recording.scans)))
    turned, moved = track_errors(recording, noisy[1], found)
    assert turned < 4.0
    assert moved < 0.08


def test_given_planes_keep_their_frame(noisy: tuple[Recording, Truth]) -> None:
    """The motion is told from the scan in whose frame given planes are, however little follows from there.

    Mutation: `begin` without `seen_from` or its second best: the frame of a scan that leads further.
    """
    found, said = begun(_half_empty(noisy[0]), given=True)
    assert found.reference == 0
    assert "track.reference" not in said


class _Known:
    """Steps of so much from scan to scan, and no turns."""

    coasts = False
    each_m = np.array([0.01, -0.02, 0.03])

    def between(self, _start_ns: int, _end_ns: int) -> None:
        return None

    def turn_std_rad(self, _turn_rad: float, _over_s: float, /) -> float:
        return np.inf

    def step(self, motions: Sequence[ScanMotion], to: int, /) -> FloatArray:
        return (to - motions[-1].position) * self.each_m


def test_a_scan_is_looked_for_where_the_imu_has_felt_it_go(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """From the last one's place, at the step's velocity, tied to both, near by, and nowhere else.

    Mutations: the step is not looked at; it is tied as loosely as a guess; the wide widths; other starts tried, too.
    """
    recording, _ = noisy
    s = TrackSettings()
    looked: list[tuple[int, ScanMotion, FloatArray, object]] = []
    found: dict[int, ScanMotion] = {}

    def spy(*arguments: Any, tie: FloatArray, position: int, scales_m: object = None, **options: Any) -> Registered:
        looked.append((position, arguments[3], tie, scales_m))
        done = register(*arguments, tie=tie, position=position, scales_m=scales_m, **options)  # type: ignore[arg-type]
        found[position] = done.motion
        return done

    monkeypatch.setattr("calib_core.full.odometry.track.register", spy)
    scans = recording.scans[:6]
    _, fits = find_reference(scans, CalibrateSettings())
    track(scans, named_planes(fits), 0, turning=_Known())
    assert [position for position, *_ in looked] == [0, 1, 2, 3, 4, 5]
    for position, start, tie, scales_m in looked[1:]:
        dt = (scans[position].stamp_ns - scans[position - 1].stamp_ns) * 1e-9
        np.testing.assert_allclose(start.p, found[position - 1].p + _Known.each_m, atol=1e-12)
        np.testing.assert_allclose(start.v_m_s, _Known.each_m / dt)
        np.testing.assert_allclose(tie[3:6], 1 / s.step_m**2)
        np.testing.assert_allclose(tie[9:], 1 / s.step_m_s**2)
        assert scales_m == s.near_scales_m


def _counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many scans each track may follow, as they are made."""
    counts: list[int] = []

    def counted(scans: Any, *arguments: Any, within: range | None = None, **options: Any) -> list[ScanMotion]:
        motions = track(scans, *arguments, within=within, **options)
        counts.append(len(motions))
        return motions

    monkeypatch.setattr("calib_core.full.odometry.reference.track", counted)
    return counts


@pytest.mark.parametrize("reference", [30, 0])
def test_a_scan_on_the_move_is_straightened_by_its_neighbours_alone(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch, reference: int
) -> None:
    """Seven scans tell its motion, and one track is made of all: not the whole with bent planes before.

    Mutations: followed throughout, twice; neighbours beyond the three; the bent planes in any case.
    """
    run = prepare(noisy[0], CalibrateSettings(), ignore_event, never_cancel)
    scan = noisy[0].scans[reference]
    bent = named_planes(segment_planes(scan.points["xyz"].astype(np.float64)))
    counts = _counted(monkeypatch)
    found = follow(run, bent, reference)
    assert counts[0] == min(reference, 3) + 4
    assert counts[1:] == [len(noisy[0].scans)]
    moved = float(np.linalg.norm(found.motions[reference].omega_rad_s))
    assert reference == 0 or moved > 0.1, "the scan has to move for this"
    turned, shifted = track_errors(noisy[0], noisy[1], found)
    assert turned < 4.0
    assert shifted < 0.08


def test_a_choice_of_planes_does_not_feed_the_start(noisy: tuple[Recording, Truth]) -> None:
    """Three of the planes chosen, or none: the same motion, bit for bit. Mutation: the given in place of the found."""
    chosen, free = (begun(noisy[0], given=given)[0] for given in (True, False))
    assert len(free.planes) > 3
    np.testing.assert_array_equal([m.R for m in chosen.motions], [m.R for m in free.motions])
    np.testing.assert_array_equal([m.p for m in chosen.motions], [m.p for m in free.motions])


@pytest.mark.parametrize(("first", "last", "goes_on"), [(20, 22, True), (20, 27, False)])
def test_short_blindness_is_bridged_and_longer_ends_the_track(
    clean: tuple[Recording, Truth], first: int, last: int, goes_on: bool
) -> None:
    """Fails when one empty scan ends the track, when seven do not, or when bridged scans claim to have been seen."""
    recording, truth = clean
    scans = [replace(s, points=s.points[:0]) if first <= i < last else s for i, s in enumerate(recording.scans)]
    motions = track(scans, truth.planes, 0)
    assert len(motions) == (len(scans) if goes_on else first)
    if goes_on:
        assert [m.position for m in motions if m.share == 0.0] == list(range(first, last))
        turned, moved = track_errors(recording, truth, Followed(0, [], [m for m in motions if m.share > 0.0]))
        assert turned < 4.0
        assert moved < 0.08


def test_a_track_is_the_same_every_time(noisy: tuple[Recording, Truth]) -> None:
    """Fails when anything random without a seed, or left over from the last run, enters."""
    run = prepare(noisy[0], CalibrateSettings(), ignore_event, never_cancel)
    _, fits = find_reference(noisy[0].scans, CalibrateSettings())
    one, other = (follow(run, named_planes(fits), 0) for _ in range(2))
    np.testing.assert_array_equal([m.R for m in one.motions], [m.R for m in other.motions])
    np.testing.assert_array_equal([m.p for m in one.motions], [m.p for m in other.motions])


def test_a_lidar_that_turns_like_nothing_the_gyroscope_saw_is_refused_as_that(noisy: tuple[Recording, Truth]) -> None:
    """Sweeps in an order drawn by lot: a track may come of it, of any speed. It is no ground to doubt a unit.

    Mutation: `refuse_lost` that lets such a track pass: the start values complain of a unit, or the solve diverges.
    """
    recording, _ = noisy
    order = np.random.default_rng(5).permutation(len(recording.scans))
    scans = [replace(scan, points=recording.scans[k].points) for scan, k in zip(recording.scans, order, strict=True)]
    with pytest.raises(Refused, match="could not be followed") as refusal:
        begun(replace(recording, scans=scans), given=False)
    assert refusal.value.code == "planes.lost"


def test_a_lidar_that_stands_still_while_the_gyroscope_turns_is_not_said_to_stand_still(
    noisy: tuple[Recording, Truth],
) -> None:
    """The first sweep again and again, under new stamps, as of clouds in a map's frame; once the gyroscope turns.

    Mutations: no look at the gyroscope: "the lidar stood still"; followed with the gyroscope's turning, which nothing shows.
    """
    recording, _ = noisy
    scans = [replace(scan, points=recording.scans[0].points) for scan in recording.scans]
    with pytest.raises(Refused, match=r"while the gyroscope turns at .* a frame that does not move") as refusal:
        begun(replace(recording, scans=scans), given=False)
    assert refusal.value.code == "points.standing"


def test_a_lidar_that_stands_still_beside_a_gyroscope_that_shakes_is_no_cloud_in_a_frame_that_does_not_move(
    noisy: tuple[Recording, Truth],
) -> None:
    """An engine's half a radian per second to and fro, between two readings, turns nothing: the lidar does stand still.

    Mutation: the gyroscope's readings in place of its turning from scan to scan.
    """
    recording, _ = noisy
    scans = [replace(scan, points=recording.scans[0].points) for scan in recording.scans]
    to_and_fro = np.where(np.arange(len(recording.imu.stamps_ns)) % 2 == 0, 0.5, -0.5)
    gyro_rad_s = to_and_fro[:, None] * np.array([1.0, 0.0, 0.0])
    found, _ = begun(replace(recording, scans=scans, imu=replace(recording.imu, gyro_rad_s=gyro_rad_s)), given=False)
    assert len(found.motions) == len(scans)


def test_pairs_of_neighbours_alone_give_lag_and_rotation(noisy: tuple[Recording, Truth]) -> None:
    """At 1.5 Hz a sweep is bent by degrees; over thirty pairs rotation and lag are told to what a track can start from.

    Mutation: swap the two scans (a half turn away), or take the turns for those between the sweeps' beginnings (50 ms).
    """
    recording, truth = noisy
    run = prepare(recording, CalibrateSettings(), ignore_event, never_cancel)
    starts, agreed = pairs_start(run)
    late_s = starts[0].time_offset_s - run.clocks.offset_s(truth.time_offset_ns)
    turned = log(truth.R_imu_lidar.T @ starts[0].R_imu_lidar)
    assert agreed.correlation > AGREEING.believed
    assert abs(late_s) < 0.02
    assert np.degrees(np.linalg.norm(turned)) < 5.0
