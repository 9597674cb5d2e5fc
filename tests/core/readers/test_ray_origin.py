"""Where the rays of a cloud meet: rotors in their own frame, and moved into others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.clouds.decoders import cloud_decoder
from calib_core.readers.container.opening import open_recording
from calib_core.readers.ray_origin import where_rays_meet
from calib_core.types import FloatArray

ELEVATION_DEG = np.linspace(-15.0, 15.0, 16)
#: Walls of a room, and how far from the lidar.
WALLS = ((0, 3.0), (0, -2.0), (1, 4.0), (1, -2.5), (2, 1.6), (2, -1.1))


def _sample(
    turn: Rotation, shift_m: FloatArray, *, ring: bool = True, wobble_deg: float = 0.0, rise_m: float = 0.0
) -> list[RawCloud]:
    """Twelve clouds of a rotor in a room, 2 cm of noise and each laser off by its own, in another frame.

    wobble_deg: of elevations, as in clouds that were straightened.   rise_m: along its axis, from laser to laser.
    """
    rng, out = np.random.default_rng(2), []
    for k in range(12):
        laser = rng.integers(0, 16, 3000)
        azimuth, elevation = rng.uniform(-np.pi, np.pi, 3000), np.radians(ELEVATION_DEG[laser])
        elevation = elevation + np.radians(wobble_deg) * rng.standard_normal(3000)
        u = np.stack(
            [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
        )
        with np.errstate(divide="ignore"):
            ends = np.stack([np.where(u[:, a] * at > 0.0, at / u[:, a], np.inf) for a, at in WALLS])
        range_m = ends.min(axis=0) + 0.02 * rng.standard_normal(3000) + 0.01 * (laser % 5 - 2)
        xyz = (
            turn.apply(range_m[:, None] * u + rise_m * np.stack([0 * laser, 0 * laser, laser / 16.0], axis=1)) + shift_m
        )
        points = np.zeros(3000, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("ring", "u2")])
        points["x"], points["y"], points["z"] = xyz.T
        points["ring"] = laser if ring else 0
        points["x"][::50] = np.nan
        out.append(RawCloud(k, k, "base_link", points, 3000, 1))
    return out


@pytest.mark.parametrize("shift_m", [(0.4, 0.1, 0.5), (0.0, 0.0, 1.2), (-0.3, 0.2, 0.0)])
@pytest.mark.parametrize("tilt_deg", [0.0, 12.0])
def test_a_cloud_that_was_moved_is_told_with_where_its_rays_meet(
    shift_m: tuple[float, float, float], tilt_deg: float
) -> None:
    """To a centimetre, whatever ranges are off by. Mutations: the axis kept along z; the origin's sign; lasers of one cone."""
    (found,) = where_rays_meet(
        _sample(Rotation.from_rotvec([0.0, np.radians(tilt_deg), 0.0]), np.array(shift_m)), "/points"
    )
    assert (found.code, found.level) == ("points.other_frame", "warning")
    told = [float(value) for value in found.text.split("meet at (")[1].split(")")[0].split(",")]
    np.testing.assert_allclose(told, shift_m, atol=0.011)
    evidence = {each.name: each.value for each in found.evidence}
    assert evidence["tilt of the rotor's axis"] == pytest.approx(tilt_deg, abs=0.05)


@pytest.mark.parametrize("of", ["own", "turned", "no ring", "straightened", "tall", "nothing", "one point"])
def test_of_others_nothing_is_said(of: str) -> None:
    """Clouds in their own frame, or only turned; without lasers told apart; whose points are off their cones by a degree;
    a rotor with lasers one above the other over 10 cm; and next to none. Mutations: any distance; however far off cones.
    """
    shift = np.array([0.4, 0.1, 0.5])
    made = {
        "own": lambda: _sample(Rotation.identity(), np.zeros(3)),
        "turned": lambda: _sample(Rotation.from_rotvec([0.2, 0.0, 0.0]), np.zeros(3)),
        "no ring": lambda: _sample(Rotation.identity(), shift, ring=False),
        "straightened": lambda: _sample(Rotation.identity(), shift, wobble_deg=1.0),
        "tall": lambda: _sample(Rotation.identity(), np.zeros(3), rise_m=0.1),
        "nothing": list,
        "one point": lambda: [
            RawCloud(0, 0, "", cloud.points[1:2], 1, 1) for cloud in _sample(Rotation.identity(), shift)
        ],
    }
    assert where_rays_meet(made[of](), "/points") == ()


@pytest.mark.parametrize("sensor", ["vlp16", "vlp32", "vls128"])
def test_rays_of_real_rotors_meet_at_the_origin_until_they_are_moved(sensor: str, real_data: Path) -> None:
    """Two real clouds each, by their packets; then half a metre aside. Mutation: rays looked for are rays found."""
    folder = real_data / "velodyne_ros2_packets" / sensor
    with open_recording(next(p for p in folder.iterdir() if p.is_dir())) as recording:
        decode = cloud_decoder(recording.topics[0])
        clouds = [decode(message) for message in recording.messages([recording.topics[0].name])]
    assert where_rays_meet(clouds, "/points") == ()
    moved = []
    for cloud in clouds:
        points = cloud.points.copy()
        points["x"] += 0.5
        moved.append(replace(cloud, points=points))
    (found,) = where_rays_meet(moved, "/points")
    told = [float(value) for value in found.text.split("meet at (")[1].split(")")[0].split(",")]
    np.testing.assert_allclose(told, [0.5, 0.0, 0.0], atol=0.05)
