"""The contract's small files: results, planes, initial guesses and noise, read and checked.

Each reader says in one sentence what it expected, what it found and in which file; nothing is repaired in silence.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from calib_core.contradictions import (
    LEAVE_ONE_OUT,
    forms_contradict,
    is_result,
    key_twice,
    strange_transform,
    times_contradict,
)
from calib_core.errors import SettingsError
from calib_core.geometry import ROTATION_TOLERANCE, rotation_meant
from calib_core.result import RESULT_SCHEMA, CalibrationResult
from calib_core.settings import FARTHEST_M, FARTHEST_S, ImuNoise
from calib_core.types import FloatArray, InitialGuess, Plane
from calib_core.validation_messages import misfit, place_of

#: An outline's corners lie in their plane, but for digits left out.
OUTLINE_OFF_PLANE_M = 0.05
#: Sine of a corner that is none: the middle of a straight side.
STRAIGHT = 1e-6
#: Corners this near to each other are one.
SAME_CORNER_M = 1e-6

_Model = TypeVar("_Model", bound=BaseModel)


class _PlaneEntry(BaseModel):
    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)
    name: str
    normal: list[float] = Field(min_length=3, max_length=3)
    offset_m: float
    outline_m: list[Annotated[list[float], Field(min_length=3, max_length=3)]] | None = Field(
        default=None, min_length=3, max_length=1000
    )
    suggested: bool = False


class _PlanesFile(BaseModel):
    model_config = ConfigDict(allow_inf_nan=False)
    schema_: Literal["unsweep.planes/1"] = Field(alias="schema")
    planes: list[_PlaneEntry] = Field(min_length=1)


class _GuessTransform(BaseModel):
    """Any subset of the result's four forms, which have to agree; of those that do the matrix is the most exact."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)
    matrix: list[list[float]] | None = None
    translation_m: list[float] | None = Field(default=None, min_length=3, max_length=3)
    quaternion_xyzw: list[float] | None = Field(default=None, min_length=4, max_length=4)
    euler_xyz_deg: list[float] | None = Field(default=None, min_length=3, max_length=3)


def _as_forms(transform: object) -> object:
    """A bare matrix is the form that has no name."""
    return {"matrix": transform} if isinstance(transform, list) else transform


class _GuessFile(BaseModel):
    """A result document serves as it is: other keys are kept only to find a mounting under another name among them."""

    model_config = ConfigDict(extra="allow", allow_inf_nan=False)
    T_imu_lidar: Annotated[_GuessTransform | None, BeforeValidator(_as_forms)] = None
    time_offset_s: float | None = Field(default=None, ge=-FARTHEST_S, le=FARTHEST_S)
    time_offset_ns: int | None = Field(default=None, ge=-round(FARTHEST_S * 1e9), le=round(FARTHEST_S * 1e9))


def read_result(path: str | Path) -> CalibrationResult:
    """The result document in `path`; refused where its forms of the answer differ, of which each use takes another.

    Keys that this version does not know are passed over: a later one may add some.
    """
    expected = f"a result of `unsweep calibrate` (schema {RESULT_SCHEMA})"
    result = _read(path, CalibrationResult.from_json, expected)
    wrong = _differing_forms(result)
    if wrong is not None:
        raise SettingsError(
            f"Expected {expected} in {path}, but {wrong}; give the file that the calibration wrote, unchanged."
        )
    return result


def _differing_forms(result: CalibrationResult) -> str | None:
    """What the forms of a result's mounting and time differ in. A matrix that is no pose is told by whoever uses it."""
    wrong = times_contradict(result.time_offset_s, result.time_offset_ns)
    if wrong is not None or result.T_imu_lidar is None:
        return wrong
    try:
        forms = _GuessTransform.model_validate(result.T_imu_lidar.model_dump())
        turns, places = _turns(forms, "the result"), _places(forms, "the result")
    except (SettingsError, ValidationError):
        return None
    return forms_contradict(turns, places)


def read_planes(path: str | Path) -> tuple[Plane, ...]:
    """The planes in `path`, map frame, normals made unit length.

    An entry is {"name", "normal", "offset_m"}, and may have "outline_m": the corners [x, y, z] in metres, map frame, of a
    convex polygon in the plane, in order. Only what lies within it is then used of the plane. "suggested": true says of an
    entry that nobody chose it: it is left out of the answer where it turns out to be doubtful.
    """
    entries = _read(
        path, _PlanesFile.model_validate_json, 'planes ({"schema": "unsweep.planes/1", "planes": [...]})'
    ).planes
    return tuple(_plane(entry, path) for entry in entries)


def read_imu_noise(path: str | Path) -> ImuNoise:
    """The noise densities in `path`."""
    return _read(
        path, ImuNoise.model_validate_json, "noise densities (gyroscope_noise_density_rad_s_sqrt_hz and the others)"
    )


def read_initial_guess(path: str | Path) -> InitialGuess:
    """The start values in `path`: any subset of a result's `T_imu_lidar` and `time_offset_s`."""
    expected = "an initial guess (any of T_imu_lidar and time_offset_s, as in a result)"
    guess = _read(path, _guess_of, expected)
    wrong = strange_transform(guess.model_extra or ())
    if wrong is None and (apart := times_contradict(guess.time_offset_s, guess.time_offset_ns)) is not None:
        wrong = f"{apart}{LEAVE_ONE_OUT}"
    if wrong is not None:
        raise SettingsError(f"Expected {expected} in {path}, but {wrong}; correct the file.")
    offset_ns = guess.time_offset_ns
    if offset_ns is None and guess.time_offset_s is not None:
        offset_ns = round(guess.time_offset_s * 1e9)
    transform = guess.T_imu_lidar or _GuessTransform()
    rotation, translation = _pose(transform, str(path))
    if rotation is None and translation is None and offset_ns is None:
        raise SettingsError(f"Expected {expected} in {path}, but it holds neither; add one, or leave the file out.")
    return InitialGuess(R_imu_lidar=rotation, p_imu_lidar=translation, time_offset_ns=offset_ns)


def make_initial_guess(matrix: list[list[float]] | None, time_offset_s: float | None, *, where: str) -> InitialGuess:
    """The start values that somebody hands over without a file, held to what `read_initial_guess` holds a file to.

    matrix: T_imu_lidar, 4 rows of 4, metres.   where: what to call the place in a sentence.   Raises SettingsError.
    """
    if time_offset_s is not None and not abs(time_offset_s) <= FARTHEST_S:
        raise SettingsError(
            f"Expected a time offset of at most {FARTHEST_S:.0e} s in {where}, but found {time_offset_s:.3g} s; correct it."
        )
    rotation, translation = _pose(_GuessTransform(matrix=matrix), where)
    return InitialGuess(
        R_imu_lidar=rotation,
        p_imu_lidar=translation,
        time_offset_ns=None if time_offset_s is None else round(time_offset_s * 1e9),
    )


def _guess_of(text: str) -> _GuessFile:
    """A guess from its text. What a result has beside the keys that are known is a later version's, and no slip of the pen."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        document = None
    lenient = isinstance(document, dict) and is_result(document)
    return _GuessFile.model_validate_json(text, extra="ignore" if lenient else None)


def json_text(path: str | Path, expected: str) -> str:
    """The text of a small JSON file. expected: what it should hold, for a person.

    Raises SettingsError where it cannot be read, or says a thing twice.
    """
    try:
        # Some editors begin a file with a mark that is none of JSON's.
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "it is not text"
        raise SettingsError(
            f"Expected {expected} in {path}, but it cannot be read ({reason}); check the name."
        ) from error
    if (twice := key_twice(text)) is not None:
        raise SettingsError(f"Expected {expected} in {path}, but {twice}; correct the file.")
    return text


def _read(path: str | Path, parse: Callable[[str], _Model], expected: str) -> _Model:
    """What `parse` makes of the text in `path`, which raises ValidationError where it is something else."""
    text = json_text(path, expected)
    try:
        return parse(text)
    except ValidationError as error:
        first = error.errors()[0]
        where = place_of(first) or "the document"
        raise SettingsError(
            f"Expected {expected} in {path}, but at {where}: {misfit(first)}; correct the file."
        ) from error


def _plane(entry: _PlaneEntry, path: str | Path) -> Plane:
    normal = np.array(entry.normal, dtype=np.float64)
    length = float(np.linalg.norm(normal))
    if not np.isfinite(length) or abs(length - 1.0) > ROTATION_TOLERANCE:
        raise SettingsError(
            f"Expected a unit normal for plane {entry.name} in {path}, but its length is {length:.4g}; correct it."
        )
    plane = Plane(entry.name, normal / length, entry.offset_m / length, suggested=entry.suggested)
    return plane if entry.outline_m is None else replace(plane, outline_m=_outline(plane, entry.outline_m, path))


def _outline(plane: Plane, corners_m: list[list[float]], path: str | Path) -> FloatArray:
    """The corners (K, 3), refused where they are not those of a convex polygon in the plane."""
    corners = np.array(corners_m, dtype=np.float64)
    off_m = float(np.abs(corners @ plane.normal + plane.offset_m).max())
    if off_m > OUTLINE_OFF_PLANE_M:
        raise SettingsError(
            f"Expected the corners of outline_m of plane {plane.name} in {path} to lie in that plane (map frame, metres), "
            f"but one is {off_m:.3g} m off it; correct them."
        )
    edges = np.roll(corners, -1, axis=0) - corners
    edges = edges[np.linalg.norm(edges, axis=1) > SAME_CORNER_M]  # their directions would be rounding
    ahead = np.roll(edges, -1, axis=0)
    turns_rad = np.arctan2(np.cross(edges, ahead) @ plane.normal, np.sum(edges * ahead, axis=1))
    # Whoever walks around a convex outline turns once, and never back: what crosses, is hollow or a line turns further.
    flat = bool((np.abs(np.sin(turns_rad)) < STRAIGHT).all())
    if flat or np.abs(turns_rad).sum() > 2.0 * np.pi + 0.01:
        raise SettingsError(
            f"Expected outline_m of plane {plane.name} in {path} to be the corners of a convex polygon in order, but they "
            "turn both ways, cross or lie on a line; list them around the outline."
        )
    return corners


def _pose(transform: _GuessTransform, where: str) -> tuple[FloatArray | None, FloatArray | None]:
    """The rotation (3, 3) and the translation (3,), each None where it has no form; refused where two forms differ."""
    turns, places = _turns(transform, where), _places(transform, where)
    wrong = forms_contradict(turns, places)
    if wrong is not None:
        raise SettingsError(f"Expected one mounting in {where}, but {wrong}{LEAVE_ONE_OUT}; correct it.")
    if any(np.abs(place).max() > FARTHEST_M for place in places.values()):
        raise SettingsError(
            f"Expected a translation of at most {FARTHEST_M:.0e} m in {where}, found a longer one; correct it."
        )
    return next(iter(turns.values()), None), next(iter(places.values()), None)


def _turns(transform: _GuessTransform, where: str) -> dict[str, FloatArray]:
    """The rotation in each form that is there, the most exact first."""
    from scipy.spatial.transform import Rotation

    turns: dict[str, FloatArray] = {}
    if transform.matrix is not None:
        turns["matrix"] = _rotation_of(_matrix(transform.matrix, where)[:3, :3], where)
    if transform.quaternion_xyzw is not None:
        quat_xyzw = np.array(transform.quaternion_xyzw)
        if not abs(float(np.linalg.norm(quat_xyzw)) - 1.0) < ROTATION_TOLERANCE:
            raise SettingsError(
                f"Expected a unit quaternion in {where}, but found {transform.quaternion_xyzw}; correct it."
            )
        turns["quaternion_xyzw"] = np.asarray(Rotation.from_quat(quat_xyzw).as_matrix(), dtype=np.float64)
    if transform.euler_xyz_deg is not None:
        turned = Rotation.from_euler("xyz", transform.euler_xyz_deg, degrees=True)
        turns["euler_xyz_deg"] = np.asarray(turned.as_matrix(), dtype=np.float64)
    return turns


def _places(transform: _GuessTransform, where: str) -> dict[str, FloatArray]:
    """The translation in each form that is there."""
    places: dict[str, FloatArray] = {}
    if transform.matrix is not None:
        places["matrix"] = _matrix(transform.matrix, where)[:3, 3].copy()
    if transform.translation_m is not None:
        places["translation_m"] = np.array(transform.translation_m, dtype=np.float64)
    return places


def _matrix(rows: list[list[float]], where: str) -> FloatArray:
    if len(rows) != 4 or any(len(row) != 4 for row in rows) or rows[3] != [0, 0, 0, 1]:
        raise SettingsError(
            f"Expected 4 rows of 4 numbers, the last 0 0 0 1, as T_imu_lidar in {where}; correct the matrix."
        )
    return np.array(rows, dtype=np.float64)


def _rotation_of(matrix: FloatArray, where: str) -> FloatArray:
    rotation = rotation_meant(matrix)
    if rotation is None:
        raise SettingsError(
            f"Expected a rotation in T_imu_lidar in {where}, but its columns are not orthonormal and right-handed; "
            "correct the matrix."
        )
    return rotation
