"""An extrinsic as people have it at hand, made T_imu_lidar whatever its file's own direction is.

    a result, an initial guess, {"T_imu_lidar": ...}    our own JSON; the time offset in its own sign
    URDF                                                fixed joints from the IMU's link to the lidar's
    FAST-LIO, Point-LIO, FAST-LIVO2                     extrinsic_T, extrinsic_R: T_imu_lidar; tau subtracted from IMU stamps,
                                                        and in FAST-LIVO2 also added to the lidar's
    LIO-SAM                                             extrinsicTrans, extrinsicRot: T_lidar_imu
    16 or 12 numbers                                    a matrix by rows, its last row 0 0 0 1 or left out
    7 or 8 numbers                                      [time] x y z, then the quaternion x y z w

Brackets, commas, line ends and comments behind # do not matter between bare numbers. These alone do not say in which
direction they lead; that is asked for.
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Literal

import numpy as np

from calib_core.audit.pose import FORMS, GivenExtrinsic, Instant, inverse, transform_of, unfit
from calib_core.contradictions import (
    LEAVE_ONE_OUT,
    forms_contradict,
    is_result,
    key_twice,
    strange_transform,
    times_contradict,
)
from calib_core.errors import InputError
from calib_core.geometry import ROTATION_TOLERANCE
from calib_core.settings import FARTHEST_S
from calib_core.types import FloatArray

Direction = Literal["imu_lidar", "lidar_imu"]

_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_BETWEEN = re.compile(r"[\s,;\[\](){}]*")


def read_extrinsic(
    path: Path, *, direction: Direction = "imu_lidar", frames: tuple[str, str] = ("", "")
) -> GivenExtrinsic:
    """The extrinsic in a file.   direction: of bare numbers.   frames: the IMU's and the lidar's, to find them in a URDF."""
    return parse_extrinsic(extrinsic_text(path), direction=direction, frames=frames)


def extrinsic_text(path: Path) -> str:
    """What is in the file, read once: it may be a pipe. Raises InputError with one sentence where it cannot be."""
    try:
        return path.read_text(encoding="utf-8-sig")  # some editors begin a file with a mark
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "it is not text"
        raise InputError(
            f"Expected {FORMS} in {path}, but it cannot be read ({reason}); check the name.",
            code="extrinsic.unreadable",
        ) from error


def asks_for_frames(text: str) -> bool:
    """Whether it takes the recording's frames to find the extrinsic in a text: a URDF's many links, whatever its file's name."""
    return text.removeprefix("\ufeff").lstrip().startswith("<")


def parse_extrinsic(
    text: str, *, direction: Direction = "imu_lidar", frames: tuple[str, str] = ("", "")
) -> GivenExtrinsic:
    """The extrinsic in a text. Raises InputError with one sentence where it is none."""
    text = text.removeprefix("\ufeff")  # the mark with which some editors begin a file
    document = _json_of(text)
    if document is not None and (twice := key_twice(text)) is not None:
        raise unfit(twice)
    if isinstance(document, dict):
        return _from_document(document)
    if asks_for_frames(text):
        from calib_core.audit.urdf import from_urdf

        return from_urdf(text, frames)
    if re.search(r"extrinsic(?:_T|Trans)\b", text):
        from calib_core.audit.odometry_yaml import from_yaml

        return from_yaml(text)
    matrix = _matrix_of(_flat(document) if isinstance(document, list) else _numbers_of(text))
    return GivenExtrinsic(matrix if direction == "imu_lidar" else inverse(matrix), None, f"numbers, T_{direction}")


def _json_of(text: str) -> object:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def _from_document(document: dict[str, object]) -> GivenExtrinsic:
    wrong = None if is_result(document) else strange_transform(document)
    if wrong is not None:
        raise unfit(wrong)
    if is_result(document) and document["T_imu_lidar"] is None:
        raise InputError(
            "Expected an extrinsic, but this result was refused and has none; give one of another run.",
            code="extrinsic.refused",
        )
    matrix = _transform_of_document(document.get("T_imu_lidar"))
    form = "JSON of unsweep, T_imu_lidar"
    return GivenExtrinsic(matrix, _offset_ns_of(document), form, _covariance_of(document), _instant_of(document))


def _offset_ns_of(document: dict[str, object]) -> int | None:
    """The time offset; whole nanoseconds are exact across clock epochs where seconds are not."""
    offset_s, offset_ns = document.get("time_offset_s"), document.get("time_offset_ns")
    seconds = None if offset_s is None else _number(offset_s)
    if offset_s is not None and seconds is None:
        raise unfit("its time_offset_s is no number")
    if offset_ns is not None and (isinstance(offset_ns, bool) or not isinstance(offset_ns, int)):
        raise unfit("its time_offset_ns is no whole number")
    if abs(seconds or 0.0) > FARTHEST_S or abs(offset_ns or 0) > FARTHEST_S * 1e9:
        raise unfit(f"its time offset is beyond {FARTHEST_S:.0e} s")
    wrong = times_contradict(seconds, offset_ns)
    if wrong is not None:
        raise unfit(f"{wrong}{LEAVE_ONE_OUT}")
    return round(seconds * 1e9) if offset_ns is None and seconds is not None else offset_ns


def _instant_of(document: dict[str, object]) -> Instant | None:
    """When the time offset holds, of a result that tells it."""
    provenance = document.get("provenance")
    recording = provenance.get("recording") if isinstance(provenance, dict) else None
    sha256 = recording.get("sha256") if isinstance(recording, dict) else None
    at_s = _number(document.get("time_offset_at_s"))
    rate_ppm, rate_std_ppm = _number(document.get("clock_rate_ppm")), _number(document.get("clock_rate_ppm_std"))
    return None if not isinstance(sha256, str) or at_s is None else Instant(sha256, at_s, rate_ppm, rate_std_ppm)


def _transform_of_document(transform: object) -> FloatArray:
    if isinstance(transform, list):
        return _matrix_of(_flat(transform))
    if not isinstance(transform, dict):
        raise unfit("this JSON has no T_imu_lidar")
    turns, places = _forms_of(transform)
    wrong = forms_contradict(turns, places)
    if wrong is not None:
        raise unfit(f"{wrong}{LEAVE_ONE_OUT}")
    if not turns or not places:
        raise unfit("its T_imu_lidar has neither a matrix nor a translation_m with a rotation")
    return transform_of(next(iter(turns.values())), next(iter(places.values())))


def _forms_of(transform: dict[str, object]) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """The rotation (3, 3) and the translation (3,) in each form that is there, the most exact first."""
    from scipy.spatial.transform import Rotation

    turns: dict[str, FloatArray] = {}
    places: dict[str, FloatArray] = {}
    if matrix := _listed(transform, "matrix"):
        whole = _matrix_of(matrix)
        turns["matrix"], places["matrix"] = whole[:3, :3], whole[:3, 3]
    if quat_xyzw := _listed(transform, "quaternion_xyzw", 4):
        turns["quaternion_xyzw"] = _matrix_of([0.0, 0.0, 0.0, *quat_xyzw])[:3, :3]
    if euler_deg := _listed(transform, "euler_xyz_deg", 3):
        turns["euler_xyz_deg"] = np.asarray(Rotation.from_euler("xyz", euler_deg, degrees=True).as_matrix())
    if position := _listed(transform, "translation_m", 3):
        places["translation_m"] = np.array(position, dtype=np.float64)
    return turns, places


def _listed(transform: dict[str, object], key: str, count: int | None = None) -> list[float]:
    """The numbers under a key, none where it is not there.   count: how many there have to be."""
    listed = transform.get(key)
    numbers = _flat(listed) if isinstance(listed, list) else []
    if numbers and count is not None and len(numbers) != count:
        raise unfit(f"{key} of its T_imu_lidar is not a list of {count} numbers")
    return numbers


def _covariance_of(document: dict[str, object]) -> FloatArray | None:
    uncertainty = document.get("uncertainty")
    rows = uncertainty.get("covariance") if isinstance(uncertainty, dict) else None
    if not isinstance(rows, list) or len(_flat(rows)) != 49:
        return None
    covariance = np.array(_flat(rows), dtype=np.float64).reshape(7, 7)
    if (np.diag(covariance) < 0.0).any():
        raise unfit("its covariance has variances below 0")
    return covariance


def _flat(rows: list[object]) -> list[float]:
    numbers: list[float] = []
    for row in rows:
        if isinstance(row, list):
            numbers += _flat(row)
            continue
        number = _number(row)
        if number is None:
            raise unfit(f"{str(row)[:20]!r} is no number")
        numbers.append(number)
    return numbers


def _number(value: object) -> float | None:
    """A finite number, or None."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value) if math.isfinite(value) else None
    except OverflowError:  # JSON's whole numbers have no end
        return None


def _numbers_of(text: str) -> list[float]:
    """All numbers of the text; anything that is neither number nor bracket nor comma is refused."""
    numbers: list[float] = []
    for line in text.splitlines():
        said = line.partition("#")[0]
        at = 0
        while (at := _skipped(said, at)) < len(said):
            found = _NUMBER.match(said, at)
            if found is None:
                raise unfit(f"{said[at : at + 20].strip()!r} is no number")
            numbers.append(float(found.group()))
            at = found.end()
    return numbers


def _skipped(text: str, at: int) -> int:
    found = _BETWEEN.match(text, at)
    return at if found is None else found.end()


def _matrix_of(numbers: list[float]) -> FloatArray:
    """The (4, 4) matrix that so many numbers mean."""
    from scipy.spatial.transform import Rotation

    values = np.array(numbers, dtype=np.float64)
    match len(numbers):
        case 16 | 12:
            if len(numbers) == 16 and not np.allclose(values[12:], [0, 0, 0, 1], atol=1e-9):
                raise unfit("the matrix's last row is not 0 0 0 1")
            rows = values[:12].reshape(3, 4)
            return transform_of(rows[:, :3], rows[:, 3])
        case 7 | 8:
            position, quat_xyzw = values[-7:-4], values[-4:]
            length = float(np.linalg.norm(quat_xyzw))
            if not abs(length - 1.0) < ROTATION_TOLERANCE:
                raise unfit(f"the last four numbers are no unit quaternion, their length is {length:.4g}")
            return transform_of(np.asarray(Rotation.from_quat(quat_xyzw).as_matrix()), position)
        case found:
            raise unfit(f"there are {found} numbers")
