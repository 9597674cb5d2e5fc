"""Readers of the exported texts, written from the consumers' own conventions and not from the exporters.

Each returns (T_imu_lidar, time_offset_s): the direction and the time's sign undone the way the consumer's code applies
them (shared formats list). time_offset_s is None for consumers that take none.
"""

from __future__ import annotations

import json
import re
import shlex
import xml.etree.ElementTree as ET
from collections.abc import Callable
from decimal import Decimal

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Matrix = NDArray[np.float64]
Parsed = tuple[Matrix, Decimal | None]


def transform(R: Matrix, p: Matrix) -> Matrix:
    """(4, 4)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p
    return T


def inverse(T: Matrix) -> Matrix:
    return np.linalg.inv(T)


def from_quat(quat_xyzw: list[float], p: list[float]) -> Matrix:
    assert abs(np.linalg.norm(quat_xyzw) - 1) < 1e-9
    return transform(Rotation.from_quat(quat_xyzw).as_matrix(), np.array(p))


def from_fixed_axes(xyz: list[float], rpy_rad: list[float]) -> Matrix:
    return transform(Rotation.from_euler("xyz", rpy_rad).as_matrix(), np.array(xyz))


def body(text: str, mark: str = "#") -> list[str]:
    return [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith(mark)]


def load_yaml(text: str) -> dict[str, dict[str, object]]:
    """YAML with its floats as decimals, so that a time offset between epochs keeps its nanoseconds."""

    class Loader(yaml.SafeLoader):
        pass

    Loader.add_constructor("tag:yaml.org,2002:float", lambda loader, node: Decimal(loader.construct_scalar(node)))
    loaded = yaml.load(text, Loader)
    assert isinstance(loaded, dict)
    return loaded


def floats(values: object) -> list[float]:
    assert isinstance(values, list)
    return [float(v) for v in values]


def numbers(line: str) -> list[float]:
    return [float(word) for word in line.split()]


def matrix(text: str) -> Parsed:
    return np.array([numbers(line) for line in body(text)]), None


def tum(text: str) -> Parsed:
    (line,) = body(text)
    stamp, *values = numbers(line)
    assert stamp == 0.0
    return from_quat(values[3:], values[:3]), None


def tf2_ros1(text: str) -> Parsed:
    (line,) = body(text)
    words = shlex.split(line)
    assert words[:3] == ["rosrun", "tf2_ros", "static_transform_publisher"]
    assert words[-2:] == ["imu_link", "velodyne"], "the parent comes first"
    values = [float(word) for word in words[3:-2]]
    return from_quat(values[3:], values[:3]), None


def tf2_ros2(text: str) -> Parsed:
    (line,) = body(text)
    words = shlex.split(line)
    assert words[:4] == ["ros2", "run", "tf2_ros", "static_transform_publisher"]
    named = dict(zip((w.removeprefix("--") for w in words[4::2]), words[5::2], strict=True))
    assert named["frame-id"] == "imu_link"
    assert named["child-frame-id"] == "velodyne"
    return from_quat([float(named[k]) for k in ("qx", "qy", "qz", "qw")], [float(named[k]) for k in "xyz"]), None


def urdf(text: str) -> Parsed:
    joint = ET.fromstring(f"<robot>{text}</robot>").find("joint")
    assert joint is not None
    assert joint.get("type") == "fixed"
    origin, parent, child = joint.find("origin"), joint.find("parent"), joint.find("child")
    assert origin is not None and parent is not None and child is not None
    assert (parent.get("link"), child.get("link")) == ("imu_link", "velodyne")
    return from_fixed_axes(numbers(origin.get("xyz", "")), numbers(origin.get("rpy", ""))), None


def extrinsic_lists(block: dict[str, object]) -> Matrix:
    return transform(np.array(floats(block["extrinsic_R"])).reshape(3, 3), np.array(floats(block["extrinsic_T"])))


def fast_lio(text: str) -> Parsed:
    config = load_yaml(text)
    # imu_cbk subtracts the parameter from the IMU's stamp to get the lidar's clock: t_lidar = t_imu - parameter
    subtracted = config["common"]["time_offset_lidar_to_imu"]
    assert isinstance(subtracted, Decimal)
    return extrinsic_lists(config["mapping"]), -subtracted


def point_lio(text: str) -> Parsed:
    config = load_yaml(text)
    assert "common" not in config, "its time parameter has no effect and must not look as if it had"
    return extrinsic_lists(config["mapping"]), None


def fast_livo2(text: str) -> Parsed:
    config = load_yaml(text)
    subtracted = config["time_offset"]["imu_time_offset"]
    assert isinstance(subtracted, Decimal)
    assert "lidar_time_offset" not in config["time_offset"]
    return extrinsic_lists(config["extrin_calib"]), -subtracted


def lio_sam(text: str) -> Parsed:
    params = load_yaml(text)["lio_sam"]
    rotation = np.array(floats(params["extrinsicRot"])).reshape(3, 3)
    assert floats(params["extrinsicRPY"]) == floats(params["extrinsicRot"])
    # acc_lidar = extRot * acc_imu: the rotation takes the IMU's axes to the lidar's
    return inverse(transform(rotation, np.array(floats(params["extrinsicTrans"])))), None


def glim(text: str) -> Parsed:
    config = json.loads("\n".join(body(text, "//")), parse_float=Decimal)
    values = floats(config["sensors"]["T_lidar_imu"])
    # glim_ros adds its parameter to the IMU's stamp
    return inverse(from_quat(values[3:], values[:3])), config["glim_ros"]["imu_time_offset"]


def rko_lio(text: str) -> Parsed:
    config = load_yaml(text)
    imu = floats(config["extrinsic_imu2base_quat_xyzw_xyz"])
    lidar = floats(config["extrinsic_lidar2base_quat_xyzw_xyz"])
    return inverse(from_quat(imu[:4], imu[4:])) @ from_quat(lidar[:4], lidar[4:]), None


def li_init(text: str) -> Parsed:
    head, _, tail = text.partition("Homogeneous Transformation Matrix")
    rows = [numbers(line) for line in tail.splitlines()[1:] if line.strip()]
    named = dict(re.findall(r"^([^#=]+?)\s*= (.*)$", head, re.MULTILINE))
    euler = Rotation.from_euler("xyz", numbers(named["Rotation LiDAR to IMU (degree)"]), degrees=True).as_matrix()
    T = np.array(rows)
    np.testing.assert_allclose(euler, T[:3, :3], atol=1e-9)
    np.testing.assert_allclose(numbers(named["Translation LiDAR to IMU (meter)"]), T[:3, 3], atol=1e-11)
    return T, -Decimal(named["Time Lag IMU to LiDAR (second)"])


def kalibr_style(text: str) -> Parsed:
    block = load_yaml(text)["lidar0"]
    rows = block["T_lidar_imu"]
    assert isinstance(rows, list)
    shift = block["timeshift_lidar_imu"]
    assert isinstance(shift, Decimal)
    # Kalibr: t_imu = t_cam + shift
    return inverse(np.array([floats(row) for row in rows])), -shift


def autoware(text: str) -> Parsed:
    kit = load_yaml(text)["sensor_kit_base_link"]
    poses = {}
    for frame, entry in kit.items():
        assert isinstance(entry, dict)
        values = [float(entry[key]) for key in ("x", "y", "z", "roll", "pitch", "yaw")]
        poses[frame] = from_fixed_axes(values[:3], values[3:])
    return inverse(poses["imu_link"]) @ poses["velodyne"], None


PARSERS: dict[str, Callable[[str], Parsed]] = {
    "matrix": matrix,
    "tum": tum,
    "tf2-ros1": tf2_ros1,
    "tf2-ros2": tf2_ros2,
    "urdf": urdf,
    "fast-lio": fast_lio,
    "point-lio": point_lio,
    "fast-livo2": fast_livo2,
    "lio-sam": lio_sam,
    "glim": glim,
    "rko-lio": rko_lio,
    "li-init": li_init,
    "kalibr-style": kalibr_style,
    "autoware": autoware,
}
