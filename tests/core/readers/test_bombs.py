"""Files that unpack to far more than they hold end in one sentence, within their limits of memory and disk.

Memory is what the process asked the kernel for beyond what it had, with the limits made small: the bound is checked
against the setting, not against a number of the day.
"""

from __future__ import annotations

import bz2
import gzip
import io
import os
import struct
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import numpy as np
import pytest

from calib_core.errors import UnreadableRecording
from calib_core.readers.container.archive import unpack_archive
from calib_core.readers.container.compression import OversizedChunk, bounded_bz2, bounded_lz4, bounded_zstd, zstd
from calib_core.readers.container.limits import LIMITS, MIB
from calib_core.readers.container.opening import decompressed_file
from calib_core.readers.container.recover_ros1 import _decompressed

ROOT = Path(__file__).resolve().parents[3]
ZEROS = bytes(64 * MIB)


def zipped(folder: Path) -> Path:
    with zipfile.ZipFile(folder / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("room/room_0.mcap", ZEROS)
    return folder / "bomb.zip"


def tarred(folder: Path) -> Path:
    with tarfile.open(folder / "bomb.tar.gz", "w:gz") as archive:
        member = tarfile.TarInfo("room/room_0.mcap")
        member.size = len(ZEROS)
        archive.addfile(member, io.BytesIO(ZEROS))
    return folder / "bomb.tar.gz"


def unwanted(folder: Path) -> Path:
    """What nobody asks for has to be unpacked too, to get past it."""
    with tarfile.open(folder / "bomb.tgz", "w:gz") as archive:
        for name, content in (("readme.txt", ZEROS), ("room_0.mcap", b"x")):
            member = tarfile.TarInfo(name)
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))
    return folder / "bomb.tgz"


def long_header(folder: Path) -> Path:
    """An attribute of 64 MB before the file, which tarfile reads whole."""
    header = tarfile.TarInfo("././@PaxHeader")
    header.type, header.size = tarfile.XHDTYPE, len(ZEROS)
    with gzip.open(folder / "bomb.tar.gz", "wb") as out:
        out.write(header.tobuf() + ZEROS + bytes(1024))
    return folder / "bomb.tar.gz"


def with_holes(folder: Path) -> Path:
    """A file that is declared to be 8 TB of nothing."""
    member = tarfile.TarInfo("room_0.mcap")
    member.type = tarfile.GNUTYPE_SPARSE
    raw = bytearray(member.tobuf(tarfile.GNU_FORMAT))
    raw[483:495] = b"%011o\0" % (2**33 - 1)
    raw[148:156] = b"        "
    raw[148:156] = b"%06o\0 " % sum(raw[:512])
    (folder / "bomb.tar").write_bytes(bytes(raw) + bytes(1024))
    return folder / "bomb.tar"


def many_files(folder: Path) -> Path:
    with zipfile.ZipFile(folder / "bomb.zip", "w") as archive:
        for k in range(LIMITS.archive_entries + 1):
            archive.writestr(f"{k}.txt", b"")
    return folder / "bomb.zip"


def odd_method(folder: Path) -> Path:
    with zipfile.ZipFile(folder / "bomb.zip", "w", zipfile.ZIP_BZIP2) as archive:
        archive.writestr("room_0.mcap", ZEROS)
    return folder / "bomb.zip"


def nested(folder: Path) -> Path:
    with zipfile.ZipFile(folder / "bomb.zip", "w") as archive:
        archive.writestr("again.zip", b"PK")
    return folder / "bomb.zip"


@pytest.mark.parametrize(
    "bomb",
    [zipped, tarred, unwanted, long_header, with_holes, many_files, odd_method, nested],
    ids=lambda b: b.__name__,
)
def test_an_archive_that_unpacks_to_too_much_is_one_sentence(bomb: Callable[[Path], Path], tmp_path: Path) -> None:
    """Oracle: the bytes that lie in the folder. Mutations: no ratio, no bound on a header's size, on the count, on seeks."""
    path = bomb(tmp_path)
    (tmp_path / "to").mkdir()
    with pytest.raises(UnreadableRecording) as refused:
        unpack_archive(path, tmp_path / "to")
    assert "\n" not in str(refused.value)
    if bomb is long_header:
        assert "header of" in str(refused.value)  # before it is read, not after
    assert sum(file.stat().st_size for file in (tmp_path / "to").iterdir()) <= LIMITS.unpacked_least_bytes + MIB


def test_what_honest_recorders_pack_is_within_the_limits(tmp_path: Path) -> None:
    """Mutation: a ratio of 2, which zeros between messages pass."""
    content = bytes(range(256)) * 8192 + bytes(6 * MIB)
    for name, mode in (("a.tar", "w:"), ("a.tar.gz", "w:gz"), ("a.tar.bz2", "w:bz2"), ("a.tar.xz", "w:xz")):
        with tarfile.open(tmp_path / name, mode) as archive:
            member = tarfile.TarInfo("room_0.mcap")
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))
        to = tmp_path / f"{name}.to"
        to.mkdir()
        assert (unpack_archive(tmp_path / name, to) / "room_0.mcap").read_bytes() == content


@pytest.mark.parametrize(
    ("pack", "unpack"),
    [(bz2.compress, bounded_bz2), (lz4.frame.compress, bounded_lz4), (zstd.compress, bounded_zstd)],
    ids=["bz2", "lz4", "zstd"],
)
def test_a_chunk_is_unpacked_up_to_its_limit_and_no_further(
    pack: Callable[[bytes], bytes], unpack: Callable[[bytes, int], bytes]
) -> None:
    """And as many frames as follow one another: joined files, and what compressors of several cores write.

    Oracle: the libraries' own one-shot functions. Mutations: checking the size after unpacking everything; the first frame alone.
    """
    honest = np.random.default_rng(1).integers(0, 16, 2 * MIB + 9, dtype=np.uint8).tobytes()
    packed = pack(honest)
    assert unpack(packed, len(honest)) == honest
    with pytest.raises(OversizedChunk):
        unpack(packed, len(honest) - 1)
    with pytest.raises(OversizedChunk, match="says"):
        unpack(packed, 2**40)
    with pytest.raises((EOFError, RuntimeError, ValueError)):
        unpack(packed[:-20], len(honest))
    joined = packed + pack(b"") + pack(b"more") + pack(b"still more")
    assert unpack(joined, 3 * MIB) == honest + b"more" + b"still more"
    with pytest.raises(OversizedChunk):
        unpack(joined, len(honest) + 4)
    if unpack is not bounded_zstd:
        compression = b"bz2" if unpack is bounded_bz2 else b"lz4"
        assert _decompressed(compression, packed) == honest
        assert _decompressed(compression, joined) == honest + b"more" + b"still more"
        assert honest.startswith(_decompressed(compression, packed[: len(packed) // 2]))


@pytest.mark.parametrize("cut", [0, 9])
def test_a_compressed_file_is_unpacked_frame_by_frame(cut: int, tmp_path: Path) -> None:
    """Three frames that end where blocks of the file do not, whole and cut in the last one. Oracle: what was packed.

    Seen: of a file made of two, and of what `pzstd` writes, the first frame was read and the rest was not missed. Mutation: that.
    """
    noise = np.random.default_rng(2).integers(0, 256, 3 * MIB + 7, dtype=np.uint8).tobytes()
    parts = [noise[: MIB + 3], noise[MIB + 3 : 2 * MIB], noise[2 * MIB :]]
    path = tmp_path / "room.mcap.zstd"
    packed = b"".join(zstd.compress(part) for part in parts)
    path.write_bytes(packed[: len(packed) - cut])
    unpacked = decompressed_file(path, tmp_path).read_bytes()
    assert noise.startswith(unpacked)
    assert len(unpacked) == len(noise) if not cut else 2 * MIB < len(unpacked) < len(noise)


def test_a_compressed_file_is_unpacked_within_the_ratio(tmp_path: Path) -> None:
    """Mutation: one call of the decompressor for each MB read: 1 MB of zstd is 30 GB of zeros in memory."""
    path = tmp_path / "room.mcap.zstd"
    path.write_bytes(zstd.compress(ZEROS))
    with pytest.raises(UnreadableRecording, match="unpacks to more"):
        decompressed_file(path, tmp_path)


def test_a_compressed_file_is_unpacked_whole_of_however_many_frames(tmp_path: Path) -> None:
    """As parallel compressors and `cat` write them, with frames among them that hold nothing; a cut one as far as it goes.
    Oracle: the bytes. Mutations: the first frame's end taken for the file's, in silence; what came before a cut thrown away."""
    first, second = bytes(range(256)) * 5000, np.random.default_rng(3).bytes(2_000_000)
    nothing = struct.pack("<II", 0x184D2A50, 7) + b"nothing"
    path = tmp_path / "room.mcap.zstd"
    path.write_bytes(nothing + zstd.compress(first) + nothing + zstd.compress(second))
    assert decompressed_file(path, tmp_path).read_bytes() == first + second
    path.write_bytes(path.read_bytes()[:-500_000])
    found = decompressed_file(path, tmp_path).read_bytes()
    assert (first + second).startswith(found)
    assert len(found) > len(first) + 1_000_000
    path.write_bytes(path.read_bytes()[:20])
    with pytest.raises(UnreadableRecording, match="not valid zstd"):
        decompressed_file(path, tmp_path)


def ros1_bomb(path: Path, size: int) -> None:
    """A regular bag of one chunk of zeros, bz2, with an index that points into it."""
    chunk = bz2.compress(bytes(size), 9)

    def record(fields: dict[bytes, bytes], content: bytes) -> bytes:
        header = b"".join(
            struct.pack("<I", len(name) + 1 + len(value)) + name + b"=" + value for name, value in fields.items()
        )
        return struct.pack("<I", len(header)) + header + struct.pack("<I", len(content)) + content

    start = len(b"#ROSBAG V2.0\n") + 4096
    chunk_record = record({b"op": b"\x05", b"compression": b"bz2", b"size": struct.pack("<I", size)}, chunk)
    index = record(
        {b"op": b"\x04", b"ver": struct.pack("<I", 1), b"conn": bytes(4), b"count": struct.pack("<I", 1)}, bytes(12)
    )
    inner = record({b"topic": b"/points", b"type": b"sensor_msgs/PointCloud2", b"md5sum": b"*"}, b"")
    fields = inner[4 : 4 + struct.unpack_from("<I", inner)[0]]
    fields += struct.pack("<I", len(b"message_definition=")) + b"message_definition="
    connection = record({b"op": b"\x07", b"conn": bytes(4), b"topic": b"/points"}, fields)
    info = record(
        {
            b"op": b"\x06",
            b"ver": struct.pack("<I", 1),
            b"chunk_pos": struct.pack("<Q", start),
            b"start_time": bytes(8),
            b"end_time": bytes(8),
            b"count": struct.pack("<I", 1),
        },
        struct.pack("<II", 0, 1),
    )
    index_pos = start + len(chunk_record) + len(index)
    first = {b"op": b"\x03", b"index_pos": struct.pack("<Q", index_pos), b"conn_count": struct.pack("<I", 1)}
    head = record({**first, b"chunk_count": struct.pack("<I", 1)}, b"")
    head = head[:-4] + struct.pack("<I", 4096 - len(head)) + b" " * (4096 - len(head))
    path.write_bytes(b"#ROSBAG V2.0\n" + head + chunk_record + index + connection + info)


SMALL_CHUNK_BYTES = 16 * MIB
#: The limits are read when modules are loaded: the smaller ones have to be there first.
PROGRAM = """
import dataclasses, importlib.util, sys
from pathlib import Path
spec = importlib.util.spec_from_file_location("calib_core.readers.container.limits", sys.argv[2])
limits = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(limits)
limits.LIMITS = dataclasses.replace(limits.LIMITS, chunk_bytes=int(sys.argv[3]))
from calib_core.readers.container.opening import open_recording
from calib_core.readers.container import compression, ros1_index
def peak():  # of this program alone: getrusage also knows what started it
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) * 1024
before = peak()
with open_recording(Path(sys.argv[1])) as recording:
    print([topic.name for topic in recording.topics], sum(1 for _ in recording.messages(["/points"])))
for name in ("bz2", "lz4", "zstd"):
    unpack = getattr(compression, f"bounded_{name}")
    stored = Path(sys.argv[1]).with_suffix(f".{name}").read_bytes()
    try:
        unpack(stored)
    except compression.OversizedChunk:
        print(name, "is too large")
    print(len(unpack(Path(sys.argv[1]).with_suffix(f".{name}-fits").read_bytes())))
print(peak() - before)
"""


def test_bags_and_chunks_of_a_few_kilobytes_stay_within_memory(tmp_path: Path) -> None:
    """Oracle: the kernel's count of a process's memory at its peak, for bombs and for chunks that just fit.

    Mutations: rosbags' own decompressors; pieces in a list, which are there twice when they are joined.
    """
    path = tmp_path / "bomb.bag"
    ros1_bomb(path, 3 * SMALL_CHUNK_BYTES)
    assert path.stat().st_size < 10_000
    for name, pack in (("bz2", bz2.compress), ("lz4", lz4.frame.compress), ("zstd", zstd.compress)):
        path.with_suffix(f".{name}").write_bytes(pack(bytes(3 * SMALL_CHUNK_BYTES)))
        path.with_suffix(f".{name}-fits").write_bytes(pack(bytes(SMALL_CHUNK_BYTES)))
    limits = str(ROOT / "calib_core" / "readers" / "container" / "limits.py")
    told = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(path), limits, str(SMALL_CHUNK_BYTES)],
        cwd=ROOT,
        env={**os.environ, "MALLOC_MMAP_THRESHOLD_": str(MIB // 8)},  # as what is larger is always allocated
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
    fits = str(SMALL_CHUNK_BYTES)
    assert told[:-1] == [
        "['/points'] 0",
        *(line for n in ("bz2", "lz4", "zstd") for line in (f"{n} is too large", fits)),
    ]
    assert int(told[-1]) < 1.5 * SMALL_CHUNK_BYTES
