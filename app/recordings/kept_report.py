"""What is asked of a recording's report by itself, without the plots that come with the whole: the doctor's word, the frames."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, ValidationError

from app.storage.records import RecordingRecord
from calib_core.doctor.report import Verdict


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)


class _Head(_Part):
    verdict: Verdict
    final: bool = True


class _Sensor(_Part):
    frame_id: str


class _Sensors(_Part):
    imu: _Sensor | None = None
    lidar: _Sensor | None = None


def verdict_of(record: RecordingRecord) -> Verdict | None:
    """The verdict; None until the recording has been inspected, and where what was kept of that cannot be read."""
    try:
        head = None if record.report_json is None else _Head.model_validate_json(record.report_json)
    except ValidationError:
        return None
    return None if head is None or not head.final else head.verdict


def frames_of(record: RecordingRecord) -> tuple[str, str]:
    """The IMU's and the lidar's frame, each empty where no report tells it, or what was kept of it cannot be read."""
    try:
        found = _Sensors.model_validate_json(record.report_json or "{}")
    except ValidationError:
        return "", ""
    return "" if found.imu is None else found.imu.frame_id, "" if found.lidar is None else found.lidar.frame_id
