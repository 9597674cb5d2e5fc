"""Extrinsics of other programs, read back from our own exporters' texts and from numbers published by others."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core import api
from calib_core.audit.given import parse_extrinsic
from calib_core.errors import InputError
from tests.core.exporters.results import make_result

R = Rotation.from_euler("xyz", [12.0, -20.0, 130.0], degrees=True).as_matrix()
P = np.array([0.31, -0.12, 0.084])
OFFSET_NS = -20_000_001
T = np.eye(4)
T[:3, :3], T[:3, 3] = R, P


@pytest.mark.parametrize(
    ("name", "has_time"),
    [
        ("urdf", False),
        ("fast-lio", True),
        ("point-lio", False),
        ("fast-livo2", True),
        ("lio-sam", False),
        ("matrix", False),
        ("tum", False),
    ],
)
def test_what_we_export_we_understand(name: str, has_time: bool) -> None:
    """The exporters are tested against the consumers' conventions. Mutations: LIO-SAM not turned round; tau's sign kept;
    the rotation read by columns; URDF angles about moving axes."""
    given = parse_extrinsic(api.export(make_result(R, P, OFFSET_NS), name))
    np.testing.assert_allclose(given.T_imu_lidar, T, atol=1e-9)
    assert given.time_offset_ns == (OFFSET_NS if has_time else None)


def test_a_result_brings_its_time_and_covariance() -> None:
    """Mutation: the float offset taken where the exact one is there: 1.7e9 s between epochs lose their nanoseconds."""
    far_ns = 1_716_257_158_900_000_003
    result = make_result(R, P, far_ns)
    given = parse_extrinsic(result.to_json())
    assert given.time_offset_ns == far_ns
    assert result.uncertainty is not None
    np.testing.assert_array_equal(given.covariance, result.uncertainty.covariance)
    assert parse_extrinsic(json.dumps({"T_imu_lidar": T.tolist()})).covariance is None


def test_published_settings_mean_what_their_programs_do() -> None:
    """The Mid-360's manual puts the IMU at (11.0, 23.29, -44.12) mm in the cloud's frame; FAST-LIO ships
    extrinsic_T = [-0.011, -0.02329, 0.04412] for it. LIO-SAM's KITTI example is KITTI's own imu_to_velo. Mutation: swap."""
    mid360 = parse_extrinsic(
        "common:\n    time_offset_lidar_to_imu: 0.0\nmapping:\n    extrinsic_T: [ -0.011, -0.02329, 0.04412 ]\n"
        "    extrinsic_R: [ 1, 0, 0,\n                   0, 1, 0,\n                   0, 0, 1]\n"
    )
    np.testing.assert_allclose(np.linalg.inv(mid360.T_imu_lidar)[:3, 3], [0.011, 0.02329, -0.04412])
    assert mid360.time_offset_ns == 0
    kitti = parse_extrinsic(
        "%YAML:1.0\n/**:\n  ros__parameters:\n    lio_sam/extrinsicTrans: [-8.086759e-01, 3.195559e-01, -7.997231e-01]\n"
        "    lio_sam/extrinsicRot: [9.999976e-01, 7.553071e-04, -2.035826e-03, -7.854027e-04, 9.998898e-01, "
        "-1.482298e-02, 2.024406e-03, 1.482454e-02, 9.998881e-01]\n"
    )
    np.testing.assert_allclose(
        np.linalg.inv(kitti.T_imu_lidar)[:3, 3], [-8.086759e-01, 3.195559e-01, -7.997231e-01], atol=1e-6
    )


def test_a_urdf_is_walked_from_link_to_link() -> None:
    """Base -> imu and base -> mount -> lidar: one joint backwards, two forwards; the recording's frames choose among
    several lidars. Oracle: the product of the poses. Mutations: a joint's inverse left out; the first lidar taken."""

    def joint(name: str, parent: str, child: str, xyz: str, rpy: str) -> str:
        return (
            f'<joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/></joint>'
        )

    def pose(xyz: list[float], rpy: list[float]) -> np.ndarray:
        made = np.eye(4)
        made[:3, :3], made[:3, 3] = Rotation.from_euler("xyz", rpy).as_matrix(), xyz
        return made

    text = (
        '<?xml version="1.0"?><robot name="r">'
        + joint("a", "base", "imu_link", "0.1 0 0.2", "0.1 0 1.2")
        + joint("b", "base", "mount", "1 2 3", "0 0.5 0")
        + joint("c", "mount", "lidar_top", "0 0 0.1", "0 0 -1")
        + joint("d", "mount", "lidar_low", "0 0 -0.4", "0 0 0")
        + "</robot>"
    )
    expected = (
        np.linalg.inv(pose([0.1, 0, 0.2], [0.1, 0, 1.2])) @ pose([1, 2, 3], [0, 0.5, 0]) @ pose([0, 0, 0.1], [0, 0, -1])
    )
    given = parse_extrinsic(text, frames=("imu_link", "/lidar_top"))
    np.testing.assert_allclose(given.T_imu_lidar, expected, atol=1e-12)
    assert "lidar_top in imu_link" in given.form
    with pytest.raises(InputError, match=r"which link .* the lidar .*: lidar_low, lidar_top; correct it\.$"):
        parse_extrinsic(text, frames=("imu_link", "velodyne"))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("<robot></robot>", "no fixed joint"),
        ("<robot>", "cannot be read"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><robot/>', "entities"),
        ('<joint type="fixed"><parent link="imu"/><child link="lidar"/><origin xyz="${x} 0 0"/></joint>', "xacro"),
        ('<joint type="fixed"><parent link="imu_1"/><child link="imu_2"/></joint>', "which link"),
        ("mapping:\n  extrinsic_T: [1, 2]\n  extrinsic_R: [1,0,0,0,1,0,0,0,1]", "extrinsic_T is not a list of 3"),
        ("extrinsicTrans: [0,0,0]\nextrinsicRot: [1,0,0,0,1,0,0,0,-1]", "right-handed"),
        ("extrinsic_T: [0, 0, 0", "YAML cannot be read"),
        ("extrinsic_T: " + 2000 * "[", "nested too deep"),
        ("1 0 0 1e160\n0 1 0 0\n0 0 1 0\n0 0 0 1", r"beyond 1e\+06 m"),  # seen: a defect to report
        ('{"T_imu_lidar": {"translation_m": [0, -1.1e6, 0], "quaternion_xyzw": [0, 0, 0, 1]}}', r"beyond 1e\+06 m"),
    ],
)
def test_what_is_no_extrinsic_is_one_sentence(text: str, reason: str) -> None:
    """Mutations: the first joint of any name taken; a RecursionError let through (a 500 of a pasted text)."""
    with pytest.raises(InputError, match=reason) as caught:
        parse_extrinsic(text)
    assert str(caught.value).startswith("Expected a result of unsweep, a URDF")
    assert "\n" not in str(caught.value)


TURN = "1, 0, 0, 0, 1, 0, 0, 0, 1"


def livo(times: str, above: str = "") -> str:
    return f"{above}time_offset:\n  {times}\nextrin_calib:\n  extrinsic_T: [0.1, 0, 0]\n  extrinsic_R: [{TURN}]\n"


@pytest.mark.parametrize(
    ("text", "offset_ns"),
    [
        (livo("imu_time_offset: 0.02"), -20_000_000),
        (livo("imu_time_offset: 0.0\n  lidar_time_offset: 0.03"), -30_000_000),
        (livo("lidar_time_offset: -0.1"), 100_000_000),
        (livo("imu_time_offset: 0.02\n  lidar_time_offset: 0.03"), -50_000_000),
        (livo("imu_time_offset: 0.02\n  lidar_time_offset: 0.03", "preprocess:\n  lidar_type: 2\n"), -50_000_000),
        (livo("imu_time_offset: 0.02\n  lidar_time_offset: 0.03", "preprocess:\n  lidar_type: 1\n"), -20_000_000),
    ],
)
def test_fast_livo2_shifts_either_sensor_s_stamps(text: str, offset_ns: int) -> None:
    """t_imu - imu_time_offset = t_lidar + lidar_time_offset, the latter of PointCloud2 alone (its LIVMapper.cpp). Mutations:
    lidar_time_offset not read; its sign turned; counted for Livox's own messages too."""
    assert parse_extrinsic(text).time_offset_ns == offset_ns


def test_names_with_dots_are_ros_2_s() -> None:
    """As of `ros2 param dump` of one node, flattened. Mutation: names split at slashes alone."""
    given = parse_extrinsic(
        f"/**:\n  ros__parameters:\n    mapping.extrinsic_T: [0.1, 0.2, 0.3]\n    mapping.extrinsic_R: [{TURN}]\n"
        "    common.time_offset_lidar_to_imu: 0.5\n"
    )
    np.testing.assert_array_equal(given.T_imu_lidar[:3, 3], [0.1, 0.2, 0.3])
    assert given.time_offset_ns == -500_000_000


def urdf_of(*joints: tuple[str, str, str, str]) -> str:
    parts = [
        f'<joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/></joint>'
        for name, parent, child, xyz in joints
    ]
    return f"<robot>{''.join(parts)}</robot>"


FAST = f"mapping:\n  extrinsic_T: [0.1, 0, 0]\n  extrinsic_R: [{TURN}]\n"


@pytest.mark.parametrize(
    ("text", "names"),
    [
        (
            FAST + f"old:\n  extrinsic_T: [0.2, 0, 0]\n  extrinsic_R: [{TURN}]\n",
            "mapping.extrinsic_T and old.extrinsic_T",
        ),
        (FAST + "old:\n  extrinsic_R: [0, -1, 0, 1, 0, 0, 0, 0, 1]\n", "mapping.extrinsic_R and old.extrinsic_R"),
        (FAST + "mapping:\n  extrinsic_T: [0.2, 0, 0]\n", 'duplicate key "mapping".*, line 4'),
        (FAST + f"extrinsicTrans: [0.1, 0, 0]\nextrinsicRot: [{TURN}]\n", "extrinsic_T and LIO-SAM's extrinsicTrans"),
        (
            FAST + "time_offset_lidar_to_imu: 0.1\ntime:\n  imu_time_offset: 0.2",
            "time_offset_lidar_to_imu and time.imu_time_offset",
        ),
        (
            FAST + "lidar_time_offset: 0.1\ntime:\n  lidar_time_offset: 0.2",
            "lidar_time_offset and time.lidar_time_offset",
        ),
        (urdf_of(("a", "imu", "lidar", "1 0 0"), ("b", "imu", "lidar", "2 0 0")), "'a' and 'b' .* imu and lidar"),
        (urdf_of(("a", "imu", "lidar", "1 0 0"), ("b", "lidar", "imu", "1 0 0")), "'a' and 'b' .* lidar and imu"),
    ],
)
def test_what_a_file_says_twice_and_differently_is_refused(text: str, names: str) -> None:
    """Mutations: the last of several sections, of two families of keys, or of two joints taken; joints of the same links
    compared in one direction alone."""
    with pytest.raises(InputError, match=names) as caught:
        parse_extrinsic(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        FAST + "old:\n  " + FAST.replace("\n", "\n  "),
        FAST + f"extrinsicTrans: [-0.1, 0, 0]\nextrinsicRot: [{TURN}]\n",
        urdf_of(("a", "imu", "lidar", "0.1 0 0"), ("b", "imu", "lidar", "0.1 0 0"), ("c", "lidar", "imu", "-0.1 0 0")),
    ],
)
def test_what_a_file_says_twice_alike_is_no_contradiction(text: str) -> None:
    """Mutations: LIO-SAM's keys held against FAST-LIO's without being turned round; anything that stands twice refused."""
    np.testing.assert_allclose(parse_extrinsic(text).T_imu_lidar[:3, 3], [0.1, 0, 0], atol=1e-12)


def edited(**transform: object) -> str:
    document = json.loads(make_result(R, P, OFFSET_NS).to_json())
    document["T_imu_lidar"] |= transform
    return json.dumps(document)


QUAT = Rotation.from_matrix(R).as_quat()
TURNED = (Rotation.from_matrix(R) * Rotation.from_rotvec([5e-6, 0, 0])).as_quat().tolist()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (edited(translation_m=[0.31, -0.12, 0.084002]), "matrix and translation_m .* different translations"),
        (edited(quaternion_xyzw=TURNED), "matrix and quaternion_xyzw .* different rotations"),
        (edited(euler_xyz_deg=[12.0, -20.0, 130.001]), "matrix and euler_xyz_deg .* different rotations"),
        (edited(matrix=None, euler_xyz_deg=[12.0, -20.0, 131.0]), "quaternion_xyzw and euler_xyz_deg"),
        (edited(translation_m=[0.31, -0.12]), "translation_m .* list of 3"),
        (
            json.dumps({"T_imu_lidar": T.tolist(), "time_offset_s": 0.005, "time_offset_ns": 4_000_000}),
            "time_offset_s of 0.005 s and its time_offset_ns of 4000000 ns",
        ),
        (json.dumps({"T_imu_lidar": T.tolist(), "time_offset_ns": 4.5}), "no whole number"),
        (json.dumps({"T_imu_lidar": T.tolist(), "time_offset_s": 1e300}), "beyond 9e\\+09 s"),
        (json.dumps({"T_imu_lidar": T.tolist(), "time_offset_s": 10**400}), "no number"),
        (json.dumps({"T_imu_lidar": T.tolist(), "T_lidar_imu": T.tolist()}), "T_lidar_imu is its inverse"),
        (FAST + "imu_time_offset: 1.0e300", "imu_time_offset is no number of seconds"),
        ("1 0 0 1e400 0 1 0 0 0 0 1 0", "too large for any program"),
        (
            json.dumps({"T_imu_lidar": T.tolist(), "uncertainty": {"covariance": (-np.eye(7)).tolist()}}),
            "variances below 0",
        ),
    ],
)
def test_a_document_whose_forms_differ_is_refused(text: str, reason: str) -> None:
    """Whoever edits one of two forms means that one. Mutations: the matrix, the quaternion, or the nanoseconds taken before
    the others, as it was; the bound on times left out (an OverflowError); another mounting beside T_imu_lidar passed over;
    a place that is not finite taken (a defect after the solve); a covariance taken as it comes."""
    with pytest.raises(InputError, match=reason) as caught:
        parse_extrinsic(text)
    assert "\n" not in str(caught.value)


def test_rounded_forms_agree() -> None:
    """Six decimals of every form. Mutation: forms compared to 1e-7."""
    rounded = edited(translation_m=np.round(P, 6).tolist(), quaternion_xyzw=np.round(QUAT, 6).tolist())
    np.testing.assert_allclose(parse_extrinsic(rounded).T_imu_lidar, T, atol=1e-9)
    times = {"T_imu_lidar": T.tolist(), "time_offset_s": 0.004001, "time_offset_ns": 4_000_600}
    assert parse_extrinsic(json.dumps(times)).time_offset_ns == 4_000_600


@pytest.mark.parametrize("text", [edited(), FAST, urdf_of(("a", "imu", "lidar", "1 0 0")), "0 0 0 0 0 0 1"])
def test_a_mark_at_the_beginning_of_a_file_is_no_part_of_it(tmp_path: Path, text: str) -> None:
    """Windows editors write one. Mutation: read as it stands ('is no number')."""
    path = tmp_path / "extrinsic"
    path.write_text(text, encoding="utf-8-sig")
    assert api.read_extrinsic(path).form == parse_extrinsic(text).form


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    """Mutation: the OSError let through."""
    (tmp_path / "b").write_bytes(b"\xff\xfe\x00")
    for name, reason in (("a", "No such file"), ("b", "not text")):
        with pytest.raises(InputError, match=reason):
            api.read_extrinsic(tmp_path / name)


def test_a_refused_result_is_said_to_be_one() -> None:
    """Seen: "this JSON has no T_imu_lidar; correct it". Mutation: as any document without a mounting."""
    refused = make_result(np.eye(3), np.zeros(3), 0, status="refused").to_json()
    with pytest.raises(InputError, match="this result was refused and has none") as caught:
        parse_extrinsic(refused)
    assert caught.value.code == "extrinsic.refused"
