"""Files that unpack to far more than they hold, sent to a server: `python -m bench.bombs`.

While each is read, somebody else asks for the list of recordings, again and again. Told for each: what became of it, how
long the longest of these answers took, and what its jobs had in memory at most.
"""

from __future__ import annotations

import gzip
import io
import json
import sys
import tarfile
import tempfile
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from bench.kills import workers
from bench.victim import Victim, running

MIB = 1 << 20
#: What each unpacks to: several times the limit of a chunk, and far beyond a hundred times its own size.
UNPACKED_BYTES = 1024 * MIB
ENDED = {"done", "failed", "cancelled", "interrupted"}
ASK_EVERY_S = 0.02


class Zeros(io.RawIOBase):
    """So many zeros, which nobody has to hold in memory."""

    def __init__(self, size: int) -> None:
        self._left = size

    def readable(self) -> bool:
        """It is."""
        return True

    def read(self, size: int = -1) -> bytes:
        """The next ones."""
        size = self._left if size < 0 else min(size, self._left)
        self._left -= size
        return bytes(size)


def zipped(folder: Path) -> Path:
    """One deflated file in a zip."""
    path = folder / "zipped.zip"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("room/room_0.mcap", "w", force_zip64=True) as out,
    ):
        for _ in range(UNPACKED_BYTES // MIB):
            out.write(bytes(MIB))
    return path


def tarred(folder: Path) -> Path:
    """One file in a compressed tar."""
    path = folder / "tarred.tar.gz"
    with tarfile.open(path, "w:gz", compresslevel=1) as archive:
        member = tarfile.TarInfo("room/room_0.mcap")
        member.size = UNPACKED_BYTES
        archive.addfile(member, Zeros(UNPACKED_BYTES))
    return path


def long_header(folder: Path) -> Path:
    """An attribute as long as all that before a tar's file."""
    path = folder / "long-header.tar.gz"
    header = tarfile.TarInfo("././@PaxHeader")
    header.type, header.size = tarfile.XHDTYPE, UNPACKED_BYTES
    with gzip.open(path, "wb", compresslevel=1) as out:
        out.write(header.tobuf())
        for _ in range(UNPACKED_BYTES // MIB):
            out.write(bytes(MIB))
    return path


def chunk(folder: Path, packing: Writer.CompressionFormat) -> Path:
    """A bag with one message in one compressed chunk."""
    path = folder / f"chunk-{packing.name.lower()}.bag"
    writer = Writer(path)
    writer.set_compression(packing)
    with writer:
        kind = "sensor_msgs/msg/PointCloud2"
        made = writer.add_connection("/points", kind, typestore=get_typestore(Stores.ROS1_NOETIC))
        writer.write(made, 0, bytes(UNPACKED_BYTES))
    return path


BOMBS: tuple[Callable[[Path], Path], ...] = (
    zipped,
    tarred,
    long_header,
    lambda folder: chunk(folder, Writer.CompressionFormat.BZ2),
    lambda folder: chunk(folder, Writer.CompressionFormat.LZ4),
)


@dataclass
class Meanwhile:
    """What others saw while a file was read.   peak_bytes: of the job that had most in memory."""

    asked: int = 0
    slowest_s: float = 0.0
    peak_bytes: int = 0

    def __str__(self) -> str:
        """In a line."""
        return f"{self.asked} answers, slowest {self.slowest_s * 1e3:.0f} ms; a job had {self.peak_bytes / MIB:.0f} MiB"


def read(victim: Victim, path: Path) -> tuple[Meanwhile, list[str]]:
    """What others saw while the server read the file, and how its jobs ended."""
    seen, over = Meanwhile(), threading.Event()
    asking = threading.Thread(target=ask, args=(victim, seen, over))
    asking.start()
    try:
        sent = victim.ask("PUT", f"/api/recordings/upload?name={path.name}", body=path.read_bytes())
        jobs = f"/api/recordings/{json.loads(sent.body)['id']}/jobs"
        while True:
            seen.peak_bytes = max([seen.peak_bytes, *peaks(victim)])
            found = json.loads(victim.ask("GET", jobs).body)
            if {job["state"] for job in found} <= ENDED:
                return seen, [f"{job['kind']}: {(job['error'] or {}).get('text', job['state'])}" for job in found]
            time.sleep(ASK_EVERY_S)
    finally:
        over.set()
        asking.join()


def ask(victim: Victim, seen: Meanwhile, over: threading.Event) -> None:
    """Ask for the list until it is over."""
    while not over.is_set():
        began_s = time.monotonic()
        victim.ask("GET", "/api/recordings")
        seen.slowest_s = max(seen.slowest_s, time.monotonic() - began_s)
        seen.asked += 1
        time.sleep(ASK_EVERY_S)


def peaks(victim: Victim) -> Iterator[int]:
    """What each job that runs had in memory at most."""
    for worker in workers(victim):
        with suppress(OSError, StopIteration):
            lines = Path(f"/proc/{worker}/status").read_text(encoding="ascii").splitlines()
            yield next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) * 1024


def main() -> None:
    """All bombs, one after the other."""
    with tempfile.TemporaryDirectory(prefix="unsweep-bombs-") as name, running(Path(name) / "data") as victim:
        for make in BOMBS:
            path = make(Path(name))
            seen, ends = read(victim, path)
            sys.stdout.write(f"{path.name} ({path.stat().st_size / 1e3:.0f} kB): {seen}\n")
            sys.stdout.writelines(f"    {end}\n" for end in ends)
            path.unlink()


if __name__ == "__main__":
    main()
