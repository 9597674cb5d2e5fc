"""The audit's document, schema unsweep.audit/1."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from calib_core.result import CalibrationResult, RoomCrispness
from calib_core.settings import Axis
from calib_core.sigmas import Unit

Verdict = Literal["passed", "failed", "unknown"]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class AxisAudit(_Model):
    """One axis. All numbers in `unit`: degrees about a lidar's axis, millimetres along an IMU's axis, milliseconds."""

    axis: Axis = Field(description="as named in the result's covariance_order")
    unit: Literal["deg", "mm", "ms"] = Field(description="of all numbers of this axis")
    difference: float | None = Field(description="given minus found; null where the file has no such number")
    difference_std: float = Field(description="standard deviation of this recording's own answer")
    limit: float | None = Field(description="largest difference that passes; null: not judged")
    smallest_error: float = Field(
        description="an error of this size or more would have shown: the limit or three sigmas, whichever is larger"
    )
    verdict: Verdict | None = Field(description="unknown: three sigmas exceed the limit; null: not judged")


def in_si(value: float, unit: Literal["deg", "mm", "ms"]) -> tuple[float, Unit]:
    """An axis' number in metres or seconds, degrees as they are, and which of them it is in."""
    match unit:
        case "deg":
            return value, "deg"
        case "mm":
            return 1e-3 * value, "m"
        case "ms":
            return 1e-3 * value, "s"


class AuditCrispness(_Model):
    """The room laid together by the IMU alone, three seconds at a time, with each extrinsic; lower is crisper."""

    given: RoomCrispness = Field(description="the room laid together with the given extrinsic")
    found: RoomCrispness = Field(description="the same points laid together with this recording's own extrinsic")
    text: str = Field(description="what the comparison means, for a person")


class AuditReport(_Model):
    """What an audit found. `calibration` is this recording's own result, against which the extrinsic is held."""

    schema_: Literal["unsweep.audit/1"] = Field(
        default="unsweep.audit/1", alias="schema", description="which document this is"
    )
    verdict: Verdict = Field(
        description="unknown: the recording cannot tell, as its own answer is missing or too uncertain for a limit"
    )
    text: str = Field(description="the verdict in one sentence, for a person")
    extrinsic_form: str = Field(description="what the given file was read as")
    axes: list[AxisAudit] = Field(description="empty where the recording gives no answer")
    rotation_deg: float | None = Field(description="angle between the given extrinsic and this recording's own")
    translation_mm: float | None = Field(description="distance between the two")
    hints: list[str] = Field(description="what may explain a difference, for a person; a sentence each")
    crispness: AuditCrispness | None = Field(
        description="the room with either extrinsic; null where it was not measured"
    )
    calibration: CalibrationResult = Field(description="this recording's own result")

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, populate_by_name=True, serialize_by_alias=True)

    def to_json(self) -> str:
        """The document as indented JSON text, ending in a newline."""
        return self.model_dump_json(by_alias=True, indent=2) + "\n"
