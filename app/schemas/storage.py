"""What takes room on the server's disk, and how long it stays."""

from __future__ import annotations

from datetime import datetime

from pydantic import Field

from app.schemas.common import RecordId, WireModel
from app.schemas.recordings import Origin, RecordingState


class RecordingUse(WireModel):
    """What one recording takes."""

    recording_id: RecordId
    name: str
    origin: Origin
    state: RecordingState
    source_bytes: int = Field(description="the file itself; 0 where it is opened in place")
    arrays_bytes: int = Field(description="what was read of it, made again when it is wanted")
    results_bytes: int = Field(description="of all its runs")
    last_used_at: datetime = Field(description="when it came, or when its latest run was")
    removed_at: datetime | None = Field(description="when it goes unless it is used; null: it stays")


class StorageUse(WireModel):
    """The data directory's disk, and who takes what of it; the largest comes first."""

    disk_total_bytes: int
    disk_free_bytes: int
    kept_free_bytes: int = Field(description="stays free: an upload that would take of it is refused")
    used_bytes: int = Field(description="of the whole data directory")
    quota_bytes: int | None = Field(description="the most that the data directory may take; null: what the disk has")
    keep_days: float | None = Field(description="a recording that nobody used for so long is removed; null: never")
    recordings: list[RecordingUse]
