"""The paper's experiments (section IV-A), run and written beside the paper's own numbers.

    python -m bench.paper                       everything, 10 runs each
    python -m bench.paper --tables "table I"    some of it;  --methods paper;  --runs 3;  --jobs 4
    python -m bench.paper --report              only the tables and plots, from what was run before

Every run is a line of bench/results/paper_runs.csv; what is there is not run again unless --again is given.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, fields
from multiprocessing import get_context
from pathlib import Path

# Before NumPy is imported by the workers: many small products are slower with several threads each.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from bench.paper_report import write_report
from bench.paper_runs import Experiment, Method, Outcome, experiments, run

RESULTS = Path(__file__).resolve().parent / "results"
RUNS = RESULTS / "paper_runs.csv"
_Task = tuple[Experiment, Method, int]


def main(arguments: list[str] | None = None) -> int:
    """Run what is missing, then write tables and plots."""
    options = _parser().parse_args(arguments)
    RESULTS.mkdir(exist_ok=True)
    done = {} if options.again else {_key(each): each for each in read_runs(RUNS)}
    if not options.report:
        wanted = {
            (experiment.key, method, seed): (experiment, method, seed)
            for experiment in experiments()
            if not options.tables or experiment.table in options.tables
            for method in experiment.methods
            if not options.methods or method in options.methods
            for seed in range(1, options.runs + 1)
            if (experiment.key, method, seed) not in done
        }
        # Neighbours share what they can: the recording, and the planes tracked in it.
        tasks = sorted(wanted.values(), key=lambda task: (task[1], task[0].recording_key, task[2]))
        for outcome in _outcomes(tasks, options.jobs):
            done[_key(outcome)] = outcome
            _write_runs(RUNS, done.values())
            print(
                f"{outcome.experiment}, {outcome.method}, seed {outcome.seed}: {outcome.e_R_deg:.4f} deg, "
                f"{1e3 * outcome.e_p_m:.3f} mm, {outcome.e_dt_ms:.4f} ms in {outcome.seconds:.1f} s",
                flush=True,
            )
    write_report(list(experiments()), list(done.values()), RESULTS)
    return 0


def read_runs(path: Path) -> Iterator[Outcome]:
    """The runs of a file; none where there is no file."""
    if not path.is_file():
        return
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            yield Outcome(
                row["experiment"],
                "full" if row["method"] == "full" else "paper",
                int(row["seed"]),
                float(row["e_R_deg"]),
                float(row["e_p_m"]),
                float(row["e_dt_ms"]),
                int(row["scans_used"]),
                float(row["seconds"]),
            )


def _write_runs(path: Path, outcomes: Iterable[Outcome]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [each.name for each in fields(Outcome)], lineterminator="\n")
        writer.writeheader()
        for outcome in sorted(outcomes, key=_key):
            row = asdict(outcome)
            writer.writerow({name: f"{v:.6g}" if isinstance(v, float) else v for name, v in row.items()})


def _key(outcome: Outcome) -> tuple[str, str, int]:
    return outcome.experiment, outcome.method, outcome.seed


def _outcomes(tasks: list[_Task], jobs: int) -> Iterator[Outcome]:
    if jobs == 1:
        for task in tasks:
            yield run(*task)
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        yield from pool.map(_run_task, tasks)


def _run_task(task: _Task) -> Outcome:
    return run(*task)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m bench.paper", description="The paper's experiments.")
    parser.add_argument("--tables", nargs="*", default=[], help='of "figure 6", "figure 7", "IV-A.3", "table I"')
    parser.add_argument("--methods", nargs="*", default=[], help="of paper, full")
    parser.add_argument("--runs", type=int, default=10, help="Monte-Carlo runs of each (%(default)s)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (%(default)s)")
    parser.add_argument("--again", action="store_true", help="run again what was run before")
    parser.add_argument("--report", action="store_true", help="only write tables and plots")
    return parser


if __name__ == "__main__":
    sys.exit(main())
