"""Bags written message by message from serialized bytes, by rosbags' writers."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from calib_core.readers.container.storage import TopicSummary

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Typesdict

#: How an mcap strings several types together, and how such a text begins where they are in DDS's own language.
_RULE = "=" * 80 + "\n"
_IDL = _RULE + "IDL: "


class BagWriter(Protocol):
    """An open bag."""

    def write(self, topic: str, receive_ns: int, payload: bytes) -> None:
        """Append a serialized message."""
        ...


class _Ros1:
    def __init__(self, writer: Ros1Writer, connections: dict[str, Connection]) -> None:
        self._writer, self._connections = writer, connections

    def write(self, topic: str, receive_ns: int, payload: bytes) -> None:
        self._writer.write(self._connections[topic], receive_ns, payload)


class _Ros2:
    def __init__(self, writer: Ros2Writer, connections: dict[str, Connection]) -> None:
        self._writer, self._connections = writer, connections

    def write(self, topic: str, receive_ns: int, payload: bytes) -> None:
        self._writer.write(self._connections[topic], receive_ns, payload)


def _definition(topic: TopicSummary, *, ros_version: Literal[1, 2]) -> tuple[str, str]:
    """The type's text and hash: the recording's own, else those of the standard types, else none.

    An mcap holds no hashes. A wrong one, of zeros say, is worse than none: readers compare it, and open no message of the bag.
    """
    if topic.definition and topic.digest:
        return topic.definition, topic.digest
    standard = get_typestore(Stores.ROS1_NOETIC if ros_version == 1 else Stores.ROS2_HUMBLE)
    if topic.definition:
        own = get_typestore(Stores.EMPTY)
        # A text may lack a type that it uses, or be none at all; rosbags tells so by whatever it stumbles over.
        with suppress(Exception):
            own.register(_types(topic.definition, topic.type))
            return topic.definition, _digest(own, topic.type, ros_version)
    if topic.type in standard.fielddefs:
        text, _ = standard.generate_msgdef(topic.type, ros_version=ros_version)
        return topic.definition or text, _digest(standard, topic.type, ros_version)
    return topic.definition, "*" if ros_version == 1 else "RIHS01_" + "0" * 64


def _types(definition: str, kind: str) -> Typesdict:
    """The types that a text defines: in ROS's own language, or several in that of DDS."""
    if not definition.startswith(_IDL):
        return get_types_from_msg(definition, kind)
    parts = [part.partition("\n")[2] for part in definition.split(_RULE)[1:]]
    return {name: fields for part in parts for name, fields in get_types_from_idl(part).items()}


def _digest(store: Typestore, kind: str, ros_version: Literal[1, 2]) -> str:
    return store.generate_msgdef(kind, ros_version=1)[1] if ros_version == 1 else store.hash_rihs01(kind)


@contextmanager
def ros1_writer(file: Path, topics: Sequence[TopicSummary]) -> Iterator[BagWriter]:
    """A ROS 1 bag at `file`."""
    with Ros1Writer(file) as writer:
        connections = {}
        for topic in topics:
            text, digest = _definition(topic, ros_version=1)
            connections[topic.name] = writer.add_connection(
                topic.name, topic.type, msgdef=text, md5sum=digest, latching=1 if topic.latching else None
            )
        yield _Ros1(writer, connections)


@contextmanager
def ros2_writer(file: Path, topics: Sequence[TopicSummary]) -> Iterator[BagWriter]:
    """A lone .mcap or .db3 at `file`: the one storage file of a bag folder that is thrown away."""
    plugin = StoragePlugin.MCAP if file.suffix == ".mcap" else StoragePlugin.SQLITE3
    with tempfile.TemporaryDirectory(prefix=".unsweep-", dir=file.parent) as folder:
        bag = Path(folder) / "bag"
        with Ros2Writer(bag, version=9, storage_plugin=plugin) as writer:
            connections = {}
            for topic in topics:
                text, digest = _definition(topic, ros_version=2)
                connections[topic.name] = writer.add_connection(
                    topic.name, topic.type, msgdef=text, rihs01=digest, offered_qos_profiles=topic.qos
                )
            yield _Ros2(writer, connections)
        shutil.move(next(bag.glob(f"*{file.suffix}")), file)
