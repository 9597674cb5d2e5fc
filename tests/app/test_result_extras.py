"""What stands beside a result: the scans' quality, the command that repeats it, and extrinsics as people paste them."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.cli.options import read_settings, solve_settings
from app.cli.parser import build_parser
from app.errors import BadRequest, facts_of
from app.jobs.orders import OrderedPlane, StoredRequest
from app.results.command import command_of
from app.results.extrinsic_text import parse_extrinsic
from app.results.scans import measure_scans
from app.results.thickness import measure_thickness
from app.schemas.jobs import InitialGuess
from calib_core import api
from calib_core.errors import InputError
from calib_core.settings import CalibrateSettings, Gravity, ImuNoise, Prior, ReadSettings
from tests.app.support import world

RECORDING = world.make_recording()
NOISE = ImuNoise(gyroscope_noise_density_rad_s_sqrt_hz=1e-4, accelerometer_noise_density_m_s2_sqrt_hz=1e-3)


def test_a_bad_scan_stands_out():
    """Oracle: the one scan spoilt here. Mutations: all scans given the first one's number; the gate left
    open; what the spread is measured of counted as on planes."""
    scans = list(RECORDING.scans)
    points = scans[4].points.copy()
    points["xyz"] += np.float32(0.15)
    scans[4] = replace(scans[4], points=points)
    points = scans[7].points.copy()
    points["xyz"] *= np.float32(0.3)
    scans[7] = replace(scans[7], points=points)
    quality = measure_scans(replace(RECORDING, scans=scans), world.make_trajectory(), world.plane_quality())
    np.testing.assert_allclose(quality.t_s, np.arange(world.N_SCANS) * world.PERIOD_S, atol=1e-6)
    good = [k for k in range(world.N_SCANS) if k not in {4, 7}]
    assert max(quality.rms_m[k] for k in good) < 2e-3
    assert min(quality.share[k] for k in good) == 1.0
    assert 0.1 < quality.rms_m[4] < 0.2
    assert quality.share[7] < 0.3
    assert quality.share[4] < 0.5  # 0.15 m off most planes: within the spread's gate, yet grey in the scene


def test_scans_beyond_the_motion_have_no_number():
    """Mutation: poses held at the ends of the motion give numbers that mean nothing."""
    path = world.make_trajectory()
    half = path.times_s < 0.62
    cut = replace(
        path,
        times_s=path.times_s[half],
        R_map_lidar=path.R_map_lidar[half],
        p_map_lidar=path.p_map_lidar[half],
        valid=path.valid[half],
    )
    quality = measure_scans(RECORDING, cut, world.plane_quality())
    assert [value is None for value in quality.rms_m] == [False] * 6 + [True] * 6


def test_walls_and_scans_are_measured_within_their_outlines():
    """Oracle: a wall moved by 5 cm beyond y = 0, which the outline of the other half leaves out.

    Mutations: the outline of the plane before; outlines looked at after the numbers are made.
    """
    scans = []
    for place in range(world.N_SCANS):
        scan, seen = world.make_scan(place)
        points = scan.points.copy()
        spoilt = (seen[:, 0] == world.HALF_M[0]) & (seen[:, 1] > 0)
        R, p = world.poses(place * world.PERIOD_S + points["offset_ns"] * 1e-9)
        moved = seen + np.array([0.05, 0.0, 0.0])
        points["xyz"][spoilt] = np.einsum("nji,nj->ni", R, moved - p)[spoilt]
        scans.append(replace(scan, points=points))
    recording, path = replace(RECORDING, scans=scans), world.make_trajectory()
    half = [[4.0, -9.0, -9.0], [4.0, 0.0, -9.0], [4.0, 0.0, 9.0], [4.0, -9.0, 9.0]]
    planes = world.plane_quality()
    boxed = [plane.model_copy(update={"outline_m": half if plane.name == "east" else None}) for plane in planes]
    east = [plane.name for plane in planes].index("east")
    free, cut = (measure_thickness(recording, path, each).walls for each in (planes, boxed))
    assert free[east].after_rms_m > 0.03
    assert cut[east].after_rms_m < 2e-3
    assert [wall.points for k, wall in enumerate(cut) if k != east] == [
        w.points for k, w in enumerate(free) if k != east
    ]
    assert max(measure_scans(recording, path, boxed).rms_m) < 2e-3
    assert min(measure_scans(recording, path, planes).rms_m) > 5e-3


#: Each setting that the command line has is another than usual in one of them.
SOLVED_WITH = [
    CalibrateSettings(),
    CalibrateSettings(excluded_spans_s=((12.5, 14.0), (-1.0, 0.25)), estimate_time_offset=False, random_seed=3),
    CalibrateSettings(method="paper", points_per_plane_per_scan=100, field_of_view_deg=45.0),
    CalibrateSettings(method="paper"),
    CalibrateSettings(points_per_plane_per_scan=50, field_of_view_deg=60.5, bias_model="constant", max_rounds=4),
    CalibrateSettings(gravity=Gravity(magnitude_m_s2=9.81, std_m_s2=0.0), estimate_planes=False),
    CalibrateSettings(priors=(Prior(axis="tz", value=-0.3, std=0.01), Prior(axis="rx", value=0.1, std=1 / 3))),
    CalibrateSettings(imu_noise="mti-3", imu_sampling="as-stamped", lidar_sampling="as-stamped"),
    CalibrateSettings(intrinsics="consider", lidar="velodyne-vlp16"),
    CalibrateSettings(cloud="as-sent"),
    CalibrateSettings(intrinsics=("gyroscope_scale", "clock_rate", "laser_range_offset")),
]


@pytest.mark.parametrize("settings", SOLVED_WITH)
def test_the_command_asks_for_the_same(settings):
    """Round trip through the command line's own parser. Mutations: exclusions, priors, the seed,
    the sensors' blocks, the lidar or whose points they are left out."""
    reading = ReadSettings(lidar_topic="/points", start_s=2.5, synthesise_point_time=True, stamps="receive")
    command = command_of(world.make_result(name="my room's.bag"), reading, StoredRequest(settings=settings))
    words = shlex.split(command.text)
    assert words[:3] == ["unsweep", "calibrate", "my room's.bag"]
    chosen = build_parser().parse_args(words[1:])
    assert solve_settings(chosen) == settings
    assert read_settings(chosen) == reading.model_copy(update={"lidar_topic": "/points", "imu_topic": "/imu"})
    assert (command.files, command.notes) == ([], [])


def test_no_setting_is_left_out_of_what_the_command_is_tried_with():
    """Mutation: a setting added to CalibrateSettings alone, or one of these left at its default."""
    defaults = CalibrateSettings()
    tried = {
        name
        for each in SOLVED_WITH
        for name in CalibrateSettings.model_fields
        if getattr(each, name) != getattr(defaults, name)
    }
    assert tried | {"crispness"} == set(CalibrateSettings.model_fields)  # measured always by a command


def test_the_commands_files_are_what_the_command_line_reads(tmp_path):
    """Oracle: the library's own readers. Mutation: the planes' file left out gives other planes."""
    planes = (OrderedPlane(name="wall A", normal=(0.6, 0.0, 0.8), offset_m=-1.5),)
    guess = InitialGuess(matrix=world.transform_matrix().tolist(), time_offset_s=-0.02)
    settings = CalibrateSettings(imu_noise=NOISE, gravity=Gravity(magnitude_m_s2=9.8, std_m_s2=0.005))
    request = StoredRequest(settings=settings, planes=planes, initial_guess=guess)
    command = command_of(world.make_result(), ReadSettings(), request)
    for file in command.files:
        (tmp_path / file.name).write_text(file.text)
    chosen = build_parser().parse_args(shlex.split(command.text)[1:])
    (read,) = api.read_planes(tmp_path / chosen.planes)
    assert (read.name, read.normal.tolist(), read.offset_m) == ("wall A", [0.6, 0.0, 0.8], -1.5)
    start = api.read_initial_guess(tmp_path / chosen.initial_guess)
    np.testing.assert_allclose(start.p_imu_lidar, world.P_IMU_LIDAR)
    assert start.time_offset_ns == -20_000_000
    assert api.read_imu_noise(tmp_path / chosen.imu_noise) == NOISE
    chosen.imu_noise = str(tmp_path / chosen.imu_noise)
    assert solve_settings(chosen).gravity.magnitude_m_s2 == pytest.approx(9.8, abs=1e-6)


@pytest.mark.parametrize("name", ["velodyne-calibration", "lasers-csv", "kalibr-imu"])
def test_a_page_that_asks_for_what_a_result_lacks_is_told_so(name):
    """The names are offered for every result. Mutation: `facts_of` without
    the library's errors gives 500."""
    assert name in api.export_names()
    with pytest.raises(InputError) as refused:
        api.export(world.make_result(), name)
    status, facts = facts_of(refused.value)
    assert (status, facts.text) == (422, str(refused.value))
    assert facts.code in {"export.no_lasers", "export.no_imu"}


def test_what_the_command_cannot_say_is_said():
    """Mutation: an unusual prior of gravity dropped in silence."""
    settings = CalibrateSettings(gravity=Gravity(magnitude_m_s2=9.81, std_m_s2=0.001))
    command = command_of(world.make_result(), ReadSettings(), StoredRequest(settings=settings))
    assert len(command.notes) == 1


ROWS = [[0.0, -1.0, 0.0, 0.1], [1.0, 0.0, 0.0, -0.2], [0.0, 0.0, 1.0, 0.3], [0.0, 0.0, 0.0, 1.0]]
HALF = float(np.sqrt(0.5))


@pytest.mark.parametrize(
    "text",
    [
        json.dumps(ROWS),
        json.dumps(ROWS[:3]),
        "0 -1 0 0.1\n1 0 0 -0.2\n0 0 1 0.3\n0 0 0 1",
        "[0, -1, 0, .1; 1, 0, 0, -2e-1; 0, 0, 1, 0.3; 0, 0, 0, 1.]",
        f"# x y z qx qy qz qw\n0.1 -0.2 0.3 0 0 {HALF} {HALF}",
        f"(0.1, -0.2, 0.3), (0, 0, {-HALF}, {-HALF})",
        f"1700000000.5 0.1 -0.2 0.3 0 0 {HALF} {HALF}",
        json.dumps({"T_imu_lidar": {"matrix": ROWS}}),
        json.dumps({"T_imu_lidar": ROWS}),
        json.dumps({"T_imu_lidar": {"translation_m": [0.1, -0.2, 0.3], "quaternion_xyzw": [0, 0, HALF, HALF]}}),
        json.dumps({"T_imu_lidar": {"translation_m": [0.1, -0.2, 0.3], "euler_xyz_deg": [0, 0, 90]}}),
    ],
)
def test_an_extrinsic_is_understood_however_it_is_written(text):
    """A quarter turn about z. Mutations: the quaternion's scalar taken first; the matrix read by columns."""
    found = parse_extrinsic(text, "imu_lidar")
    np.testing.assert_allclose(found.translation_m, [0.1, -0.2, 0.3], atol=1e-12)
    np.testing.assert_allclose(found.quaternion_xyzw, [0, 0, HALF, HALF], atol=1e-12)
    assert found.time_offset_s is None


def test_bare_numbers_may_lead_the_other_way_and_a_result_may_not():
    """Oracle: a point goes there and back. Mutation: the translation of the inverse not turned."""
    there, back = parse_extrinsic(json.dumps(ROWS), "imu_lidar"), parse_extrinsic(json.dumps(ROWS), "lidar_imu")
    point = np.array([0.3, 0.5, -0.7])
    moved = Rotation.from_quat(there.quaternion_xyzw).apply(point) + there.translation_m
    returned = Rotation.from_quat(back.quaternion_xyzw).apply(moved) + back.translation_m
    np.testing.assert_allclose(returned, point, atol=1e-12)
    document = world.make_result().to_json()
    one, other = parse_extrinsic(document, "imu_lidar"), parse_extrinsic(document, "lidar_imu")
    assert one == other
    assert one.time_offset_s == 0.004
    np.testing.assert_allclose(one.translation_m, world.P_IMU_LIDAR)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "0 numbers"),
        ("1 2 3", "3 numbers"),
        ("x: 0.1", "'x: 0.1' is no number"),
        ("0 0 0 0 0 0 0", "no unit quaternion"),
        ("2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1", "orthonormal"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0 0 0 0 1", "right-handed"),
        ("1 0 0 0 0 1 0 0 0 0 1 0 1 2 3 1", "last row"),
        ("{}", "no T_imu_lidar"),
        ('{"T_lidar_imu": 1}', "key T_lidar_imu, where a mounting has to be T_imu_lidar"),
        ('{"T_imu_lidar": {"translation_m": [1, 2, 3]}}', "neither a matrix"),
        ('[["a"]]', "is no number"),
        ("[[NaN]]", "is no number"),
    ],
)
def test_what_is_no_extrinsic_is_told_in_one_sentence(text, reason):
    """Mutation: the first numbers found taken for a translation."""
    with pytest.raises(BadRequest, match=reason) as caught:
        parse_extrinsic(text, "imu_lidar")
    assert str(caught.value).startswith("Expected a result of unsweep")
