"""A track looked at while it is followed: steps in closed form, simulated scans whose registration is spoilt on purpose."""

from __future__ import annotations

from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.errors import Refused
from calib_core.events import ignore_event, never_cancel
from calib_core.full.initialise.inertial_guide import Guide, ImuMotion
from calib_core.full.initialise.inertial_motion import GyroTurning, TrackCheck, told_rotation
from calib_core.full.initialise.lidar_motion import lidar_track
from calib_core.full.initialise.settings import GUIDING
from calib_core.full.initialise.start import RotationStart
from calib_core.full.odometry.motion_prior import Misled
from calib_core.full.odometry.reference import Followed, follow
from calib_core.full.odometry.register import Registered, ScanMotion, register
from calib_core.full.odometry.track import track
from calib_core.full.planes.propose import find_reference, named_planes
from calib_core.full.prepare.prepare import prepare
from calib_core.full.run import Run
from calib_core.geometry import exp
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import FloatArray, Recording
from tests.core.full.tracks import begun, track_errors

RATE = np.array([0.5, -0.3, 0.4])
R_C = exp(np.array([0.4, -1.1, 0.7]))
P_C = np.array([0.1, -0.2, 0.3])
BIAS = np.array([0.05, -0.1, 0.2])
GRAVITY = exp(np.array([0.2, 0.1, 0.0])) @ np.array([0.0, 0.0, -9.81])
OFFSET_S = 0.25
IMU_S = np.arange(0.0, 6.0, 0.0025)
SCAN_S = OFFSET_S + 0.1 * np.arange(58)


def _pose(t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The lidar's at a constant rate, the IMU on three sines about a corner of the map: p_lidar = p_imu + R_imu p_c."""
    t = t_s - OFFSET_S
    R = exp(t[:, None] * RATE)
    imu = np.stack([0.4 * np.sin(3.0 * t), 0.3 * np.cos(2.0 * t), 0.2 * np.sin(4.0 * t)], axis=1)
    return R, imu + (R @ R_C.T) @ P_C


def _readings() -> FloatArray:
    """Specific force R_imu^T (a - g) + b at the IMU's stamps."""
    t = IMU_S
    a = np.stack([-3.6 * np.sin(3.0 * t), -1.2 * np.cos(2.0 * t), -3.2 * np.sin(4.0 * t)], axis=1)
    R_imu = exp(t[:, None] * RATE) @ R_C.T
    return np.asarray((np.swapaxes(R_imu, 1, 2) @ (a - GRAVITY)[..., None])[..., 0] + BIAS)


def _led(*, silent: slice = slice(0, 0)) -> ImuMotion:
    kept = np.delete(np.arange(len(IMU_S)), silent)
    run: Any = SimpleNamespace(
        recording=SimpleNamespace(
            imu=SimpleNamespace(gyro_rad_s=np.tile(R_C @ RATE, (len(kept), 1)), accel_m_s2=_readings()[kept])
        ),
        clocks=SimpleNamespace(imu_s=IMU_S[kept], scan_s=SCAN_S, lidar_epoch_ns=0),
    )
    rotation = RotationStart(OFFSET_S, R_C, np.zeros(3), 0.0, 1.0, None)
    linear = SimpleNamespace(gravity=GRAVITY, p_imu_lidar=P_C, accel_bias=BIAS)
    found: Any = SimpleNamespace(rotation=rotation, steps=SimpleNamespace(start=linear))
    return ImuMotion.of(run, found)


def _motions(which: range, share: float = 1.0) -> list[ScanMotion]:
    R, p = _pose(SCAN_S)
    return [ScanMotion(k, R[k], p[k], RATE, np.zeros(3), share) for k in which]


@pytest.mark.parametrize("which", [range(5, 25), range(50, 30, -1)])
@pytest.mark.parametrize("further", [1, 4])
def test_the_next_step_is_where_it_was(which: range, further: int) -> None:
    """Either way, over one scan and over a few that were lost, to half a millimetre (a scan's bend of 0.1 s would be 18 mm).

    Mutations: gravity, the lever arm or the bias left out or turned round; the velocity of the mean taken for the last one's;
    the way told in the IMU's world; clocks compared without their offset.
    """
    led, behind = _led(), _motions(which)
    to = which[-1] + further * which.step
    step = led.step(behind, to)
    assert step is not None
    np.testing.assert_allclose(step, _pose(SCAN_S)[1][to] - behind[-1].p, atol=5e-4 * further)
    turn = led.between(round(SCAN_S[which[-1]] * 1e9), round(SCAN_S[to] * 1e9))
    assert turn is not None
    np.testing.assert_allclose(turn, exp(RATE * (SCAN_S[to] - SCAN_S[which[-1]])), atol=1e-6)


def test_nothing_is_told_where_the_imu_was_silent_or_little_lies_behind() -> None:
    """Mutations: a silence taken for readings; bridged scans taken for seen ones; ones of long ago for the last second's."""
    tells = _led()
    assert tells.step(_motions(range(5, 25)), 25) is not None
    assert tells.step(_motions(range(5, 25), share=0.0), 25) is None
    assert tells.step(_motions(range(22, 25)), 25) is None
    assert tells.step([*_motions(range(5)), *_motions(range(40, 42))], 42) is None
    first, last = np.searchsorted(IMU_S, [2.12, 2.18])
    silent = _led(silent=slice(int(first), int(last)))
    assert silent.step(_motions(range(5, 21)), 21) is not None
    assert silent.step(_motions(range(5, 22)), 22) is None  # 2.10 to 2.20 s
    assert silent.step(_motions(range(23, 45)), 45) is not None


def test_a_motion_beside_what_was_felt_is_told() -> None:
    """Mutations: its turn, or its way, not looked at."""
    led, behind = _led(), _motions(range(5, 25))
    (right,) = _motions(range(25, 26))
    assert led.has_felt(behind, right)
    assert led.has_felt(behind, replace(right, p=right.p + np.array([0.0, 0.04, 0.0])))
    assert not led.has_felt(behind, replace(right, p=right.p + np.array([0.0, 0.12, 0.0])))
    assert not led.has_felt(behind, replace(right, R=right.R @ exp(np.array([0.0, 0.05, 0.0]))))
    assert led.has_felt(behind[:3], right) is None


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Six seconds are looked back at from their fourth on."""
    monkeypatch.setattr("calib_core.full.initialise.inertial_guide.GUIDING", replace(GUIDING, first_s=4.0, again_s=0.5))


@pytest.fixture(scope="module")
def run(noisy: tuple[Recording, Truth]) -> Run:
    return prepare(noisy[0], CalibrateSettings(), ignore_event, never_cancel)


@pytest.fixture(scope="module")
def motions(run: Run) -> list[ScanMotion]:
    reference, fits = find_reference(run.recording.scans, run.settings)
    return follow(run, named_planes(fits), reference, may_leave=False).motions


def test_what_was_felt_is_left_alone(run: Run, motions: list[ScanMotion], soon: None) -> None:
    """Every scan of a sound track, and then one that goes aside, or is lost. Mutations: led always; never; a lost one not led."""
    guide = Guide(run)
    for k in range(10, len(motions)):
        assert guide.lead(motions[:k], motions[k]) is None
    assert not guide.led
    aside = replace(motions[50], p=motions[50].p + np.array([0.0, 0.3, 0.0]))
    assert isinstance(guide.lead(motions[:50], aside), ImuMotion)
    assert guide.led
    assert isinstance(guide.lead(motions[:50], motions[50]), ImuMotion)  # from there on
    other = Guide(run)
    for k in range(10, 50):
        other.lead(motions[:k], motions[k])
    assert isinstance(other.lead(motions[:50], None), ImuMotion)


def test_what_lies_behind_is_followed_anew_where_it_was_not_felt(
    run: Run, motions: list[ScanMotion], soon: None
) -> None:
    """A turn at one scan: turns and steps are told all the same. Most steps wrong: turns alone are, and then steps; and never
    a third time. Mutations: not told to; told to for ever; by turns again.
    """
    rng = np.random.default_rng(3)
    leapt = [replace(m, R=exp(np.array([0.0, 0.0, 0.1 * (m.position >= 12)])) @ m.R) for m in motions]
    shaken = [replace(m, p=m.p + rng.uniform(-0.3, 0.3, 3)) for m in leapt]
    guide = Guide(run)
    for tracked, leads in ((shaken, GyroTurning), (leapt, ImuMotion)):
        with pytest.raises(Misled) as misled:
            guide.lead(tracked[:45], tracked[45])
        assert isinstance(misled.value.turning, leads)
    assert isinstance(guide.lead(leapt[:45], leapt[45]), ImuMotion)
    assert guide.led


def test_straightened_clouds_are_refused_before_the_gyroscope_tells_their_turning(
    run: Run, motions: list[ScanMotion], soon: None
) -> None:
    """Mutation: not looked at where a track is followed anew."""
    still = [
        replace(m, omega_rad_s=np.zeros(3), R=exp(np.array([0.0, 0.0, 0.1 * (m.position >= 12)])) @ m.R)
        for m in motions
    ]
    with pytest.raises(Refused, match="motion was taken out of the clouds"):
        Guide(run).lead(still, None)


def test_a_registration_that_is_drawn_aside_is_made_again_by_what_was_felt(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch, soon: None
) -> None:
    """Scans registered 0.3 m aside unless their way is known, at the 50th and the 54th of sixty: followed once, and right. Their
    turning is the gyroscope's from there on, so that the points are asked for it.

    Mutations: the guide not asked; what it tells not used; followed again from the beginning; what led it not kept.
    """
    starts: list[object] = []

    def drawn(*arguments: Any, **options: Any) -> Registered:
        found = register(*arguments, **options)
        starts.append(options["position"])
        if options["position"] in (50, 54) and options.get("known_rad") is None:
            return replace(found, motion=replace(found.motion, p=found.motion.p + np.array([0.1, 0.2, 0.2])))
        return found

    monkeypatch.setattr("calib_core.full.odometry.track.register", drawn)
    found, said = begun(noisy[0], given=False)
    assert found.led
    assert "track.aided" in said
    assert starts.count(50) >= 2
    assert found.turning is not None
    assert starts.count(54) == 1
    turned, moved = track_errors(noisy[0], noisy[1], found)
    assert turned < 4.0
    assert moved < 0.08


def test_what_coasted_comes_back_without_a_leap(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch, soon: None
) -> None:
    """Two scans whose points leave a direction open slide in it; the next one is back where it is. Seen in a drawn room of three
    planes, which the IMU then led half a metre away. Mutations: asked of the scans that slid; of the one that comes back.
    """

    def open_ended(*arguments: Any, **options: Any) -> Registered:
        found = register(*arguments, **options)
        if options["position"] in (50, 51):
            return replace(found, motion=replace(found.motion, p=found.motion.p + np.array([0.0, 0.1, 0.0]), std_m=1.0))
        return found

    monkeypatch.setattr("calib_core.full.odometry.track.register", open_ended)
    found, said = begun(noisy[0], given=False)
    assert not found.led
    assert "track.aided" not in said


def test_what_slid_tells_no_velocity() -> None:
    """Mutation: undetermined motions among those that the next step is told by."""
    behind = [replace(m, std_m=1.0 if m.position % 5 else 0.0) for m in _motions(range(5, 25))]
    assert _led().step(behind, 25) is None


class _Aside:
    """`register`, but that some scans are found so far aside [m], whatever leads them; the 45th as long as nothing does."""

    def __init__(self, aside_m: dict[int, float]) -> None:
        self.aside_m = aside_m

    def __call__(self, *arguments: Any, **options: Any) -> Registered:
        found, position = register(*arguments, **options), options["position"]
        off_m = self.aside_m.get(position, 0.3 if position == 45 and options.get("known_rad") is None else 0.0)
        return replace(found, motion=replace(found.motion, p=found.motion.p + np.array([0.0, off_m, 0.0])))


def test_what_pulls_a_led_scan_aside_is_not_taken(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch, soon: None
) -> None:
    """7 cm from what was felt in a tenth of a second it is bridged, in three tenths taken: so much may be felt wrongly.

    Mutations: taken whatever it is; not taken however long nothing was.
    """
    monkeypatch.setattr("calib_core.full.odometry.track.register", _Aside({50: 0.07, 51: 0.3, 52: 0.07}))
    found, _ = begun(noisy[0], given=False)
    assert found.led
    shares = {m.position: m.share for m in found.motions}
    assert [shares[k] > 0.0 for k in (49, 50, 51, 52)] == [True, False, False, True]


def test_a_led_track_that_was_not_felt_gives_way_to_the_planes_own(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch, soon: None
) -> None:
    """Mutations: taken all the same; its own planes followed no more; said to be led."""
    calls: list[object] = []

    def followed(*arguments: Any, **options: Any) -> Any:
        calls.append(options.get("guide"))
        return follow(*arguments, **options)

    def never(_run: Run, known: Any, *_: object) -> Any:
        return known[0], None

    begin = "calib_core.full.initialise.lidar_motion."
    monkeypatch.setattr("calib_core.full.odometry.track.register", _Aside({}))
    monkeypatch.setattr(begin + "follow", followed)
    monkeypatch.setattr(begin + "check_track", lambda *_: TrackCheck(*[None] * 3, np.arange(3)))  # type: ignore[arg-type]
    monkeypatch.setattr(TrackCheck, "faults", 3)
    monkeypatch.setattr(begin + "_with_steps", never)
    monkeypatch.setattr(begin + "_felt", lambda _run, first, *_: first)
    found, said = begun(noisy[0], given=False)
    assert [guide is None for guide in calls] == [False, True]
    assert not found.led
    assert "track.aided" not in said


def test_what_leads_one_way_leads_the_other(noisy: tuple[Recording, Truth], run: Run) -> None:
    """From a reference in the middle: turns told to the march forwards are those of the march back.

    Mutation: the march back by its planes alone.
    """
    asked: list[int] = []

    class LidarTurns(GyroTurning):
        def between(self, start_ns: int, end_ns: int) -> FloatArray | None:
            asked.append(start_ns)
            return super().between(start_ns, end_ns)

    class Forwards:
        led = True

        def lead(self, _motions: Any, newest: ScanMotion | None) -> LidarTurns | None:
            return turns if newest is not None and newest.position > 30 + reference else None

    reference, fits = find_reference(noisy[0].scans[30:], run.settings)
    motions = follow(run, named_planes(fits), 30 + reference, may_leave=False).motions
    lidar = lidar_track(run, Followed(30, [], motions))
    rotation = told_rotation(run, lidar)
    assert rotation is not None
    known = GyroTurning.of(run, rotation)
    turns = LidarTurns(**{each.name: getattr(known, each.name) for each in fields(known)})
    track(noisy[0].scans, named_planes(fits), 30 + reference, guide=Forwards(), within=range(25, 36))
    first_ns = noisy[0].scans[30 + reference].stamp_ns
    assert min(asked) < first_ns - 2e8
