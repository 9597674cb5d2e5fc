"""Recordings on their way here: announced, received in one request or many, finished, given up."""

from __future__ import annotations

import logging
import threading
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import anyio
from anyio import to_thread
from fastapi import Request
from starlette.types import Receive

from app.bus import Bus
from app.errors import BadRequest, Conflict, DiskFull, TooLarge
from app.events import RecordingArrived
from app.recordings.service import RecordingService, new_record
from app.schemas.recordings import Recording
from app.settings import AppSettings
from app.storage.atomic import sync_folder
from app.storage.files import DataFolder, display_name, suffix_of
from app.storage.records import RecordingChanges, RecordingRecord
from app.storage.sizes import tree_size
from app.storage.store import RecordingStore
from app.uploads.inbox import Inbox, Part
from app.uploads.protocol import Checksum, TusError, number_of

_LOG = logging.getLogger("unsweep")


class Arrivals:
    """All uploads of the application. Tells the bus when a recording has arrived."""

    def __init__(
        self,
        store: RecordingStore,
        files: DataFolder,
        recordings: RecordingService,
        bus: Bus,
        *,
        settings: AppSettings,
    ) -> None:
        self._store = store
        self._files = files
        self._recordings = recordings
        self._bus = bus
        self._settings = settings
        self._inbox = Inbox(files)
        self._announcing = threading.Lock()
        self._admitted: dict[str, int] = {}  # uploads of unknown size: how many bytes each may have by now

    def announce_upload(self, name: str, size_bytes: int, sha256: str | None = None) -> RecordingRecord:
        """A recording whose bytes are about to arrive; refused where they and all others announced would not fit.

        size_bytes: 0 where it is not known before.   sha256: what the whole will hash to, where that is known.
        """
        suffix = suffix_of(name)
        self.check_size(size_bytes)
        with self._announcing:
            promised = self._promised_bytes()
            self._files.check_room(size_bytes, promised_bytes=promised)
            self._files.check_quota(size_bytes, promised_bytes=promised)
            record = new_record(
                display_name(name), "upload", source=f"source{suffix}", size_bytes=size_bytes, state="receiving"
            )
            try:
                self._files.partial(record.id).create(sha256)
            except OSError as error:
                self._files.partial(record.id).remove()
                raise DiskFull(
                    "upload.disk_full",
                    f"The data directory takes no more files ({error.strerror}); delete recordings.",
                ) from error
            self._store.add(record)
        return record

    def finish_upload(self, recording_id: str) -> None:
        """The last byte is here. Called again for the same upload it does nothing."""
        record = self._recordings.get(recording_id)
        if record.state != "receiving":
            return
        partial, source = self._files.partial(record.id), self._files.source(record)
        if partial.path.exists():  # else the server ended just after the file was moved
            if not partial.is_what_was_sent():
                self._recordings.delete(record)
                raise TusError(
                    460,
                    "upload.sha256",
                    f"What arrived of {record.name} is not what was sent (its SHA-256 differs); upload it again.",
                )
            source.parent.mkdir(parents=True, exist_ok=True)
            partial.path.replace(source)
            for folder in (source.parent, source.parent.parent, partial.path.parent):
                sync_folder(folder)
        here: RecordingChanges = {"state": "inspecting", "size_bytes": source.stat().st_size}
        first = self._store.change(record.id, here, where={"state": "receiving"})
        partial.remove()
        if first:
            self._bus.publish(RecordingArrived(replace(record, **here)))

    async def receive(self, name: str, request: Request) -> Recording:
        """A recording from one request's body, written as it comes; nothing is kept of one that is cut short."""
        length = number_of(request.headers, "content-length") if "content-length" in request.headers else None
        if length == 0:
            raise self._empty(name)
        record = await to_thread.run_sync(self.announce_upload, name, length or 0)
        await self.receive_first(record, request.receive, None)
        return await to_thread.run_sync(lambda: self._recordings.wire(self._recordings.get(record.id)))

    async def receive_first(self, record: RecordingRecord, receive: Receive, checksum: Checksum | None) -> int:
        """The bytes that come with an announcement. Where they cannot be kept nothing was announced."""
        self._admitted[record.id] = 0
        try:
            reached = await self._receive(record, receive, 0, checksum)
            if record.size_bytes == 0:
                if reached == 0:
                    raise self._empty(record.name)
                await to_thread.run_sync(self.finish_upload, record.id)
        except BaseException:
            with anyio.CancelScope(shield=True):
                await to_thread.run_sync(self._recordings.delete, record)
            raise
        finally:
            del self._admitted[record.id]
        return reached

    async def receive_part(
        self, record: RecordingRecord, request: Request, offset_bytes: int, checksum: Checksum | None
    ) -> int:
        """More bytes of an upload; how many there are now."""
        if record.state != "receiving":
            if offset_bytes == record.size_bytes:
                return record.size_bytes  # the answer to the last bytes was lost
            raise Conflict("upload.finished", f"All of {record.name} has arrived already.")
        if "content-length" in request.headers and (
            offset_bytes + number_of(request.headers, "content-length") > record.size_bytes
        ):
            raise TooLarge(
                "upload.too_large",
                f"{record.name} was announced with {record.size_bytes} bytes, and this request goes beyond; start it again.",
            )
        return await self._receive(record, request.receive, offset_bytes, checksum)

    async def give_up(self, record: RecordingRecord) -> None:
        """An upload that is still arriving goes, with everything of it."""
        if record.state != "receiving":
            raise Conflict("upload.finished", f"All of {record.name} has arrived; delete the recording instead.")
        await self._inbox.stop(record.id)
        await to_thread.run_sync(self._recordings.delete, record)

    async def stop_uploads(self) -> None:
        """Keep what has come of the uploads under way, and end their requests: the server stops."""
        await self._inbox.stop_all()

    def expires_at(self, record: RecordingRecord, now: datetime) -> datetime | None:
        """When the upload is removed unless it goes on; None where all of it is here."""
        if record.state != "receiving":
            return None
        return (self._files.partial(record.id).changed_at() or now) + timedelta(days=self._settings.upload_expiry_days)

    def check_size(self, size_bytes: int) -> None:
        """Raise TooLarge for more than is accepted."""
        most = self._settings.max_upload_bytes
        if size_bytes > most:
            raise TooLarge(
                "upload.too_large",
                f"A recording may have {most / 1e9:.2f} GB, this one has {size_bytes / 1e9:.2f} GB: "
                "cut it, or open it from the server's folder (--recordings).",
            )

    def resume(self, now: datetime) -> None:
        """After a start of the server: finish uploads whose last byte had come, delete those given up long ago."""
        arriving = self._arriving(now)
        self._files.keep_only_uploads([record.id for record in arriving])
        for record in arriving:
            whole = (
                self._files.source(record).is_file() or self._recordings.received_bytes(record) == record.size_bytes > 0
            )
            if whole:
                try:
                    self.finish_upload(record.id)
                except TusError as error:
                    _LOG.warning("%s", error)

    async def _receive(
        self, record: RecordingRecord, receive: Receive, offset_bytes: int, checksum: Checksum | None
    ) -> int:
        end_bytes = record.size_bytes or self._settings.max_upload_bytes
        # Of an upload whose size nobody told nothing was promised: the quota is asked as it grows.
        grows = record.size_bytes == 0 and self._settings.quota_bytes is not None
        part = Part(
            record.name,
            offset_bytes,
            end_bytes,
            checksum,
            admit=(lambda reach_bytes: self._admit(record.id, reach_bytes)) if grows else None,
            begins=record.id in self._admitted,
        )
        reached = await self._inbox.receive(record.id, receive, part)
        if reached == record.size_bytes:
            await to_thread.run_sync(self.finish_upload, record.id)
        return reached

    def _admit(self, recording_id: str, reach_bytes: int) -> None:
        """Let an upload of unknown size grow to so many bytes; refused where they are more than the quota has left."""
        with self._announcing:
            more = reach_bytes - self._here_bytes(recording_id)
            self._files.check_quota(more, promised_bytes=self._promised_bytes(but=recording_id))
            self._admitted[recording_id] = reach_bytes

    def _promised_bytes(self, *, but: str = "") -> int:
        """What is still to come of the uploads under way: as announced, or as far as they were let grow."""
        arriving = [record for record in self._arriving(datetime.now(UTC)) if record.id != but]
        sizes = {record.id: record.size_bytes or self._admitted.get(record.id, 0) for record in arriving}
        return sum(max(0, size - self._here_bytes(recording_id)) for recording_id, size in sizes.items())

    def _here_bytes(self, recording_id: str) -> int:
        """What an upload takes on the disk, safely there or not."""
        return tree_size(self._files.partial(recording_id).path)

    def _arriving(self, now: datetime) -> list[RecordingRecord]:
        """Uploads under way. Those given up long ago are deleted here."""
        arriving: list[RecordingRecord] = []
        for record in self._store.in_states(["receiving"]):
            if record.origin != "upload":
                continue
            if (self.expires_at(record, now) or now) < now:
                self._recordings.delete(record)
            else:
                arriving.append(record)
        return arriving

    def _empty(self, name: str) -> BadRequest:
        return BadRequest("upload.empty", f"The file {display_name(name)} is empty; choose one with messages in it.")
