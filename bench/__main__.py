"""`python -m bench`: measure, judge, bless.

    list                                what can be measured
    run [NAME...]                       measure, show, write bench/results/NAME.json
    gate [NAME...]                      measure what is gated, aims, first_run, passes, lasers and growth too; exit 1 where a
                                        ratio slipped; what is over its aim is said
    bless [NAME...]                     measure and make the ratios the new baseline (commit it with a reason)
    readme                              write the tables of README.md and docs/accuracy.md from bench/results
    answers CHECKOUT [--names]          this version's answers against another's, in sigmas: bench/results/answers.md
    bound [SCENARIO...]                 Cramér-Rao bounds into bench/results/bounds.csv
    bound-faults [SCENARIO]             the bounds with real sensors' faults as unknowns: bench/results/fault_bounds.csv
    monte-carlo SCENARIO... [--seeds]   one row a run in bench/results/monte_carlo.csv; goes on where it was stopped
    monte-carlo SCENARIO... --faults FAULTS [--duration-s] [--set]
                                        the same on sensors as they are: fault_runs.csv, fault_parameters.csv
    fault-table [--seeds] [--duration-s] [--set]
                                        a campaign for each fault that was ever measured, each in its scenario
    report-faults                       bench/results/faults.md from these and the bounds: NEES, the test of the mean error
    starts [--seeds] [--kinds]          from any start the same answer: bench/results/starts.csv; goes on, too
    report                              bench/results/accuracy.md from these three

The tables and figures of the paper, both methods side by side, are `python -m bench.paper`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path

from bench import (
    accuracy,
    aims,
    answers,
    bounds,
    campaign,
    fault_bounds,
    fault_report,
    fault_runs,
    first_run,
    growth,
    lasers,
    passes,
    starts,
)
from bench.metrics import Metric, slips
from bench.readme import write_pages
from bench.store import RESULTS, bless, read_baseline, write_results
from bench.workloads import WORKLOADS, Workload, metrics_of, runs_of
from calib_core.errors import InputError
from calib_core.threads import usable_cores

#: What is measured beside the workloads.
_COSTS: Mapping[str, Callable[[], list[Metric]]] = {
    aims.NAME: aims.measure,
    first_run.NAME: first_run.measure,
    passes.NAME: passes.measure,
    lasers.NAME: lasers.measure,
    growth.NAME: growth.measure,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one of the commands; its exit code."""
    chosen = _parser().parse_args(arguments)
    try:
        return _run(chosen)
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2


def _run(chosen: argparse.Namespace) -> int:
    match chosen.command:
        case "answers":
            return answers.main(chosen.checkout, chosen.names, chosen.folder)
        case "bound":
            bounds.compute(chosen.names or bounds.BOUNDED, jobs=chosen.jobs, folder=chosen.folder)
        case "bound-faults":
            rows = {text: text for text in chosen.faults} or fault_bounds.ROWS
            fault_bounds.compute(chosen.scenario, rows, duration_s=chosen.duration_s, folder=chosen.folder)
        case "monte-carlo":
            _monte_carlo(chosen)
        case "fault-table":
            label = chosen.label or campaign.version_label()
            campaigns = [
                fault_runs.Campaign(name, faults, chosen.duration_s, chosen.set, label)
                for name, faults in fault_runs.TABLE
            ]
            fault_runs.monte_carlo(
                campaigns, chosen.seeds, jobs=chosen.jobs, folder=chosen.folder, scheduler=chosen.scheduler
            )
        case "report-faults":
            sys.stdout.write(f"{fault_report.write_report(chosen.folder)}\n")
        case "starts":
            starts.campaign(
                chosen.seeds,
                scenario=chosen.scenario,
                kinds=chosen.kinds,
                jobs=chosen.jobs,
                label=chosen.label or campaign.version_label(),
                folder=chosen.folder,
                scheduler=chosen.scheduler,
            )
        case "report":
            sys.stdout.write(f"{accuracy.write_report(chosen.folder, chosen.label)}\n")
        case "list":
            for workload in WORKLOADS.values():
                sys.stdout.write(f"{workload.name:24}{workload.text} Seeds {workload.seeds}.\n")
            sys.stdout.write(f"{lasers.NAME:24}CPU with the sensors' own parameters over that with ideal sensors.\n")
            sys.stdout.write(
                f"{growth.NAME:24}CPU of longer recordings, of more lasers and of more planes, and their memory.\n"
            )
            sys.stdout.write(
                f"{aims.NAME:24}What is asked of a minute by hand and of shorter ones, in passes over it.\n"
            )
            sys.stdout.write(f"{first_run.NAME:24}A first calibration after the loops are compiled, over the second.\n")
            sys.stdout.write(f"{passes.NAME:24}Each stage's time over that of one honest pass over the recording.\n")
        case "readme":
            write_pages()
        case _:
            return _workloads(chosen.command, chosen.names, chosen.jobs)
    return 0


def _monte_carlo(chosen: argparse.Namespace) -> None:
    label = chosen.label or campaign.version_label()
    if not chosen.faults:
        campaign.monte_carlo(
            chosen.names,
            chosen.seeds,
            jobs=chosen.jobs,
            label=label,
            folder=chosen.folder,
            independent=chosen.independent,
            scheduler=chosen.scheduler,
        )
        return
    campaigns = [
        fault_runs.Campaign(name, faults, chosen.duration_s, chosen.set, label)
        for name in chosen.names
        for faults in chosen.faults
    ]
    fault_runs.monte_carlo(campaigns, chosen.seeds, jobs=chosen.jobs, folder=chosen.folder, scheduler=chosen.scheduler)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m bench", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name in ("list", "readme"):
        commands.add_parser(name)
    for name in ("run", "gate", "bless"):
        command = commands.add_parser(name)
        command.add_argument("names", nargs="*", metavar="NAME", help="workloads; all gated ones where none is named")
        _add_jobs(command)
    command = commands.add_parser("answers", description=answers.__doc__)
    command.add_argument("checkout", type=Path, help="folder of the other version's sources")
    command.add_argument(
        "--names", nargs="+", default=[], metavar="SCENARIO", help="recordings; all where none is named"
    )
    _add_folder(command)
    command = commands.add_parser("bound")
    command.add_argument("names", nargs="*", metavar="SCENARIO", help=f"default: {' '.join(bounds.BOUNDED)}")
    _add_jobs(command)
    _add_folder(command)
    command = commands.add_parser("bound-faults", description=fault_bounds.__doc__)
    command.add_argument("scenario", nargs="?", default="handheld", metavar="SCENARIO", help="(%(default)s)")
    command.add_argument(
        "--faults",
        nargs="+",
        default=[],
        metavar="FAULTS",
        help="rows: faults of `unsweep simulate`, each with its std",
    )
    command.add_argument("--duration-s", type=float, default=30.0, metavar="S", help="of the recording (%(default)s)")
    _add_folder(command)
    command = commands.add_parser("monte-carlo")
    command.add_argument(
        "names",
        nargs="+",
        metavar="SCENARIO",
        help="with --faults also behind another lidar: handheld+xt32, +os1, +livox",
    )
    command.add_argument(
        "--faults",
        action="append",
        default=[],
        metavar="FAULTS",
        help="as `unsweep simulate` takes them, or `none`; several times for several campaigns",
    )
    command.add_argument(
        "--duration-s", type=float, default=30.0, metavar="S", help="of recordings with --faults (%(default)s)"
    )
    command.add_argument(
        "--set",
        default="",
        metavar="NAME=VALUE,...",
        help="settings of the solve with --faults, such as intrinsics=off",
    )
    command.add_argument(
        "--independent",
        action="store_true",
        help="without --faults: random numbers of each scenario's own; else scenarios share them and can be paired",
    )
    _add_campaign(command, "1-100")
    command = commands.add_parser("starts")
    command.add_argument("--scenario", default="paper-normal", help="(%(default)s)")
    command.add_argument(
        "--kinds", nargs="+", choices=starts.KINDS, default=["any"], help="how the clocks differ (%(default)s)"
    )
    _add_campaign(command, "1-200")
    command = commands.add_parser("fault-table")
    _add_faulty(command)
    _add_campaign(command, "1")
    command = commands.add_parser("report-faults")
    _add_folder(command)
    command = commands.add_parser("report")
    command.add_argument("--label", help="the version to show; default: each scenario's latest")
    _add_folder(command)
    return parser


def _add_jobs(command: argparse.ArgumentParser) -> None:
    command.add_argument("--jobs", type=int, default=max(1, usable_cores() // 2), help="processes (%(default)s)")


def _add_folder(command: argparse.ArgumentParser) -> None:
    command.add_argument("--folder", type=Path, default=RESULTS, help="of the results (bench/results)")


def _add_campaign(command: argparse.ArgumentParser, seeds: str) -> None:
    command.add_argument(
        "--seeds", type=campaign.seeds_of, default=campaign.seeds_of(seeds), help=f"such as 1-5,8 ({seeds})"
    )
    command.add_argument("--label", help="of the program's version; default: the commit")
    command.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of a dask.distributed cluster that does it instead of --jobs processes here: `dask worker --nthreads 1`, "
        "each in this same checkout",
    )
    _add_jobs(command)
    _add_folder(command)


def _add_faulty(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--duration-s", type=float, default=30.0, metavar="S", help="of recordings with faults (%(default)s)"
    )
    command.add_argument(
        "--set", default="", metavar="NAME=VALUE,...", help="settings of the solve with faults, such as intrinsics=off"
    )


def _workloads(command: str, names: Sequence[str], jobs: int) -> int:
    known = [*WORKLOADS, *_COSTS]
    unknown = [name for name in names if name not in known]
    if unknown:
        sys.stderr.write(f"Unknown: {', '.join(unknown)}; known: {', '.join(known)}.\n")
        return 2
    gated = [*(workload.name for workload in WORKLOADS.values() if workload.is_gated), *_COSTS]
    ran = list(names or gated)
    measured = _measure(ran, jobs)
    if command == "gate":
        return gate(measured, read_baseline(), ran)
    say_missed(measured, read_baseline())
    if command == "bless":
        bless(measured)
    return 0


def _measure(names: Iterable[str], jobs: int) -> list[Metric]:
    """Run the workloads, show and write each as it is done."""
    everything: list[Metric] = []
    baseline = read_baseline()
    for name in names:
        metrics = _COSTS[name]() if name in _COSTS else _solve(WORKLOADS[name], jobs)
        for metric in metrics:
            sys.stdout.write(f"{metric.key:44}{metric.told(baseline.get(metric.key))}\n")
        write_results(name, metrics)
        everything += metrics
    return everything


def _solve(workload: Workload, jobs: int) -> list[Metric]:
    """What the runs of a workload amount to."""
    runs = []
    for run in runs_of(workload, jobs):
        sys.stderr.write(f"{workload.name} seed {run.seed}: {run.status} in {run.solve_s:.1f} s\n")
        runs.append(run)
    return metrics_of(workload, sorted(runs, key=lambda run: run.seed))


def gate(measured: Sequence[Metric], baseline: Mapping[str, Metric], ran: Collection[str]) -> int:
    """Say what slipped, and what does not reach its aim; the exit code, which only slips decide.   ran: the workloads."""
    found = slips(measured, baseline, ran)
    for slip in found:
        sys.stderr.write(f"slipped: {slip.text}\n")
    say_missed(measured, baseline)
    sys.stderr.write("The gate holds.\n" if not found else f"{len(found)} of {len(measured)} numbers slipped.\n")
    return 1 if found else 0


def say_missed(measured: Sequence[Metric], baseline: Mapping[str, Metric]) -> None:
    """A line for each figure that does not reach its aim, and how many of those that have one."""
    over = [metric for metric in measured if metric.is_over()]
    for metric in over:
        sys.stderr.write(f"OVER ITS AIM: {metric.key} = {metric.told(baseline.get(metric.key))}\n")
    asked = sum(metric.aim is not None for metric in measured)
    if asked:
        sys.stderr.write(f"{len(over)} of {asked} aims are missed.\n")


if __name__ == "__main__":
    sys.exit(main())
