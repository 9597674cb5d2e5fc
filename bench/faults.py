"""Uploads under kills, stops and full disks: `python -m bench.faults [--rounds 200] [--seed 1]`.

Each round announces an upload, ends it in one of five ways at a seeded random moment, takes it up again, and compares
what is stored with what was sent by SHA-256. Between rounds the server is the one that the last kill left behind.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import json
import random
import resource
import signal
import statistics
import tempfile
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from bench.victim import TUS, Victim, running, until

#: The ways a round can go.
WAYS = ("killed in a PATCH", "stopped in a PATCH", "killed at the end", "cut connection", "full disk")
MIB = 1 << 20


@dataclass
class Tally:
    """What was seen over all rounds."""

    ways: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    lost_acknowledged: int = 0
    starts_s: list[float] = field(default_factory=list)
    resent_bytes: int = 0

    def median_start_s(self) -> float:
        """How long a server usually took until it answered."""
        return statistics.median(self.starts_s)


@dataclass(frozen=True, slots=True)
class Upload:
    """One upload under way: where, what, and how much of it the server has acknowledged."""

    where: str
    content: bytes
    acknowledged: int

    @property
    def recording_id(self) -> str:
        """The recording it becomes."""
        return self.where.rsplit("/", 1)[-1]


def begin(victim: Victim, chance: random.Random) -> Upload:
    """A new upload, with a first part that was answered."""
    content = chance.randbytes(chance.randrange(MIB, 12 * MIB))
    name = base64.b64encode(b"room.bag").decode()
    told = {**TUS, "Upload-Length": str(len(content)), "Upload-Metadata": f"filename {name}"}
    where = victim.ask("POST", "/api/uploads", headers=told).headers["location"]
    first = chance.randrange(len(content) // 2)
    answer = victim.patch(where, 0, content[:first])
    if answer.status != 204:
        raise RuntimeError(f"the first part was answered {answer.status}")
    return Upload(where, content, first)


def disturb(victim: Victim, upload: Upload, way: str, chance: random.Random) -> None:
    """Send the rest, and end it in that way."""
    begun, size = upload.acknowledged, len(upload.content)
    if way == "full disk":
        limit = resource.prlimit(victim.process.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(victim.process.pid, resource.RLIMIT_FSIZE, (max(begun, 4 * MIB), limit[1]))
        status = victim.patch(upload.where, begun, upload.content[begun:]).status
        resource.prlimit(victim.process.pid, resource.RLIMIT_FSIZE, limit)
        if status not in {204, 507}:
            raise RuntimeError(f"a full disk was answered {status}")
        return
    with victim.patch_begun(upload.where, begun, size - begun) as sock:
        until_byte = size if way == "killed at the end" else chance.randrange(begun, size)
        sock.sendall(upload.content[begun:until_byte])
        time.sleep(chance.uniform(0.0, 0.06))
        if way == "stopped in a PATCH":
            victim.process.send_signal(signal.SIGTERM)
            victim.process.wait()
        elif way != "cut connection":
            victim.kill()


def finish(victim: Victim, upload: Upload, data_dir: Path, tally: Tally) -> None:
    """Go on where the server says; compare what is stored with what was sent."""
    offset = victim.offset(upload.where)
    tally.lost_acknowledged += offset < upload.acknowledged
    tally.resent_bytes += len(upload.content) - offset
    if offset < len(upload.content):
        until(lambda: victim.patch(upload.where, victim.offset(upload.where), b"").status != 423)
        offset = victim.offset(upload.where)
        answer = victim.patch(upload.where, offset, upload.content[offset:])
        if answer.status != 204:
            tally.wrong.append(f"{upload.where}: {answer.status} {answer.body[:200]!r}")
            return
    stored = (data_dir / "recordings" / upload.recording_id / "source.bag").read_bytes()
    if hashlib.sha256(stored).digest() != hashlib.sha256(upload.content).digest():
        tally.wrong.append(f"{upload.where}: {len(stored)} bytes stored of {len(upload.content)}")
    shown = json.loads(victim.ask("GET", f"/api/recordings/{upload.recording_id}").body)
    if shown["size_bytes"] != len(upload.content) or shown["state"] == "receiving":
        tally.wrong.append(f"{upload.where}: shown as {shown['state']} with {shown['size_bytes']} bytes")
    victim.ask("DELETE", f"/api/recordings/{upload.recording_id}")


class Servers:
    """The server of the moment: another one is started where the last has ended."""

    def __init__(self, data_dir: Path, tally: Tally, *, entry: str = "app.work.ready:run_job") -> None:
        self._entry = entry
        self._data_dir = data_dir
        self._tally = tally
        self._stack = ExitStack()
        self._victim: Victim | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def one(self) -> Victim:
        """A server that runs."""
        if self._victim is None or self._victim.process.poll() is not None:
            self._stack.close()
            started_s = time.monotonic()
            self._victim = self._stack.enter_context(running(self._data_dir, entry=self._entry))
            self._tally.starts_s.append(time.monotonic() - started_s)
        return self._victim


def run(rounds: int, seed: int, data_dir: Path) -> Tally:
    """All rounds."""
    tally, chance = Tally(), random.Random(seed)
    with Servers(data_dir, tally) as servers:
        for number in range(rounds):
            way = WAYS[number % len(WAYS)]
            upload = begin(servers.one(), chance)
            disturb(servers.one(), upload, way, chance)
            finish(servers.one(), upload, data_dir, tally)
            tally.ways[way] += 1
            print(f"round {number}: {way}; wrong so far: {len(tally.wrong)}", flush=True)
    return tally


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="unsweep-faults-") as folder:
        tally = run(chosen.rounds, chosen.seed, Path(folder))
    print(f"rounds: {dict(tally.ways)}")
    print(f"wrong bytes or half shown: {len(tally.wrong)}; acknowledged bytes lost: {tally.lost_acknowledged}")
    print(f"starts: {len(tally.starts_s)}, slowest {max(tally.starts_s):.1f} s, median {tally.median_start_s():.1f} s")
    print(f"sent again: {tally.resent_bytes / MIB:.0f} MiB")
    for line in tally.wrong:
        print(line)
    return 1 if tally.wrong or tally.lost_acknowledged else 0


if __name__ == "__main__":
    raise SystemExit(main())
