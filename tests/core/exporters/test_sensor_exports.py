"""What was found of the sensors, as other programs take it: numbers computed by hand, and read back by their own rules."""

from __future__ import annotations

import csv
import io
import re

import numpy as np
import pytest
import velodyne_decoder
import yaml
from scipy.spatial.transform import Rotation

from calib_core.errors import InputError
from calib_core.exporters import SENSOR_NAMES, export
from calib_core.exporters.velodyne_models import HDL_32E, VLP_16, VLP_32C, VLS_128, VelodyneModel
from calib_core.factors.laser_features import LaserErrors
from calib_core.result import CalibrationResult, Intrinsic
from calib_core.settings import ImuNoise
from tests.core.exporters.results import make_result

NOISE = ImuNoise(
    gyroscope_noise_density_rad_s_sqrt_hz=1.2e-4,
    accelerometer_noise_density_m_s2_sqrt_hz=1.18e-3,
    gyroscope_random_walk=3e-5,
    accelerometer_random_walk=4e-4,
)


def parameter(block: str, name: str, value: float, std: float = 0.001, state: str = "estimated") -> Intrinsic:
    fields = {"block": block, "name": name, "unit": "", "value": value, "std": std, "prior_std": 0.01}
    return Intrinsic.model_validate({**fields, "state": state, "significant": False})


def lasers_result(*parameters: Intrinsic, model: str = "velodyne-vlp16", lasers: int = 16) -> CalibrationResult:
    """A result with all range offsets zero but those given."""
    given = {(each.block, each.name) for each in parameters}
    rest = [parameter("laser_range_offset", str(ring), 0.0) for ring in range(lasers)]
    result = make_result(np.eye(3), np.zeros(3))
    result.provenance.recording.lidar_model = model
    result.intrinsics = [*parameters, *(each for each in rest if (each.block, each.name) not in given)]
    return result


def imu_result(*parameters: Intrinsic, time_offset_ns: int = 0) -> CalibrationResult:
    result = make_result(np.eye(3), np.zeros(3), time_offset_ns)
    result.intrinsics, result.imu_noise = list(parameters), NOISE
    result.provenance.recording.imu_rate_hz = 400.0
    return result


def test_a_laser_that_reads_short_is_lengthened() -> None:
    """By hand: ring 8 of a VLP-16 looks up by 1 deg and is the second to fire; it reads 9 mm short, all read 2 mm long, it
    looks 0.001 rad above where it says and 0.002 rad to the left. So laser 1: +0.009 - 0.002 = +0.007 m, 0.0174533 + 0.001
    rad. Mutations seen to fail: the offset's sign, the shared offset left out, rings taken for lasers, elevation taken off."""
    result = lasers_result(
        parameter("laser_range_offset", "8", -0.009),
        parameter("range_offset", "all", 0.002),
        parameter("laser_elevation", "8", 0.001),
        parameter("laser_azimuth", "8", 0.002),
    )
    text = export(result, "velodyne-calibration")
    assert (
        "- {laser_id: 1, rot_correction: 0.002, vert_correction: 0.01845329252, dist_correction: 0.007, "
        "dist_correction_x: 0.0, dist_correction_y: 0.0, vert_offset_correction: 0.0, horiz_offset_correction: 0.0, "
        "focal_distance: 0.0, focal_slope: 0.0}\n"
    ) in text
    assert "# Check: laser 1 (ring 8) reads 7.0 mm short.\n" in text
    document = yaml.safe_load(text)
    assert (document["num_lasers"], document["distance_resolution"]) == (16, 0.002)
    assert [laser["laser_id"] for laser in document["lasers"]] == list(range(16))
    others = [laser["dist_correction"] for laser in document["lasers"] if laser["laser_id"] != 1]
    assert others == [-0.002] * 15


def test_a_driver_with_the_file_puts_points_where_the_correction_does() -> None:
    """Oracle: the driver's own steps from a distance and a head's azimuth to a point, by a decoder's rules (distance plus
    dist_correction; the azimuth less rot_correction, clockwise; x ahead, y left), against LaserErrors.corrected of the points
    that it makes without the file. Mutations: each sign turned; laser_id the ring."""
    rng = np.random.default_rng(5)
    offsets, elevations, azimuths = rng.normal(0, [[0.008], [0.001], [0.001]], (3, 16))
    found = [
        parameter(block, str(ring), float(values[ring]))
        for block, values in zip(
            ("laser_range_offset", "laser_elevation", "laser_azimuth"), (offsets, elevations, azimuths), strict=True
        )
        for ring in range(16)
    ]
    lasers = yaml.safe_load(export(lasers_result(*found), "velodyne-calibration"))["lasers"]
    plain = yaml.safe_load(velodyne_decoder.Calibration.default_calibs[velodyne_decoder.Model.VLP16].to_string())
    order = np.argsort([laser["vert_correction"] for laser in plain["lasers"]])

    def point(laser: dict[str, float], distance_m: float, head_rad: float) -> np.ndarray:
        r = distance_m + laser.get("dist_correction", 0.0)
        clockwise = head_rad - laser["rot_correction"]
        up = laser["vert_correction"]
        return r * np.array([np.cos(up) * np.cos(clockwise), -np.cos(up) * np.sin(clockwise), np.sin(up)])

    errors = LaserErrors(offsets, np.zeros(16), elevations, azimuths, np.zeros(1))
    ring = np.arange(16, dtype=np.uint16)
    shots = [(float(d), float(a)) for d, a in zip(rng.uniform(1, 20, 16), rng.uniform(0, 6, 16), strict=True)]
    seen = np.array([point(plain["lasers"][order[k]], *shots[k]) for k in ring], dtype=np.float32)
    right = np.array([point(lasers[order[k]], *shots[k]) for k in ring])
    assert np.linalg.norm(right - seen, axis=1).max() > 5e-3
    np.testing.assert_allclose(errors.corrected(seen, ring), right, atol=5e-6)


@pytest.mark.parametrize(
    ("model", "name"), [(VLP_16, "VLP16"), (VLP_32C, "VLP32C"), (HDL_32E, "HDL32E"), (VLS_128, "VLS128")]
)
def test_models_are_as_the_decoder_has_them(model: VelodyneModel, name: str) -> None:
    """Oracle: the decoder's own calibrations. Fails with a laser out of order (seen: two of the VLS-128 swapped)."""
    kind = getattr(velodyne_decoder.Model, name)
    document = yaml.safe_load(velodyne_decoder.Calibration.default_calibs[kind].to_string())
    up = np.degrees([laser["vert_correction"] for laser in document["lasers"]])
    aside = np.degrees([laser["rot_correction"] for laser in document["lasers"]])
    np.testing.assert_allclose(model.elevation_deg, up, atol=6e-4)
    np.testing.assert_allclose(model.azimuth_deg, aside, atol=6e-4)
    assert model.laser_of_ring == tuple(np.argsort(up, kind="stable"))
    assert model.distance_resolution_m == pytest.approx(document["distance_resolution"])


@pytest.mark.parametrize(("model", "lasers"), [("", 16), ("ouster-os", 16), ("velodyne", 32), ("velodyne-vlp16", 8)])
def test_an_unknown_model_keeps_rings_and_says_so(model: str, lasers: int) -> None:
    """Fails if the angles of some model are written for a sensor that is not one (seen: the first model taken)."""
    offset = parameter("laser_range_offset", "3", 0.004)
    elevation = parameter("laser_elevation", "3", -0.001)
    text = export(lasers_result(offset, elevation, model=model, lasers=lasers), "velodyne-calibration")
    assert "The lidar's model is not known: laser_id is the ring" in text
    laser = yaml.safe_load(text)["lasers"][3]
    assert (laser["laser_id"], laser["vert_correction"], laser["dist_correction"]) == (3, -0.001, -0.004)


def test_the_lidar_that_was_named_goes_before_the_recognised_one() -> None:
    """Mutation: `lidar_model` alone."""
    result = lasers_result(model="velodyne", lasers=32)
    result.provenance.settings["lidar"] = "velodyne-vlp32c"
    assert "a VLP-32C's" in export(result, "velodyne-calibration")


def test_one_preset_for_several_models_goes_by_the_number_of_lasers() -> None:
    """Mutation: the first model of the preset, whatever it has."""
    text = export(lasers_result(model="velodyne", lasers=128), "velodyne-calibration")
    assert "a VLS-128's" in text
    assert yaml.safe_load(text)["lasers"][36]["vert_correction"] == pytest.approx(np.radians(-25.0))


def test_a_row_a_laser() -> None:
    """By hand: 3 mm and 4 mm are 5 mm together; ring 15 of a VLP-16 fires last, ring 0 first. Mutation: sigmas added;
    rows in the rings' order."""
    result = lasers_result(
        parameter("laser_range_offset", "15", 0.0105, 0.003),
        parameter("laser_elevation", "15", -0.0005, 0.0001),
        parameter("range_offset", "all", -0.0025, 0.004),
    )
    rows = list(csv.DictReader(io.StringIO(export(result, "lasers-csv"))))
    assert [row["laser"] for row in rows] == [str(k) for k in range(16)]
    assert [row["ring"] for row in rows][:4] == ["0", "8", "1", "9"]
    assert rows[15] == {
        "laser": "15",
        "ring": "15",
        "range_offset_m": "-0.008000",
        "range_offset_std_m": "0.005000",
        "range_scale": "0.0000000",
        "range_scale_std": "0.0000000",
        "elevation_rad": "-0.0005000",
        "elevation_std_rad": "0.0001000",
        "azimuth_rad": "0.0000000",
        "azimuth_std_rad": "0.0000000",
    }
    assert rows[0]["range_offset_m"] == "0.002500"


def test_the_table_puts_points_where_the_correction_does() -> None:
    """Oracle: LaserErrors.corrected, of points of lasers that are off in all four ways, against the table's own rule as
    docs/formats.md has it. Mutations: each column's sign turned, left out, or taken for another's; the shared offset left out."""
    rng = np.random.default_rng(6)
    offsets, scales, elevations, azimuths = rng.normal(0, [[0.008], [0.003], [0.002], [0.002]], (4, 16))
    blocks = ("laser_range_offset", "laser_range_scale", "laser_elevation", "laser_azimuth")
    found = [
        parameter(block, str(ring), float(values[ring]), 1e-4 * (1 + place))
        for place, (block, values) in enumerate(zip(blocks, (offsets, scales, elevations, azimuths), strict=True))
        for ring in range(16)
    ]
    every = parameter("range_offset", "all", 0.004, 0.0)
    text = export(lasers_result(*found, every), "lasers-csv")
    table = {
        int(row["ring"]): {key: float(value) for key, value in row.items()} for row in csv.DictReader(io.StringIO(text))
    }
    ring = rng.integers(0, 16, 200).astype(np.uint16)
    xyz = rng.normal((30, 0, 0), 10, (200, 3)).astype(np.float32)
    right = LaserErrors(offsets + 0.004, scales, elevations, azimuths, np.zeros(1)).corrected(xyz, ring)
    for point, laser, expected in zip(xyz.astype(np.float64), ring, right, strict=True):
        add = table[int(laser)]
        r = (np.linalg.norm(point) + add["range_offset_m"]) * (1.0 + add["range_scale"])
        up = np.arcsin(point[2] / np.linalg.norm(point)) + add["elevation_rad"]
        head = np.arctan2(point[1], point[0]) + add["azimuth_rad"]
        here = r * np.array([np.cos(up) * np.cos(head), np.cos(up) * np.sin(head), np.sin(up)])
        np.testing.assert_allclose(here, expected, atol=2e-5)
    names = (
        "range_offset_std_m",
        "range_scale_std",
        "elevation_std_rad",
        "azimuth_std_rad",
    )
    assert [table[3][name] for name in names] == pytest.approx([1e-4, 2e-4, 3e-4, 4e-4])


def test_what_a_drivers_file_has_no_place_for_is_said() -> None:
    """In one line. Mutations: the scale, or what all lasers share, passed over; one of an eccentricity's two alone."""
    found = (
        parameter("laser_range_scale", "4", 0.002),
        parameter("eccentricity", "sine", 3e-4),
        parameter("eccentricity", "cosine", -4e-4),
        parameter("incidence", "all", 0.003),
        parameter("grazing", "all", -0.0012),
    )
    (line,) = [
        line for line in export(lasers_result(*found), "velodyne-calibration").splitlines() if "left out" in line
    ]
    assert line == (
        "# No place is in this form for a range scale (up to -0.200% to be added), an encoder off its axis (up to 0.0286 deg "
        "once a turn) and what a slant does to ranges (incidence +3.0 mm, grazing -1.20 mrad): left out."
    )


def test_an_imu_as_kalibr_reads_it() -> None:
    """By hand: M is I + S + N row by row; a quarter turn about z takes x to y. The rest are the result's own numbers.
    Mutations seen to fail: N above the diagonal, C_gyro_i transposed, the time's sign, A left out,
    A not turned into the gyroscope's axes."""
    blocks = {
        "gyroscope_scale": (0.004, -0.005, 0.006),
        "gyroscope_axes": (0.001, 0.002, -0.003),
        "gyroscope_rotation": (0.0, 0.0, np.pi / 2),
        "accelerometer_scale": (-0.001, 0.002, 0.003),
        "accelerometer_axes": (0.0004, -0.0005, 0.0006),
        "g_sensitivity": tuple(1e-5 * k for k in range(1, 10)),
    }
    rows = tuple(row + column for row in "xyz" for column in "xyz")
    names = {"gyroscope_axes": ("yx", "zx", "zy"), "accelerometer_axes": ("yx", "zx", "zy"), "g_sensitivity": rows}
    found = [
        parameter(block, name, value)
        for block, values in blocks.items()
        for name, value in zip(names.get(block, ("x", "y", "z")), values, strict=True)
    ]
    imu = yaml.safe_load(export(imu_result(*found, time_offset_ns=-20_000_000), "kalibr-imu"))["imu0"]
    assert imu["accelerometers"]["M"] == [[0.999, 0.0, 0.0], [0.0004, 1.002, 0.0], [-0.0005, 0.0006, 1.003]]
    assert imu["gyroscopes"]["M"] == [[1.004, 0.0, 0.0], [0.001, 0.995, 0.0], [0.002, -0.003, 1.006]]
    # A C = F with C y = -x, C x = y: A's columns are those of F at -y, x and z.
    felt = 1e-5 * np.array([[-2, 1, 3], [-5, 4, 6], [-8, 7, 9]])
    np.testing.assert_allclose(imu["gyroscopes"]["A"], felt, atol=1e-12)
    np.testing.assert_allclose(imu["gyroscopes"]["C_gyro_i"], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)
    assert imu["T_i_b"] == np.eye(4).tolist()
    assert (imu["model"], imu["rostopic"]) == ("scale-misalignment", "/imu/data")
    assert (imu["update_rate"], imu["time_offset"]) == (400.0, -0.02)
    assert (imu["gyroscope_noise_density"], imu["gyroscope_random_walk"]) == (1.2e-4, 3e-5)
    assert (imu["accelerometer_noise_density"], imu["accelerometer_random_walk"]) == (1.18e-3, 4e-4)


def test_accelerometers_apart_as_kalibr_reads_them() -> None:
    """Row k of the block is where axis k's is. Mutations: by columns; the name of the model that has none."""
    names = [row + column for row in "xyz" for column in "xyz"]
    found = [parameter("size_effect", name, 1e-3 * k) for k, name in enumerate(names)]
    imu = yaml.safe_load(export(imu_result(parameter("gyroscope_scale", "x", 0.004), *found), "kalibr-imu"))["imu0"]
    assert imu["model"] == "scale-misalignment-size-effect"
    assert imu["accelerometers"]["rx_i"] == [0.0, 0.001, 0.002]
    assert imu["accelerometers"]["rz_i"] == [0.006, 0.007, 0.008]


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.005, 0.3, 3.0])
def test_the_gyroscopes_turn_agrees_with_scipy(angle: float) -> None:
    """Mutation: the half angle's square left out; a division by zero at no turn."""
    turn = angle * np.array([0.36, -0.48, 0.8])
    found = [parameter("gyroscope_rotation", name, value) for name, value in zip("xyz", turn, strict=True)]
    imu = yaml.safe_load(export(imu_result(*found), "kalibr-imu"))["imu0"]
    np.testing.assert_allclose(imu["gyroscopes"]["C_gyro_i"], Rotation.from_rotvec(turn).as_matrix(), atol=2e-12)


def test_what_kalibr_has_no_key_for_is_said() -> None:
    """Mutations: the delay, which way it is, the bent lines, the filters, the clock's rate, a block that was not estimated or
    parameters not applied passed over."""
    scale = parameter("gyroscope_scale", "x", 0.01, state="considered")
    bends = [parameter("accelerometer_quadratic", name, 1e-4 * k) for k, name in enumerate("xyz")]
    filters = [parameter("low_pass_skew", name, 1e-6 * k) for k, name in enumerate(("gyroscope", "accelerometer"))]
    result = imu_result(scale, parameter("accelerometer_delay", "delay", 0.0015), *bends, *filters)
    result.clock_rate_ppm, result.time_offset_at_s = 12.5, 30.0
    text = export(result, "kalibr-imu")
    assert "1.500 ms behind the gyroscope" in text
    early = export(imu_result(scale, parameter("accelerometer_delay", "delay", -0.00163)), "kalibr-imu")
    assert "1.630 ms ahead of the gyroscope" in early
    assert "squared accelerations [0.0, 0.0001, 0.0002] 1/(m/s²) are read too much" in text
    assert "low-pass filters have a skew of [0.0, 0.000001] s³" in text
    assert "have a spread" not in text
    assert "changes by 12.50 us a second; it holds 30.000 s after" in text
    assert (
        "ideal and not estimated: gyroscope_axes, gyroscope_rotation, accelerometer_scale, accelerometer_axes, g_sensitivity."
        in text
    )
    assert "not applied to it" in text


@pytest.mark.parametrize("name", SENSOR_NAMES)
@pytest.mark.parametrize("status", ["calibrated", "refused"])
def test_without_parameters_there_is_one_sentence(name: str, status: str) -> None:
    """Fails if an ideal sensor is exported for one that nobody looked at."""
    result = make_result(np.eye(3), np.zeros(3), status=status)
    with pytest.raises(
        InputError, match=rf"room\.bag \(status `{status}`\) holds none; .*--intrinsics auto`\.$"
    ) as refused:
        export(result, name)
    assert refused.value.code == ("export.no_imu" if name == "kalibr-imu" else "export.no_lasers")
    assert str(refused.value).count(". ") == 0


def test_hostile_names_stay_in_comments() -> None:
    """Names in a bag are foreign text. Mutation: the topic written as it is."""
    evil = 'x"\n    M: [[9]]\n- {laser_id: 0}'
    imu, lasers = imu_result(parameter("gyroscope_scale", "x", 0.01)), lasers_result()
    for result in (imu, lasers):
        recording = result.provenance.recording
        recording.name, recording.lidar_topic, recording.imu_topic = evil, evil, evil
    document = yaml.safe_load(export(imu, "kalibr-imu"))
    assert list(document) == ["imu0"]
    assert document["imu0"]["rostopic"] == re.sub(r"\n", "?", evil).replace("--", "- -")
    assert len(yaml.safe_load(export(lasers, "velodyne-calibration"))["lasers"]) == 16
