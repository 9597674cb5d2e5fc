"""Message definitions that name themselves, nest without end or have arrays of 2^31, in bags that are read all the same."""

from __future__ import annotations

import random
from functools import cache
from pathlib import Path

from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer

from bench.spoilt import SIZES, require, spoilt
from calib_core.errors import InputError
from calib_core.readers.container.opening import open_recording


def definition(chance: random.Random) -> str:
    """A message definition as nobody would write it."""
    way = chance.randrange(6)
    if way == 0:  # names itself, or each other
        return "Imu again\n" + "=" * 80 + "\nMSG: sensor_msgs/Imu\nsensor_msgs/Imu again\n" * chance.choice((1, 50))
    if way == 1:
        return f"uint8[{chance.choice(SIZES)}] data\nfloat64[{chance.choice(SIZES)}][{chance.choice(SIZES)}] more"
    if way == 2:  # a thousand levels
        levels = chance.choice((3, 1000))
        return "\n".join(f"{'=' * 80}\nMSG: p/T{k}\nT{k + 1}[{chance.choice((2, 1000))}] inner" for k in range(levels))
    if way == 3:
        return "(" * chance.choice((1, 5000)) + chance.choice(("", ")", "struct X { sequence<X, 4294967295> x; };"))
    if way == 4:
        return spoilt(b"std_msgs/Header header\nfloat64[9] covariance\n" * 20, chance).decode("utf-8", "replace")
    return chance.choice(("", "\0", "# none", "x" * 100_000, "{" * 3000, "uint8 A=" + "9" * 5000))


TOPICS = (("/points", "sensor_msgs/msg/PointCloud2"), ("/imu", "sensor_msgs/msg/Imu"), ("/own", "own_msgs/msg/Own"))


@cache
def payload(number: int) -> bytes:
    """Bytes of a message; which ones does not matter, for nothing is to understand them by their definition."""
    return b"\x00\x01\x00\x00" + random.Random(number).randbytes(40 + number)


def definitions(folder: Path, chance: random.Random) -> str:
    """A bag with such a definition in it, read message by message."""
    suffix = chance.choice((".bag", ".mcap", ".db3"))
    path = folder / f"room{suffix}"
    sent = [(topic, payload(k)) for k, (topic, _) in enumerate(TOPICS)]
    if suffix == ".bag":
        with Ros1Writer(path) as bag:
            for k, (topic, kind) in enumerate(TOPICS):
                made = bag.add_connection(topic, kind, msgdef=definition(chance), md5sum="0" * 32)
                bag.write(made, 1000 + k, payload(k))
    else:
        plugin = StoragePlugin.MCAP if suffix == ".mcap" else StoragePlugin.SQLITE3
        with Ros2Writer(folder / "made", version=9, storage_plugin=plugin) as writer:
            for k, (topic, kind) in enumerate(TOPICS):
                made = writer.add_connection(topic, kind, msgdef=definition(chance), rihs01="RIHS01_" + "0" * 64)
                writer.write(made, 1000 + k, payload(k))
        path = next(file for file in (folder / "made").iterdir() if file.suffix == suffix)
    try:
        with open_recording(path) as recording:
            got = [(message.topic, bytes(message.payload)) for message in recording.messages([t for t, _ in TOPICS])]
    except InputError as error:
        require("\n" not in str(error), f"more than one line: {error}")
        return "refused"
    require(got == sent, f"read otherwise: {got!r:.200}")
    return "taken"
