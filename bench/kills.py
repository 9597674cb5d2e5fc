"""Jobs under kills, stops and full disks: `python -m bench.kills [--rounds 120] [--seed 1]`.

Each round lets a job get somewhere, ends its worker or its server there at a seeded random moment, has a server again,
and looks: the recording is the one that was sent, nothing half made is shown, and what is said to be done is right.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import resource
import shutil
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import cycle, islice
from pathlib import Path
from typing import cast

from bench.faults import Servers, Tally
from bench.kill_jobs import KEPT
from bench.victim import Victim, until
from calib_core import api

Json = dict[str, object]
WHAT = ("server killed", "worker killed", "server stopped", "full disk")
WHERE = ("reading", "solving", "writing")
ENDED = {"done", "failed", "cancelled", "interrupted"}
#: What a solve leaves behind before its document, in order: marks of how far its writing has come.
MARKS = ("trajectory.npz", "thickness.json", "scans.json", "evidence.json", "reading.json", "result.part.json")
#: The longest a round's moment lies behind its mark: about as long as what follows the mark takes.
LATEST_S = {"reading": 4.0, "solving": 1.0, "writing": 0.4}


@dataclass
class Seen:
    """What was seen over all rounds.   ended: states in which the disturbed jobs were found."""

    ways: Counter[str] = field(default_factory=Counter)
    ended: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    checked_results: int = 0


class Rounds:
    """All rounds over one data directory."""

    def __init__(self, servers: Servers, data_dir: Path, chance: random.Random, *, hurry: float = 1.0) -> None:
        """Begin.   hurry: how much of the time between a mark and a round's moment is waited."""
        self.seen = Seen()
        self._hurry = hurry
        self._servers = servers
        self._data_dir = data_dir
        self._chance = chance
        self._recording_id = ""
        self._sent = b""
        self._answer: object = None

    def prepare(self, bag: Path, kept: Path) -> None:
        """A recording that has been read and really solved once; the answer is kept for all rounds."""
        victim = self._servers.one()
        content = bag.read_bytes()
        self._sent = hashlib.sha256(content).digest()
        made = victim.ask("PUT", "/api/recordings/upload?name=room.bag", body=content)
        self._recording_id = str(json.loads(made.body)["id"])
        until(lambda: {job["state"] for job in self._jobs()} == {"done"})
        job_id = self._start()
        until(lambda: self._job(job_id)["state"] in ENDED)
        shutil.copytree(self._data_dir / "jobs" / job_id, kept, dirs_exist_ok=True)
        self._answer = json.loads((kept / "result.json").read_text(encoding="utf-8"))["T_imu_lidar"]
        if self._answer is None:
            raise RuntimeError("the recording of these rounds has no answer")

    def play(self, what: str, where: str) -> None:
        """One round."""
        job_id = self._get_somewhere(where)
        time.sleep(self._hurry * self._chance.uniform(0.0, LATEST_S[where]))
        self._disturb(what)
        until(lambda: self._job(job_id)["state"] in ENDED)
        self.seen.ways[f"{what}, {where}"] += 1
        self._look(job_id)

    def _get_somewhere(self, where: str) -> str:
        victim = self._servers.one()
        if where == "reading":  # another span is another reading: nothing kept serves
            body = {"range_max_m": round(self._chance.uniform(60.0, 90.0), 6)}
            victim.ask("PATCH", f"/api/recordings/{self._recording_id}", headers=JSON, body=json.dumps(body).encode())
            job_id = str(next(job["id"] for job in self._jobs() if job["kind"] == "planes"))
            until(lambda: self._job(job_id)["state"] != "queued")
            return job_id
        job_id = self._start()
        until(lambda: self._job(job_id)["state"] in ENDED or self._job(job_id)["stage"] == "solve")
        if where == "writing":
            mark = self._data_dir / "jobs" / job_id / self._chance.choice(MARKS)
            until(lambda: mark.exists() or self._job(job_id)["state"] in ENDED)
        return job_id

    def _disturb(self, what: str) -> None:
        victim = self._servers.one()
        if what == "server killed":
            victim.kill()
        elif what == "server stopped":
            victim.process.send_signal(signal.SIGTERM)
            victim.process.wait()
        elif what == "worker killed":
            for worker in workers(victim):
                with suppress(ProcessLookupError):
                    os.kill(worker, signal.SIGKILL)
        else:
            for worker in workers(victim):
                with suppress(ProcessLookupError):
                    resource.prlimit(worker, resource.RLIMIT_FSIZE, (2**14, 2**14))

    def _look(self, job_id: str) -> None:
        state = str(self._job(job_id)["state"])
        self.seen.ended[state] += 1
        stored = (self._data_dir / "recordings" / self._recording_id / "source.bag").read_bytes()
        if hashlib.sha256(stored).digest() != self._sent:
            self._wrong("the recording is not the one that was sent")
        for path in ("", "/timeline", "/planes", "/jobs", "/view"):
            status = self._victim().ask("GET", f"/api/recordings/{self._recording_id}{path}").status
            if status not in {200, 409}:
                self._wrong(f"{path or 'the recording'} answers {status}")
        if not any(job["id"] == job_id and job["kind"] == "solve" for job in self._jobs()):
            return
        for path in ("", "/thickness", "/scans", "/report"):
            answer = self._victim().ask("GET", f"/api/results/{job_id}{path}")
            if (answer.status == 200) != (state == "done") or answer.status not in {200, 404, 409}:
                self._wrong(f"a solve that is {state} answers {answer.status} to {path or 'its document'}")
            if answer.status == 200 and path == "":
                self.seen.checked_results += 1
                if json.loads(answer.body)["T_imu_lidar"] != self._answer:
                    self._wrong("a document says something else than what was solved")

    def finish(self) -> None:
        """In the end everything can still be done: read, solve, delete."""
        job_id = self._start()
        until(lambda: self._job(job_id)["state"] in ENDED)
        self._look(job_id)
        if self._job(job_id)["state"] != "done":
            self._wrong("the last solve did not end well")

    def _wrong(self, text: str) -> None:
        self.seen.wrong.append(text)

    def _victim(self) -> Victim:
        return self._servers.one()

    def _jobs(self) -> list[Json]:
        answer = self._victim().ask("GET", f"/api/recordings/{self._recording_id}/jobs")
        return cast("list[Json]", json.loads(answer.body))

    def _job(self, job_id: str) -> Json:
        return cast(Json, json.loads(self._victim().ask("GET", f"/api/jobs/{job_id}").body))

    def _start(self) -> str:
        path = f"/api/recordings/{self._recording_id}/jobs"
        answer = self._victim().ask("POST", path, headers=JSON, body=b'{"kind": "solve"}')
        return str(json.loads(answer.body)["id"])


JSON = {"Content-Type": "application/json"}


def workers(victim: Victim) -> Sequence[int]:
    """The processes of jobs that a server runs."""
    found: list[int] = []
    for task in Path(f"/proc/{victim.process.pid}/task").iterdir():
        with suppress(OSError):
            children = (task / "children").read_text(encoding="ascii").split()
            found += [int(child) for child in children if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]
    return found


#: All that can happen, wherever it can.
EVERY_WAY = tuple((what, where) for where in WHERE for what in WHAT)


def run(
    ways: Iterable[tuple[str, str]],
    seed: int,
    folder: Path,
    *,
    entry: str = "bench.kill_jobs:run_job",
    hurry: float = 1.0,
) -> tuple[Seen, Tally]:
    """A round for each of the ways, about the recording `room.bag` in the folder.   entry: the jobs."""
    tally, chance = Tally(), random.Random(seed)
    kept, data_dir = folder / "kept", folder / "data"
    os.environ[KEPT] = str(kept)
    with Servers(data_dir, tally, entry=entry) as servers:
        all_rounds = Rounds(servers, data_dir, chance, hurry=hurry)
        all_rounds.prepare(folder / "room.bag", kept)
        for number, (what, where) in enumerate(ways):
            all_rounds.play(what, where)
            print(f"round {number}: {what}, {where}; wrong so far: {all_rounds.seen.wrong}", flush=True)
        all_rounds.finish()
    return all_rounds.seen, tally


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=120)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="unsweep-kills-") as folder:
        api.simulate("paper-fast", Path(folder) / "room.bag", duration_s=3.0)
        seen, tally = run(islice(cycle(EVERY_WAY), chosen.rounds), chosen.seed, Path(folder))
    print(f"rounds: {dict(seen.ways)}")
    print(f"disturbed jobs were found: {dict(seen.ended)}; documents compared: {seen.checked_results}")
    print(f"starts: {len(tally.starts_s)}, slowest {max(tally.starts_s):.1f} s, median {tally.median_start_s():.1f} s")
    print(f"wrong or half shown: {len(seen.wrong)}")
    for line in seen.wrong:
        print(line)
    return 1 if seen.wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
