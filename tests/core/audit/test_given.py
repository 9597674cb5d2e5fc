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
    ],
)
def test_what_is_no_extrinsic_is_one_sentence(text: str, reason: str) -> None:
    """Mutation: the first joint of any name taken."""
    with pytest.raises(InputError, match=reason) as caught:
        parse_extrinsic(text)
    assert str(caught.value).startswith("Expected a result of unsweep, a URDF")
    assert "\n" not in str(caught.value)


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    """Mutation: the OSError let through."""
    (tmp_path / "b").write_bytes(b"\xff\xfe\x00")
    for name, reason in (("a", "No such file"), ("b", "not text")):
        with pytest.raises(InputError, match=reason):
            api.read_extrinsic(tmp_path / name)
