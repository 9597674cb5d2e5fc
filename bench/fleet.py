"""`python -m bench.fleet`: what a recording costs, and what a second worker brings, into bench/results/fleet.md.

Costs: `unsweep calibrate` on recordings of 20 s and 60 s, on one core, in a process of its own. Scaling: the same short
recordings through a real scheduler with one worker and with two, each worker held to a core of its own, turn by turn so that
a machine that grows busier slows both. Few of the recordings are different files; the others are links to them.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from app.children import THREAD_CAPS
from app.fleet.campaign import run_fleet
from app.fleet.cluster import DaskCluster
from app.fleet.orders import FleetOrder
from bench.machine import measured
from bench.store import RESULTS
from calib_core import api
from calib_core.threads import usable_cores

SCENARIO = "handheld"
COSTED_S = (20.0, 60.0)
#: How much quicker two workers have to be than one.
LEAST_GAIN = 1.8
_DISTINCT = 4
_START_S = 60.0


@dataclass(frozen=True, slots=True)
class Cost:
    """What one recording took. read_mb, written_mb: through the system's calls, program and libraries included."""

    duration_s: float
    file_mb: float
    wall_s: float
    cpu_s: float
    memory_mb: float
    read_mb: float
    written_mb: float
    document_kb: float


@dataclass(frozen=True, slots=True)
class Pass:
    """All recordings once. load: the machine's load average before.   busy: of the workers' time, what recordings took.

    What is not busy is lost on the way to the workers; what others take of the cores is not seen in it.
    """

    workers: int
    wall_s: float
    busy: float
    documents: int
    load: float


def cost(folder: Path, duration_s: float) -> Cost:
    """Of a recording of that length. Raises SystemExit where it gives no calibration."""
    bag, document = folder / f"cost-{duration_s:.0f}.mcap", folder / "document.json"
    api.simulate(SCENARIO, bag, seed=0, duration_s=duration_s)
    command = [sys.executable, "-m", "app.cli", "calibrate", str(bag), "--output", str(document), "--quiet"]
    start_s = time.monotonic()
    with held_to(0), subprocess.Popen(command, env=os.environ | THREAD_CAPS) as process:
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)  # ended, and still to be asked
        lines = Path(f"/proc/{process.pid}/io").read_text(encoding="ascii").splitlines()
        moved = {name: int(count) for name, count in (line.split(": ") for line in lines)}
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"unsweep calibrate ended with exit code {process.returncode}.")
    return Cost(
        duration_s,
        bag.stat().st_size / 1e6,
        time.monotonic() - start_s,
        used.ru_utime + used.ru_stime,
        used.ru_maxrss * 1024 / 1e6,
        moved["rchar"] / 1e6,
        moved["wchar"] / 1e6,
        document.stat().st_size / 1e3,
    )


@contextmanager
def held_to(core: int) -> Iterator[None]:
    """What is started meanwhile has one core, by its number among those there are."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {sorted(before)[core % len(before)]})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[str]:
    """The address of a scheduler with so many workers, each with a core of its own."""
    file = folder / f"scheduler-{time.monotonic_ns()}.json"
    dask = [sys.executable, "-m", "dask"]
    scheduler = [*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
    worker = [*dask, "worker", "--scheduler-file", str(file), "--host", "127.0.0.1", "--nthreads", "1"]
    worker += ["--no-dashboard", "--no-nanny", "--local-directory", str(folder)]
    started = []

    def start(words: Sequence[str]) -> None:
        started.append(subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))

    try:
        start([*scheduler, "--scheduler-file", str(file)])
        for core in range(workers):
            with held_to(core):
                start(worker)
        yield _address(file, workers)
    finally:
        for process in reversed(started):
            process.kill()
            process.wait()


def _address(file: Path, workers: int) -> str:
    """The scheduler's, once all of its workers are there."""
    from distributed import Client

    end_s = time.monotonic() + _START_S
    while not (file.is_file() and file.read_text(encoding="utf-8").strip().endswith("}")):
        if time.monotonic() > end_s:
            raise SystemExit("The scheduler did not start.")
        time.sleep(0.05)
    address = str(json.loads(file.read_text(encoding="utf-8"))["address"])
    with Client(address, set_as_default=False) as client:
        client.wait_for_workers(workers, timeout=_START_S)
    return address


def one_pass(recordings: Sequence[Path], out: Path, folder: Path, workers: int) -> Pass:
    """All recordings on so many workers."""
    out.mkdir()
    orders = [FleetOrder(name=path.stem, recording=path) for path in recordings]
    with cluster(folder, workers) as address:
        load, start_s = os.getloadavg()[0], time.monotonic()
        rows = run_fleet(orders, out, DaskCluster(address), lambda _: None)
        wall_s = time.monotonic() - start_s
    busy = sum(row.duration_s for row in rows) / (workers * wall_s)
    found = Pass(workers, wall_s, busy, sum(row.has_document for row in rows), load)
    sys.stderr.write(f"{workers} workers: {len(rows)} recordings in {wall_s:.1f} s, load before {load:.1f}\n")
    return found


def recordings_in(folder: Path, count: int, duration_s: float) -> list[Path]:
    """So many short recordings, few of them different."""
    first = [folder / f"short-{number:03}.mcap" for number in range(min(count, _DISTINCT))]
    for seed, path in enumerate(first):
        api.simulate(SCENARIO, path, seed=seed, duration_s=duration_s)
    others = [folder / f"short-{number:03}.mcap" for number in range(len(first), count)]
    for number, path in enumerate(others):
        path.hardlink_to(first[number % len(first)])
    return [*first, *others]


def gain(passes: Sequence[Pass]) -> float:
    """How much quicker two workers are than one, over all turns."""
    return sum(one.wall_s for one in passes if one.workers == 1) / sum(one.wall_s for one in passes if one.workers == 2)


def report(costs: Sequence[Cost], passes: Sequence[Pass], recordings: int, duration_s: float) -> str:
    """The page."""
    head = "| recording | file | CPU | wall clock, one core | memory | read | written | document |"
    lines = [
        "# What a fleet costs",
        "",
        (f"Written by `python -m bench.fleet`: `{SCENARIO}`, simulated, mcap, all points used. {measured()}"),
        "",
        head,
        "| ---: " * head.count(" | ") + "| ---: |",
        *(
            f"| {one.duration_s:.0f} s | {one.file_mb:.0f} MB | {one.cpu_s:.1f} s | {one.wall_s:.1f} s | "
            f"{one.memory_mb:.0f} MB | {one.read_mb:.0f} MB | {one.written_mb:.0f} MB | {one.document_kb:.0f} kB |"
            for one in costs
        ),
        "",
        f"{recordings} recordings of {duration_s:g} s, each worker with a core of its own:",
        "",
        "| workers | wall clock | workers busy | documents | load average before |",
        "| ---: | ---: | ---: | ---: | ---: |",
        *(
            f"| {one.workers} | {one.wall_s:.1f} s | {100.0 * one.busy:.1f} % | {one.documents} | {one.load:.1f} |"
            for one in passes
        ),
        "",
        f"Two workers are {gain(passes):.2f} times as quick as one; asked: {LEAST_GAIN:g}.",
        "",
    ]
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and write; 1 where a second worker brings too little, or a document is missing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=int, default=100, metavar="N", help="(%(default)s)")
    parser.add_argument("--duration-s", type=float, default=6.0, metavar="S", help="of each of them (%(default)s)")
    parser.add_argument("--turns", type=int, default=1, help="one worker, then two, so often (%(default)s)")
    chosen = parser.parse_args(arguments)
    if usable_cores() < 2:
        raise SystemExit("Two workers with a core each need two cores.")
    with tempfile.TemporaryDirectory(prefix="unsweep-fleet-") as name:
        folder = Path(name)
        costs = [cost(folder, duration_s) for duration_s in COSTED_S]
        paths = recordings_in(folder, chosen.recordings, chosen.duration_s)
        passes = [
            one_pass(paths, folder / f"out-{turn}-{workers}", folder, workers)
            for turn in range(chosen.turns)
            for workers in (1, 2)
        ]
    text = report(costs, passes, len(paths), chosen.duration_s)
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "fleet.md").write_text(text, encoding="utf-8")
    sys.stdout.write(text)
    return 0 if gain(passes) >= LEAST_GAIN and all(one.documents == len(paths) for one in passes) else 1


if __name__ == "__main__":
    sys.exit(main())
