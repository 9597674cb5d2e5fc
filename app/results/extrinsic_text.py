"""An extrinsic as people paste or upload it, as the view takes it; what is understood, the library's audit says."""

from __future__ import annotations

from app.errors import BadRequest
from app.schemas.view import OldExtrinsic
from calib_core import api
from calib_core.audit.given import Direction
from calib_core.errors import InputError


def parse_extrinsic(text: str, direction: Direction, frames: tuple[str, str] = ("", "")) -> OldExtrinsic:
    """The extrinsic as T_imu_lidar. direction: of bare numbers, imu_lidar takes lidar coordinates to the IMU's.

    frames: the IMU's and the lidar's in the recording that it is meant for, to find them among a URDF's links.
    """
    from scipy.spatial.transform import Rotation

    try:
        given = api.parse_extrinsic(text, direction=direction, frames=frames)
    except InputError as error:
        raise BadRequest(error.code, str(error)) from error
    matrix = given.T_imu_lidar
    x, y, z = (float(part) for part in matrix[:3, 3])
    qx, qy, qz, qw = (float(part) for part in Rotation.from_matrix(matrix[:3, :3]).as_quat(canonical=True))
    offset_s = None if given.time_offset_ns is None else given.time_offset_ns * 1e-9
    return OldExtrinsic(translation_m=(x, y, z), quaternion_xyzw=(qx, qy, qz, qw), time_offset_s=offset_s)
