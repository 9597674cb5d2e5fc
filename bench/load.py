"""Many at once, and for long: `python -m bench.load [--browsers 20 --uploads 50 --upload-mb 200 --minutes 0]`.

Browsers hold a scene open and ask for what pages ask for, uploads come in four at a time in tus parts and are compared
and deleted, and two solves run beside them. With --minutes it all goes on for so long, and what the server holds is
looked at every ten seconds. Everything stays on the loopback; at most four uploads lie on the disk at a time.
What the server holds at rest is told too, after a first round and at the end: what grew between them was not given back.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import json
import os
import random
import statistics
import tempfile
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import viser
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

from bench.victim import TUS, Victim, running, until
from calib_core import api

MIB = 1 << 20
#: What a browser's page asks for, and how often.
PATHS = (
    "/api/info",
    "/api/recordings",
    "/api/recordings/{}",
    "/api/recordings/{}/planes",
    "/api/recordings/{}/jobs",
    "/",
)
PAUSE_S = 0.5
PART_BYTES = 32 * MIB
UPLOADERS = 4
SAMPLE_S = 10.0
#: Idle threads end after ten seconds, and jobs of the last upload with its recording.
REST_S = 25.0


@dataclass(frozen=True, slots=True)
class Held:
    """What the server's process holds at a moment."""

    memory_bytes: int
    descriptors: int
    threads: int


@dataclass
class Figures:
    """What was measured.

    waits_s: until each small request was answered.   own_s: the same without what the server's first thread, which holds
    the event loop, and the asking one stood in the kernel's queue for a processor: what is left where nobody else wants
    them, and an upper bound of it, for the server's other threads queue too.
    """

    waits_s: list[float] = field(default_factory=list)
    own_s: list[float] = field(default_factory=list)
    slow: list[str] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    uploads: int = 0
    scene_bytes: int = 0
    held: list[Held] = field(default_factory=list)
    rested: list[Held] = field(default_factory=list)
    lock: threading.Lock = field(default_factory=threading.Lock)


class Load:
    """Everybody who asks something of one server."""

    def __init__(self, victim: Victim, data_dir: Path, seed: int) -> None:
        self.figures = Figures()
        self._victim = victim
        self._data_dir = data_dir
        self._seed = seed
        self._over = threading.Event()
        self._recording_id = ""

    def prepare(self, bag: Path) -> None:
        """A recording that is read, and two solves of it that run."""
        made = self._victim.ask("PUT", "/api/recordings/upload?name=room.bag", body=bag.read_bytes())
        self._recording_id = str(json.loads(made.body)["id"])
        path = f"/api/recordings/{self._recording_id}/jobs"
        until(lambda: {job["state"] for job in json.loads(self._victim.ask("GET", path).body)} == {"done"})
        for _ in range(2):
            self._victim.ask("POST", path, headers={"Content-Type": "application/json"}, body=b'{"kind": "solve"}')

    def run(self, *, browsers: int, uploads: int, upload_bytes: int, minutes: float) -> None:
        """All of it, until the uploads are through and the time is over."""
        end_s = time.monotonic() + 60.0 * minutes
        self._over.clear()
        threads = [threading.Thread(target=self._browse, args=(k,), daemon=True) for k in range(browsers)]
        threads.append(threading.Thread(target=self._watch, daemon=True))
        for thread in threads:
            thread.start()
        number = 0
        with ThreadPoolExecutor(UPLOADERS) as pool:
            while number < uploads or time.monotonic() < end_s:
                batch = range(number, number + UPLOADERS)
                list(pool.map(lambda k: self._upload(k, upload_bytes), batch))
                number += UPLOADERS
        self._over.set()
        for thread in threads:
            thread.join(60)

    def rest(self) -> None:
        """What the server holds when nobody has asked for anything for a while."""
        time.sleep(REST_S)
        self.figures.rested.append(held_by(self._victim.process.pid))

    def _browse(self, number: int) -> None:
        scene = threading.Thread(target=self._look, daemon=True)
        scene.start()
        chance = random.Random(f"{self._seed} {number}")
        while not self._over.is_set():
            path = chance.choice(PATHS).format(self._recording_id)
            began_s, queued_s = time.monotonic(), self._queued_s()
            status = self._victim.ask("GET", path).status
            wait_s, queued_s = time.monotonic() - began_s, self._queued_s() - queued_s
            with self.figures.lock:
                self.figures.waits_s.append(wait_s)
                self.figures.own_s.append(max(0.0, wait_s - queued_s))
                if wait_s > 1.0:
                    self.figures.slow.append(
                        f"{wait_s:.2f} s ({max(0.0, wait_s - queued_s):.2f}) {path.split('/')[-1]}"
                    )
                if status >= 400:
                    self.figures.refused.append(f"{status} {path}")
            self._over.wait(chance.uniform(0.0, 2 * PAUSE_S))
        scene.join(60)

    def _queued_s(self) -> float:
        pid = self._victim.process.pid
        return queued_s(pid, pid) + queued_s(os.getpid(), threading.get_native_id())

    def _look(self) -> None:
        with scene_of(self._victim.port, self._recording_id) as scene:
            while not self._over.is_set():
                try:
                    message = scene.recv(timeout=1.0)
                except TimeoutError:
                    continue
                except ConnectionClosed:
                    return
                with self.figures.lock:
                    self.figures.scene_bytes += len(message)

    def _upload(self, number: int, size: int) -> None:
        content = random.Random(f"{self._seed} {number}").randbytes(MIB) * (size // MIB)
        lost = sent_whole(self._victim, self._data_dir, content)
        if lost:
            self.figures.lost.append(f"upload {number} {lost}")
        else:
            self.figures.uploads += 1

    def _watch(self) -> None:
        while not self._over.is_set():
            self.figures.held.append(held_by(self._victim.process.pid))
            self._over.wait(SAMPLE_S)


def scene_of(port: int, recording_id: str) -> ClientConnection:
    """A browser's connection to the scene of a recording."""
    where = f"ws://127.0.0.1:{port}/scene/{recording_id}"
    spoken = [Subprotocol(f"viser-v{viser.__version__}")]
    origin = Origin(f"http://127.0.0.1:{port}")
    return connect(where, origin=origin, subprotocols=spoken, proxy=None, max_size=None, open_timeout=120)


def sent_whole(victim: Victim, data_dir: Path, content: bytes, *, part_bytes: int = PART_BYTES) -> str:
    """A recording sent in parts, compared with what is stored, and deleted.   Returns what went wrong, if anything."""
    name = base64.b64encode(b"load.db3").decode()
    told = {**TUS, "Upload-Length": str(len(content)), "Upload-Metadata": f"filename {name}"}
    where = victim.ask("POST", "/api/uploads", headers=told).headers["location"]
    for start in range(0, len(content), part_bytes):
        status = victim.patch(where, start, content[start : start + part_bytes]).status
        if status != 204:
            return f"was answered {status} at {start}"
    recording_id = where.rsplit("/", 1)[-1]
    with (data_dir / "recordings" / recording_id / "source.db3").open("rb") as stored:
        same = hashlib.file_digest(stored, "sha256").digest() == hashlib.sha256(content).digest()
    victim.ask("DELETE", f"/api/recordings/{recording_id}")
    return "" if same else "is stored as something else"


def held_by(pid: int) -> Held:
    """What the process holds now."""
    lines = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines())
    return Held(
        memory_bytes=int(lines["VmRSS"].split()[0]) * 1024,
        descriptors=len(list(Path(f"/proc/{pid}/fd").iterdir())),
        threads=int(lines["Threads"]),
    )


def queued_s(pid: int, thread: int) -> float:
    """How long a thread has stood in the kernel's queue for a processor since it began; 0 where the kernel keeps no count."""
    try:
        return int(Path(f"/proc/{pid}/task/{thread}/schedstat").read_text(encoding="ascii").split()[1]) * 1e-9
    except OSError:
        return 0.0


def told(figures: Figures) -> Sequence[str]:
    """The figures in lines."""
    waits = figures.waits_s
    quarter = max(1, len(figures.held) // 4)
    lines = [
        f"requests: {len(waits)}, {shares(waits)}",
        f"without the queue for a processor: {shares(figures.own_s)}",
        f"over 1 s: {over_1_s(waits)}, without the queue {over_1_s(figures.own_s)}; slowest {slowest(figures.slow)}",
        f"refused: {len(figures.refused)} {figures.refused[:3]}",
        f"uploads: {figures.uploads}, lost: {figures.lost}; scenes sent {figures.scene_bytes / 1e6:.0f} MB",
        f"load average {os.getloadavg()[0]:.1f}",
    ]
    for name in ("memory_bytes", "descriptors", "threads"):
        values = [getattr(one, name) for one in figures.held]
        first, last = statistics.median(values[:quarter]), statistics.median(values[-quarter:])
        at_rest = ", ".join(f"{getattr(one, name)}" for one in figures.rested)
        lines.append(
            f"{name}: first quarter {first:.0f}, last quarter {last:.0f}, most {max(values)}; at rest {at_rest}"
        )
    return lines


def shares(waits_s: Sequence[float]) -> str:
    """How long so many of the requests took at most."""
    ordered = sorted(waits_s)
    at = {name: ordered[min(len(ordered) - 1, int(part * len(ordered)))] for name, part in SHARES.items()}
    return ", ".join(f"{name} {wait_s * 1e3:.0f} ms" for name, wait_s in at.items())


def over_1_s(waits_s: Sequence[float]) -> int:
    """How many took more than a second."""
    return sum(wait_s > 1.0 for wait_s in waits_s)


def slowest(lines: Sequence[str]) -> Sequence[str]:
    """The ten that took longest, and in brackets what is left of it without the queue for a processor."""
    return sorted(lines, key=lambda line: -float(line.split()[0]))[:10]


SHARES = {"median": 0.5, "99 %": 0.99, "99.9 %": 0.999, "slowest": 1.0}


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--browsers", type=int, default=20)
    parser.add_argument("--uploads", type=int, default=50)
    parser.add_argument("--upload-mb", type=int, default=200)
    parser.add_argument("--minutes", type=float, default=0.0)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="unsweep-load-") as folder:
        bag, data_dir = Path(folder) / "room.bag", Path(folder) / "data"
        api.simulate("paper-fast", bag, duration_s=3.0)
        with running(data_dir) as victim:
            load = Load(victim, data_dir, chosen.seed)
            load.prepare(bag)
            size = chosen.upload_mb * MIB
            load.run(browsers=chosen.browsers, uploads=UPLOADERS, upload_bytes=size, minutes=0.0)
            load.rest()
            load.run(browsers=chosen.browsers, uploads=chosen.uploads, upload_bytes=size, minutes=chosen.minutes)
            load.rest()
    print("\n".join(told(load.figures)))
    return 1 if load.figures.lost or load.figures.refused else 0


if __name__ == "__main__":
    raise SystemExit(main())
