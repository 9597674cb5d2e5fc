"""A simulated bag and the document beside it against physics by hand, with nothing of simulator or estimator in between.

The signs that both could have wrong alike are those of the document: which way T_imu_lidar leads and in whose axes its lever arm
is, what the time offset is added to, about which instant the clocks' rate turns, whether biases are in the readings, and how a
plane's offset counts. From standing, in the map frame, readings are integrated to the IMU's motion, the lidar hangs on it, and
each point, put there at its own time, has to lie on a plane.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from calib_core.simulate import SCENARIOS, parse_faults, simulate
from calib_core.types import FloatArray

STEP_S = 1e-3
MOVING = replace(
    SCENARIOS["paper-fast"],
    noise=False,
    duration_s=8.0,
    time_offset_s=0.03,
    mounting=(0.3, -0.2, 0.15, *Rotation.from_euler("xyz", [20.0, -35.0, 50.0], degrees=True).as_quat()),
    gyro_bias_rad_s=(0.004, -0.003, 0.002),
    accel_bias_m_s2=(0.05, -0.04, 0.03),
)


@dataclass(frozen=True)
class Told:
    """What a document says, in the contract's words."""

    R_imu_lidar: FloatArray
    p_imu_lidar: FloatArray
    offset_s: float
    offset_at_s: float
    rate: float
    gyro_bias: FloatArray
    accel_bias: FloatArray
    gravity: float
    normals: FloatArray
    offsets_m: FloatArray
    floor: FloatArray


@dataclass(frozen=True)
class Sent:
    """What a bag holds. imu_ns: (Q,), gyro, accel: (Q, 3).   clouds: header [ns], points (N, 3), times after it (N,) [s]."""

    imu_ns: np.ndarray
    gyro: FloatArray
    accel: FloatArray
    clouds: list[tuple[int, FloatArray, FloatArray]]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Sent, Told]:
    path = tmp_path_factory.mktemp("contract") / "room.bag"
    simulate(MOVING, path, seed=4, faults=parse_faults("clock-rate=2000"))
    imu, clouds = [], []
    with AnyReader([path]) as reader:
        for connection, _, payload in reader.messages():
            message = reader.deserialize(payload, connection.msgtype)
            stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            if connection.msgtype.endswith("Imu"):
                w, a = message.angular_velocity, message.linear_acceleration
                imu.append((stamp_ns, (w.x, w.y, w.z), (a.x, a.y, a.z)))
                continue
            rows = message.data.reshape(-1, message.point_step)
            at = {field.name: field.offset for field in message.fields}
            x, y, z, time = (
                np.frombuffer(rows[:, at[n] : at[n] + 4].tobytes(), "<f4").astype(np.float64)
                for n in ("x", "y", "z", "time")
            )
            clouds.append((stamp_ns, np.stack([x, y, z], axis=1), time))
    stamps, gyro, accel = (np.array(column) for column in zip(*imu, strict=True))
    truth = json.loads(Path(path.with_suffix(".truth.json")).read_text())
    T = np.array(truth["T_imu_lidar"]["matrix"])
    told = Told(
        T[:3, :3],
        T[:3, 3],
        truth["time_offset_s"],
        truth["time_offset_at_s"],
        truth["clock_rate_ppm"] * 1e-6,
        np.array(truth["gyroscope_bias_rad_s"]),
        np.array(truth["accelerometer_bias_m_s2"]),
        truth["gravity_m_s2"],
        np.array([plane["normal"] for plane in truth["planes"]]),
        np.array([plane["offset_m"] for plane in truth["planes"]]),
        np.array(next(plane["normal"] for plane in truth["planes"] if plane["name"] == "floor")),
    )
    return Sent(stamps, gyro, accel, clouds), told


def _off_planes_m(sent: Sent, told: Told) -> float:
    """Root mean square distance of the points of some scans from the nearest plane."""
    first_ns = sent.clouds[0][0] + round(sent.clouds[0][2].min() * 1e9)
    # t_lidar = t_imu + offset + rate (t_lidar - offset_at), seconds after the first scan.
    imu_s = (sent.imu_ns - first_ns) * 1e-9
    t = (imu_s + told.offset_s - told.rate * told.offset_at_s) / (1.0 - told.rate)
    gyro, accel = CubicSpline(t, sent.gyro - told.gyro_bias), CubicSpline(t, sent.accel - told.accel_bias)
    at = np.arange(0.0, (sent.clouds[-1][0] - first_ns) * 1e-9 + 0.12, STEP_S)
    # The map is the lidar's frame at first, where all stands still: the IMU's pose there is the inverse of T_imu_lidar.
    R = told.R_imu_lidar.T
    p, v = -R @ told.p_imu_lidar, np.zeros(3)
    up = R @ accel(np.linspace(0.1, 0.8, 50)).mean(axis=0)
    gravity = -told.gravity * up / np.linalg.norm(up)
    half = Rotation.from_rotvec(gyro(at + 0.5 * STEP_S) * 0.5 * STEP_S).as_matrix()
    force = accel(at + 0.5 * STEP_S)
    R_map_imu, p_map_imu = np.empty((len(at), 3, 3)), np.empty((len(at), 3))
    for k in range(len(at)):
        R_map_imu[k], p_map_imu[k] = R, p
        a = R @ half[k] @ force[k] + gravity
        p, v, R = p + STEP_S * v + 0.5 * STEP_S**2 * a, v + STEP_S * a, R @ half[k] @ half[k]
    turn, place = RotationSpline(at[::5], Rotation.from_matrix(R_map_imu[::5])), CubicSpline(at, p_map_imu)
    squares = []
    for header_ns, points_m, time_s in (sent.clouds[k] for k in (25, 45, 75)):
        seen = np.linalg.norm(points_m, axis=1) > 0.0
        point_s = (header_ns - first_ns) * 1e-9 + time_s[seen]
        imu_m = points_m[seen] @ told.R_imu_lidar.T + told.p_imu_lidar
        map_m = turn(point_s).apply(imu_m) + place(point_s)
        squares.append(np.abs(map_m @ told.normals.T + told.offsets_m).min(axis=1) ** 2)
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def test_points_lie_on_planes_by_physics_alone(recorded: tuple[Sent, Told]) -> None:
    """Measured: 0.04 mm, of a spline through 100 readings a second. Mutations in the simulator: the offset
    added to stamps, the clock's rate turned about the start, the lever arm in the lidar's axes, a bias' or a plane's sign.
    """
    assert _off_planes_m(*recorded) < 1e-4


@pytest.mark.parametrize(
    "name", ["p_imu_lidar", "offset_s", "offset_at_s", "rate", "gyro_bias", "accel_bias", "offsets_m", "R_imu_lidar"]
)
def test_and_by_no_other_signs(recorded: tuple[Sent, Told], name: str) -> None:
    """What is checked above can be seen to fail: forty times its bound with any one sign turned, or the rotation backwards."""
    sent, told = recorded
    value = getattr(told, name)
    assert _off_planes_m(sent, replace(told, **{name: value.T if name == "R_imu_lidar" else -value})) > 4e-3


def test_the_lever_arm_is_along_the_imus_axes(recorded: tuple[Sent, Told]) -> None:
    """Along the lidar's it is another place."""
    sent, told = recorded
    assert _off_planes_m(sent, replace(told, p_imu_lidar=told.R_imu_lidar.T @ told.p_imu_lidar)) > 4e-3


def test_a_still_accelerometer_reads_upwards(recorded: tuple[Sent, Told]) -> None:
    """Away from the floor, by what the document calls gravity: a specific force, no acceleration. Mutation: gravity's sign."""
    sent, told = recorded
    up = told.R_imu_lidar.T @ (sent.accel[:80].mean(axis=0) - told.accel_bias)
    assert np.linalg.norm(up) == pytest.approx(told.gravity, abs=1e-6)
    # Floors lean by up to a degree.
    assert up @ told.floor / told.gravity > np.cos(np.radians(2.0))
