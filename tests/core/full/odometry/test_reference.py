"""From where the planes are followed, and what is made of scans that cannot be: simulated motion, known truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calib_core.errors import Refused
from calib_core.events import LogEvent, ignore_event, never_cancel
from calib_core.full.initialise.agreement import Agreement
from calib_core.full.initialise.begin import _pairs_start, begin
from calib_core.full.initialise.settings import AGREEING
from calib_core.full.odometry.reference import Followed, follow
from calib_core.full.odometry.register import Registered, ScanMotion, register
from calib_core.full.odometry.settings import TrackSettings
from calib_core.full.odometry.track import track
from calib_core.full.planes.propose import find_reference, named_planes
from calib_core.full.prepare.prepare import prepare
from calib_core.geometry import exp, log
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import FloatArray, Recording


def _errors(recording: Recording, truth: Truth, found: Followed) -> tuple[float, float]:
    """Worst turn [deg] and shift [m] between the track and the truth, in the frame of its reference."""
    start = np.array([(recording.scans[m.position].stamp_ns - truth.epoch_ns) * 1e-9 for m in found.motions])
    at = [m.position for m in found.motions].index(found.reference)
    R, p = truth.map_lidar(start)
    R, p = R[at].T @ R, (p - p[at]) @ R[at]
    turned = log(np.swapaxes(R, 1, 2) @ np.array([m.R for m in found.motions]))
    moved = np.array([m.p for m in found.motions]) - p
    return float(np.degrees(np.linalg.norm(turned, axis=1).max())), float(np.linalg.norm(moved, axis=1).max())


def _half_empty(recording: Recording) -> Recording:
    """Two and a half seconds of empty scans, more than a gyroscope bridges, after the first twelve of sixty."""
    scans = [replace(s, points=s.points[:0]) if 12 <= i < 37 else s for i, s in enumerate(recording.scans)]
    return replace(recording, scans=scans)


def _begin(recording: Recording, *, given: bool, at_fault: float = 0.0) -> tuple[Followed, list[str]]:
    said: list[str] = []

    def listen(event: object) -> None:
        if isinstance(event, LogEvent):
            said.append(event.code)

    settings = CalibrateSettings()
    ctx = prepare(recording, settings, listen, never_cancel)
    _, fits = find_reference(recording.scans, settings)
    return begin(ctx, named_planes(fits)[:3] if given else None, at_fault=at_fault), said


def test_another_reference_is_taken_where_the_first_leads_nowhere(noisy: tuple[Recording, Truth]) -> None:
    """Fails when the first reference's twelve scans are kept, or the poses stay in the first one's frame."""
    recording = _half_empty(noisy[0])
    found, said = _begin(recording, given=False)
    assert found.reference > 36
    assert "track.reference" in said
    assert [m.position for m in found.motions] == list(range(37, len(recording.scans)))
    turned, moved = _errors(recording, noisy[1], found)
    assert turned < 4.0
    assert moved < 0.08


def test_given_planes_keep_their_frame(noisy: tuple[Recording, Truth]) -> None:
    """The motion is told from the scan in whose frame given planes are, however little follows from there.

    Mutation: `begin` without `seen_from` or its second best: the frame of a scan that leads further.
    """
    found, said = _begin(_half_empty(noisy[0]), given=True)
    assert found.reference == 0
    assert "track.reference" not in said


def test_a_track_that_agrees_by_chance_is_not_trusted(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Alike to 0.95, but 22 times as fast: the turns between neighbours are asked. Mutation: trusted by the correlation alone."""
    by_chance = Agreement(0.95, 4.7, 0.045, 0.35)
    monkeypatch.setattr("calib_core.full.initialise.begin.agreement", lambda *_: by_chance)
    found, said = _begin(noisy[0], given=False)
    assert "track.aided" in said
    turned, moved = _errors(noisy[0], noisy[1], found)
    assert turned < 4.0
    assert moved < 0.08


def _led_astray(kind: str, of_all: list[object]) -> Callable[..., Followed]:
    """`follow`, but that the first track slides by 0.5 m within four scans, turns by 6 deg at one, or is lost from one on.

    of_all: each call's turns.
    """
    rng = np.random.default_rng(4)

    def astray(*arguments: Any, **options: Any) -> Followed:
        found = follow(*arguments, **options)
        of_all.append(options.get("turning"))
        if len(of_all) > 1:
            return found
        out = []
        for m in found.motions:
            share = float(np.clip((m.position - 25) / 4.0, 0.0, 1.0))
            if kind == "slid":
                out.append(replace(m, p=m.p + share * np.array([0.1, 0.2, 0.45])))
            elif kind == "lost" and m.position >= 33:
                turn = exp(rng.uniform(-0.9, 0.9, 3)) @ m.R
                out.append(replace(m, R=turn, omega_rad_s=rng.uniform(-3.0, 3.0, 3)))
            elif kind == "lost":
                out.append(m)
            else:
                out.append(replace(m, R=exp(np.array([0.0, 0.0, 0.1 * (share > 0.0)])) @ m.R))
        return replace(found, motions=out)

    return astray


@pytest.mark.parametrize("kind", ["slid", "turned", "lost"])
def test_a_track_that_the_imu_has_not_felt_is_followed_again(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """Planes that led the track aside, of which nothing is seen in what it leaves: the IMU has not felt it. One leap leaves
    its rotation right, as does the stretch before it was lost: turns from scan to scan need not be asked.

    Mutations: no second look; turns alone, or steps alone, are looked at; the worse of the two tracks is kept; turns from
    scan to scan asked in any case, or before the stretch that goes with the gyroscope.
    """
    recording, truth = noisy
    calls: list[object] = []

    def asked(*_: object) -> None:
        pytest.fail("turns from scan to scan were asked for")

    monkeypatch.setattr("calib_core.full.initialise.begin.follow", _led_astray(kind, calls))
    monkeypatch.setattr("calib_core.full.initialise.begin._pairs_start", asked)
    # Half of these six seconds would do.
    short = replace(AGREEING, shortest_part_s=2.5)
    monkeypatch.setattr("calib_core.full.initialise.agreement.AGREEING", short)
    found, said = _begin(recording, given=False)
    assert "track.aided" in said
    turned, moved = _errors(recording, truth, found)
    assert turned < 4.0
    assert moved < 0.08


def test_a_track_that_no_longer_leaps_may_slide_all_the_same(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Followed by its own rotation a track that leapt and slid slides still: turns from scan to scan are asked then.

    Seen in a drawn rig, 0.9 m off and 80 s long. Mutation: leaps alone are counted.
    """
    calls: list[object] = []
    asked: list[object] = []

    def astray(*arguments: Any, **options: Any) -> Followed:
        found = follow(*arguments, **options)
        calls.append(options.get("turning"))
        if len(calls) > 2:
            return found
        out = []
        for m in found.motions:
            slid = float(np.clip((m.position - 20) / 10.0, 0.0, 1.0)) * np.array([0.4, 0.3, 0.9])
            leapt = exp(np.array([0.0, 0.0, 0.1 * (m.position >= 45 and m.position % 3 == 0)]))
            out.append(replace(m, p=m.p + slid, R=m.R if len(calls) == 2 else leapt @ m.R))
        return replace(found, motions=out)

    def pairs(ctx: Any) -> Any:
        asked.append(ctx)
        return _pairs_start(ctx)

    monkeypatch.setattr("calib_core.full.initialise.begin.follow", astray)
    monkeypatch.setattr("calib_core.full.initialise.begin._pairs_start", pairs)
    found, _ = _begin(noisy[0], given=False)
    assert len(asked) == 1
    turned, moved = _errors(noisy[0], noisy[1], found)
    assert turned < 4.0
    assert moved < 0.08


def test_a_forecast_s_track_may_stray(noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch) -> None:
    """Five scans of sixty astray are fewer than a tenth. Mutation: followed again in any case."""
    calls: list[object] = []
    monkeypatch.setattr("calib_core.full.initialise.begin.follow", _led_astray("slid", calls))
    _, said = _begin(noisy[0], given=False, at_fault=0.1)
    assert "track.aided" not in said
    assert len(calls) == 1


class _Known:
    """Steps of so much from scan to scan, and no turns."""

    each_m = np.array([0.01, -0.02, 0.03])

    def between(self, _start_ns: int, _end_ns: int) -> None:
        return None

    def step(self, position: int, to: int, /) -> FloatArray:
        return (to - position) * self.each_m


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


def test_a_choice_of_planes_does_not_feed_the_start(noisy: tuple[Recording, Truth]) -> None:
    """Three of the planes chosen, or none: the same motion, bit for bit. Mutation: the given in place of the found."""
    chosen, free = (_begin(noisy[0], given=given)[0] for given in (True, False))
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
        turned, moved = _errors(recording, truth, Followed(0, [], [m for m in motions if m.share > 0.0]))
        assert turned < 4.0
        assert moved < 0.08


def test_a_track_is_the_same_every_time(noisy: tuple[Recording, Truth]) -> None:
    """Fails when anything random without a seed, or left over from the last run, enters."""
    ctx = prepare(noisy[0], CalibrateSettings(), ignore_event, never_cancel)
    _, fits = find_reference(noisy[0].scans, CalibrateSettings())
    one, other = (follow(ctx, named_planes(fits), 0) for _ in range(2))
    np.testing.assert_array_equal([m.R for m in one.motions], [m.R for m in other.motions])
    np.testing.assert_array_equal([m.p for m in one.motions], [m.p for m in other.motions])


def test_a_lidar_that_turns_like_nothing_the_gyroscope_saw_is_refused_as_that(noisy: tuple[Recording, Truth]) -> None:
    """Sweeps in an order drawn by lot: a track may come of it, of any speed. It is no ground to doubt a unit.

    Mutation: `_refuse_lost` that lets such a track pass: the start values complain of a unit, or the solve diverges.
    """
    recording, _ = noisy
    order = np.random.default_rng(5).permutation(len(recording.scans))
    scans = [replace(scan, points=recording.scans[k].points) for scan, k in zip(recording.scans, order, strict=True)]
    with pytest.raises(Refused, match="could not be followed") as refusal:
        _begin(replace(recording, scans=scans), given=False)
    assert refusal.value.code == "planes.lost"


def test_a_lidar_that_stands_still_while_the_gyroscope_turns_is_not_said_to_stand_still(
    noisy: tuple[Recording, Truth],
) -> None:
    """The first sweep again and again, under new stamps, as of clouds in a map's frame; once the gyroscope turns.

    Mutations: no look at the gyroscope: "the lidar stood still"; followed with the gyroscope's turning, which nothing shows.
    """
    recording, _ = noisy
    scans = [replace(scan, points=recording.scans[0].points) for scan in recording.scans]
    with pytest.raises(Refused, match=r"while the gyroscope turns by .* a frame that does not move") as refusal:
        _begin(replace(recording, scans=scans), given=False)
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
    found, _ = _begin(replace(recording, scans=scans, imu=replace(recording.imu, gyro_rad_s=gyro_rad_s)), given=False)
    assert len(found.motions) == len(scans)


def test_pairs_of_neighbours_alone_give_lag_and_rotation(noisy: tuple[Recording, Truth]) -> None:
    """At 1.5 Hz a sweep is bent by degrees; over thirty pairs rotation and lag are told to what a track can start from.

    Mutation: swap the two scans (a half turn away), or take the turns for those between the sweeps' beginnings (50 ms).
    """
    recording, truth = noisy
    ctx = prepare(recording, CalibrateSettings(), ignore_event, never_cancel)
    starts, agreed = _pairs_start(ctx)
    late_s = starts[0].time_offset_s - ctx.clocks.offset_s(truth.time_offset_ns)
    turned = log(truth.R_imu_lidar.T @ starts[0].R_imu_lidar)
    assert agreed.correlation > AGREEING.believed
    assert abs(late_s) < 0.02
    assert np.degrees(np.linalg.norm(turned)) < 5.0
