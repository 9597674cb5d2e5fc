"""An extrinsic as people have it at hand: our own JSON, a matrix, or a position and a quaternion.

    {"T_imu_lidar": {...}, "time_offset_s": ...}     a result, an initial guess, or only one of the transform's forms
    16 or 12 numbers                                 a matrix by rows, its last row 0 0 0 1 or left out
    7 numbers                                        x y z, then the quaternion x y z w
    8 numbers                                        a line of a TUM file: its time, then the same

Brackets, commas, line ends and comments behind # do not matter. Numbers alone do not say in which direction they lead;
that is asked for. A result does.
"""

from __future__ import annotations

import json
import math
import re
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from app.errors import BadRequest
from app.schemas.view import OldExtrinsic
from calib_core.types import FloatArray

Direction = Literal["imu_lidar", "lidar_imu"]

#: A rotation typed to three digits is still meant as a rotation; more than this is a mistake.
TOLERANCE = 1e-2
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_BETWEEN = re.compile(r"[\s,;\[\](){}]*")
FORMS = "a result of unsweep, a matrix of 4 rows of 4 numbers, or x y z and a quaternion x y z w"


def parse_extrinsic(text: str, direction: Direction) -> OldExtrinsic:
    """The extrinsic as T_imu_lidar. direction: of bare numbers, imu_lidar takes lidar coordinates to the IMU's."""
    document = _json_of(text)
    if isinstance(document, dict):
        return _from_document(document)
    numbers = _flat(document) if isinstance(document, list) else _numbers_of(text)
    matrix = _matrix_of(numbers)
    return _extrinsic(matrix if direction == "imu_lidar" else _inverse(matrix), None)


def _json_of(text: str) -> object:
    try:
        return json.loads(text)
    except ValueError:
        return None


def _from_document(document: dict[str, object]) -> OldExtrinsic:
    transform, offset_s = document.get("T_imu_lidar"), document.get("time_offset_s")
    if offset_s is not None and not _finite(offset_s):
        raise _unfit("its time_offset_s is no number")
    given = None if offset_s is None else float(offset_s)  # type: ignore[arg-type]
    if isinstance(transform, list):
        return _extrinsic(_matrix_of(_flat(transform)), given)
    if not isinstance(transform, dict):
        raise _unfit("this JSON has no T_imu_lidar")
    if isinstance(transform.get("matrix"), list):
        return _extrinsic(_matrix_of(_flat(transform["matrix"])), given)
    position, quaternion = transform.get("translation_m"), transform.get("quaternion_xyzw")
    euler_deg = transform.get("euler_xyz_deg")
    if isinstance(position, list) and isinstance(quaternion, list):
        return _extrinsic(_matrix_of([*_flat(position), *_flat(quaternion)]), given)
    if isinstance(position, list) and isinstance(euler_deg, list) and len(_flat(euler_deg)) == 3:
        turned = Rotation.from_euler("xyz", _flat(euler_deg), degrees=True).as_quat()
        return _extrinsic(_matrix_of([*_flat(position), *(float(part) for part in turned)]), given)
    raise _unfit("its T_imu_lidar has neither a matrix nor a translation_m with a rotation")


def _flat(rows: list[object]) -> list[float]:
    numbers: list[float] = []
    for row in rows:
        if isinstance(row, list):
            numbers += _flat(row)
        elif _finite(row):
            numbers.append(float(row))  # type: ignore[arg-type]
        else:
            raise _unfit(f"{str(row)[:20]!r} is no number")
    return numbers


def _finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _numbers_of(text: str) -> list[float]:
    """All numbers of the text; anything that is neither number nor bracket nor comma is refused."""
    numbers: list[float] = []
    for line in text.splitlines():
        said = line.partition("#")[0]
        at = 0
        while (at := _skipped(said, at)) < len(said):
            found = _NUMBER.match(said, at)
            if found is None:
                raise _unfit(f"{said[at : at + 20].strip()!r} is no number")
            numbers.append(float(found.group()))
            at = found.end()
    return numbers


def _skipped(text: str, at: int) -> int:
    found = _BETWEEN.match(text, at)
    return at if found is None else found.end()


def _matrix_of(numbers: list[float]) -> FloatArray:
    """The (4, 4) matrix that so many numbers mean."""
    values = np.array(numbers, dtype=np.float64)
    matrix = np.eye(4)
    match len(numbers):
        case 16 | 12:
            if len(numbers) == 16 and not np.allclose(values[12:], [0, 0, 0, 1], atol=1e-9):
                raise _unfit("the matrix's last row is not 0 0 0 1")
            matrix[:3] = values[:12].reshape(3, 4)
            matrix[:3, :3] = _nearest_rotation(matrix[:3, :3])
        case 7 | 8:
            position, quat_xyzw = values[-7:-4], values[-4:]
            length = float(np.linalg.norm(quat_xyzw))
            if not abs(length - 1.0) < TOLERANCE:
                raise _unfit(f"the last four numbers are no unit quaternion, their length is {length:.4g}")
            matrix[:3, :3] = Rotation.from_quat(quat_xyzw).as_matrix()
            matrix[:3, 3] = position
        case found:
            raise _unfit(f"there are {found} numbers")
    return matrix


def _nearest_rotation(matrix: FloatArray) -> FloatArray:
    left, _, right = np.linalg.svd(matrix)
    rotation: FloatArray = left @ right
    if np.linalg.det(rotation) < 0 or np.abs(rotation - matrix).max() > TOLERANCE:
        raise _unfit("the matrix's columns are not orthonormal and right-handed")
    return rotation


def _inverse(matrix: FloatArray) -> FloatArray:
    inverse = np.eye(4)
    inverse[:3, :3] = matrix[:3, :3].T
    inverse[:3, 3] = -matrix[:3, :3].T @ matrix[:3, 3]
    return inverse


def _extrinsic(matrix: FloatArray, time_offset_s: float | None) -> OldExtrinsic:
    x, y, z = (float(part) for part in matrix[:3, 3])
    qx, qy, qz, qw = (float(part) for part in Rotation.from_matrix(matrix[:3, :3]).as_quat(canonical=True))
    return OldExtrinsic(translation_m=(x, y, z), quaternion_xyzw=(qx, qy, qz, qw), time_offset_s=time_offset_s)


def _unfit(reason: str) -> BadRequest:
    return BadRequest("extrinsic.unfit", f"Expected {FORMS}, but {reason}; correct it.")
