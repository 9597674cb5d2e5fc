"""The whole calibration on short simulated recordings: truth recovered, choices obeyed, refusals with a reason."""

from __future__ import annotations

import mmap
import os
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core import calibrate as page
from calib_core import growing, paged
from calib_core.api import propose_planes
from calib_core.calibrate import Calibration, calibrate
from calib_core.doctor.outlook import planes_report
from calib_core.errors import Cancelled, Refused, SettingsError
from calib_core.events import PLANNED, Event, IterationEvent, LogEvent, StageEvent
from calib_core.factors import laser_features, lidar_plane
from calib_core.final_messages import with_doubts_settled
from calib_core.full.assess.plausibility import SIGNS_BORNE_OUT, SIGNS_RIGHT
from calib_core.full.joint import lidar_factors, moments, motion
from calib_core.full.joint.settings import CHAIN
from calib_core.geometry import log
from calib_core.imu import preintegration
from calib_core.method import Question
from calib_core.readers.imu.units import detect_accelerometer_unit
from calib_core.result import CalibrationResult, Message
from calib_core.settings import CalibrateSettings, ReadSettings
from calib_core.simulate import Scenario, Truth, generate
from calib_core.simulate.motions import STILL
from calib_core.threads import usual_threads, workers
from calib_core.types import ImuData, Recording
from tests.core.full.answers import errors_of


def _first(recording: Recording, readings: int) -> ImuData:
    """The IMU's first readings."""
    imu = recording.imu
    return replace(
        imu,
        stamps_ns=imu.stamps_ns[:readings],
        gyro_rad_s=imu.gyro_rad_s[:readings],
        accel_m_s2=imu.accel_m_s2[:readings],
    )


def test_without_noise_the_truth_comes_back(clean: tuple[Recording, Truth]) -> None:
    """Fails when the time offset enters with the other sign, or eq. (3) loses its half.

    Ranges are rounded to 2 mm by the packets, 40 000 of them a second: what is left is that and the interpolation.
    """
    recording, truth = clean
    result = calibrate(recording, CalibrateSettings(intrinsics="off", crispness=False)).result
    errors = errors_of(result, truth)
    assert np.degrees(np.abs(errors[:3])).max() < 2e-3
    assert np.abs(errors[3:6]).max() < 1e-4
    assert abs(errors[6]) < 2e-6
    assert result.status == "calibrated"
    assert result.gravity_m_s2 == pytest.approx(truth.gravity_m_s2, abs=2e-3)


def test_under_noise_the_errors_are_as_large_as_the_error_bars(
    noisy: tuple[Recording, Truth], calibrated: Calibration
) -> None:
    """Fails when every weight is ten times too small: the chi-square of the errors leaves its range.

    One draw of chi-square with 7 degrees of freedom: 24.3 is passed once in a thousand, 0.6 the other way.
    """
    truth, result = noisy[1], calibrated.result
    errors = errors_of(result, truth)
    assert result.uncertainty is not None
    covariance = np.array(result.uncertainty.covariance)
    assert 0.6 < errors @ np.linalg.solve(covariance, errors) < 24.3
    std = np.concatenate([np.radians(result.uncertainty.rotation_std_deg), result.uncertainty.translation_std_m])
    np.testing.assert_allclose(std, np.sqrt(np.diag(covariance))[:6], rtol=1e-9)
    assert result.uncertainty.time_offset_std_s == pytest.approx(np.sqrt(covariance[6, 6]))
    # Off by 0.0003 rad/s and 0.016 m/s2; biases of zero would be by 0.002 and 0.05 at least, each of them.
    np.testing.assert_allclose(result.gyroscope_bias_rad_s, truth.gyro_bias_rad_s, atol=6e-4)
    np.testing.assert_allclose(result.accelerometer_bias_m_s2, truth.accel_bias_m_s2, atol=0.03)


def test_the_document_says_one_thing_in_all_its_forms(noisy: tuple[Recording, Truth], calibrated: Calibration) -> None:
    """Fails when planes are left in the frame of the solve, or the quaternion is that of the inverse."""
    recording, truth = noisy
    result = calibrated.result
    assert result.T_imu_lidar is not None
    matrix = np.array(result.T_imu_lidar.matrix)
    np.testing.assert_allclose(
        Rotation.from_quat(result.T_imu_lidar.quaternion_xyzw).as_matrix(), matrix[:3, :3], atol=1e-9
    )
    roll, pitch, yaw = result.T_imu_lidar.euler_xyz_deg
    np.testing.assert_allclose(
        Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True).as_matrix(), matrix[:3, :3], atol=1e-9
    )
    np.testing.assert_array_equal(result.T_imu_lidar.translation_m, matrix[:3, 3])
    assert result.time_offset_ns is not None
    assert result.time_offset_s == pytest.approx(result.time_offset_ns * 1e-9, abs=1e-12)
    for plane in result.quality.planes:
        best = max(truth.planes, key=lambda t: float(t.normal @ np.array(plane.normal)))
        assert float(best.normal @ np.array(plane.normal)) > np.cos(np.radians(0.2))
        assert plane.offset_m == pytest.approx(best.offset_m, abs=0.01)
    assert result.quality.scans_used == result.quality.scans_total == len(recording.scans)
    assert result.quality.points_used == sum(p.points for p in result.quality.planes) > 200_000
    assert CalibrationResult.model_validate_json(result.to_json()) == result


def test_the_trajectory_is_the_lidars_true_motion(noisy: tuple[Recording, Truth], calibrated: Calibration) -> None:
    """Fails when the trajectory is the IMU's, or is left in the frame of the solve."""
    truth, path = noisy[1], calibrated.trajectory
    assert path is not None
    t = path.times_s + (path.epoch_ns - truth.epoch_ns) * 1e-9
    inside = (t > 0.0) & (t < 5.9)
    R, p = truth.map_lidar(t[inside])
    assert np.degrees(np.linalg.norm(log(np.swapaxes(R, 1, 2) @ path.R_map_lidar[inside]), axis=1)).max() < 0.1
    assert np.linalg.norm(path.p_map_lidar[inside] - p, axis=1).max() < 0.01
    assert path.valid[inside].all()


@pytest.fixture(params=[1, 2, 4])
def threads(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """So many threads, of the pool too, on any machine."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(request.param)), raising=False)
    workers.cache_clear()
    yield request.param
    workers.cache_clear()


def test_any_number_of_threads_gives_the_same_answer_bit_for_bit(
    noisy: tuple[Recording, Truth], calibrated: Calibration, threads: int
) -> None:
    """Against as many as the machine has. Also: every event is valid and in order.

    Mutations, in `joint/many_scans.py`: results in another order where more than two threads work; smaller batches for more.
    """
    assert usual_threads() == threads
    events: list[Event] = []
    again = calibrate(noisy[0], CalibrateSettings(), on_event=events.append)
    first, second = (c.result.model_dump() for c in (calibrated, again))
    for document in (first, second):
        document["quality"].pop("duration_s")
    assert first == second
    assert calibrated.trajectory is not None
    assert again.trajectory is not None
    np.testing.assert_array_equal(again.trajectory.p_map_lidar, calibrated.trajectory.p_map_lidar)
    steps = [e for e in events if isinstance(e, IterationEvent)]
    assert [e.iteration for e in steps] == list(range(1, len(steps) + 1))
    assert [e.round for e in steps] == sorted(e.round for e in steps)
    assert again.result.T_imu_lidar is not None
    np.testing.assert_allclose(steps[-1].translation_m, again.result.T_imu_lidar.translation_m, atol=1e-9)
    told = [e for e in events if isinstance(e, StageEvent)]
    assert tuple(dict.fromkeys(e.stage for e in told)) == PLANNED["full"]
    place = [(PLANNED["full"].index(e.stage), e.fraction) for e in told]
    assert place == sorted(place)
    assert all(0.0 <= e.fraction <= 1.0 for e in told)
    solving = [e.fraction for e in told if e.stage == "solve"]
    assert len(set(solving)) > 5
    assert any(isinstance(e, LogEvent) and e.code == "imu.noise" for e in events)


def test_arrays_in_files_whose_pages_are_given_back_give_the_same_answer_bit_for_bit(
    noisy: tuple[Recording, Truth], calibrated: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of a recording of half an hour: everything that may lie in a file lies there, is given back all the time, and is gone
    through a few rows at a time.

    Mutations: a shelf's arrays on top of one another; pages given back with what is written to them (private ones); of instants,
    or of means of hits, the first few alone; links made from the first few on.
    """
    files: list[int] = []
    monkeypatch.setattr(growing, "_IN_MEMORY_BYTES", 0)
    monkeypatch.setattr(paged, "_IN_MEMORY_BYTES", 0)
    monkeypatch.setattr(paged, "_HELD_BYTES", 2**16)
    for module in (moments, motion, lidar_factors):
        monkeypatch.setattr(module, "CHAIN", replace(CHAIN, clusters_at_once=97))
    monkeypatch.setattr(preintegration, "_LINKS_AT_ONCE", 13)
    monkeypatch.setattr(laser_features, "_AT_ONCE", 97)
    monkeypatch.setattr(lidar_plane, "_AT_ONCE", 97)
    of_a_file = paged._pages_of_a_file

    def counted(n_bytes: int) -> mmap.mmap | None:
        files.append(n_bytes)
        return of_a_file(n_bytes)

    monkeypatch.setattr(paged, "_pages_of_a_file", counted)
    again = calibrate(noisy[0], CalibrateSettings())
    assert len(files) > 20
    first, second = (c.result.model_dump(exclude={"quality": {"duration_s"}}) for c in (calibrated, again))
    assert first == second


def test_standing_still_is_refused(short: Scenario) -> None:
    """Fails when a recording without motion goes on to the solve."""
    recording, _ = generate(replace(short, motion=STILL, duration_s=2.5), seed=1)
    done = calibrate(recording, CalibrateSettings())
    assert done.result.status == "refused"
    assert done.trajectory is None
    assert done.result.T_imu_lidar is None
    assert done.result.uncertainty is None
    assert done.result.messages[-1].code == "motion.none"
    assert done.result.messages[-1].level == "error"


@pytest.mark.parametrize("ways", [2, 0])
def test_standing_still_is_refused_as_that_whatever_planes_are_in_view(short: Scenario, ways: int) -> None:
    """Seen behind 16 lasers: "record where three planes stay in view", while nothing moved. Only points of planes that face so
    many ways are left, by the simulator's planes; where none, a cloud without any. Mutation: the planes' reason is told.
    """
    recording, truth = generate(replace(short, motion=STILL, duration_s=2.5), seed=1)
    rng = np.random.default_rng(2)
    normals = np.array([plane.normal for plane in truth.planes])
    faced = [plane for plane in truth.planes if np.abs(np.cross(normals[:2], plane.normal)).max(axis=1).min() < 1e-6]
    scans = []
    for scan in recording.scans:
        xyz = scan.points["xyz"]
        near = np.any([np.abs(xyz @ plane.normal + plane.offset_m) < 0.05 for plane in faced], axis=0)
        points = scan.points[near] if ways else scan.points.copy()
        if not ways:
            points["xyz"] = rng.uniform(-5.0, 5.0, xyz.shape)
        scans.append(replace(scan, points=points))
    last = calibrate(replace(recording, scans=scans), CalibrateSettings()).result.messages[-1]
    assert (last.code, last.level) == ("motion.none", "error")
    assert last.text.startswith("the rig stood still: the IMU feels neither a turn nor an acceleration")


@pytest.mark.parametrize(("scans", "readings"), [(9, 1000), (60, 49), (0, 0)])
def test_too_little_is_refused_before_anything_is_tried(
    clean: tuple[Recording, Truth], scans: int, readings: int
) -> None:
    """Fails when either count is not asked for; an empty recording would then raise."""
    recording = clean[0]
    imu = recording.imu
    cut = replace(
        imu,
        stamps_ns=imu.stamps_ns[:readings],
        gyro_rad_s=imu.gyro_rad_s[:readings],
        accel_m_s2=imu.accel_m_s2[:readings],
    )
    result = calibrate(replace(recording, scans=recording.scans[:scans], imu=cut), CalibrateSettings()).result
    assert result.status == "refused"
    assert [m.code for m in result.messages] == ["recording.too_short"]


@pytest.mark.parametrize("what", ["a scan twice", "scans swapped", "a reading twice"])
def test_what_is_out_of_order_is_refused(clean: tuple[Recording, Truth], what: str) -> None:
    """A scan of the same stamp divided by zero, far inside. Mutations: the scans are not looked at; nor the readings."""
    recording = clean[0]
    scans, imu = list(recording.scans), recording.imu
    match what:
        case "a scan twice":
            recording, words = (
                replace(recording, scans=[*scans[:5], *scans[4:]]),
                "scans have to come in order, each once: number 5 ",
            )
        case "scans swapped":
            recording, words = (
                replace(recording, scans=[*scans[:7], scans[8], scans[7], *scans[9:]]),
                "number 8 (from 0)",
            )
        case _:
            stamps_ns = imu.stamps_ns.copy()
            stamps_ns[30] = stamps_ns[29]
            recording, words = (
                replace(recording, imu=replace(imu, stamps_ns=stamps_ns)),
                "IMU readings have to come in order",
            )
    result = calibrate(recording, CalibrateSettings()).result
    assert [m.code for m in result.messages] == ["recording.order"]
    assert words in result.messages[0].text


def test_clocks_that_never_meet_are_refused(clean: tuple[Recording, Truth]) -> None:
    """Fails when an IMU of another hour is answered with an exception."""
    recording = clean[0]
    result = calibrate(replace(recording, imu=_first(recording, 60)), CalibrateSettings()).result
    assert result.status == "refused"
    assert result.messages[-1].code.startswith("start.")


@pytest.mark.parametrize("polls", [1, 6])
def test_cancelling_raises_and_nothing_else(clean: tuple[Recording, Truth], polls: int) -> None:
    """Fails when Cancelled is turned into a refusal."""
    asked = [0]

    def cancel() -> bool:
        asked[0] += 1
        return asked[0] >= polls

    with pytest.raises(Cancelled):
        calibrate(clean[0], CalibrateSettings(), should_cancel=cancel)
    assert asked[0] == polls


def test_a_sensor_that_nobody_knows_is_the_calls_fault(clean: tuple[Recording, Truth]) -> None:
    """It counted as any lidar in silence. Mutation, for each: a name that is not looked up."""
    with pytest.raises(SettingsError, match="no-such-imu"):
        calibrate(clean[0], CalibrateSettings(imu_noise="no-such-imu"))
    with pytest.raises(SettingsError, match="no-such-lidar"):
        calibrate(clean[0], CalibrateSettings(lidar="no-such-lidar"))


def test_a_document_has_one_name_for_a_sensor_however_it_was_asked_for(clean: tuple[Recording, Truth]) -> None:
    """Over HTTP `vlp16` stood there, and the preset's name from the command line. Mutation: the settings as they came."""
    recording = replace(clean[0], scans=clean[0].scans[:3])
    for lidar, imu in (("vlp16", "ICM 20948"), ("VLP-16", "icm20948"), ("velodyne-vlp16", "ouster-icm20948")):
        result = calibrate(recording, CalibrateSettings(lidar=lidar, imu_noise=imu)).result
        assert result.status == "refused"
        said = result.provenance.settings
        assert (said["lidar"], said["imu_noise"]) == ("velodyne-vlp16", "ouster-icm20948")


def test_the_document_says_what_the_imu_is_like(calibrated: Calibration, short: Scenario) -> None:
    """Oracle: the simulated IMU's own densities and rate. Mutation: a density for a sample's deviation, ten times as large."""
    noise, imu = calibrated.result.imu_noise, short.imu
    assert noise is not None
    for name in ("gyroscope_noise_density_rad_s_sqrt_hz", "accelerometer_noise_density_m_s2_sqrt_hz"):
        assert getattr(noise, name) == pytest.approx(getattr(imu, name), rel=0.2)
    assert calibrated.result.provenance.recording.imu_rate_hz == pytest.approx(imu.rate_hz, rel=0.01)


def test_what_two_attempts_say_is_said_once(clean: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch) -> None:
    """A second attempt of a solve leaves out the same plane again: one sentence in the result, and another plane's stays.

    Mutation: append every sentence.
    """

    def attempts(_: Recording, question: Question) -> Any:
        for name in ("plane 2", "plane 2", "plane 3"):
            question.log(LogEvent(level="info", code="planes.moving", text=f"{name} did not stand still: left out"))
        raise Refused("solve.unsettled", "it moves")

    monkeypatch.setattr("calib_core.calibrate._answer", attempts)
    result = calibrate(clean[0], CalibrateSettings()).result
    names = [message.text.split(" did")[0] for message in result.messages if message.code == "planes.moving"]
    assert names == ["plane 2", "plane 3"]


def test_planes_are_called_in_an_answer_as_where_they_are_looked_at(
    noisy: tuple[Recording, Truth], calibrated: Calibration
) -> None:
    """Floor and ceiling are the room's own; every plane that was proposed has the doctor's name for it.

    Mutations: numbered plainly; up the other way; numbered in another order.
    """
    planes = {plane.name: np.array(plane.normal) for plane in calibrated.result.quality.planes}
    built = {plane.name: np.array(plane.normal) for plane in noisy[1].planes}
    for name in planes.keys() & {"floor", "ceiling"}:
        assert planes[name] @ built[name] > 0.99
    proposals = propose_planes(noisy[0], CalibrateSettings())
    for patch, seen in zip(proposals.patches, planes_report(proposals, -built["floor"]).planes, strict=True):
        if seen.name in planes:
            assert planes[seen.name] @ patch.plane.normal > 0.99
    assert len(planes.keys() & {seen.name for seen in planes_report(proposals, -built["floor"]).planes}) >= 4


def test_an_answer_bears_the_gyroscopes_unit_out() -> None:
    """Seen: `inspect` said that the lidar turns at the same rate, the result of the same recording that only plausibility speaks.
    Every answer of a Livox had a warning of its accelerations in g. Mutations: messages as they came; none warned of a unit that
    was asked for, or that is neither.
    """
    said = [
        Message(
            code="imu.gyroscope_unit",
            level="info",
            text="Angular rates on /imu are in rad/s (gravity hardly turns, so this is judged by their size alone).",
        ),
        Message(code="imu.noise", level="info", text="IMU noise (of a standstill)"),
        Message(code="imu.axis_signs", level="warning", text="Gyroscope axis y on /imu: its sign seems to be flipped."),
    ]
    unit, noise, signs = with_doubts_settled(said)
    settings = ReadSettings(accelerometer_unit="m_s2")
    for scale, level, asked in ((1.0, "info", None), (3.1, "warning", None), (1.0, "warning", settings)):
        stamps_ns = np.arange(0, 4_000_000_000, 5_000_000)
        accel = np.full((len(stamps_ns), 3), scale / np.sqrt(3.0))
        _, found = detect_accelerometer_unit(stamps_ns, 0.0 * accel, accel, asked or ReadSettings(), "/imu")
        assert found.level == "warning"
        (told,) = with_doubts_settled([Message(code=found.code, level=found.level, text=found.text)])
        assert (told.level, told.text) == (level, found.text)
    assert (signs.code, signs.level, signs.text) == (SIGNS_BORNE_OUT, "info", SIGNS_RIGHT)
    assert unit.text == "Angular rates on /imu are in rad/s: the lidar turns at the same rate."
    assert noise == said[1]


@pytest.mark.parametrize("is_weak", [False, True])
def test_a_weak_answer_bears_no_unit_out(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch, is_weak: bool
) -> None:
    """Mutations: messages as they came; borne out whatever the answer."""

    def answer(_recording: Recording, question: Question) -> Any:
        question.log(LogEvent(level="info", code="imu.gyroscope_unit", text="Rates are in rad/s (who knows)."))
        return type("Found", (), {"time_offset_ns": 0, "evidence": None, "trajectory": None, "is_weak": is_weak})()

    monkeypatch.setattr(page, "_answer", answer)
    monkeypatch.setattr(page, "document", lambda _recording, _settings, _answer, messages, _s: messages)
    told: Any = page.calibrate(noisy[0], CalibrateSettings(crispness=False)).result
    said = [m.text for m in told if m.code == "imu.gyroscope_unit"]
    assert ("Rates are in rad/s: the lidar turns at the same rate." in said) is not is_weak
