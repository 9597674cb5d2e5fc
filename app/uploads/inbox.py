"""Bodies of requests on their way into uploads: one at a time for each upload, never on the event loop."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TypeVar, TypeVarTuple

import anyio
from anyio import to_thread
from starlette.types import Receive

from app.errors import ApiError, BadRequest, Conflict, DiskFull, NotFound, TooLarge, Unavailable
from app.storage.files import DataFolder
from app.storage.partial import Appender
from app.uploads.protocol import Checksum, TusError
from calib_core.errors import is_for_want_of_room

#: Bytes gathered before they are handed to a thread for writing.
WRITE_BYTES = 4 * 2**20
#: Bytes after which what was written is made durable: as much as a power cut may cost within one long request.
SYNC_BYTES = 32 * 2**20
#: Silence after which a request is given up; its upload can be taken up by another one then.
SILENCE_S = 30.0
#: Uploads written at once; the threads that answer other requests stay free.
WRITERS = 8
#: How long somebody who wants to delete an upload waits for its writer, who is told to stop.
STOP_WAIT_S = 10.0

T = TypeVar("T")
Arguments = TypeVarTuple("Arguments")


@dataclass(frozen=True, slots=True)
class Part:
    """What a request brings: bytes from `offset_bytes` on, at most up to `end_bytes`.

    checksum: of this request's bytes.   admit: asked before bytes are written whether the upload may have so many;
    None where all of them were promised when it was announced.   begins: whether it comes with the announcement, of which
    nothing is kept where it is cut.
    """

    name: str
    offset_bytes: int
    end_bytes: int
    checksum: Checksum | None = None
    admit: Callable[[int], None] | None = None
    begins: bool = False

    @property
    def advice(self) -> str:
        """How to go on where not all of it came."""
        again = "send it again, as nothing of it was kept; by /api/uploads it could go on"
        return again if self.begins else "go on from the upload's offset"


@dataclass(slots=True)
class _Turn:
    """One request's turn with an upload."""

    ended: asyncio.Event = field(default_factory=asyncio.Event)
    listening: asyncio.Timeout | None = None
    stopped: bool = False


class Inbox:
    """All uploads that are being written. Belongs to one event loop."""

    def __init__(self, files: DataFolder) -> None:
        self._files = files
        self._turns: dict[str, _Turn] = {}
        self._threads: anyio.CapacityLimiter | None = None

    async def receive(self, upload_id: str, receive: Receive, part: Part) -> int:
        """Append a request's body; the durable bytes afterwards.

        What came of a request that is cut short is kept, unless it has a checksum, which only the whole can pass.
        """
        with self._turn(upload_id) as turn:
            try:
                appender = await self._in_thread(Appender, self._files.partial(upload_id))
            except FileNotFoundError:
                raise _gone(part) from None
            try:
                if part.offset_bytes != appender.durable_bytes:
                    raise Conflict(
                        "upload.offset",
                        f"The upload goes on at byte {appender.durable_bytes}, not at {part.offset_bytes}; "
                        "ask where it is (HEAD) and send from there.",
                    )
                await self._write(appender, turn, receive, part)
                return appender.durable_bytes
            except OSError as error:
                raise _refusal(error, appender, part) from error
            finally:
                with anyio.CancelScope(shield=True):
                    await self._in_thread(appender.close)

    async def stop(self, upload_id: str) -> None:
        """End whatever writes into the upload."""
        turn = self._turns.get(upload_id)
        if turn is not None:
            await self._end(turn)

    async def stop_all(self) -> None:
        """End all that writes: the server stops. What has come is kept."""
        await asyncio.gather(*(self._end(turn) for turn in list(self._turns.values())))

    async def _end(self, turn: _Turn) -> None:
        turn.stopped = True
        if turn.listening is not None:
            turn.listening.reschedule(asyncio.get_running_loop().time())
        with anyio.move_on_after(STOP_WAIT_S):
            await turn.ended.wait()

    @contextmanager
    def _turn(self, upload_id: str) -> Iterator[_Turn]:
        if upload_id in self._turns:
            raise TusError(423, "upload.locked", "Another request is writing into this upload; try again in a moment.")
        turn = self._turns[upload_id] = _Turn()
        try:
            yield turn
        finally:
            del self._turns[upload_id]
            turn.ended.set()

    async def _write(self, appender: Appender, turn: _Turn, receive: Receive, part: Part) -> None:
        hasher = None if part.checksum is None else hashlib.new(part.checksum.algorithm, usedforsecurity=False)
        try:
            async for block in _blocks(receive, turn, part):
                await self._in_thread(self._files.check_room, len(block))
                if part.admit is not None:
                    await self._in_thread(part.admit, appender.written_bytes + len(block))
                await self._in_thread(appender.append, block)
                if hasher is not None:
                    await self._in_thread(hasher.update, block)
                # The last bytes are made durable only when the body has ended with them: it may be too long.
                elif appender.written_bytes - appender.durable_bytes >= SYNC_BYTES and (
                    appender.written_bytes < part.end_bytes
                ):
                    await self._in_thread(appender.sync)
                if appender.was_deleted():
                    raise _gone(part)
        except _Cut as cut:
            await self._keep(appender, part)
            raise BadRequest("upload.cut", f"The request ended early ({cut}); {part.advice}.") from cut
        except OSError:
            await self._keep(appender, part)
            raise
        except DiskFull:
            await self._keep(appender, part)
            raise
        if part.checksum is not None and hasher is not None and hasher.digest() != part.checksum.digest:
            raise TusError(
                460, "upload.checksum", "The bytes that arrived are not those that were sent; send them again."
            )
        await self._in_thread(appender.sync)

    async def _keep(self, appender: Appender, part: Part) -> None:
        """Make durable what came, where it can be believed as it is."""
        if part.checksum is None and appender.written_bytes < part.end_bytes:
            with anyio.CancelScope(shield=True):
                await self._in_thread(appender.sync)

    async def _in_thread(self, work: Callable[[*Arguments], T], *arguments: *Arguments) -> T:
        if self._threads is None:
            self._threads = anyio.CapacityLimiter(WRITERS)
        return await to_thread.run_sync(work, *arguments, limiter=self._threads)


class _Cut(Exception):
    """The body ended before its end."""


async def _blocks(receive: Receive, turn: _Turn, part: Part) -> AsyncIterator[bytearray]:
    """The body in blocks of about WRITE_BYTES; _Cut after the last one where the body is cut."""
    room = part.end_bytes - part.offset_bytes
    gathered = bytearray()
    cut = ""
    more = True
    while more and not cut:
        try:
            async with asyncio.timeout(None if turn.stopped else SILENCE_S) as turn.listening:
                if turn.stopped:
                    raise TimeoutError
                message = await receive()
        except TimeoutError:
            cut = "it was stopped" if turn.stopped else f"nothing came for {SILENCE_S:.0f} s"
            break
        if message["type"] == "http.disconnect":
            cut = "the connection was lost"
            break
        chunk: bytes = message.get("body", b"")
        room -= len(chunk)
        if room < 0:
            raise TooLarge(
                "upload.too_large",
                f"{part.name} may have {part.end_bytes} bytes, and more came; nothing beyond them was kept.",
            )
        gathered += chunk
        more = message.get("more_body", False)
        if len(gathered) >= WRITE_BYTES:
            yield gathered
            gathered = bytearray()
    if gathered:
        yield gathered
    if cut:
        raise _Cut(cut)


def _gone(part: Part) -> ApiError:
    return NotFound("upload.gone", f"The upload of {part.name} was deleted; start it again.")


def _refusal(error: OSError, appender: Appender, part: Part) -> ApiError:
    if is_for_want_of_room(error):
        return DiskFull(
            "upload.disk_full",
            f"The data directory's disk is full after {appender.durable_bytes / 1e9:.2f} GB of {part.name}: "
            f"delete recordings, then {part.advice}.",
        )
    return Unavailable(
        "upload.write_failed",
        f"{part.name} could not be written ({error.strerror}); see to the data directory's disk, then {part.advice}.",
    )
