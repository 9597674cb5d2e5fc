"""Taking the motion out with a calibration that is known: against closed-form turning and the simulator's own truth."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.deskew import deskew_points
from calib_core.errors import InputError, Refused, SettingsError
from calib_core.events import Event, LogEvent
from calib_core.full import known_extrinsic
from calib_core.full.known_extrinsic import held_calibration, held_motion, laser_corrector, turning_alone
from calib_core.maps.accumulate import covers
from calib_core.result import Intrinsic
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth, generate
from calib_core.types import POINT_DTYPE, Float32Array, ImuData, InitialGuess, LidarInfo, Recording, Scan, Trajectory
from tests.core.exporters.results import make_result

R_IMU_LIDAR = Rotation.from_rotvec([0.4, -0.2, 2.0]).as_matrix()
P_IMU_LIDAR = np.array([0.3, -0.1, 0.2])
OFFSET_NS = -20_000_000


def scan_at(stamp_ns: int, offsets_ns: np.ndarray, xyz: np.ndarray) -> Scan:
    points = np.zeros(len(xyz), POINT_DTYPE)
    points["xyz"], points["offset_ns"] = xyz, offsets_ns
    return Scan(index=0, stamp_ns=stamp_ns, points=points)


def test_turning_about_the_imu_is_taken_out_exactly() -> None:
    """An IMU that turns as Rz(a t) Rx(b t) in front of a fixed point: closed form for every instant. Fails if the rate
    is integrated in the wrong axes or order, the bias is added, the lever arm is left out, or the time offset's sign is
    turned (seen: each).
    """
    a, b, bias = 0.9, -1.1, np.array([0.02, 0.01, -0.03])
    stamps_ns = 1_000_000_000 + 5_000_000 * np.arange(200)
    t = stamps_ns * 1e-9
    rates = np.column_stack([np.full(t.size, b), a * np.sin(b * t), a * np.cos(b * t)])
    imu = ImuData(stamps_ns, rates + bias, np.zeros((200, 3)))
    trajectory = turning_alone(imu, InitialGuess(R_IMU_LIDAR, P_IMU_LIDAR, OFFSET_NS), bias)

    fixed_m = np.array([4.0, 1.0, -2.0])
    start_ns, offsets_ns = 1_300_000_000 + OFFSET_NS, np.linspace(0, 99_000_000, 50).astype(np.int64)
    imu_s = (start_ns + offsets_ns - OFFSET_NS) * 1e-9
    R_fixed_imu = Rotation.from_euler("ZX", np.column_stack([a * imu_s, b * imu_s])).as_matrix()
    in_lidar = (np.einsum("nji,j->ni", R_fixed_imu, fixed_m) - P_IMU_LIDAR) @ R_IMU_LIDAR
    deskewed = deskew_points(scan_at(start_ns, offsets_ns, in_lidar), trajectory)
    assert np.ptp(in_lidar, axis=0).max() > 0.1, "the raw sweep is smeared"
    # Instants are rounded to 20 us: 10 us x 1.4 rad/s x 5 m, for the point and for the scan's start.
    np.testing.assert_allclose(deskewed, np.tile(in_lidar[0], (50, 1)), atol=1.5e-4)


def test_only_known_motion_counts_as_covered() -> None:
    """Fails if a bridged knot, or a sweep that hangs over an end, is taken for known motion."""
    times_s = np.arange(0.0, 1.05, 0.1)
    valid = np.ones(times_s.size, dtype=bool)
    valid[5] = False
    eye = np.tile(np.eye(3), (times_s.size, 1, 1))
    trajectory = Trajectory(10_000_000_000, times_s, eye, np.zeros((times_s.size, 3)), valid)
    sweep = {"offsets_ns": np.array([0, 90_000_000]), "xyz": np.ones((2, 3))}
    covered = [
        covers(trajectory, scan_at(10_000_000_000 + ms * 1_000_000, **sweep))
        for ms in (-500, 0, 200, 405, 550, 605, 900, 960)
    ]
    assert covered == [False, True, True, False, False, True, True, False]


def found(block: str, values: np.ndarray) -> list[Intrinsic]:
    """A block's parameters as a result has them, one a laser."""
    names = ["all"] if block == "range_offset" else [str(k) for k in range(len(values))]
    rest = {"unit": "", "std": 1e-3, "prior_std": 1e-2, "state": "estimated", "significant": True}
    return [
        Intrinsic.model_validate({"block": block, "name": name, "value": float(value), **rest})
        for name, value in zip(names, values, strict=True)
    ]


def test_a_wall_seen_by_lasers_that_are_off_gets_flat(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wall four metres ahead, swept by 16 lasers that read long, short and askew while the lidar turns and moves. Oracle:
    closed form, by the published formula of calib_core/intrinsics.py. Fails if a sign of the four is turned, the offset of
    all is left out, points are corrected where they are straightened to, or without being asked (seen: each)."""
    rng = np.random.default_rng(2)
    offset, scale, elevation, azimuth = rng.normal(0.0, [[0.01], [0.002], [0.002], [0.002]], (4, 16))
    every, rate_rad_s, speed_m_s = 0.006, 0.5, np.array([0.0, 2.0, 1.0])
    laser = np.tile(np.arange(16, dtype=np.uint16), 60)
    t = np.arange(laser.size) * 1e-4
    head = np.linspace(-0.6, 0.6, laser.size)
    up = np.radians(2.0 * laser - 15.0)
    ray = np.column_stack([np.cos(up) * np.cos(head), np.cos(up) * np.sin(head), np.sin(up)])
    turned = Rotation.from_rotvec(np.outer(rate_rad_s * t, [0, 0, 1])).apply(ray)
    range_m = 4.0 / turned[:, 0]
    published_m = range_m * (1.0 + scale[laser]) + offset[laser] + every
    up, head = up - elevation[laser], head - azimuth[laser]
    xyz = published_m[:, None] * np.column_stack([np.cos(up) * np.cos(head), np.cos(up) * np.sin(head), np.sin(up)])
    points = scan_at(10_000_000_000, np.rint(t * 1e9).astype(np.int64), xyz).points.copy()
    points["ring"] = laser
    scan = Scan(0, 10_000_000_000, points)

    knots_s = np.linspace(0.0, 0.2, 201)
    R = Rotation.from_rotvec(np.outer(rate_rad_s * knots_s, [0, 0, 1])).as_matrix()
    motion = Trajectory(scan.stamp_ns, knots_s, R, knots_s[:, None] * speed_m_s, np.ones(201, dtype=bool))
    monkeypatch.setattr("calib_core.full.known_extrinsic._solved_motion", lambda *_: motion)
    imu = ImuData(np.array([9, 11], np.int64) * 10**9, np.zeros((2, 3)), np.zeros((2, 3)))
    recording = Recording(name="x", imu=imu, scans=(scan,))
    result = make_result(np.eye(3), np.zeros(3))
    with pytest.raises(SettingsError, match=r"room\.bag holds none; .*--correct-lasers"):
        held_motion(recording, result, correct_lasers=True)
    result.intrinsics = [
        *found("laser_range_offset", offset),
        *found("laser_range_scale", scale),
        *found("laser_elevation", elevation),
        *found("laser_azimuth", azimuth),
        *found("range_offset", np.array([every])),
    ]
    before = scan.points["xyz"].copy()
    # Instants are rounded to 20 us: 10 us x 0.5 rad/s x 5 m.
    assert np.abs(held_motion(recording, result, correct_lasers=True).deskew(scan)[:, 0] - 4.0).max() < 5e-5
    assert np.abs(held_motion(recording, result).deskew(scan)[:, 0] - 4.0).std() > 5e-3
    np.testing.assert_array_equal(scan.points["xyz"], before)


def test_lasers_that_are_not_told_apart_are_corrected_as_one(simulated: tuple[Recording, Truth]) -> None:
    """Mutation: rings asked for where only the offset of all is known corrects the first ring alone."""
    scan = simulated[0].scans[0]
    result = make_result(np.eye(3), np.zeros(3))
    result.intrinsics = found("range_offset", np.array([0.02]))
    corrected = laser_corrector(result)(scan).points["xyz"]
    shorter_m = np.linalg.norm(scan.points["xyz"], axis=1) - np.linalg.norm(corrected, axis=1)
    np.testing.assert_allclose(shorter_m, 0.02, atol=2e-6)


def test_a_refused_result_is_one_sentence() -> None:
    """Fails if a refused result is used as identity."""
    recording = Recording(name="x", imu=ImuData(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3))), scans=())
    with pytest.raises(SettingsError, match="refused"):
        held_motion(recording, make_result(np.eye(3), np.zeros(3), status="refused"))


@pytest.mark.parametrize(
    ("written", "used"), [("as-stamped", "as-stamped"), ("even", "even"), (None, "detect"), ("rubbish", "detect")]
)
def test_stamps_mean_what_they_meant_to_the_calibration(
    written: str | None, used: str, simulated: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fails if motion is taken out with the IMU's stamps read otherwise than when the calibration was solved."""
    recording, truth = simulated
    result = make_result(truth.R_imu_lidar, truth.p_imu_lidar, truth.time_offset_ns)
    result = result.model_copy(update={"gyroscope_bias_rad_s": [0.0, 0.0, 0.0]})
    result.provenance.settings.pop("imu_sampling", None)
    if written is not None:
        result.provenance.settings["imu_sampling"] = written
    asked: list[CalibrateSettings] = []

    def prepare(_: Recording, settings: CalibrateSettings, *__: object) -> None:
        asked.append(settings)
        raise Refused("planes.none", "no plane")

    monkeypatch.setattr("calib_core.full.known_extrinsic.prepare", prepare)
    held_motion(recording, result)
    assert [settings.imu_sampling for settings in asked] == [used]
    assert asked[0].priors


@pytest.fixture(scope="module")
def simulated() -> tuple[Recording, Truth]:
    """Eight seconds of the paper's motion with noise."""
    return generate("paper-normal", seed=3, duration_s=8.0)


def true_deskewed(scan: Scan, truth: Truth) -> Float32Array:
    """The same from the exact motion."""
    t_s = truth.seconds(scan.stamp_ns + scan.points["offset_ns"].astype(np.int64))
    R, p = truth.map_lidar(t_s)
    in_map = np.einsum("nij,nj->ni", R, scan.points["xyz"].astype(np.float64)) + p
    R0, p0 = truth.map_lidar(truth.seconds(np.array([scan.stamp_ns])))
    return ((in_map - p0[0]) @ R0[0]).astype(np.float32)


def test_with_the_true_calibration_sweeps_come_out_as_the_true_motion_says(simulated: tuple[Recording, Truth]) -> None:
    """Every scan within a few millimetres of what the exact motion gives, where raw points are centimetres off. Fails
    if the calibration held is turned round, not held, or the wrong scan's motion is used."""
    recording, truth = simulated
    result = make_result(truth.R_imu_lidar, truth.p_imu_lidar, truth.time_offset_ns)
    deskew = held_motion(recording, result.model_copy(update={"gyroscope_bias_rad_s": [0.0, 0.0, 0.0]})).deskew
    worst_raw_m, errors_m = 0.0, []
    for scan in recording.scans:
        expected = true_deskewed(scan, truth)
        errors_m.append(float(np.sqrt(np.mean(np.sum((deskew(scan) - expected) ** 2, axis=1)))))
        worst_raw_m = max(worst_raw_m, float(np.sqrt(np.mean(np.sum((scan.points["xyz"] - expected) ** 2, axis=1)))))
    assert worst_raw_m > 0.03
    assert max(errors_m) < 0.003


def test_the_calibration_of_another_rig_is_told_and_takes_nothing_out(simulated: tuple[Recording, Truth]) -> None:
    """Half a turn off, it went through thirty rounds of walls that "are not flat" and wrote what it made of the sweeps.

    Mutation: the refusal taken for a recording that does not give its motion, of which the turning is taken out.
    """
    recording, truth = simulated
    R_other = truth.R_imu_lidar @ Rotation.from_rotvec([0.0, np.pi, 0.0]).as_matrix()
    result = make_result(R_other, truth.p_imu_lidar, truth.time_offset_ns)
    with pytest.raises(InputError, match=r"room\.bag does not fit this recording: .* turned by 180 deg; ") as refusal:
        held_motion(recording, result)
    assert refusal.value.code == "deskew.other_calibration"


@pytest.mark.parametrize(
    ("sha256", "rate_ppm", "moved_ns", "std_s"),
    [("00", 50.0, 1_000_000, 1e-6), ("00", None, 0, 8e-4), ("01", 50.0, 0, 1e-6), ("", 50.0, 0, 1e-6)],
)
def test_the_offset_is_held_as_it_is_where_the_motion_is_asked_for(
    sha256: str, rate_ppm: float | None, moved_ns: int, std_s: float
) -> None:
    """Found in the first 20 s of a recording that lasts 60: clocks that are 50 ppm apart have gone a millisecond by its middle.

    Of another recording nobody knows since when. Mutations: as at its own instant; the rate's sign; held where no rate is known.
    """
    result = make_result(R_IMU_LIDAR, P_IMU_LIDAR, OFFSET_NS)
    result = result.model_copy(update={"time_offset_at_s": 12.0, "clock_rate_ppm": rate_ppm})
    points = np.array([0, 90_000_000]), np.ones((2, 3))
    scans = [scan_at(5_000_000_000 + second * 1_000_000_000, *points) for second in (0, 30, 60)]
    imu = ImuData(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)))
    recording = Recording(name="x", imu=imu, scans=scans, sha256=sha256, skipped_s=2.0)
    guess, priors = held_calibration(result, recording)
    assert guess.time_offset_ns == OFFSET_NS + moved_ns
    (offset,) = [prior for prior in priors if prior.axis == "dt"]
    assert offset.value == pytest.approx(1e-9 * (OFFSET_NS + moved_ns), abs=1e-12)
    assert offset.std == pytest.approx(std_s, rel=1e-3)
    assert held_calibration(result)[0].time_offset_ns == OFFSET_NS


@pytest.mark.parametrize(
    ("lidar_frame", "imu_frame", "said"),
    [
        ("velodyne", "imu_link", []),
        ("/velodyne", "", []),
        ("os_sensor", "imu_link", ["lidar of x is in the frame os_sensor, but .* room.bag is of the frame velodyne"]),
        ("rear", "imu_rear", ["lidar of x .* rear,", "IMU of x .* imu_rear, .* imu_link"]),
    ],
)
def test_sensors_of_other_frames_are_told(
    lidar_frame: str, imu_frame: str, said: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A lidar's two frames half a turn apart, or the rig's other lidar, were straightened by the wrong extrinsic in silence.

    Mutations: nothing is said; the lidar's frame alone; ROS 1's leading slash counts; a frame nobody named counts.
    """
    monkeypatch.setattr(known_extrinsic, "_solved_motion", lambda *_: None)
    stamps_ns = 5_000_000_000 + 10_000_000 * np.arange(20)
    imu = ImuData(stamps_ns, np.zeros((20, 3)), np.zeros((20, 3)), frame_id=imu_frame)
    scans = [scan_at(5_000_000_000, np.array([0, 90_000_000]), np.ones((2, 3)))]
    recording = Recording(name="x", imu=imu, scans=scans, lidar=LidarInfo(frame_id=lidar_frame))
    events: list[Event] = []
    held_motion(recording, make_result(R_IMU_LIDAR, P_IMU_LIDAR, OFFSET_NS), on_event=events.append)
    told = [event.text for event in events if isinstance(event, LogEvent) and event.code == "deskew.other_frame"]
    assert len(told) == len(said)
    for text, pattern in zip(told, said, strict=True):
        assert re.search(pattern, text)
