"""A track held against the IMU and followed again: simulated scans, tracks spoilt on purpose, known truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.errors import Refused
from calib_core.events import LogEvent, never_cancel
from calib_core.full.initialise.agreement import Agreement
from calib_core.full.initialise.by_pairs import pairs_start
from calib_core.full.initialise.inertial_guide import ImuMotion
from calib_core.full.initialise.inertial_motion import GyroAndSteps, GyroTurning
from calib_core.full.initialise.lidar_motion import _from_where_planes_are, begin
from calib_core.full.initialise.rotation import rotation_start
from calib_core.full.initialise.settings import AGREEING
from calib_core.full.initialise.start import LidarTrack, RotationStart
from calib_core.full.odometry.reference import Followed, follow
from calib_core.full.prepare.prepare import prepare
from calib_core.geometry import exp, log
from calib_core.settings import CalibrateSettings
from calib_core.simulate import SCENARIOS, Truth, generate
from calib_core.simulate.motion import Pose
from calib_core.simulate.motions import SHIFTING, faster
from calib_core.types import Recording
from tests.core.full.conftest import SMALL_LIDAR
from tests.core.full.tracks import begun, track_errors


def test_a_track_that_agrees_by_chance_is_not_trusted(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Alike to 0.95, but 22 times as fast: the turns between neighbours are asked. Mutation: trusted by the correlation alone."""
    by_chance = Agreement(0.95, 0.045, 0.35)
    monkeypatch.setattr("calib_core.full.initialise.lidar_motion.agreement", lambda *_: by_chance)
    found, said = begun(noisy[0], given=False)
    assert "track.aided" in said
    turned, moved = track_errors(noisy[0], noisy[1], found)
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

    monkeypatch.setattr("calib_core.full.initialise.lidar_motion.follow", _led_astray(kind, calls))
    monkeypatch.setattr("calib_core.full.initialise.lidar_motion.pairs_start", asked)
    # Half of these six seconds would do.
    short = replace(AGREEING, shortest_part_s=2.5)
    monkeypatch.setattr("calib_core.full.initialise.agreement.AGREEING", short)
    found, said = begun(recording, given=False)
    assert "track.aided" in said
    turned, moved = track_errors(recording, truth, found)
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
        if asked:
            return found
        out = []
        for m in found.motions:
            slid = float(np.clip((m.position - 20) / 10.0, 0.0, 1.0)) * np.array([0.4, 0.3, 0.9])
            leapt = exp(np.array([0.0, 0.0, 0.1 * (m.position >= 45 and m.position % 3 == 0)]))
            out.append(replace(m, p=m.p + slid, R=m.R if len(calls) > 1 else leapt @ m.R))
        return replace(found, motions=out)

    def pairs(run: Any) -> Any:
        asked.append(run)
        return pairs_start(run)

    monkeypatch.setattr("calib_core.full.initialise.lidar_motion.follow", astray)
    monkeypatch.setattr("calib_core.full.initialise.lidar_motion.pairs_start", pairs)
    found, _ = begun(noisy[0], given=False)
    assert len(asked) == 1
    turned, moved = track_errors(noisy[0], noisy[1], found)
    assert turned < 4.0
    assert moved < 0.08


def test_turns_from_scan_to_scan_are_found_once(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where nothing that is followed ever goes with the IMU, they are wanted twice. Mutation: found again for the second."""
    asked: list[object] = []

    def astray(*arguments: Any, **options: Any) -> Followed:
        found = follow(*arguments, **options)
        leapt = exp(np.array([0.0, 0.0, 0.1]))
        out = [replace(m, R=leapt @ m.R if m.position % 3 == 0 and m.position > 40 else m.R) for m in found.motions]
        return replace(found, motions=out)

    def pairs(run: Any) -> Any:
        asked.append(run)
        return pairs_start(run)

    by_chance = Agreement(0.95, 0.045, 0.35)
    monkeypatch.setattr("calib_core.full.initialise.lidar_motion.agreement", lambda *_: by_chance)
    monkeypatch.setattr("calib_core.full.initialise.lidar_motion.follow", astray)
    monkeypatch.setattr("calib_core.full.initialise.lidar_motion.pairs_start", pairs)
    begun(noisy[0], given=False)
    assert len(asked) == 1


def test_a_track_that_broke_off_before_it_turned_about_two_axes_asks_pairs_of_scans(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It goes with the gyroscope, but leaves a turn open. Seen in a hall, shaken: 48 scans of 299 were followed, and the time
    offset was sought half a second away.

    Mutations: what the track leaves open is all that is known; pairs are asked and not used.
    """

    def short(*arguments: Any, **options: Any) -> Followed:
        found = follow(*arguments, **options)
        return found if options.get("turning") is not None else replace(found, motions=found.motions[:24])

    def open_turn(lidar: LidarTrack, *others: Any) -> list[RotationStart]:
        starts = rotation_start(lidar, *others)
        return [replace(one, open_axis_imu=np.array([0.0, 0.0, 1.0])) for one in starts]

    monkeypatch.setattr("calib_core.full.initialise.lidar_motion.follow", short)
    monkeypatch.setattr("calib_core.full.initialise.lidar_motion.rotation_start", open_turn)
    found, said = begun(noisy[0], given=False)
    assert "track.aided" in said
    assert len(found.motions) == len(noisy[0].scans)
    turned, moved = track_errors(noisy[0], noisy[1], found)
    assert turned < 4.0
    assert moved < 0.08


def test_steps_mend_what_turns_alone_do_not(noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch) -> None:
    """A track most of whose steps are wrong tells its rotation; by that it slides in a few; what was felt mends those.

    Mutation: turns from scan to scan asked before steps are looked at.
    """
    calls: list[object] = []
    rng = np.random.default_rng(8)

    def astray(*arguments: Any, **options: Any) -> Followed:
        found = follow(*arguments, **options)
        calls.append(options.get("turning"))
        out = []
        for m in found.motions:
            if len(calls) == 1:
                turn = exp(np.array([0.0, 0.0, 0.1 * (m.position == 50)]))
                out.append(replace(m, p=m.p + (m.position > 15) * rng.uniform(-0.3, 0.3, 3), R=turn @ m.R))
            elif len(calls) == 2:
                slid = float(np.clip((m.position - 25) / 4.0, 0.0, 1.0)) * np.array([0.1, 0.2, 0.45])
                turn = exp(np.array([0.0, 0.0, 0.1 * (m.position == 50)]))
                out.append(replace(m, p=m.p + slid, R=turn @ m.R))
            else:
                out.append(m)
        return replace(found, motions=out)

    def asked(*_: object) -> None:
        pytest.fail("turns from scan to scan were asked for")

    monkeypatch.setattr("calib_core.full.initialise.lidar_motion.follow", astray)
    monkeypatch.setattr("calib_core.full.initialise.lidar_motion.pairs_start", asked)
    found, _ = begun(noisy[0], given=False)
    assert [type(turning) for turning in calls] == [type(None), GyroTurning, GyroAndSteps]
    turned, moved = track_errors(noisy[0], noisy[1], found)
    assert turned < 4.0
    assert moved < 0.08


@pytest.mark.parametrize("breaks_off", [False, True])
def test_a_track_that_is_mostly_wrong_is_led_by_its_longest_sound_stretch(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch, breaks_off: bool
) -> None:
    """After 36 scans of 60 it goes anywhere, whatever turns it. Seen in a cluttered office: 49 faults of 299, an answer 1.2 deg
    and 30 mm off; one fault when it was led so. Mutations: what the whole of it tells leads it; the first stretch rather than the
    longest; nothing of it is looked at.

    breaks_off: led so it ends after 33 scans, as a room with curtains did after 52 of 198, and was solved 1.6 deg off; by what
    those told it led throughout. Mutation: led once.
    """
    calls: list[object] = []
    rng = np.random.default_rng(8)

    def astray(*arguments: Any, **options: Any) -> Followed:
        found = follow(*arguments, **options)
        calls.append(options.get("turning"))
        if isinstance(calls[-1], ImuMotion):
            is_first = sum(isinstance(turning, ImuMotion) for turning in calls) == 1
            return replace(found, motions=found.motions[:33]) if breaks_off and is_first else found
        out = []
        for m in found.motions:
            wild = m.position >= 36 or m.position == 2
            turn = exp(wild * rng.uniform(-0.1, 0.1, 3))
            out.append(replace(m, p=m.p + wild * rng.uniform(-0.3, 0.3, 3), R=turn @ m.R))
        return replace(found, motions=out)

    monkeypatch.setattr("calib_core.full.initialise.lidar_motion.follow", astray)
    found, _ = begun(noisy[0], given=False)
    assert any(isinstance(turning, ImuMotion) for turning in calls)
    assert len(found.motions) > 50
    turned, moved = track_errors(noisy[0], noisy[1], found)
    assert turned < 4.0
    assert moved < 0.08


def test_a_track_that_is_mostly_right_is_followed_by_turns_and_steps_at_once(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It leapt, but what is right of it tells both. Mutation: by the gyroscope's turns alone first."""
    calls: list[object] = []
    monkeypatch.setattr("calib_core.full.initialise.lidar_motion.follow", _led_astray("turned", calls))
    _, said = begun(noisy[0], given=False)
    assert "track.aided" in said
    assert [type(turning) for turning in calls] == [type(None), GyroAndSteps]


def test_a_forecast_s_track_may_stray(noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch) -> None:
    """Five scans of sixty astray are fewer than a tenth. Mutation: followed again in any case."""
    calls: list[object] = []
    monkeypatch.setattr("calib_core.full.initialise.lidar_motion.follow", _led_astray("slid", calls))
    _, said = begun(noisy[0], given=False, at_fault=0.1)
    assert "track.aided" not in said
    assert len(calls) == 1


def _broken_off(monkeypatch: pytest.MonkeyPatch, calls: list[str], *, turned_to: int = 60, within: float = 1.0) -> None:
    """`follow`, but that planes alone are lost after 36 scans of sixty, and with the gyroscope's turns at `turned_to`.

    calls: how each was asked for.   within: so much of their rates is seen within the sweeps.
    """

    def broken(*arguments: Any, known: Followed | None = None, **options: Any) -> Followed:
        calls.append("by turns" if options.get("turning") else "by planes" if known is None else "elsewhere")
        if known is not None:
            return known
        found = follow(*arguments, **options)
        if options.get("turning"):
            return replace(found, motions=found.motions[:turned_to])
        return replace(found, motions=[replace(m, omega_rad_s=within * m.omega_rad_s) for m in found.motions[:36]])

    monkeypatch.setattr("calib_core.full.initialise.lidar_motion.follow", broken)


def test_a_track_that_breaks_off_is_led_on_by_the_gyroscope_before_other_scans_are_tried(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is seen before tells the rotation. Mutations: other scans first, or as well; nothing said of it; led on always."""
    calls: list[str] = []
    _broken_off(monkeypatch, calls)
    found, said = begun(noisy[0], given=False)
    assert calls == ["by planes", "by turns"]
    assert "track.aided" in said
    assert found.seen == len(noisy[0].scans)
    turned, moved = track_errors(noisy[0], noisy[1], found)
    assert turned < 4.0
    assert moved < 0.08


def test_what_breaks_off_all_the_same_is_followed_from_elsewhere(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Mutations: the track by turns taken however short; what is known followed again."""
    calls: list[str] = []
    _broken_off(monkeypatch, calls, turned_to=45)
    begun(noisy[0], given=False)
    assert calls[:3] == ["by planes", "by turns", "elsewhere"]


@pytest.mark.parametrize("alone", [3, 60])
def test_planes_in_a_frame_that_the_best_track_does_not_reach_are_followed_from_by_its_turns(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch, alone: int
) -> None:
    """Seen on stairs: from the scan that three planes were chosen in, the planes alone lead over one of 249 scans, and that was
    refused; under the rotation that the best track tells, the gyroscope leads over 247. Where the planes alone lead on, they do.

    Mutations: the planes alone, however short; by turns in any case; nothing said of it.
    """
    recording, truth = noisy
    said: list[str] = []

    def listen(event: object) -> None:
        if isinstance(event, LogEvent):
            said.append(event.code)

    run = prepare(recording, CalibrateSettings(), listen, never_cancel)
    whole = begin(run, None)
    later = whole.seen_from(20)
    assert later is not None
    best = replace(later, motions=[m for m in later.motions if m.position >= 20], away=True)
    asked: list[object] = []

    def short(*arguments: Any, **options: Any) -> Followed:
        asked.append(options.get("turning"))
        found = follow(*arguments, **options)
        return found if options.get("turning") else replace(found, motions=found.motions[:alone])

    monkeypatch.setattr("calib_core.full.initialise.lidar_motion.follow", short)
    said.clear()
    assert best.seen_from(0) is None
    found = _from_where_planes_are(run, best, whole.planes, 0)
    assert found.reference == 0
    assert found.seen == len(recording.scans)
    assert ("track.aided" in said) == (alone < 60)
    assert [turning is not None for turning in asked][:2] == ([False, True] if alone < 60 else [False])
    turned, moved = track_errors(recording, truth, found)
    assert turned < 4.0
    assert moved < 0.08


def test_clouds_that_stand_still_within_their_sweeps_are_told_before_the_gyroscope_turns_them(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The gyroscope's own rates would be found within them. Mutation: not asked there."""
    _broken_off(monkeypatch, [], within=0.0)
    with pytest.raises(Refused) as refused:
        begun(noisy[0], given=False)
    assert refused.value.code == "points.straightened"


def _sliding(slug: str, *, height_m: float) -> tuple[Recording, Truth]:
    """A level rig that is slid to and fro in a scenario's room and never turns; of few lasers, which see hardly any floor."""
    there = SCENARIOS[slug]
    x_m, y_m, _ = there.motion.base.position_m
    motion = replace(faster(SHIFTING, 2.0), base=Pose((0.0, 0.0, -135.0), (x_m, y_m, height_m)))
    imu = SCENARIOS["handheld"].imu
    return generate(replace(there, motion=motion, lidar=SMALL_LIDAR, duration_s=6.0, imu=imu, outliers=None), seed=1)


def test_a_lidar_that_does_not_turn_is_not_followed_as_if_it_did() -> None:
    """Walls fit as well where it turns instead of moving up and down: by 3 deg and 1 m in all.

    Mutation: the track by its planes alone (`_aided`).
    """
    recording, truth = _sliding("ouster", height_m=1.1)
    found, _ = begun(recording, given=False)
    turned, moved = track_errors(recording, truth, found)
    assert turned < 1.5
    assert moved < 0.2
    assert found.seen == len(recording.scans)


def test_a_rig_that_does_not_turn_is_calibrated_but_for_its_lever_arm() -> None:
    """Two walls and no floor hold a lidar that is known not to turn; its height the IMU tells. The lever arm is assumed.

    Mutations: the track by its planes alone (`_aided`), which is refused; no direction may stay open (`_unturned`).
    """
    recording, truth = _sliding("livox", height_m=1.3)
    found = calibrate(recording, CalibrateSettings(intrinsics="off")).result
    assert found.status == "weak"
    assert found.T_imu_lidar is not None
    assert found.uncertainty is not None
    T = np.array(found.T_imu_lidar.matrix)
    np.testing.assert_allclose(T[:3, 3], 0.0, atol=1e-3)
    turned_deg = np.degrees(log(truth.R_imu_lidar.T @ T[:3, :3]))
    assert (np.abs(turned_deg) < 4.0 * np.array(found.uncertainty.rotation_std_deg)).all()
    assert abs(found.time_offset_s - truth.time_offset_s) < 4.0 * found.uncertainty.time_offset_std_s
