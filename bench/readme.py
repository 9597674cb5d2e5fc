"""The tables of accuracy in README.md and docs/accuracy.md, made from the committed campaigns: `python -m bench readme`.

The README has the campaigns of whole sensors alone (the simulator's profiles), the other page all of them.
"""

from __future__ import annotations

from collections.abc import Container
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
from calib_core.simulate.faults import PROFILES

README, ACCURACY = FOLDER.parent / "README.md", FOLDER.parent / "docs" / "accuracy.md"
#: The marks that each table stands between: ideal sensors, all campaigns with faults, and of these the profiles'.
IDEAL, REAL, WHOLE = (
    (f"<!-- {name} -->\n", f"<!-- /{name} -->\n") for name in ("bench", "bench-real", "bench-profiles")
)
#: Which of them each page has.
PAGES = {README: (WHOLE,), ACCURACY: (REAL, IDEAL)}
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


def real_table(folder: Path = RESULTS, *, only: Container[str] | None = None) -> str:
    """One row for the latest campaign on each recording with faults. only: the faults that get a row; None: all."""
    rows = []
    for campaign, runs in latest(read_fault_runs(folder)).items():
        if only is not None and campaign.faults not in only:
            continue
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
    """A page's text with the tables replaced between the marks that it has."""
    tables = ((WHOLE, real_table(folder, only=PROFILES)), (REAL, real_table(folder)), (IDEAL, table(folder)))
    for (start, end), made in tables:
        if start in text:
            before, _, rest = text.partition(start)
            _, _, after = rest.partition(end)
            text = before + start + made + end + after
    return text


def write_pages() -> None:
    """Write the tables anew into both pages."""
    for page in PAGES:
        page.write_text(with_tables(page.read_text(encoding="utf-8")), encoding="utf-8")
