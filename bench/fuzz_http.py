"""Senseless requests by the hundred: `python -m bench.fuzz_http --count 100000` against a server of its own.

Every request begins as one of the API document's own examples and is then spoilt: numbers no float holds, strings that
are no text, nesting without end, wrong types, unknown fields, odd headers, ids of nothing. What must not come back is a
500, a traceback, or a server that answers nobody afterwards. Seeded: the same count and seed ask the same things.
"""

from __future__ import annotations

import argparse
import json
import random
import socket
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import httpx2

from app.application import Server, make_server
from app.jobs.orders import Order, Parcel, Stopped
from app.settings import AppSettings

Json = object
Media = dict[str, dict[str, dict[str, Json]]]
#: Written into the JSON as they stand: a float's limits, and what the standard does not know but parsers do.
RAW_NUMBERS = ("NaN", "Infinity", "-Infinity", "1e999", "-1e999", "1e-999", "9" * 400, "-0.0", "1E400", "0.1e1", "007")
STRINGS = (
    "",
    "x" * 20_000,
    "\ud800",
    "\x00",
    "../../../etc/passwd",
    "/etc/passwd",
    "%00",
    "<script>",
    "ünï\u202ecode",
    "0" * 32,
    "'; DROP TABLE jobs; --",
    "\r\nX: y",
)
HEADERS: tuple[dict[str, str], ...] = (
    {},
    {"Last-Event-ID": "9" * 5000},
    {"Range": "bytes=5-1"},
    {"Content-Type": "text/plain"},
    {"Content-Type": "application/json; charset=utf-7"},
    {"Content-Encoding": "gzip"},
    {"Accept": "nothing/at-all"},
    {"X-HTTP-Method-Override": "DELETE"},
    {"X-Forwarded-Host": "evil.example"},
    {"Cookie": "unsweep_session=" + "a" * 3000},
    {"If-None-Match": "*"},
    {"Origin": "null"},
)
_MARK = "@@raw-number-{}@@"
#: Levels of what is nested deepest.
DEEPEST = 2000
#: Things asked between two lines on how far it is.
LINE_EVERY = 500
#: Of a client, on the busiest machine [s]; nothing is judged by it.
PATIENCE_S = 180.0
#: An answer that takes longer is asked for again [s].
LONG_S = 1.0
#: Things asked of one server: what they leave behind would make its lists long, and the rest of the run slow.
SERVER_EVERY = 1000


class StillLauncher:
    """Runs no process: every job ends at once, having done nothing. The requests are what is tried here."""

    def launch(self, _: Order) -> StillLauncher:
        """A job that has ended."""
        return self

    def parcels(self) -> Iterator[Parcel]:
        """Its end."""
        yield Stopped()

    def ask_to_stop(self) -> None:
        """It has."""

    def terminate(self) -> None:
        """It has."""

    def prepare(self) -> None:
        """Nothing to prepare."""

    def close(self) -> None:
        """Nothing to close."""


@dataclass
class Findings:
    """What came back. statuses: how often each.   faults: requests that must not be answered so.

    asked: how many things, some of which were thought better of.   slowest_s: of all answers, on a machine that may be
    crowded.   slowest_again_s: what took over a second was asked twice more, and this is the slowest of the
    quickest answers: what holds the server up does so each time, a neighbour on the machine does not.
    """

    statuses: Counter[int] = field(default_factory=Counter)
    asked: int = 0
    slowest_s: float = 0.0
    slowest_again_s: float = 0.0
    faults: list[str] = field(default_factory=list)

    def add(self, other: Findings) -> None:
        """What somebody else has found, too."""
        self.statuses += other.statuses
        self.asked += other.asked
        self.slowest_s = max(self.slowest_s, other.slowest_s)
        self.slowest_again_s = max(self.slowest_again_s, other.slowest_again_s)
        self.faults += other.faults


@contextmanager
def server_of_its_own(folder: Path) -> Iterator[tuple[str, Server]]:
    """The address of a server over an empty data directory, and the server."""
    bound = socket.create_server(("127.0.0.1", 0))
    shared = folder / "recordings"
    shared.mkdir()
    settings = AppSettings(data_dir=folder / "data", recordings_dir=shared, min_free_bytes=0, spare_worker=False)
    server = make_server(settings, launcher=StillLauncher())
    thread = threading.Thread(target=server.run, kwargs={"sockets": [bound]}, daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    try:
        yield f"http://127.0.0.1:{bound.getsockname()[1]}", server
    finally:
        server.should_exit = True
        thread.join(30)
        bound.close()


class Fuzzer:
    """Asks senseless things of the server at an address."""

    def __init__(self, address: str, seed: int) -> None:
        self._http = httpx2.Client(base_url=address, timeout=PATIENCE_S, trust_env=False)
        self._random = random.Random(seed)
        document = self._http.get("/api/openapi.json").json()
        self._operations = [
            (method.upper(), path, operation)
            for path, operations in document["paths"].items()
            for method, operation in operations.items()
        ]
        answer = self._http.put("/api/recordings/upload", params={"name": "a.bag"}, content=b"x")
        self._ids = [answer.json()["id"], "0" * 32]
        self._ids += [job["id"] for job in self._http.get(f"/api/recordings/{self._ids[0]}/jobs").json()]

    def close(self) -> None:
        """Hang up."""
        self._http.close()

    def run(self, count: int, *, longest_s: float = float("inf")) -> Findings:
        """Ask so many things, or as many as fit into the time."""
        found, began_s = Findings(), time.monotonic()
        while found.asked < count and time.monotonic() - began_s < longest_s:
            self._ask(found)
            found.asked += 1
            if found.asked % LINE_EVERY == 0:
                sys.stderr.write(f"asked {found.asked}, {len(found.faults)} faults, slowest {found.slowest_s:.2f} s\n")
        # Whatever was stored by then can be read by everybody.
        for path in ("/api/recordings", "/api/info", "/readyz"):
            status = self._http.get(path).status_code
            if status != 200:
                found.faults.append(f"{path} answers {status} in the end")
        return found

    def _ask(self, found: Findings) -> None:
        method, path, operation = self._random.choice(self._operations)
        for name in ("recording_id", "job_id"):
            path = path.replace(f"{{{name}}}", self._random.choice([*self._ids, self._ids[0], "x", "%00", "é"]))
        path = path.replace("{format_name}", self._random.choice(["tum", "urdf", "nothing", "%2e%2e", "x" * 500]))
        query = {
            str(each["name"]): self._random.choice(["room.bag", "", "1", *STRINGS[2:8], "x" * 3000])
            for each in operation.get("parameters", [])
            if each["in"] == "query"
        }
        if method == "DELETE" and self._ids[0] in path:
            return  # what all others are about
        body = self._body(operation)
        headers = {"Content-Type": "application/json", **self._random.choice(HEADERS)}
        began_s = time.monotonic()
        query = {name: value.encode("utf-8", "replace").decode() for name, value in query.items()}
        try:
            status, text = self._answer(method, path, query, body, headers)
        except httpx2.HTTPError:
            # A connection that was kept may be one that the server has closed after a 500: asked again on another.
            try:
                status, text = self._answer(method, path, query, body, headers)
            except httpx2.HTTPError as error:
                status, text = 599, repr(error)
        wait_s = time.monotonic() - began_s
        found.slowest_s = max(found.slowest_s, wait_s)
        if wait_s > LONG_S:
            again_s = min(wait_s, *(self._wait(method, path, query, body, headers) for _ in range(2)))
            found.slowest_again_s = max(found.slowest_again_s, again_s)
        found.statuses[status] += 1
        if status >= 500 or "Traceback" in text:
            found.faults.append(f"{status} {method} {path} {query} {headers} {body[:300]!r}: {text[:200]}")

    def _wait(self, method: str, path: str, query: dict[str, str], body: bytes, headers: dict[str, str]) -> float:
        """How long the same thing takes [s]."""
        began_s = time.monotonic()
        with suppress(httpx2.HTTPError):
            self._answer(method, path, query, body, headers)
        return time.monotonic() - began_s

    def _answer(
        self, method: str, path: str, query: dict[str, str], body: bytes, headers: dict[str, str]
    ) -> tuple[int, str]:
        """Status and text; of a stream of events no text."""
        with self._http.stream(method, path, params=query, content=body, headers=headers) as answer:
            streams = "event-stream" in answer.headers.get("content-type", "")
            return answer.status_code, "" if streams else answer.read().decode("utf-8", "replace")

    def _body(self, operation: dict[str, Json]) -> bytes:
        content = cast("dict[str, Media]", cast("dict[str, Json]", operation.get("requestBody", {})).get("content"))
        if not content:
            return b""
        examples = next(iter(content.values())).get("examples") or {"none": {"value": {}}}
        value: Json = json.loads(json.dumps(self._random.choice(list(examples.values()))["value"]))
        for _ in range(self._random.randint(0, 3)):
            value = self._spoilt(value, depth=0)
        try:
            text = json.dumps(value)
        except RecursionError:  # nested twice: deeper than this program itself can write
            text = "[" * DEEPEST + "]" * DEEPEST
        for number, raw in enumerate(RAW_NUMBERS):
            text = text.replace(f'"{_MARK.format(number)}"', raw)
        raw_body = text.encode("utf-8", "replace")
        return raw_body[: self._random.randrange(len(raw_body) + 1)] if self._random.random() < 0.05 else raw_body

    def _spoilt(self, value: Json, depth: int) -> Json:
        """The value with one thing wrong somewhere inside."""
        inside = self._random.random() < 0.75
        if isinstance(value, dict) and value and inside:
            key = self._random.choice(list(value))
            return {**value, key: self._spoilt(value[key], depth + 1)}
        if isinstance(value, list) and value and inside:
            place = self._random.randrange(len(value))
            return [*value[:place], self._spoilt(value[place], depth + 1), *value[place + 1 :]]
        return self._nonsense(value)

    def _nonsense(self, value: Json) -> Json:
        pick = self._random.random()
        if pick < 0.35:
            return _MARK.format(self._random.randrange(len(RAW_NUMBERS)))
        if pick < 0.55:
            return self._random.choice(STRINGS)
        if pick < 0.62:
            nested: Json = value
            for _ in range(self._random.choice([5, 900])):
                nested = [nested]
            return nested
        if pick < 0.7 and isinstance(value, dict):
            return {**value, self._random.choice(["extra", "", "__proto__", "x" * 1000]): value}
        return self._random.choice([None, True, -1, 2**70, 1e308, [], {}, [value] * 300, {"op": "undo"}, 0.5])


def fuzz(address: str, *, seed: int, count: int, at_once: int, longest_s: float = float("inf")) -> Findings:
    """So many things asked by several fuzzers at once, each by a seed of its own and about a recording of its own."""

    def ask(number: int) -> Findings:
        with closing(Fuzzer(address, seed + number)) as fuzzer:
            return fuzzer.run(count // at_once + (number < count % at_once), longest_s=longest_s)

    found = Findings()
    with ThreadPoolExecutor(at_once) as pool:
        for each in pool.map(ask, range(at_once)):
            found.add(each)
    return found


def main() -> None:
    """Ask, and say what came back."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--at-once", type=int, default=1, help="so many ask side by side; more than one are not repeatable"
    )
    parser.add_argument("--minutes", type=float, default=float("inf"), help="the longest it may take")
    chosen = parser.parse_args()
    found, end_s = Findings(), time.monotonic() + 60.0 * chosen.minutes
    for number, start in enumerate(range(0, chosen.count, SERVER_EVERY)):
        longest_s = end_s - time.monotonic()
        if longest_s <= 0:
            break
        count = min(SERVER_EVERY, chosen.count - start)
        seed = chosen.seed + number * chosen.at_once
        with tempfile.TemporaryDirectory() as name, server_of_its_own(Path(name)) as (address, _):
            found.add(fuzz(address, seed=seed, count=count, at_once=chosen.at_once, longest_s=longest_s))
        sys.stderr.write(f"{found.asked} by {number + 1} servers: {len(found.faults)} faults\n")
    sys.stdout.write(
        f"asked {found.asked}, slowest answer {found.slowest_s:.2f} s, asked again {found.slowest_again_s:.2f} s\n"
        f"{dict(sorted(found.statuses.items()))}\n"
    )
    for fault in found.faults:
        sys.stdout.write(fault + "\n")
    sys.exit(1 if found.faults else 0)


if __name__ == "__main__":
    main()
