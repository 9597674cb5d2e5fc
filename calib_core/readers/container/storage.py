"""Where messages come from: one protocol over every container, and the regular files that rosbags reads.

A storage yields (topic, receive time, payload) in receive order. What could not be read is a Damage, never an
exception half-way: whoever iterates gets everything up to the damage and finds the reason in `damages`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol

from calib_core.readers.container.compression import unpack_first, zstd
from calib_core.readers.container.limits import LIMITS
from calib_core.readers.container.names import storage_suffix
from calib_core.readers.container.wire import Encoding

if TYPE_CHECKING:
    from rosbags.interfaces import Connection, Qos

    from calib_core.readers.container.ros1_index import Ros1Index
    from calib_core.readers.container.ros2_index import Reader as Ros2Index

DamageKind = Literal["index", "holes", "cut", "missing"]
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


class StorageError(Exception):
    """A file cannot be opened this way; the caller tries the next way or gives up with a sentence."""


class RawMessage(NamedTuple):
    """One message as stored. receive_ns: when the recorder got it."""

    topic: str
    receive_ns: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class TopicSummary:
    """One topic. type: `package/msg/Name` whatever the container.   count: messages stored.

    definition, digest: the type's text and hash as the container holds them, "" where it holds none.
    foreign: how its messages are written where that is ROS's way neither of 1 nor of 2 ("json"), else "".
    latching, qos: how it was offered: whoever comes later gets its last message, in ROS 1 and in ROS 2.
    """

    name: str
    type: str
    count: int
    encoding: Encoding
    definition: str = ""
    digest: str = ""
    foreign: str = ""
    latching: bool = False
    qos: tuple[Qos, ...] = ()


@dataclass(frozen=True, slots=True)
class Damage:
    """What is wrong with a file: one clause for a sentence.

    kind: "index", nothing is lost; "holes", something inside is; "cut", all after lost_from_ns (receive time) is; "missing", of a
    folder, files are.
    """

    file: str
    text: str
    kind: DamageKind
    lost_from_ns: int = 0


class Storage(Protocol):
    """One opened file."""

    topics: list[TopicSummary]
    start_ns: int
    end_ns: int
    damages: list[Damage]

    def messages(self, topics: Collection[str], start_ns: int | None, stop_ns: int | None) -> Iterator[RawMessage]:
        """Messages of these topics with start_ns <= receive time < stop_ns, in receive order."""
        ...

    def close(self) -> None:
        """Let go of the file."""
        ...


def normalised_type(name: str) -> str:
    """`package/msg/Name` from either spelling."""
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name


def message_itself(payload: bytes) -> bytes:
    """The message, unpacked where the recorder compressed messages one by one (CDR never starts with zstd's magic).

    A damaged one is given on as it is: it costs itself alone, counted by its decoder as no message of its type.
    """
    if payload[:4] != ZSTD_MAGIC:
        return payload
    try:
        return unpack_first(zstd.ZstdDecompressor, payload, LIMITS.message_bytes)
    except zstd.ZstdError:
        return payload


class RosbagsStorage:
    """A regular ROS 1 bag, mcap or sqlite3 file, read by rosbags; damage met half-way hands over to `recover`."""

    def __init__(self, path: Path, recover: Callable[[str], Storage]) -> None:
        self._path = path
        self._recover = recover
        is_ros1 = storage_suffix(path) == ".bag"
        try:
            self._reader = _reader(path, is_ros1=is_ros1)
            self._reader.open()
        except Exception as error:  # rosbags lets struct, sqlite and decompression errors through
            raise StorageError(str(error) or type(error).__name__) from error
        self.topics = merged_topics([_summary(c, "ros1" if is_ros1 else "cdr") for c in self._reader.connections])
        self.start_ns = self._reader.start_time
        self.end_ns = max(self._reader.end_time, self.start_ns)
        self.damages: list[Damage] = []

    def messages(self, topics: Collection[str], start_ns: int | None, stop_ns: int | None) -> Iterator[RawMessage]:
        connections = [c for c in self._reader.connections if c.topic in topics]
        if not connections:
            return
        last_ns = None if start_ns is None else start_ns - 1
        try:
            for connection, receive_ns, payload in self._reader.messages(connections, start_ns, stop_ns):
                message = RawMessage(connection.topic, receive_ns, message_itself(payload))
                last_ns = receive_ns
                yield message
            return
        except GeneratorExit:
            raise
        except Exception as error:  # noqa: BLE001 - decompressors raise what they like; absurd sizes are MemoryErrors
            reason = str(error) or type(error).__name__
        yield from self._after_damage(reason, topics, last_ns, stop_ns)

    def _after_damage(
        self, reason: str, topics: Collection[str], last_ns: int | None, stop_ns: int | None
    ) -> Iterator[RawMessage]:
        """What the recovery still finds later than the last message read."""
        reached_ns = last_ns
        try:
            rest = self._recover(reason)
        except (StorageError, OSError):
            self._note(Damage(self._path.name, f"damaged ({reason})", "cut", reached_ns or self.start_ns))
            return
        with closing(rest):
            for message in rest.messages(topics, None if last_ns is None else last_ns + 1, stop_ns):
                reached_ns = message.receive_ns
                yield message
        if reached_ns is None or reached_ns == last_ns:
            self._note(Damage(self._path.name, f"damaged ({reason})", "cut", reached_ns or self.start_ns))
        else:
            self._note(Damage(self._path.name, f"damaged in places ({reason})", "holes"))

    def _note(self, damage: Damage) -> None:
        """Once, however often the file is iterated."""
        if damage.kind not in {known.kind for known in self.damages}:
            self.damages.append(damage)

    def close(self) -> None:
        self._reader.close()


def _reader(path: Path, *, is_ros1: bool) -> Ros1Index | Ros2Index:
    """One family's reader: the other one's libraries, with all their message types, need not be imported."""
    if is_ros1:
        from calib_core.readers.container.ros1_index import Ros1Index

        return Ros1Index(path)
    from calib_core.readers.container.ros2_index import Reader

    return Reader(path)


def _summary(connection: Connection, encoding: Encoding) -> TopicSummary:
    kind, text = normalised_type(connection.msgtype), connection.msgdef.data
    offered = connection.ext
    return TopicSummary(
        connection.topic,
        kind,
        connection.msgcount,
        encoding,
        text,
        connection.digest,
        foreign=foreign_to_ros(getattr(offered, "serialization_format", encoding)),
        latching=bool(getattr(offered, "latching", None)),
        qos=tuple(getattr(offered, "offered_qos_profiles", ())),
    )


def foreign_to_ros(written: str) -> str:
    """A serialization by its name, "" where it is ROS's own: an mcap file holds messages of any kind."""
    return "" if written in ("cdr", "ros1") else written or "unnamed"


def merged_topics(summaries: list[TopicSummary]) -> list[TopicSummary]:
    """One entry per topic and type, counts added, in name order."""
    merged: dict[tuple[str, str], TopicSummary] = {}
    for summary in summaries:
        key = (summary.name, summary.type)
        known = merged.get(key)
        merged[key] = summary if known is None else _both(known, summary)
    return [merged[key] for key in sorted(merged)]


def _both(one: TopicSummary, other: TopicSummary) -> TopicSummary:
    """What two publishers, or two files, have of one topic."""
    qos = one.qos + tuple(each for each in other.qos if each not in one.qos)
    return replace(one, count=one.count + other.count, latching=one.latching or other.latching, qos=qos)
