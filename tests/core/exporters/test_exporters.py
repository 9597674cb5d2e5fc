"""Every export, read back by a parser of its own, is the same extrinsic; and public numbers come out as published."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from decimal import Decimal

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calib_core.errors import InputError
from calib_core.exporters import EXTRINSIC_NAMES as NAMES
from calib_core.exporters import SENSOR_NAMES, export
from calib_core.exporters.extrinsic import exact_seconds, quat_xyzw
from tests.core.exporters.parsers import PARSERS, body
from tests.core.exporters.results import make_result

CONTRACT_NAMES = (
    "matrix, tum, tf2-ros1, tf2-ros2, urdf, fast-lio, point-lio, fast-livo2, lio-sam, glim, rko-lio, li-init, "
    "kalibr-style, autoware"
).split(", ")
SENSORS = ["velodyne-calibration", "lasers-csv", "kalibr-imu"]

#: Consumers whose files take a time offset at all (formats list).
TIMED = {"fast-lio", "fast-livo2", "glim", "li-init", "kalibr-style"}

unit = st.floats(-1, 1, allow_nan=False)
quaternions = st.tuples(unit, unit, unit, unit).filter(lambda q: sum(c * c for c in q) > 1e-2)
places = st.tuples(*[st.floats(-30, 30, allow_nan=False)] * 3)
#: Milliseconds, and the distance between a clock that starts at power-on and one that counts from 1970.
offsets_ns = st.one_of(st.integers(-500_000_000, 500_000_000), st.integers(-(10**19) // 5, 10**19 // 5))


def test_names_are_the_contracts() -> None:
    """Fails if a name is misspelt, missing or added among the exporters."""
    assert list(NAMES) == CONTRACT_NAMES
    assert list(SENSOR_NAMES) == SENSORS
    assert set(PARSERS) == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=25, deadline=None)
@given(quat=quaternions, place=places, offset_ns=offsets_ns)
def test_reads_back_as_the_same_extrinsic(
    name: str, quat: tuple[float, ...], place: tuple[float, ...], offset_ns: int
) -> None:
    """Fails if an exporter writes the inverse, transposes the rotation, swaps the quaternion's order, takes the
    angles the other way round, flips the time's sign, or rounds it (seen: each of `R_imu_lidar` for `R_lidar_imu` in
    lio_sam and glim, `tau_ns` for `time_offset_ns` in glim, `-` dropped from tau, rpy reversed in urdf)."""
    R, p = Rotation.from_quat(quat).as_matrix(), np.array(place)
    T, offset_s = PARSERS[name](export(make_result(R, p, offset_ns), name))
    np.testing.assert_allclose(T[:3, :3], R, atol=2e-9)
    np.testing.assert_allclose(T[:3, 3], p, atol=2e-8)
    np.testing.assert_array_equal(T[3], [0, 0, 0, 1])
    assert (offset_s is not None) == (name in TIMED)
    if offset_s is not None:
        assert offset_s == Decimal(offset_ns).scaleb(-9)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "euler_deg", [(0, 0, 0), (180, 0, 0), (0, 180, 0), (0, 0, 180), (20, 90, 30), (-70, -90, 10), (2.9, -1.11, 179.9)]
)
def test_half_turns_and_straight_up_read_back(name: str, euler_deg: tuple[float, float, float]) -> None:
    """Fails if the quaternion is taken from the real part alone (0 in half turns) or the angles at a pitch of 90 deg
    are taken one by one (seen: branch `cosine < 1e-9` removed)."""
    R = Rotation.from_euler("ZYX", euler_deg[::-1], degrees=True).as_matrix()
    T, _ = PARSERS[name](export(make_result(R, np.array([0.1, -0.2, 0.3])), name))
    np.testing.assert_allclose(T[:3, :3], R, atol=2e-9)


@pytest.mark.parametrize("name", ["fast-lio", "point-lio", "fast-livo2"])
def test_mid360_is_as_fast_lio_ships_it(name: str) -> None:
    """The manual puts the IMU at (11.0, 23.29, -44.12) mm in the cloud's frame, axes aligned; FAST-LIO's mid360.yaml
    has extrinsic_T = [-0.011, -0.02329, 0.04412]. Fails if the direction is turned round."""
    imu_in_lidar_m = np.array([0.011, 0.02329, -0.04412])
    text = export(make_result(np.eye(3), -imu_in_lidar_m), name)
    assert "    extrinsic_T: [-0.011, -0.02329, 0.04412]\n" in text
    rows = "1.0, 0.0, 0.0,0.0, 1.0, 0.0,0.0, 0.0, 1.0"
    assert f"extrinsic_R:[{rows}]".replace(" ", "") in text.replace(" ", "").replace("\n", "")


def test_kitti_is_as_lio_sam_ships_it() -> None:
    """KITTI's calib_imu_to_velo takes IMU coordinates to the lidar's and is LIO-SAM's own example. Fails if lio_sam
    writes T_imu_lidar, or the transpose of the rotation."""
    published = [9.999976e-01, 7.553071e-04, -2.035826e-03, -7.854027e-04, 9.998898e-01, -1.482298e-02]
    published += [2.024406e-03, 1.482454e-02, 9.998881e-01]
    R_lidar_imu, p_lidar_imu = np.array(published).reshape(3, 3), np.array([-8.086759e-01, 3.195559e-01, -7.997231e-01])
    text = export(make_result(R_lidar_imu.T, -R_lidar_imu.T @ p_lidar_imu), "lio-sam")
    values = {
        key: [float(v) for v in numbers.replace("\n", " ").split(",")]
        for key, numbers in re.findall(r"(extrinsic\w+): \[([^\]]*)\]", text)
    }
    # the published digits are no exact rotation: its inverse by transposition is off by 1e-6
    np.testing.assert_allclose(values["extrinsicTrans"], p_lidar_imu, atol=3e-6)
    np.testing.assert_allclose(values["extrinsicRot"], published, atol=1e-12)
    np.testing.assert_allclose(values["extrinsicRPY"], published, atol=1e-12)


def test_li_init_has_the_biases_and_gravity_of_the_result() -> None:
    """By its labels, which are LI-Init's. Mutations: zeros for biases; the one sensor's for the other's; gravity upwards; the
    usual gravity for the result's.
    """
    result = make_result(np.eye(3), np.zeros(3))
    result.gravity_m_s2 = 9.81234
    told = dict(line.split("=") for line in body(export(result, "li-init")) if "=" in line)
    numbers = {label.split("(")[0].strip(): [float(v) for v in values.split()] for label, values in told.items()}
    assert numbers["Bias of Gyroscope"] == [0.001, -0.002, 0.003]
    assert numbers["Bias of Accelerometer"] == [0.01, 0.02, -0.03]
    assert numbers["Gravity in World Frame"] == [0.0, 0.0, -9.81234]


@pytest.mark.parametrize("name", NAMES)
def test_sentence_and_self_check_hold(name: str) -> None:
    """The two sentences, computed again with another library. Fails if they are missing, or say the inverse."""
    rotation = Rotation.from_rotvec([0.3, -1.2, 2.0])
    p = np.array([0.1, -0.25, 0.031])
    text = export(make_result(rotation.as_matrix(), p, -20_000_000), name)
    found = [
        [float(v) for v in place.split(",")]
        for line in text.splitlines()
        if "lidar's origin" in line or "Self-check" in line
        for place in re.findall(r"\[([^\]]*)\]", line)
    ]
    np.testing.assert_allclose(found[0], p, atol=1e-6)
    np.testing.assert_allclose(found[2], rotation.apply(found[1]) + p, atol=1e-6)
    assert "t_lidar = t_imu + (-0.02 s)" in text
    if name not in TIMED - {"li-init"} and name not in {"matrix", "tum", "li-init"}:
        assert "add -0.02 s to every IMU stamp" in text


@pytest.mark.parametrize("name", NAMES)
def test_a_time_offset_that_changes_says_so(name: str) -> None:
    """A program is given one number: by 39 us a second it is 2 ms off within a minute. Mutations: the sentence in the IMU's own
    file alone, as it was; said of clocks that were taken to run alike."""
    result = make_result(np.eye(3), np.zeros(3), 12_000_000)
    assert "us a second" not in export(result, name)
    result.clock_rate_ppm, result.time_offset_at_s = -39.438, 9.9506
    assert "The offset changes by -39.44 us a second; it holds 9.951 s after the recording began." in export(
        result, name
    )


@pytest.mark.parametrize("name", NAMES)
def test_refused_result_is_one_sentence(name: str) -> None:
    """Fails if a refused result is exported as identity or ends in a traceback."""
    with pytest.raises(InputError, match=r"room\.bag has the status `refused`"):
        export(make_result(np.eye(3), np.zeros(3), status="refused"), name)


def test_unknown_name_lists_the_known() -> None:
    """Fails if the sentence does not help to find the right name."""
    with pytest.raises(InputError, match=r"`fastlio`; choose one of matrix, .*autoware"):
        export(make_result(np.eye(3), np.zeros(3)), "fastlio")


@pytest.mark.parametrize("name", NAMES)
def test_weak_result_says_what_is_weak(name: str) -> None:
    """Fails if a weak direction is exported without a word."""
    assert "Weak: tz is known to 40 mm." in export(make_result(np.eye(3), np.zeros(3), status="weak"), name)


@pytest.mark.parametrize("name", NAMES)
def test_hostile_names_stay_in_comments(name: str) -> None:
    """A recording's name and frame ids are foreign text. Fails if `printable` or `_frame_name` lets a line break, the
    end of a comment or a shell's separator through."""
    evil = "x\n--> */ rm -rf /; $(date) <joint/>"
    text = export(make_result(np.eye(3), np.zeros(3), name=evil, lidar_frame_id=evil, imu_frame_id="/imu;ls"), name)
    lines = body(text, "//" if name == "glim" else "#")
    if name == "urdf":
        joints = ET.fromstring(f"<robot>{text}</robot>")
        assert [child.tag for child in joints] == ["joint"]
    else:
        assert not any(sign in line for line in lines for sign in (";", "$", "<", ">", "*"))


@pytest.mark.parametrize("name", ["tf2-ros1", "tf2-ros2", "urdf", "autoware"])
def test_one_frame_id_for_both_sensors_becomes_two(name: str) -> None:
    """RoboSense's Airy names one frame for both. Fails if a transform from a frame to itself is written."""
    text = export(make_result(np.eye(3), np.ones(3), lidar_frame_id="/rslidar", imu_frame_id="rslidar"), name)
    assert "rslidar_imu" in text
    assert "Both sensors name their frame rslidar" in text


@pytest.mark.parametrize(
    "frame", ["1", "on", "Null", "0x10", "1e3", "~", "os1/imu", "imu.link-2", "_imu", "2024-01-01"]
)
def test_autowares_entries_are_named_by_text(frame: str) -> None:
    """As PyYAML reads them, which is what Autoware's launch files use. Mutation: names as they come."""
    text = export(make_result(np.eye(3), np.ones(3), imu_frame_id=frame), "autoware")
    assert set(yaml.safe_load(text)["sensor_kit_base_link"]) == {"velodyne", frame.replace("~", "_")}


@given(st.integers(-(2**62), 2**62))
def test_exact_seconds_lose_nothing(nanoseconds: int) -> None:
    """Fails if the text goes through a float, or drops the sign of values between -1 s and 0."""
    assert Decimal(exact_seconds(nanoseconds)) == Decimal(nanoseconds).scaleb(-9)
    assert re.fullmatch(r"-?\d+\.\d+", exact_seconds(nanoseconds))


@given(quaternions)
def test_quaternion_agrees_with_scipy(quat: tuple[float, ...]) -> None:
    """Fails for a wrong sign or place in the table of products."""
    rotation = Rotation.from_quat(quat)
    made = quat_xyzw(rotation.as_matrix())
    assert made[3] >= 0
    assert (Rotation.from_quat(made) * rotation.inv()).magnitude() < 1e-9


def _changed(**place):
    """A result document with one number of it spoilt, as an editor or a crash may leave it."""
    result = make_result(np.eye(3), np.array([0.1, 0.2, 0.3]))
    for name, value in place.items():
        if name.startswith("m"):
            row, column = int(name[1]), int(name[2])
            result.T_imu_lidar.matrix[row][column] = value
        else:
            setattr(result, name, value)
    return result


@pytest.mark.parametrize("format_name", NAMES)
@pytest.mark.parametrize(
    "place",
    [
        {"m00": float("nan")},
        {"m13": float("inf")},
        {"m00": 2.0},
        {"m01": 0.01},
        {"m22": -1.0},
        {"m30": 1.0},
        {"m33": 0.0},
        {"gyroscope_bias_rad_s": [0.0, float("nan"), 0.0]},
        {"accelerometer_bias_m_s2": [0.0, 1.0]},
        {"gravity_m_s2": float("nan")},
    ],
    ids=lambda place: next(iter(place)),
)
def test_what_is_no_pose_is_not_exported(format_name, place):
    """NaN in a URDF is read as zero by some programs. Oracle: the refusal. Mutations: exported as it is; a mirror taken
    for a rotation; a scale of 2; only the matrix looked at."""
    with pytest.raises(InputError) as refused:
        export(_changed(**place), format_name)
    assert refused.value.code == "export.no_pose"
    assert str(refused.value).startswith("Expected ")


def test_a_matrix_of_the_wrong_shape_is_not_exported():
    """Mutation: NumPy's own complaint let through."""
    result = make_result(np.eye(3), np.zeros(3))
    for matrix in ([], [[1.0]], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]], [[1.0] * 4] * 3):
        result.T_imu_lidar.matrix = matrix
        with pytest.raises(InputError, match="4 rows of 4"):
            export(result, "urdf")


@given(st.integers(0, 2**32 - 1))
def test_every_rotation_written_with_six_decimals_is_exported(seed):
    """People shorten files. Mutation: a tolerance of 1e-9 refuses them."""
    R = np.round(Rotation.random(random_state=seed).as_matrix(), 6)
    result = make_result(np.eye(3), np.zeros(3))
    for row in range(3):
        result.T_imu_lidar.matrix[row][:3] = R[row].tolist()
    assert export(result, "matrix")
