"""What takes room on the server's disk, and how long it stays."""

from __future__ import annotations

from datetime import datetime

from pydantic import Field

from app.schemas.common import RecordId, WireModel
from app.schemas.recordings import Origin, RecordingState


class RecordingUse(WireModel):
    """What one recording takes."""

    recording_id: RecordId = Field(description="of the recording")
    name: str = Field(description="what people call it")
    origin: Origin = Field(description="where it came from")
    state: RecordingState = Field(description="of the recording")
    source_bytes: int = Field(description="the recording itself; 0 where it is opened in place")
    arrays_bytes: int = Field(description="points and readings decoded from it; made again when they are needed")
    results_bytes: int = Field(description="results of all its runs")
    last_used_at: datetime = Field(description="when it came, or when its latest run ended")
    removed_at: datetime | None = Field(description="when it will be removed unless it is used; null: it stays")


class StorageUse(WireModel):
    """The data directory's disk, and who takes what of it; the largest comes first."""

    disk_total_bytes: int = Field(description="size of the disk")
    disk_free_bytes: int = Field(description="free on the disk")
    kept_free_bytes: int = Field(description="kept free on the disk: an upload that would need this space is refused")
    used_bytes: int = Field(description="what the whole data directory takes")
    quota_bytes: int | None = Field(description="the most that the data directory may take; null: what the disk has")
    keep_days: float | None = Field(description="a recording that nobody used for so many days is removed; null: never")
    recordings: list[RecordingUse] = Field(description="the largest first")
