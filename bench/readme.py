"""The README's tables of accuracy, made from the committed campaigns: `python -m bench readme` writes them anew."""

from __future__ import annotations

from pathlib import Path

from bench.accuracy import by_scenario
from bench.bounds import read_bounds
from bench.campaign import read_runs
from bench.fault_report import latest, summary
from bench.fault_runs import read_fault_runs
from bench.figures import TWINS
from bench.runs import PARAMETERS
from bench.statistics import accuracy, bound_accuracy, consistency
from bench.store import FOLDER, RESULTS

README = FOLDER.parent / "README.md"
#: Of ideal sensors, and of sensors as they are: the marks that each table stands between.
IDEAL, REAL = ("<!-- bench -->\n", "<!-- /bench -->\n"), ("<!-- bench-real -->\n", "<!-- /bench-real -->\n")
_REAL_HEAD = (
    "| recording | faults | runs | rotation, rms (stated) | translation, rms (stated) | time offset, rms (stated) "
    "| NEES / 7 | 95 % intervals cover | worst of all, sigmas |\n"
    "| --- | --- | --- | --- | --- | --- | --- | --- | --- |\n"
)
_HEAD = (
    "| recording | runs | rotation, rms (bound) | translation, rms (bound) | time offset, rms (bound) "
    "| NEES / 7 | 95 % intervals cover |\n"
    "| --- | --- | --- | --- | --- | --- | --- |\n"
)
#: Fewer runs than this make no row: their mean says little.
_LEAST_RUNS = 30
#: Rows of fewer runs than this are marked. derived: of fewer than five an honest mean NEES may be 0.55 to 1.6 times what it
#: should (95 %, chi-square of 7 a run): those stand in faults.md alone.
_LEAST_FAULTY_RUNS, _FEWEST_FAULTY_RUNS = 20, 5


def table(folder: Path = RESULTS) -> str:
    """One row for each scenario of the campaign that has a bound."""
    bounds = read_bounds(folder)
    rows = []
    for name, runs in by_scenario(read_runs(folder)).items():
        solved = [run for run in runs if run.is_solved]
        if name not in bounds or name in TWINS or len(solved) < _LEAST_RUNS:
            continue
        found, limit, judged = accuracy(runs), bound_accuracy(bounds[name]), consistency(runs)
        cells = [
            name,
            f"{len(runs)}",
            f"{found.rotation_deg:.4f} deg ({limit.rotation_deg:.4f})",
            f"{found.translation_mm:.2f} mm ({limit.translation_mm:.2f})",
            f"{found.offset_ms:.4f} ms ({limit.offset_ms:.4f})",
            f"{judged.mean_nees / len(PARAMETERS):.2f}",
            f"{100 * judged.pooled:.1f} %",
        ]
        rows.append("| " + " | ".join(cells) + " |\n")
    return _HEAD + "".join(rows) if rows else "Not measured yet.\n"


def real_table(folder: Path = RESULTS) -> str:
    """One row for the latest campaign on each recording with faults."""
    rows = []
    for campaign, runs in latest(read_fault_runs(folder)).items():
        solved = any(run.is_solved for run in runs)
        if solved and len(runs) < _FEWEST_FAULTY_RUNS:
            continue
        if not solved:
            where = f"{campaign.scenario}, {campaign.duration_s:g} s"
            rows.append(f"| {where} | {campaign.faults} | {len(runs)}, 0 solved |" + " |" * 6 + "\n")
            continue
        found = summary(runs)
        count = f"{found.runs}" if found.solved == found.runs else f"{found.runs}, {found.solved} solved"
        cells = [
            f"{campaign.scenario}, {campaign.duration_s:g} s",
            campaign.faults,
            count if found.runs >= _LEAST_FAULTY_RUNS else f"only {count}",
            *(
                f"{rms:.{digits}f} {unit} ({stated:.{digits}f})"
                for rms, stated, unit, digits in zip(
                    found.rms, found.stated, ("deg", "mm", "ms"), (4, 2, 4), strict=True
                )
            ),
            f"{found.nees[0] / len(PARAMETERS):.2f}",
            f"{100 * found.inside:.1f} %",
            f"{found.worst:.1f}",
        ]
        rows.append("| " + " | ".join(cells) + " |\n")
    return _REAL_HEAD + "".join(rows) if rows else "Not measured yet.\n"


def with_tables(text: str, folder: Path = RESULTS) -> str:
    """The README's text with the tables between their marks replaced."""
    for (start, end), made in ((REAL, real_table(folder)), (IDEAL, table(folder))):
        before, _, rest = text.partition(start)
        _, _, after = rest.partition(end)
        text = before + start + made + end + after
    return text
