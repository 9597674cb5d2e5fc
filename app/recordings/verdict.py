"""The doctor's one word on a recording, without the plots that come with the whole report."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from app.storage.records import RecordingRecord

DoctorVerdict = Literal["good", "limited", "unusable"]


class _ReportHead(BaseModel):
    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)
    verdict: DoctorVerdict
    final: bool = True


def verdict_of(record: RecordingRecord) -> DoctorVerdict | None:
    """The verdict; None until the recording has been inspected, and where what was kept of that cannot be read."""
    try:
        head = None if record.report_json is None else _ReportHead.model_validate_json(record.report_json)
    except ValidationError:
        return None
    return None if head is None or not head.final else head.verdict
