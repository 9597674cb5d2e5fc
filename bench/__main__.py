"""`python -m bench`: measure, judge, bless.

    list                    what can be measured
    run NAME... [--jobs N]  measure, show, write bench/results/NAME.json
    gate [--jobs N]         measure the gated workloads; exit 1 where a ratio slipped
    bless NAME...           measure and make the ratios the new baseline (commit it with a reason)
    readme                  write the README's table from bench/results

The tables and figures of the paper, both methods side by side, are `python -m bench.paper`.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable, Sequence

from bench.metrics import Metric, slips
from bench.readme import README, table, with_table
from bench.store import bless, read_baseline, write_results
from bench.workloads import WORKLOADS, metrics_of, runs_of


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one of the commands; its exit code."""
    parser = argparse.ArgumentParser(prog="python -m bench", description="Measure, judge, bless.")
    parser.add_argument("command", choices=("list", "run", "gate", "bless", "readme"))
    parser.add_argument("names", nargs="*", metavar="NAME", help="workloads; all gated ones where none is named")
    parser.add_argument("--jobs", type=int, default=max(1, (os.cpu_count() or 2) // 2), help="processes (%(default)s)")
    chosen = parser.parse_args(arguments)
    unknown = [name for name in chosen.names if name not in WORKLOADS]
    if unknown:
        sys.stderr.write(f"Unknown: {', '.join(unknown)}; known: {', '.join(WORKLOADS)}.\n")
        return 2
    match chosen.command:
        case "list":
            for workload in WORKLOADS.values():
                sys.stdout.write(f"{workload.name:24}{workload.text} Seeds {workload.seeds}.\n")
        case "readme":
            README.write_text(with_table(README.read_text(encoding="utf-8"), table()), encoding="utf-8")
        case "gate":
            return _gate(_measure(chosen.names or _gated(), chosen.jobs))
        case "bless":
            bless(_measure(chosen.names or _gated(), chosen.jobs))
        case _:
            _measure(chosen.names or _gated(), chosen.jobs)
    return 0


def _gated() -> list[str]:
    return [workload.name for workload in WORKLOADS.values() if workload.is_gated]


def _measure(names: Iterable[str], jobs: int) -> list[Metric]:
    """Run the workloads, show and write each as it is done."""
    everything: list[Metric] = []
    for name in names:
        workload = WORKLOADS[name]
        runs = []
        for run in runs_of(workload, jobs):
            sys.stderr.write(f"{name} seed {run.seed}: {run.status} in {run.solve_s:.1f} s\n")
            runs.append(run)
        metrics = metrics_of(workload, runs)
        for metric in metrics:
            sys.stdout.write(f"{metric.key:44}{metric.value:12.5g} {metric.unit}\n")
        write_results(name, metrics)
        everything += metrics
    return everything


def _gate(measured: list[Metric]) -> int:
    found = slips(measured, read_baseline())
    for slip in found:
        sys.stderr.write(f"slipped: {slip.text}\n")
    sys.stderr.write("The gate holds.\n" if not found else f"{len(found)} of {len(measured)} numbers slipped.\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
