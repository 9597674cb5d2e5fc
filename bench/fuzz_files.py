"""Spoilt bytes by the ten thousand: `python -m bench.fuzz_files [--count 20000 --seed 1 --only KIND ...]`.

Beside what `bench.fuzz_http` asks: archives whose headers lie, compressed chunks that are cut and flipped and declared to
be of any size, message definitions that name themselves, nest without end or have arrays of 2^31, and what a browser may
say to the scene. `tests.core.readers.damage` does the same with whole recordings, point by point.

Each is taken or refused in one sentence. Anything else is a defect: another exception, a byte beside the folder that was
given or beyond the limit, a message that reads otherwise than under its honest definition. Seeded: input n of a kind is
the same wherever it is run.
"""

from __future__ import annotations

import argparse
import bz2
import io
import math
import random
import resource
import shutil
import struct
import sys
import tarfile
import tempfile
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import lz4.frame
import msgspec
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer

from app.scene.messages import LONGEST_BYTES, admitted
from calib_core.errors import InputError
from calib_core.readers.container.archive import unpack_archive
from calib_core.readers.container.compression import OversizedChunk, bounded_bz2, bounded_lz4, bounded_zstd, zstd
from calib_core.readers.container.opening import open_recording

MIB = 1 << 20
#: What an archive of this run may unpack to.
ROOM_BYTES = MIB
#: Of sizes, counts and lengths: nothing, the edges of their types, and a lie by one.
SIZES = (0, 1, 2, 127, 128, 255, 256, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1, 2**63)
NAMES = (
    "room/room_0.mcap",
    "room_0.db3",
    "../../out.mcap",
    "/var/out.mcap",
    "room/../../x.bag",
    "C:\\room.bag",
    "a" * 3000 + ".bag",
    "ro\nom.bag",
    "\u202ebag.x.bag",
    ".bag",
    "room.txt",
    "again.zip",
    "",
)
TAR_SUFFIXES = (("room.tar", "w:"), ("room.tar.gz", "w:gz"), ("room.tar.bz2", "w:bz2"), ("room.tar.xz", "w:xz"))
TAR_TYPES = (
    tarfile.REGTYPE,
    tarfile.REGTYPE,
    tarfile.REGTYPE,
    tarfile.SYMTYPE,
    tarfile.LNKTYPE,
    tarfile.CHRTYPE,
    tarfile.FIFOTYPE,
    tarfile.DIRTYPE,
    tarfile.GNUTYPE_SPARSE,
    tarfile.XHDTYPE,
    tarfile.GNUTYPE_LONGNAME,
)


@dataclass
class Found:
    """What became of the inputs, by kind, and what should not have."""

    outcomes: dict[str, Counter[str]] = field(default_factory=dict)
    defects: list[str] = field(default_factory=list)

    @property
    def inputs(self) -> int:
        """How many there were."""
        return sum(sum(each.values()) for each in self.outcomes.values())


def spoilt(whole: bytes, chance: random.Random) -> bytes:
    """The bytes with some flipped, replaced by sizes, cut, doubled or moved; sometimes as they are."""
    damaged = bytearray(whole)
    for _ in range(chance.choice((0, 1, 1, 2, 5, 30))):
        if not damaged:
            break
        at = chance.randrange(len(damaged)) if chance.random() < 0.5 else chance.randrange(min(512, len(damaged)))
        way = chance.random()
        if way < 0.5:
            damaged[at] = chance.randrange(256)
        elif way < 0.75:
            raw = struct.pack("<Q", chance.choice(SIZES))[: chance.choice((2, 4, 8))]
            damaged[at : at + len(raw)] = raw
        elif way < 0.85:
            damaged[at:at] = damaged[at : at + chance.randrange(64)]
        elif len(damaged) > at + 1:
            del damaged[at : at + chance.randrange(1, 64)]
    if damaged and chance.random() < 0.2:
        del damaged[chance.randrange(len(damaged) + 1) :]
    return bytes(damaged) or b"\0"


def content(chance: random.Random) -> bytes:
    """Some bytes, which pack well or badly."""
    size = chance.choice((0, 1, 500, 20_000))
    return chance.randbytes(size) if chance.random() < 0.5 else bytes(size)


def zipped(folder: Path, chance: random.Random) -> Path:
    """A zip with odd members."""
    raw = io.BytesIO()
    with zipfile.ZipFile(raw, "w", chance.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as archive:
        for name in chance.sample(NAMES[: chance.choice((3, len(NAMES)))], chance.randrange(4)):
            info = zipfile.ZipInfo(name)
            info.compress_type = archive.compression
            archive.writestr(info, content(chance))
    path = folder / "room.zip"
    path.write_bytes(spoilt(raw.getvalue(), chance))
    return path


def tarred(folder: Path, chance: random.Random) -> Path:
    """A tar with odd members; spoilt before it is packed, or after."""
    name, mode = chance.choice(TAR_SUFFIXES)
    plain = io.BytesIO()
    with tarfile.open(
        fileobj=plain, mode="w:", format=chance.choice((tarfile.PAX_FORMAT, tarfile.GNU_FORMAT))
    ) as archive:
        for _ in range(chance.randrange(4)):
            member, body = tarfile.TarInfo(chance.choice(NAMES) or "x"), content(chance)
            member.size, member.type = len(body), chance.choice(TAR_TYPES)
            member.linkname = chance.choice(("", "/etc/passwd", "room_0.mcap"))
            if chance.random() < 0.2:
                member.pax_headers = {
                    chance.choice(("path", "size", "GNU.sparse.map", "x")): chance.choice(("9" * 30, "-1", "é"))
                }
            archive.addfile(member, io.BytesIO(body))
    inside = plain.getvalue()
    before = chance.random() < 0.5
    packed = packer(mode)(spoilt(inside, chance) if before else inside)
    path = folder / name
    path.write_bytes(packed if before else spoilt(packed, chance))
    return path


def packer(mode: str) -> Callable[[bytes], bytes]:
    """What packs a tar so."""
    import gzip
    import lzma

    pack: dict[str, Callable[[bytes], bytes]] = {
        "w:": bytes,
        "w:gz": lambda raw: gzip.compress(raw, 1),
        "w:bz2": lambda raw: bz2.compress(raw, 1),
        "w:xz": lambda raw: lzma.compress(raw, preset=0),
    }
    return pack[mode]


def archives(folder: Path, chance: random.Random) -> str:
    """An archive unpacked into a folder of its own."""
    path = chance.choice((zipped, tarred))(folder, chance)
    target = folder / "to"
    target.mkdir()
    try:
        unpack_archive(path, target, max_bytes=ROOM_BYTES)
        outcome = "taken"
    except InputError as error:
        require("\n" not in str(error), f"more than one line: {error}")
        outcome = "refused"
    left = {each.name for each in folder.iterdir()}
    require(left == {path.name, "to"}, f"beside the folder: {left}")
    files = list(target.rglob("*"))
    require(all(file.is_file() and not file.is_symlink() and file.parent == target for file in files), f"odd: {files}")
    require(all(file.name.isprintable() for file in files), f"names that break a line: {files}")
    total = sum(file.stat().st_size for file in files)
    require(total <= ROOM_BYTES + MIB, f"{total} bytes unpacked")
    return outcome


PACKED: tuple[tuple[Callable[[bytes], bytes], Callable[[bytes, int], bytes]], ...] = (
    (lambda raw: bz2.compress(raw, 1), bounded_bz2),
    (lz4.frame.compress, bounded_lz4),
    (zstd.compress, bounded_zstd),
)


def chunks(_: Path, chance: random.Random) -> str:
    """A compressed chunk, spoilt, and unpacked to a size that is right or is not."""
    honest = content(chance) * chance.choice((1, 1, 1, 10))
    pack, unpack = chance.choice(PACKED)
    packed = pack(honest)
    bytes_given = spoilt(packed, chance)
    most_bytes = chance.choice((len(honest), len(honest), max(0, len(honest) - 1), *SIZES))
    try:
        got = unpack(bytes_given, most_bytes)
    except (OversizedChunk, EOFError, OSError, RuntimeError, ValueError, zstd.ZstdError):
        # Of nothing, lz4's frames do not say that they end.
        fits = 0 < len(honest) <= most_bytes < 2**28
        require(bytes_given != packed or not fits, "an honest chunk was refused")
        return "refused"
    require(len(got) <= most_bytes, f"{len(got)} bytes of at most {most_bytes}")
    require(bytes_given != packed or got == honest, "an honest chunk came out otherwise")
    return "taken"


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


VECTOR = (0.0, 0.0, 0.0)
SAID: tuple[dict[str, object], ...] = (
    {
        "type": "ViewerCameraMessage",
        "wxyz": (1.0, 0.0, 0.0, 0.0),
        "position": VECTOR,
        "fov": 1.2,
        "near": 0.1,
        "far": 1000,
        "image_height": 600,
        "image_width": 800,
        "look_at": VECTOR,
        "up_direction": (0.0, 0.0, 1.0),
    },
    {
        "type": "SceneNodeClickMessage",
        "name": "/patch/0",
        "instance_index": None,
        "ray_origin": VECTOR,
        "ray_direction": (1.0, 0.0, 0.0),
        "screen_pos": (0.5, 0.5),
        "modifier": None,
        "owner": "",
    },
    {
        "type": "ScenePointerMessage",
        "event_type": "rect-select",
        "ray_origin": None,
        "ray_direction": None,
        "screen_pos": ((0.1, 0.1), (0.9, 0.9)),
        "modifier": "shift",
    },
)
ODD: tuple[object, ...] = (
    *(None, True, -1, 2**63, math.nan, math.inf, -math.inf, 1e308, "", "x" * 5000, b"\xff", [], {}, [[]] * 50),
    *("ShareUrlRequest", "RunJavascriptMessage", "ViewerCameraMessage", (math.nan,) * 3, (1e9,) * 3),
)


def said(_: Path, chance: random.Random) -> str:
    """What a browser says to the scene."""
    message = dict(chance.choice(SAID))
    for _turn in range(chance.choice((0, 1, 1, 2))):
        key = chance.choice([*message, "extra", "uuid"])
        message[key] = chance.choice(ODD)
        if chance.random() < 0.2:
            message.pop(key)
    raw = msgspec.msgpack.encode(message)
    passed = admitted(spoilt(raw, chance) if chance.random() < 0.5 else raw)
    if passed is None:
        return "refused"
    kinds = {each["type"] for each in SAID}
    require(msgspec.msgpack.decode(passed)["type"] in kinds, "of another kind")
    require(len(passed) <= 2 * LONGEST_BYTES, "too long")
    require(all(math.isfinite(number) for number in numbers(msgspec.msgpack.decode(passed))), "no number")
    return "taken"


def numbers(value: object) -> Iterator[float]:
    """All numbers somewhere in a value."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, (list, tuple)):
        for inner in value:
            yield from numbers(inner)
    elif isinstance(value, (int, float)):
        yield value


class DefectError(Exception):
    """Something that must not be."""


def require(holds: bool, text: str) -> None:
    """It must hold."""
    if not holds:
        raise DefectError(text)


#: The kinds, and how large a share of the inputs each is: what opens files takes longest.
KINDS: dict[str, tuple[Callable[[Path, random.Random], str], float]] = {
    "archives": (archives, 0.3),
    "chunks": (chunks, 0.23),
    "definitions": (definitions, 0.02),
    "said to the scene": (said, 0.45),
}


def run(count: int, seed: int, folder: Path, *, only: tuple[str, ...] = tuple(KINDS)) -> Found:
    """So many inputs of the kinds together."""
    found = Found()
    shares = sum(KINDS[name][1] for name in only)
    for name in only:
        given, share = KINDS[name]
        outcomes = found.outcomes[name] = Counter()
        for number in range(round(count * share / shares)):
            own = folder / "one"
            own.mkdir()
            try:
                outcomes[given(own, random.Random(f"{seed} {name} {number}"))] += 1
            except Exception as error:  # noqa: BLE001 - whatever else it is, is what is looked for
                outcomes["defect"] += 1
                found.defects.append(f"{name} {seed} {number}: {error!r:.300}")
            shutil.rmtree(own)
    return found


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="+", choices=list(KINDS), default=list(KINDS))
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="unsweep-fuzz-") as folder:
        found = run(chosen.count, chosen.seed, Path(folder), only=tuple(chosen.only))
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    for name, outcomes in found.outcomes.items():
        sys.stdout.write(f"{name}: {dict(outcomes)}\n")
    sys.stdout.write(f"inputs {found.inputs}, defects {len(found.defects)}, peak memory {peak_mb:.0f} MiB\n")
    for defect in found.defects[:20]:
        sys.stdout.write(defect + "\n")
    return 1 if found.defects else 0


if __name__ == "__main__":
    raise SystemExit(main())
