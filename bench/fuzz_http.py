"""Senseless requests by the hundred: `python -m bench.fuzz_http --count 100000` against a server of its own.

Every request begins as one of the API document's own examples and is then spoilt: numbers no float holds, strings that
are no text, nesting without end, wrong types, unknown fields, odd headers, ids of nothing. What must not come back is a
500, a traceback, or a server that answers nobody afterwards. Seeded: the same count and seed ask the same things.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path

import httpx2

from bench.nonsense import HEADERS, STRINGS, spoilt_body
from bench.still_server import server_of_its_own

#: Things asked between two lines on how far it is.
LINE_EVERY = 500
#: Of a client, on the busiest machine [s]; nothing is judged by it.
PATIENCE_S = 180.0
#: An answer that takes longer is asked for again [s].
LONG_S = 1.0
#: Things asked of one server: what they leave behind would make its lists long, and the rest of the run slow.
SERVER_EVERY = 1000


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
        body = spoilt_body(operation, self._random)
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
