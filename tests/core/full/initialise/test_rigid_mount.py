"""Whether both sensors are fixed to one another, on a motion in closed form whose lidar may be turned against its IMU."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.errors import Refused
from calib_core.full.initialise.rigid_mount import left_of, require_rigid
from calib_core.full.initialise.start import LidarTrack, RotationStart
from calib_core.full.planes.curved import CurvedSurfaces
from calib_core.settings import CalibrateSettings
from calib_core.types import FloatArray
from tests.core.full.initialise.perfect_tracks import SCENARIO, imu_readings, tracked_lidar, truth_of

OFFSET_S = -0.2


def _refused(turned_rad: FloatArray | None, *, gyro_scale: float = 1.0, leaps: int = 0, first_s: float = 10.0) -> str:
    """What is said of a lidar that is turned against the rig by rotation vectors (M, 3) at its scans; "" for nothing."""
    truth = truth_of(SCENARIO)
    track: LidarTrack = tracked_lidar(truth, first_s, 30.0)
    stamps, gyro, _ = imu_readings(truth, 5.0, 35.0, OFFSET_S)
    R = track.R
    if turned_rad is not None:
        R = R @ Rotation.from_rotvec(turned_rad[: len(R)]).as_matrix()
    noise = Rotation.from_rotvec(np.random.default_rng(1).normal(0.0, 0.003, (len(R), 3)))
    R = R @ noise.as_matrix()
    for leap in range(1, leaps + 1):
        after = slice(leap * len(R) // (leaps + 1), None)
        R[after] = Rotation.from_rotvec([0.5, 0.0, 0.0]).as_matrix() @ R[after]
    run = SimpleNamespace(
        clocks=SimpleNamespace(imu_s=stamps),
        recording=SimpleNamespace(imu=SimpleNamespace(gyro_rad_s=gyro * gyro_scale), scans=[]),
        settings=CalibrateSettings(),
    )
    try:
        rotation = RotationStart(OFFSET_S, truth.R_imu_lidar, np.zeros(3), 0.1, 1.0, None)
        require_rigid(run, replace(track, R=R), rotation)  # type: ignore[arg-type]
    except Refused as refused:
        return f"{refused.code}: {refused}"
    return ""


def _motor(most_deg: float, every_s: float) -> FloatArray:
    at_s = 0.1 * np.arange(400)
    return np.radians(most_deg) * np.outer(np.sin(2 * np.pi * at_s / every_s), [1.0, 0.0, 0.0])


@pytest.mark.parametrize("scale", [1.0, 1.02])
@pytest.mark.parametrize("leaps", [0, 5])
def test_sensors_that_are_fixed_are_let_through(scale: float, leaps: int) -> None:
    """A rotation between them, a bias, a scale of 2 %, a track that leaps by 30 deg five times, noise of 0.17 deg a scan.

    Mutations: both taken for turned alike; no bias; the mean for the median; the map begun with all spans alike.
    """
    assert _refused(None, gyro_scale=scale, leaps=leaps) == ""


@pytest.mark.parametrize(("most_deg", "every_s"), [(17.0, 7.0), (30.0, 12.0), (60.0, 40.0)])
def test_a_lidar_that_a_motor_turns_is_named(most_deg: float, every_s: float) -> None:
    """Seen: a solve of more than ten minutes. Oracle: within a second a sine changes by 2 sin(pi / period) of itself at most, and
    half of the time by a root of a half of that; the map, drawn to what the motor does, takes up a part.

    Mutations: never; told in rad; turns in the map's axes, of which a rig that is carried round makes something else.
    """
    half_deg = 2.0 * most_deg * np.sin(np.pi / every_s) / np.sqrt(2.0)
    said = _refused(_motor(most_deg, every_s))
    told_deg = float(said.split("rotations differ by ")[1].split(" deg")[0])
    assert said.startswith("motion.not_rigid: ")
    assert 0.5 * half_deg < told_deg < 1.1 * half_deg


def test_a_round_room_is_named_before_a_motor_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seen in a silo, whose wall was taken for eleven planes: "a motor, a gimbal, a loose mount". Sensors that are fixed are let
    through in a round room, too. Mutations: never asked; asked of every track.
    """
    silo = CurvedSurfaces(curved=11, all=12, radius_m=3.12)
    monkeypatch.setattr("calib_core.full.initialise.rigid_mount.curved_surfaces", lambda *_: silo)
    said = _refused(_motor(30.0, 12.0))
    assert said.startswith("planes.lost: ")
    assert "11 of the 12 surfaces that were taken for planes are curved, with a radius of about 3.1 m" in said
    assert "three flat surfaces" in said
    assert _refused(None) == ""


def test_too_few_scans_tell_nothing() -> None:
    """Mutation: asked all the same."""
    assert _refused(_motor(30.0, 3.0), first_s=24.5) == ""


def test_what_is_left_is_what_no_map_explains() -> None:
    """Oracle: noise of a known size; the median length of a vector of three normal numbers is 1.538 of one's.

    Mutation: what a map makes of the turns counted, too.
    """
    rng = np.random.default_rng(5)
    lidar = rng.normal(0.0, 0.5, (4000, 3))
    imu = lidar @ (np.eye(3) + 0.1 * rng.normal(size=(3, 3))) + [0.1, -0.2, 0.3] + rng.normal(0.0, 0.02, (4000, 3))
    left, turned = left_of(lidar, imu, np.eye(3))
    assert left == pytest.approx(1.538 * 0.02, rel=0.05)
    assert turned == pytest.approx(1.538 * 0.5, rel=0.05)
