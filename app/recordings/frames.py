"""The frames that a recording's sensors publish in, without the rest of its report."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, ValidationError

from app.storage.records import RecordingRecord


class _Sensor(BaseModel):
    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)
    frame_id: str


class _ReportFrames(BaseModel):
    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)
    imu: _Sensor | None = None
    lidar: _Sensor | None = None


def frames_of(record: RecordingRecord) -> tuple[str, str]:
    """The IMU's and the lidar's frame, each empty where no report tells it, or what was kept of it cannot be read."""
    try:
        found = _ReportFrames.model_validate_json(record.report_json or "{}")
    except ValidationError:
        return "", ""
    return "" if found.imu is None else found.imu.frame_id, "" if found.lidar is None else found.lidar.frame_id
