"""The lidar's pose in the IMU's frame from a URDF: the chain of fixed joints between their links.

A joint's origin is the child's pose in the parent; rpy turns about fixed axes, R = Rz(yaw) Ry(pitch) Rx(roll), radians.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import numpy as np

from calib_core.audit.pose import GivenExtrinsic, inverse, transform_of, unfit
from calib_core.contradictions import poses_apart
from calib_core.types import FloatArray

_IMU_WORDS = ("imu",)
_LIDAR_WORDS = (
    "lidar",
    "velodyne",
    "laser",
    "ouster",
    "os_sensor",
    "livox",
    "hesai",
    "pandar",
    "rslidar",
    "sick",
    "scan",
)


def from_urdf(text: str, frames: tuple[str, str]) -> GivenExtrinsic:
    """T_imu_lidar.   frames: the IMU's and the lidar's, as in the recording; where they are no links, names that say so."""
    steps = _steps(text)
    links = sorted({link for pair in steps for link in pair})
    imu = _link(links, frames[0], _IMU_WORDS, "the IMU")
    lidar = _link([link for link in links if link != imu], frames[1], _LIDAR_WORDS, "the lidar")
    poses: dict[str, FloatArray] = {imu: np.eye(4)}
    waiting = [imu]
    while waiting:
        at = waiting.pop()
        for (parent, child), T_parent_child in steps.items():
            if parent == at and child not in poses:
                poses[child] = poses[at] @ T_parent_child
                waiting.append(child)
            elif child == at and parent not in poses:
                poses[parent] = poses[at] @ inverse(T_parent_child)
                waiting.append(parent)
    if lidar not in poses:
        raise unfit(f"no chain of fixed joints leads from {imu} to {lidar} in this URDF")
    return GivenExtrinsic(poses[lidar], None, f"URDF, {lidar} in {imu}")


def check_urdf(text: str) -> None:
    """Raises InputError where a text is no URDF with fixed joints, whichever links are the sensors'."""
    _steps(text)


def _steps(text: str) -> dict[tuple[str, str], FloatArray]:
    """T_parent_child of every fixed joint."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise unfit("this URDF declares entities of its own")
    bare = re.sub(r"<\?xml.*?\?>", "", text)
    try:
        root = ET.fromstring(f"<all>{bare}</all>")  # noqa: S314  without a document type nothing can be expanded
    except ET.ParseError as error:
        raise unfit(f"this XML cannot be read ({error})") from error
    steps: dict[tuple[str, str], FloatArray] = {}
    names: dict[tuple[str, str], str] = {}
    for joint in root.iter("joint"):
        parent, child, origin = joint.find("parent"), joint.find("child"), joint.find("origin")
        if joint.get("type") == "fixed" and parent is not None and child is not None:
            pair = (parent.get("link", ""), child.get("link", ""))
            pose, name = np.eye(4) if origin is None else _pose(origin), joint.get("name", "")
            before = inverse(steps[pair[::-1]]) if pair[::-1] in steps else steps.get(pair, pose)
            if poses_apart(before, pose):
                other = names.get(pair, names.get(pair[::-1], ""))
                raise unfit(
                    f"the fixed joints '{other}' and '{name}' of this URDF both join {pair[0]} and {pair[1]}, by different "
                    "origins, of which one has to be left out"
                )
            steps[pair], names[pair] = pose, name
    if not steps:
        raise unfit("this XML has no fixed joint")
    return steps


def _pose(origin: ET.Element) -> FloatArray:
    from scipy.spatial.transform import Rotation

    place, angles = (_three(origin.get(name, "0 0 0"), name) for name in ("xyz", "rpy"))
    return transform_of(np.asarray(Rotation.from_euler("xyz", angles).as_matrix()), place)


def _three(text: str, name: str) -> FloatArray:
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.zeros(0)
    if values.size != 3 or not np.isfinite(values).all():
        raise unfit(f"{name} of a joint's origin is not three numbers but '{text}' (xacro has to be expanded first)")
    return values


def _link(links: list[str], frame: str, words: tuple[str, ...], what: str) -> str:
    if frame.lstrip("/") in links:
        return frame.lstrip("/")
    fitting = [link for link in links if any(word in link.lower() for word in words)]
    if len(fitting) != 1:
        named = ", ".join(fitting or links)
        raise unfit(
            f"it is not clear which link of this URDF is {what} (its frame in the recording is '{frame}'): {named}"
        )
    return fitting[0]
