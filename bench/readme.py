"""The README's table of accuracy, made from the committed campaign: `python -m bench readme` writes it anew."""

from __future__ import annotations

from pathlib import Path

from bench.accuracy import by_scenario
from bench.bounds import read_bounds
from bench.campaign import read_runs
from bench.figures import TWINS
from bench.runs import PARAMETERS
from bench.statistics import accuracy, bound_accuracy, consistency
from bench.store import FOLDER, RESULTS

README = FOLDER.parent / "README.md"
START, END = "<!-- bench -->\n", "<!-- /bench -->\n"
_HEAD = (
    "| recording | runs | rotation, rms (bound) | translation, rms (bound) | time offset, rms (bound) "
    "| NEES / 7 | 95 % intervals cover |\n"
    "| --- | --- | --- | --- | --- | --- | --- |\n"
)
#: Fewer runs than this make no row: their mean says little.
_LEAST_RUNS = 30


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


def with_table(text: str, made: str) -> str:
    """The README's text with the table between the two marks replaced."""
    before, _, rest = text.partition(START)
    _, _, after = rest.partition(END)
    return before + START + made + END + after
