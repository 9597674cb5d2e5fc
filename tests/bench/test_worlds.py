"""The second simulator against closed forms, and that it shares nothing with what it is the oracle of."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.worlds import __main__ as page
from bench.worlds import faults, places
from bench.worlds.bags import Sweep, write_bag
from bench.worlds.draw import World, draw
from bench.worlds.imus import Imu, readings
from bench.worlds.lidars import LIDARS, PERIOD_S, Shots
from bench.worlds.motions import GRID_HZ, MARGIN_S, MOTIONS, Motion, moved
from bench.worlds.report import Row, read, report
from bench.worlds.shapes import Hits, box, cast, cylinder, rectangle
from calib_core import api

SILENT = Imu(200.0, averages=False, noise=(0.0, 0.0), walk=(0.0, 0.0))


def test_it_shares_nothing_with_the_estimator() -> None:
    """Only names of types. Fails when a part of it takes a formula of calib_core's; the page alone calls the program."""
    for path in sorted(Path(page.__file__).parent.glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("calib_core"):
                assert node.module == "calib_core.types" or path.name == "__main__.py", (
                    f"{path.name} imports {node.module}"
                )


def test_rays_end_where_they_first_meet_something() -> None:
    """Oracle: by hand. Mutations: the last instead of the first; beyond a rectangle's edge; a cylinder's far side; cosine of a
    cylinder by the ray's own direction.
    """
    shapes = [
        rectangle((3, 0, 0), (0, 1, 0), (0, 0, 1)),
        rectangle((4, 0, 0), (0, 1, 0), (0, 0, 1)),
        cylinder(0, 5, 1, 2),
    ]
    slanting = np.array([3.0, 0.9, 0.0]) / np.hypot(3.0, 0.9)
    aside = np.array([0.6, 5.0 - 0.8, 0.0])
    directions = np.array([[1, 0, 0], slanting, [0, 1, 0], [0, 0, 1], [0.8, 0.6, 0], aside / np.linalg.norm(aside)])
    hits = cast(shapes, np.tile([0.0, 0.0, 0.5], (6, 1)), directions)
    np.testing.assert_array_equal(hits.shape, [0, 0, 2, -1, -1, 2])
    along = aside / np.linalg.norm(aside)
    middle = along @ [0, 5, 0]
    to_side = middle - np.sqrt(1.0 - (25.0 - middle**2))
    np.testing.assert_allclose(hits.range_m[[0, 1, 2, 5]], [3.0, np.hypot(3.0, 0.9), 4.0, to_side])
    assert np.isinf(hits.range_m[[3, 4]]).all()
    np.testing.assert_allclose(hits.cosine[:3], [1.0, 3.0 / np.hypot(3.0, 0.9), 1.0])
    assert hits.cosine[5] == pytest.approx(abs((to_side * along - [0, 5, 0]) @ along))


def test_a_box_is_closed_around_its_middle() -> None:
    """Whatever way one looks from inside, along its own axes half its size. Mutations: turned the other way; a face twice."""
    yaw = 0.7
    turned = Rotation.from_euler("z", yaw)
    hits = cast(box((1, 2, 3), (2, 4, 6), yaw), np.tile([1.0, 2.0, 3.0], (3, 1)), turned.apply(np.eye(3)))
    np.testing.assert_allclose(hits.range_m, [1, 2, 3])


@pytest.mark.parametrize("name", [name for name, lidar in LIDARS.items() if lidar.spins])
def test_lasers_of_a_rotor_keep_to_their_cones(name: str) -> None:
    """Within one sweep, clockwise, once around. Mutations: anticlockwise; two turns; a cone that leans."""
    lidar = LIDARS[name]
    shots = lidar.shots(3.0)
    assert (shots.time_s >= 3.0).all()
    assert (shots.time_s < 3.0 + PERIOD_S).all()
    for laser in (0, lidar.lasers - 1):
        mine = shots.laser == laser
        assert np.ptp(shots.direction[mine, 2]) < 1e-12
        azimuth = np.unwrap(np.arctan2(shots.direction[mine, 1], shots.direction[mine, 0]))
        rate = np.diff(azimuth) / np.diff(shots.time_s[mine])
        np.testing.assert_allclose(rate, -2 * np.pi / PERIOD_S, rtol=1e-9)


def circling(rate_rad_s: float, radius_m: float) -> Motion:
    """On a circle, looking outwards, for a second."""
    t = np.arange(round((1.0 + 2 * MARGIN_S) * GRID_HZ)) / GRID_HZ - MARGIN_S
    angle = rate_rad_s * t
    p = radius_m * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(t)], axis=1)
    return Motion(t, Rotation.from_rotvec(np.outer(angle, [0, 0, 1])), p)


@pytest.mark.parametrize("averages", [False, True])
def test_an_imu_on_a_carousel(averages: bool) -> None:
    """Oracle: w about z, w^2 r inwards, gravity up. Mutations: gravity down; forces in the world's axes; half the rate."""
    rng = np.random.default_rng(0)
    _, gyro, accel = readings(rng, replace(SILENT, averages=averages), circling(2.0, 0.5), 1.0)
    # Biases are drawn: what is told is how readings of two carousels differ.
    _, gyro_still, accel_still = readings(np.random.default_rng(0), SILENT, circling(0.0, 0.5), 1.0)
    np.testing.assert_allclose(gyro - gyro_still, np.tile([0.0, 0.0, 2.0], (200, 1)), atol=6e-4)
    np.testing.assert_allclose(accel - accel_still, np.tile([-2.0, 0.0, 0.0], (200, 1)), atol=3e-3)
    assert accel_still[:, 2].mean() == pytest.approx(9.81, abs=0.25)


def test_an_average_sees_less_of_what_is_quick() -> None:
    """A sine of 40 Hz averaged over 5 ms keeps sin(x) / x of it, x = 0.628. Mutations: averages are samples; over two periods."""
    motion = circling(0.0, 0.5)
    shake = 1e-4 * np.sin(2 * np.pi * 40.0 * motion.time_s)
    shaken = replace(motion, p_m=motion.p_m + np.outer(shake, [1, 0, 0]))
    sampled, averaged = (
        readings(np.random.default_rng(0), replace(SILENT, averages=averages), shaken, 1.0)[2][:, 0].std()
        for averages in (False, True)
    )
    assert averaged / sampled == pytest.approx(np.sin(0.2 * np.pi) / (0.2 * np.pi), rel=0.01)


def test_the_imu_frame_is_the_accelerometers_x_axis_and_xy_plane() -> None:
    """In that frame its x axis feels x alone, its y axis x and y. Mutations: its z axis; turned the other way; mirrored."""
    wrong = faults.drawn(np.random.default_rng(3), "all", 4)
    axes = wrong.imu_axes
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    felt = wrong.accel @ axes.T
    np.testing.assert_allclose(np.triu(felt, 1), np.zeros((3, 3)), atol=1e-12)
    assert (np.diag(felt) > 0.9).all()
    np.testing.assert_array_equal(faults.drawn(np.random.default_rng(3), "lasers", 4).imu_axes, np.eye(3))


def test_a_driver_puts_points_where_it_believes_its_lasers_aim() -> None:
    """A laser that aims 0.1 deg higher, and reads 9 mm long. Mutations: higher still; azimuth lost; a rosette's cones turned."""
    wrong = faults.drawn(np.random.default_rng(0), "ideal", 1)
    wrong = replace(wrong, range_m=np.full(128, 0.009), elevation_rad=np.full(128, np.radians(0.1)))
    aims = Rotation.from_euler("ZY", [50.0, -10.0], degrees=True).apply([1.0, 0.0, 0.0])
    shots = Shots(np.zeros(1), aims[None], np.array([5]))
    believed = Rotation.from_euler("ZY", [50.0, -9.9], degrees=True).apply([1.0, 0.0, 0.0])
    ranges = np.array([4.0])
    np.testing.assert_allclose(faults.as_read(shots, ranges, wrong, spins=True)[0], 4.009 * believed, atol=1e-12)
    np.testing.assert_allclose(faults.as_read(shots, ranges, wrong, spins=False)[0], 4.009 * aims, atol=1e-12)


def test_a_bent_wall_is_met_where_it_bends() -> None:
    """Head on, its height less; slantwise more of the ray, and as much shorter as is said at 60 deg. Boxes are flat.

    Mutations: the height's sign; not divided by the cosine; boxes bent; short by the angle's sine.
    """
    wrong = replace(
        faults.drawn(np.random.default_rng(0), "ideal", 2), bend_m=0.006, waves_m=np.full((2, 2), 1e9),
        phases=np.full((2, 2), np.pi / 2), slant_m=0.003,
    )  # fmt: skip
    shapes = [rectangle((4, 0, 0), (0, 9, 0), (0, 0, 9)), rectangle((0, 4, 0), (0.1, 0, 0), (0, 0, 9))]
    directions = np.array([[1.0, 0, 0], [0.5, np.sqrt(0.75), 0], [0, 1.0, 0]])
    hits = Hits(np.array([4.0, 8.0, 4.0]), np.array([0, 0, 1]), np.array([1.0, 0.5, 1.0]))
    sideways = np.sign(directions[0] @ shapes[0].normal)
    found = faults.bent(hits, wrong, shapes, np.zeros((3, 3)), directions)
    height = sideways * 0.006 * np.sqrt(2)
    np.testing.assert_allclose(found, [4.0 + height, 8.0 + 2 * height + 0.003, 4.0], atol=1e-9)


@pytest.mark.parametrize("name", list(MOTIONS))
def test_ways_begin_at_rest_and_keep_to_what_is_free(name: str) -> None:
    """Mutations: begin in mid-motion; the IMU kept to it instead of the lidar."""
    rng = np.random.default_rng(4)
    place, lever_m = replace(places.tent(rng), free_m=0.45), np.array([0.3, -0.2, 0.1])
    motion = moved(rng, MOTIONS[name], place, 5.0, 1.0, lever_m)
    still = motion.time_s < 1.0
    assert motion.rotation[np.flatnonzero(still)].magnitude().max() == 0.0
    assert np.ptp(motion.p_m[still], axis=0).max() == 0.0
    at = motion.p_m + motion.rotation.apply(lever_m) - place.start_m
    assert np.hypot(at[:, 0], at[:, 1]).max() <= place.free_m
    assert motion.rotation.magnitude().max() > 0.05
    turned, p = motion.at(np.array([2.0, 2.0 + 0.5 / GRID_HZ]))
    assert (turned[0].inv() * turned[1]).magnitude() < 1e-2
    assert np.linalg.norm(p[1] - p[0]) < 1e-2


@pytest.mark.parametrize("layout", ["velodyne", "ouster", "hesai", "robosense", "livox"])
def test_what_a_bag_holds_is_what_was_seen(layout: str, tmp_path: Path) -> None:
    """Read back by the program. Mutations: a field at another's place; times from another instant; the IMU's axes swapped."""
    rng = np.random.default_rng(5)
    sweeps = []
    for k in range(12):
        time_s = 0.1 * k + np.sort(rng.uniform(0, 0.0999, 400))
        time_s[0] = 0.1 * k
        xyz_m = rng.normal([5.0, 0.0, 0.0], size=(400, 3))
        sweeps.append(Sweep(0.1 * k, 0.1 * k + 0.1, xyz_m, time_s, np.arange(400) % 4))
    imu_s = np.arange(0.0, 1.2, 0.005)
    gyro, accel = rng.normal(size=(len(imu_s), 3)), rng.normal([0.0, 0.0, 9.8], size=(len(imu_s), 3))
    path = tmp_path / "world.bag"
    epoch_ns = 1_700_000_000 * 10**9
    write_bag(path, sweeps, imu_s, gyro, accel, layout=layout, epoch_ns=epoch_ns, rng=rng)
    recording = api.load(path)
    np.testing.assert_allclose(recording.imu.gyro_rad_s, gyro, atol=1e-12)
    np.testing.assert_allclose(recording.imu.accel_m_s2, accel, atol=1e-12)
    np.testing.assert_allclose((recording.imu.stamps_ns - epoch_ns) * 1e-9, imu_s, atol=1e-6)
    assert len(recording.scans) == len(sweeps)
    for scan, sweep in zip(recording.scans, sweeps, strict=True):
        np.testing.assert_allclose(scan.points["xyz"], sweep.xyz_m, atol=1e-6)
        np.testing.assert_array_equal(scan.points["ring"], sweep.laser)
        at_s = (scan.stamp_ns - epoch_ns) * 1e-9 + scan.points["offset_ns"] * 1e-9
        np.testing.assert_allclose(at_s, sweep.time_s, atol=1e-6)


def test_a_seed_is_a_world() -> None:
    """The same one each time, and the truth is the frame that its readings define. Mutations: another seed; the body's frame."""
    one, again, other = draw(3, "all"), draw(3, "all"), draw(4, "all")
    np.testing.assert_array_equal(one.T_imu_lidar, again.T_imu_lidar)
    np.testing.assert_array_equal(one.moved.p_m, again.moved.p_m)
    assert (one.time_offset_s, one.place) == (again.time_offset_s, again.place)
    assert one.time_offset_s != other.time_offset_s
    axes = one.faults.imu_axes
    np.testing.assert_allclose(one.T_imu_lidar[:3, :3], axes @ one.R_body_lidar.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(one.T_imu_lidar[:3, 3], axes @ one.lever_m, atol=1e-12)
    assert np.linalg.norm(axes - np.eye(3)) > 1e-4


def row(seed: int, kind: str, status: str, errors: tuple[float, ...], nees: float) -> Row:
    """One of a hand's VLP-16 in a room."""
    return Row(
        seed, kind, "room", "hand", "VLP-16", 20.0, status, "", errors, (1e-4,) * 3 + (1e-3,) * 4, nees, 9.0, "v1"
    )


def test_rows_are_summed_up_by_what_there_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutations: weak ones in the mean; a refusal's NaN in it; wrong beyond 3; a seed in the table run again."""
    nan = (float("nan"),) * 7
    made = {
        1: row(1, "lasers", "calibrated", (1e-4,) * 7, 6.0),
        2: row(2, "imu", "calibrated", (4e-4,) + (0.0,) * 6, 16.0),
        3: row(3, "walls", "calibrated", (6e-4,) + (0.0,) * 6, 36.0),
        4: row(4, "industrial", "weak", (9e-4,) * 7, 900.0),
        5: row(5, "consumer", "refused", nan, float("nan")),
    }
    asked: list[int] = []

    def solve(world: World, _path: Path) -> Row:
        asked.append(world.seed)
        return replace(made[world.seed], faults=world.kind)

    monkeypatch.setattr(page, "record", lambda *_: None)
    monkeypatch.setattr(page, "draw", lambda seed, kind: replace(draw_one, seed=seed, kind=kind))
    monkeypatch.setattr(page, "solve", solve)
    draw_one = draw(3, "ideal")
    for _ in range(2):
        assert page.main(["--seeds", "1-5", "--folder", str(tmp_path), "--report"]) == 0
    assert asked == [1, 2, 3, 4, 5]
    text = (tmp_path / "worlds.md").read_text(encoding="utf-8")
    assert text == report(read(tmp_path))
    assert "| all | 5 | 3 | 1 | 1 | 19.3 | 2.7 to 13.8 | 6.0 | 1 |" in text
    assert "| faults: consumer | 1 | 0 | 0 | 1 |  |  |  |  |" in text
    assert report([]).count("\n| all | 0 |") == 1
