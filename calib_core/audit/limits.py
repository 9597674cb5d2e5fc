"""How far off an extrinsic may be: limits of one's own, each axis with its unit in its name."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from calib_core.errors import SettingsError
from calib_core.input_files import json_text
from calib_core.result import WEAK_DEG, WEAK_M, WEAK_S
from calib_core.validation_messages import misfit

_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
_Three = Annotated[tuple[_Positive, _Positive, _Positive], Field(strict=False)]


class Limits(BaseModel):
    """The largest difference that is still right. A number holds for all three axes; null: this is not judged.

    Without a file the limits beyond which our own result would be called weak.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, populate_by_name=True, serialize_by_alias=True
    )
    schema_: Literal["unsweep.limits/1"] = Field(
        default="unsweep.limits/1", alias="schema", description="which document this is"
    )
    rotation_deg: _Positive | _Three | None = Field(default=WEAK_DEG, description="about the lidar's axes x, y, z")
    translation_mm: _Positive | _Three | None = Field(default=1e3 * WEAK_M, description="along the IMU's axes x, y, z")
    time_offset_ms: _Positive | None = Field(default=1e3 * WEAK_S, description="of the time offset")

    def per_axis(self) -> tuple[float | None, ...]:
        """Seven, in the order rx ry rz tx ty tz dt, in degrees, millimetres and milliseconds."""
        turns, places = _spread(self.rotation_deg), _spread(self.translation_mm)
        return (*turns, *places, self.time_offset_ms)


def read_limits(path: Path) -> Limits:
    """The limits in a JSON file."""
    expected = "limits (any of rotation_deg, translation_mm, time_offset_ms, each a number, three numbers, or null)"
    text = json_text(path, expected)
    try:
        return Limits.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        where = str(first["loc"][0]) if first["loc"] else "the document"
        raise SettingsError(
            f"Expected {expected} in {path}, but at {where}: {misfit(first)}; correct the file."
        ) from error


def _spread(limit: float | tuple[float, float, float] | None) -> tuple[float | None, float | None, float | None]:
    return limit if isinstance(limit, tuple) else (limit, limit, limit)
