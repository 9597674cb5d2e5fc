"""An hour of quiet use: `nice python -m bench.soak [--minutes 60 --log soak.csv]`.

Nobody is in a hurry here: pages ask a few times a second, scenes are opened, looked at and closed, streams of events are
left half-way, planes are edited and put back, a recording arrives and goes, and every five minutes a recording lives its
whole life: sent, read, solved, its answer taken away, deleted. A crowd comes before all of them, so that pools of threads
and of the store's connections have their full size from then on. Once a minute what the server holds is written down. What
is not given back shows as growth from the middle third of the minutes after the first ten to the last third: that is what
is judged, and by how much, not how fast anything was. Seeded; everything stays on the loopback.
"""

from __future__ import annotations

import argparse
import csv
import http.client
import json
import os
import random
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import astuple, dataclass, field, fields
from pathlib import Path

from websockets.exceptions import WebSocketException

from bench.load import PATHS, REST_S, held_by, scene_of, sent_whole
from bench.minutes import Minute, grown, table
from bench.victim import Victim, running, until
from calib_core import api

JSON = {"Content-Type": "application/json"}
MIB = 1 << 20
UPLOAD_BYTES = 16 * MIB
#: How often each kind of visitor comes, and for how long a scene or a stream is held [s].
ASK_S, SCENE_S, STREAM_S, EDIT_S, UPLOAD_S, LIFE_S = 0.3, 20.0, 15.0, 10.0, 30.0, 300.0
LOOK_S, LISTEN_S = 8.0, 3.0
#: A job's turn on a machine whose processors others want; nothing is judged by it.
JOB_PATIENCE_S = 3600.0
SAMPLE_S = 60.0
#: So many come at once in the beginning, each with so many requests.
CROWD, CROWD_REQUESTS = 40, 5
ENDED = {"done", "failed", "cancelled", "interrupted"}


@dataclass
class Seen:
    """What came of it.   wrong: every answer that should not have been."""

    minutes: list[Minute] = field(default_factory=list)
    waits_s: list[float] = field(default_factory=list)
    done: dict[str, int] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)
    requests: int = 0
    over_1_s: int = 0
    slowest_s: float = 0.0
    lock: threading.Lock = field(default_factory=threading.Lock)

    def answered(self, wait_s: float) -> None:
        """One small request more."""
        with self.lock:
            self.waits_s.append(wait_s)

    def count(self, what: str) -> None:
        """One more of that."""
        with self.lock:
            self.done[what] = self.done.get(what, 0) + 1


class Soak:
    """The visitors of one server."""

    def __init__(self, victim: Victim, data_dir: Path, bag: bytes, *, seed: int, log: Path) -> None:
        self.seen = Seen()
        self._victim = victim
        self._data_dir = data_dir
        self._bag = bag
        self._seed = seed
        self._log = log
        self._over = threading.Event()
        made = victim.ask("PUT", "/api/recordings/upload?name=room.bag", body=bag)
        self._recording_id = str(json.loads(made.body)["id"])
        self._ended(self._recording_id)

    def run(self, minutes: float) -> None:
        """All of them, for so long; the last minute's figures are those at rest."""
        with self._log.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerow([each.name for each in fields(Minute)])
        visits: list[tuple[float, Callable[[random.Random], None]]] = [
            (ASK_S, self._ask),
            (SCENE_S, self._look),
            (STREAM_S, self._listen),
            (EDIT_S, self._edit),
            (UPLOAD_S, self._upload),
            (LIFE_S, self._live),
        ]
        self._crowd()
        threads = [threading.Thread(target=self._come, args=visit, daemon=True) for visit in visits]
        for thread in threads:
            thread.start()
        end_s, number = time.monotonic() + 60.0 * minutes, 0
        while (left_s := end_s - time.monotonic()) > 0:
            time.sleep(min(SAMPLE_S, left_s))
            self._note(number := number + 1)
        self._over.set()
        for thread in threads:
            thread.join(600)
        time.sleep(REST_S)
        self._note(number + 1)

    def _crowd(self) -> None:
        def ask(number: int) -> None:
            for _ in range(CROWD_REQUESTS):
                self._ask(random.Random(f"{self._seed} {number}"))

        with ThreadPoolExecutor(CROWD) as pool:
            list(pool.map(ask, range(CROWD)))

    def _come(self, every_s: float, visit: Callable[[random.Random], None]) -> None:
        chance = random.Random(f"{self._seed} {visit.__name__}")
        while not self._over.wait(chance.uniform(0.5, 1.5) * every_s):
            try:
                visit(chance)
            except (OSError, ValueError, KeyError, http.client.HTTPException, WebSocketException) as error:
                self._wrong(f"{visit.__name__}: {error!r}")

    def _wrong(self, text: str) -> None:
        with self.seen.lock:
            self.seen.wrong.append(text)
        sys.stderr.write(text + "\n")

    def _small(self, method: str, path: str, body: bytes = b"", *, allowed: Sequence[int] = ()) -> bytes:
        began_s = time.monotonic()
        answer = self._victim.ask(method, path, headers=JSON if body else None, body=body)
        self.seen.answered(time.monotonic() - began_s)
        if answer.status >= 400 and answer.status not in allowed:
            self._wrong(f"{answer.status} {method} {path} {answer.body[:200]!r}")
        return answer.body

    def _ask(self, chance: random.Random) -> None:
        self._small("GET", chance.choice((*PATHS, "/api/storage", "/metrics")).format(self._recording_id))

    def _look(self, chance: random.Random) -> None:
        end_s = time.monotonic() + chance.uniform(0.2, 1.0) * LOOK_S
        with scene_of(self._victim.port, self._recording_id) as scene:
            while time.monotonic() < end_s:
                with suppress(TimeoutError):
                    scene.recv(timeout=1.0)
        self.seen.count("scenes")

    def _listen(self, chance: random.Random) -> None:
        connection = http.client.HTTPConnection("127.0.0.1", self._victim.port, timeout=30)
        connection.request("GET", f"/api/recordings/{self._recording_id}/events")
        answer = connection.getresponse()
        if answer.status != 200:
            self._wrong(f"a stream of events was answered {answer.status}")
        self._over.wait(chance.uniform(0.2, 1.0) * LISTEN_S)
        connection.close()
        self.seen.count("streams")

    def _edit(self, chance: random.Random) -> None:
        path = f"/api/recordings/{self._recording_id}/planes/operations"
        self._small("POST", path, json.dumps({"op": "toggle", "index": chance.randrange(3)}).encode())
        self._small("POST", path, b'{"op": "undo"}')
        self.seen.count("edits")

    def _upload(self, chance: random.Random) -> None:
        content = chance.randbytes(MIB) * (UPLOAD_BYTES // MIB)
        lost = sent_whole(self._victim, self._data_dir, content, part_bytes=4 * MIB)
        if lost:
            self._wrong(f"an upload {lost}")
        self.seen.count("uploads")

    def _live(self, _: random.Random) -> None:
        made = self._victim.ask("PUT", "/api/recordings/upload?name=room.bag", body=self._bag)
        recording_id = str(json.loads(made.body)["id"])
        try:
            self._lived(recording_id)
        finally:
            self._small("DELETE", f"/api/recordings/{recording_id}")

    def _lived(self, recording_id: str) -> None:
        self._ended(recording_id)
        job_id = self._job(recording_id, {"kind": "solve"})
        for what in ("", "/download", "/thickness", "/scans", "/report", "/export/urdf", "/scene.html"):
            self._small("GET", f"/api/results/{job_id}{what}", allowed=(409,))
        with scene_of(self._victim.port, recording_id) as scene:
            scene.recv(timeout=60)
        self.seen.count("whole lives")

    def _job(self, recording_id: str, wish: dict[str, str]) -> str:
        made = json.loads(self._small("POST", f"/api/recordings/{recording_id}/jobs", json.dumps(wish).encode()))
        self._ended(recording_id)
        return str(made["id"])

    def _ended(self, recording_id: str) -> None:
        path = f"/api/recordings/{recording_id}/jobs"

        def ended() -> bool:
            states = [str(job["state"]) for job in json.loads(self._victim.ask("GET", path).body)]
            return bool(states) and set(states) <= ENDED

        until(ended, JOB_PATIENCE_S)

    def _note(self, number: int) -> None:
        held = held_by(self._victim.process.pid)
        with self.seen.lock:
            waits_s, self.seen.waits_s = self.seen.waits_s, []
            self.seen.requests += len(waits_s)
            self.seen.over_1_s += sum(wait > 1.0 for wait in waits_s)
            self.seen.slowest_s = max([self.seen.slowest_s, *waits_s])
        now = Minute(
            minute=number,
            memory_bytes=held.memory_bytes,
            descriptors=held.descriptors,
            store_descriptors=store_descriptors(self._victim.process.pid),
            threads=held.threads,
            children=children_of(self._victim.process.pid),
            disk_bytes=sum(path.stat().st_size for path in self._data_dir.rglob("*") if path.is_file()),
            requests=len(waits_s),
            slowest_s=round(max(waits_s, default=0.0), 3),
            over_1_s=sum(wait > 1.0 for wait in waits_s),
            machine_load=round(os.getloadavg()[0], 1),
        )
        self.seen.minutes.append(now)
        with self._log.open("a", encoding="utf-8", newline="") as file:
            csv.writer(file).writerow(astuple(now))


def children_of(pid: int) -> int:
    """How many processes it has started that are there still, ended ones that nobody asked after included."""
    found = 0
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(OSError):
            found += len((task / "children").read_text(encoding="ascii").split())
    return found


def store_descriptors(pid: int) -> int:
    """How many of its descriptors are the store's, whose pool of connections keeps what it once had."""
    found = 0
    for path in Path(f"/proc/{pid}/fd").iterdir():
        with suppress(OSError):
            found += "unsweep.sqlite" in path.readlink().name
    return found


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--log", type=Path, default=Path("soak.csv"), help="a row a minute")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="unsweep-soak-") as folder:
        bag, data_dir = Path(folder) / "room.bag", Path(folder) / "data"
        api.simulate("paper-fast", bag, duration_s=3.0)
        with running(data_dir) as victim:
            soak = Soak(victim, data_dir, bag.read_bytes(), seed=chosen.seed, log=chosen.log)
            soak.run(chosen.minutes)
    print("\n".join(table(soak.seen.minutes)))
    print(f"done: {soak.seen.done}; requests {soak.seen.requests}, over 1 s {soak.seen.over_1_s}")
    found = grown(soak.seen.minutes[:-1])
    print(f"grown: {found}\nwrong: {len(soak.seen.wrong)} {soak.seen.wrong[:5]}")
    return 1 if found or soak.seen.wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
