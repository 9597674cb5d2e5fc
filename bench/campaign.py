"""Many runs over several processes, one row each, resumable: what is in the table is not run again."""

from __future__ import annotations

import os
import subprocess
import sys
import uuid
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

from app.fleet.cluster import connect
from bench.runs import PARAMETERS, Run, solve_once
from bench.store import FOLDER, RESULTS
from bench.tables import append_row, read_rows

MONTE_CARLO = "monte_carlo.csv"
#: End of the label of runs whose random numbers are their scenario's own.
INDEPENDENT = "-independent"
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
T = TypeVar("T")
R = TypeVar("R")


def seeds_of(text: str) -> tuple[int, ...]:
    """Seeds from `1-100` or `3,7,20-25`."""
    seeds: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        seeds.extend(range(int(first), int(last or first) + 1))
    return tuple(dict.fromkeys(seeds))


def version_label(root: Path = FOLDER.parent) -> str:
    """The commit of a checkout, with a `+` where the estimator or the simulator differs from it."""

    def git(*arguments: str) -> str:
        done = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, check=False)  # noqa: S607
        return done.stdout.strip()

    commit = git("rev-parse", "--short=8", "HEAD") or "unknown"
    return commit + ("+" if git("status", "--porcelain", "--", "calib_core") else "")


def spread(work: Callable[[T], R], tasks: Sequence[T], jobs: int, scheduler: str | None = None) -> Iterator[R]:
    """Results as they are done, each process with one numerical thread.

    scheduler: address of a dask.distributed cluster that does the work instead, on machines with this same checkout.
    """
    if not tasks:
        return
    if scheduler is not None:
        yield from _spread_over(scheduler, work, tasks)
        return
    if jobs == 1:
        yield from map(work, tasks)
        return
    # Read by the libraries when the workers import them.
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        waiting = [pool.submit(work, task) for task in tasks]
        try:
            for future in as_completed(waiting):
                yield future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _spread_over(scheduler: str, work: Callable[[T], R], tasks: Sequence[T]) -> Iterator[R]:
    """The same on a cluster, where what a lost worker had is done by another; what is left is taken back at the end."""
    from distributed import as_completed as completed

    with connect(scheduler) as client:
        # By number: of two tasks that are alike dask would do one.
        keys = [f"{work.__name__}-{uuid.uuid4().hex}" for _ in tasks]
        waiting = [client.submit(work, task, key=key, pure=False) for key, task in zip(keys, tasks, strict=True)]
        try:
            for future in completed(waiting, loop=client.loop):
                yield future.result()
                future.release()
        finally:
            client.cancel(waiting)


def monte_carlo(
    scenarios: Sequence[str],
    seeds: Sequence[int],
    *,
    jobs: int,
    label: str,
    folder: Path = RESULTS,
    independent: bool = False,
    scheduler: str | None = None,
) -> None:
    """Every scenario with every seed, appended to monte_carlo.csv.

    independent: no scenario shares random numbers with another; the label then says so, since such runs are not paired.
    scheduler: as in `spread`.
    """
    label = label + INDEPENDENT if independent else label
    path = folder / MONTE_CARLO
    done = {(run.scenario, run.seed, run.label) for run in read_runs(folder)}
    # Seed by seed, so that an unfinished campaign has its scenarios paired.
    tasks = [(name, seed, label) for seed in seeds for name in scenarios if (name, seed, label) not in done]
    for number, run in enumerate(spread(_solve, tasks, jobs, scheduler), start=1):
        append_row(path, run, PARAMETERS)
        sys.stderr.write(
            f"{number} of {len(tasks)}: {run.scenario} seed {run.seed}: {run.status} {run.code} "
            f"{run.e_R_deg:.4f} deg {run.e_p_mm:.3f} mm {run.e_dt_ms:.4f} ms NEES {run.nees:.1f} "
            f"in {run.solve_s:.0f} s ({run.cpu_s:.0f} s of CPU)\n"
        )


def read_runs(folder: Path = RESULTS) -> list[Run]:
    """All runs of the table, in its order."""
    return list(read_rows(folder / MONTE_CARLO, Run, PARAMETERS))


def _solve(task: tuple[str, int, str]) -> Run:
    scenario, seed, label = task
    return solve_once(scenario, seed, label=label, salt=scenario if label.endswith(INDEPENDENT) else "")
