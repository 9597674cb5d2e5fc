"""`python -m bench.scenarios`: every scenario through the command line, as its user would, into bench/results/scenarios.md.

    python -m bench.scenarios                   all scenarios
    python -m bench.scenarios vehicle attic     these; the rows of the others stay as they are

Each recording is written, solved on all cores and once more on a single one: what is answered, what is said of directions
that the motion leaves open and of the motion to add, how far the determined directions are from the truth, and whether
both documents are the same but for `quality.duration_s`. Rows go to bench/results/scenarios.json.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from pydantic import BaseModel
from scipy.stats import chi2

from bench.bounds import BoundRow, read_bounds
from bench.campaign import version_label
from bench.figures import ASKED as FIGURES
from bench.runs import compare, difference
from bench.store import RESULTS
from calib_core import api
from calib_core.full.joint.undetermined import UNITS
from calib_core.result import CalibrationResult
from calib_core.simulate import SCENARIOS, Truth, prepare

ROWS = "scenarios.json"
TABLE = "scenarios.md"
SEED = 1
#: Status and number of undetermined directions where they are not `calibrated` and none.
ASKED: dict[str, tuple[str, int]] = {
    "one-axis": ("weak", 1),
    "one-axis-in-place": ("weak", 2),
    "no-rotation": ("weak", 3),
    "static": ("refused", 0),
}
#: Where an open turn is further off than this, what is across the directions at the answer is not what is at the truth.
_LINEAR_DEG = 5.0
_HEAD = (
    "scenario", "status", "rotation", "translation", "offset", "error / bound", "stated / bound", "NEES", "of", "scans used",
    "the same", "holds",
)  # fmt: skip
#: The chance that an honest answer's determined directions are called too far from the truth.
_CHANCE = 1e-4


class Row(BaseModel):
    """What one recording came to.

    error, stated: norms of eq. (15) and of the sigmas: deg, mm, ms; None, as nees, where refused.   weak: what is said of each
    undetermined direction.   nees: of the determined directions.   determined: how many they are.   errors: messages of
    that level.   repeatable: the same document from all cores and from one.
    """

    scenario: str
    seed: int
    label: str
    status: str
    exit_code: int
    error: list[float] | None
    stated: list[float] | None
    weak: list[str]
    advice: list[str]
    errors: list[str]
    nees: float | None
    determined: int
    scans_used: int
    scans_total: int
    repeatable: bool

    @property
    def holds(self) -> bool:
        """Whether status, directions, errors and repeatability are as they should be."""
        status, directions = ASKED.get(self.scenario, ("calibrated", 0))
        has_advice = bool(self.advice or self.errors) or self.status == "calibrated"
        return (self.status, len(self.weak)) == (status, directions) and self.is_near and has_advice and self.repeatable

    @property
    def is_near(self) -> bool:
        """Whether the determined directions are as near to the truth as stated; without noise, as near as is asked."""
        figures = FIGURES.get(self.scenario)
        if self.error is not None and figures is not None and figures.at_most is not None:
            most = figures.at_most
            return all(
                e <= m
                for e, m in zip(self.error, (most.rotation_deg, most.translation_mm, most.offset_ms), strict=True)
            )
        return self.nees is None or self.nees <= float(chi2.ppf(1.0 - _CHANCE, self.determined))


def run(slug: str, folder: Path, seed: int = SEED, *, label: str = "") -> Row:
    """Write a recording, solve it twice, compare. Raises CalledProcessError where the command line breaks down."""
    bag = folder / f"{slug}.bag"
    api.simulate(slug, bag, seed=seed)
    cores = sorted(os.sched_getaffinity(0))
    code, text = _solved(bag, folder / "all.json", cores)
    _, again = _solved(bag, folder / "one.json", cores[:1])
    bag.unlink()
    result = CalibrationResult.model_validate_json(text)
    return row_of(result, prepare(slug, seed=seed).truth, seed, label, code, repeatable=same(text, again))


def row_of(result: CalibrationResult, truth: Truth, seed: int, label: str, exit_code: int, *, repeatable: bool) -> Row:
    """The result held against the truth."""
    error = stated = nees = None
    determined = 0
    if result.uncertainty is not None:
        errors, stds, _ = compare(result, truth)
        error, stated = _norms(errors), _norms(stds)
        if error[0] < _LINEAR_DEG:
            nees, determined = nees_of_determined(result, truth)
    return Row(
        scenario=truth.scenario.slug,
        seed=seed,
        label=label,
        status=result.status,
        exit_code=exit_code,
        error=error,
        stated=stated,
        weak=[weak.text for weak in result.observability.weak_directions],
        advice=result.observability.advice,
        errors=[message.text for message in result.messages if message.level == "error"],
        nees=nees,
        determined=determined,
        scans_used=result.quality.scans_used,
        scans_total=result.quality.scans_total,
        repeatable=repeatable,
    )


def nees_of_determined(result: CalibrationResult, truth: Truth) -> tuple[float, int]:
    """NEES of what is across the weak directions, in the contract's scaled units, and how many numbers that is."""
    assert result.uncertainty is not None
    errors = difference(result, truth.T_imu_lidar, truth.time_offset_ns) / UNITS
    covariance = np.array(result.uncertainty.covariance) / np.outer(UNITS, UNITS)
    weak = np.array([each.vector for each in result.observability.weak_directions]).reshape(-1, len(UNITS))
    across = np.linalg.svd(weak, full_matrices=True)[2][len(weak) :]
    shown = across @ errors
    return float(shown @ np.linalg.solve(across @ covariance @ across.T, shown)), len(across)


def same(first: str, second: str) -> bool:
    """Whether two documents differ in nothing but how long they took."""
    documents = [json.loads(text) for text in (first, second)]
    for document in documents:
        document["quality"].pop("duration_s")
    return bool(documents[0] == documents[1])


def table(rows: Sequence[Row], bounds: Mapping[str, BoundRow]) -> str:
    """The page. bounds: by scenario, of those that have one."""
    lines = [
        "# Every scenario through the command line",
        "",
        "Written by `python -m bench.scenarios`: `unsweep simulate SCENARIO`, then `unsweep calibrate` without any option,",
        "on all cores and again on one. Rotation [deg], translation [mm], time offset [ms]: norm of the error (norm of the",
        "stated sigmas). Efficiency: error over the Cramér-Rao bound of `bounds.csv`, and stated sigmas over it, rotation /",
        "translation / time offset; one recording's error is a single draw, what many come to is in accuracy.md. NEES is of the",
        "determined directions, its law chi-square with as many degrees of freedom. The same: both documents are equal but for",
        f"`quality.duration_s`. Where a turn is open and more than {_LINEAR_DEG:g} deg off, the directions of the answer are not",
        "those of the truth, and the rest is not judged. Without noise the IMU's interpolation is all that errs, and no sigma",
        "says how much: those recordings are held against what is asked of them.",
        "",
        f"{sum(row.holds for row in rows)} of {len(rows)} are as they should be.",
        "",
        f"| {' | '.join(_HEAD)} |",
        "| --- | --- |" + " ---: |" * (len(_HEAD) - 4) + " --- | --- |",
        *(_line(row, bounds.get(row.scenario)) for row in rows),
        "",
        "## What is said where something is open",
        "",
    ]
    for row in rows:
        if row.status != "calibrated":
            said = [*row.errors, *row.weak, *(f"To add: {text}" for text in row.advice)]
            lines += [f"**{row.scenario}** ({row.status})", "", *(f"- {text}" for text in said), ""]
    labels = sorted({row.label for row in rows})
    lines += [f"Seed {SEED}, version {', '.join(labels)}.", ""]
    return "\n".join(lines)


def _line(row: Row, bound: BoundRow | None) -> str:
    error, stated = row.error or [], row.stated or []
    limits = [] if bound is None else [bound.rotation_deg, bound.translation_mm, bound.offset_ms]
    cells = [row.scenario, row.status]
    cells += [f"{_short(a)} ({_short(b)})" for a, b in zip(error, stated, strict=True)] or ["", "", ""]
    cells += [" / ".join(f"{a / b:.2f}" for a, b in zip(norms, limits, strict=False)) for norms in (error, stated)]
    cells += ["", ""] if row.nees is None else [f"{row.nees:.1f}", str(row.determined)]
    cells += [f"{row.scans_used} of {row.scans_total}", _yes(row.repeatable), _yes(row.holds)]
    return f"| {' | '.join(cells)} |"


def _yes(holds: bool) -> str:
    return "yes" if holds else "**no**"


def _short(value: float) -> str:
    return f"{value:.2g}" if value < 100.0 else f"{value:.0f}"


def _norms(values: Sequence[float]) -> list[float]:
    rotation, translation = np.linalg.norm(values[:3]), np.linalg.norm(values[3:6])
    return [float(np.degrees(rotation)), float(1e3 * translation), float(1e3 * abs(values[6]))]


def _solved(bag: Path, result: Path, cores: Sequence[int]) -> tuple[int, str]:
    """Exit code and document of one run of the command line on some of the cores."""
    result.unlink(missing_ok=True)
    command = [sys.executable, "-m", "app.cli", "calibrate", str(bag), "--output", str(result), "--quiet"]
    bind: Callable[[], None] = lambda: os.sched_setaffinity(0, cores)  # noqa: E731
    done = subprocess.run(command, check=False, capture_output=True, text=True, preexec_fn=bind)
    if not result.is_file():
        raise subprocess.CalledProcessError(done.returncode, command, stderr=done.stderr)
    return done.returncode, result.read_text(encoding="utf-8")


def read_rows(folder: Path = RESULTS) -> dict[str, Row]:
    """The rows of earlier runs by scenario."""
    path = folder / ROWS
    entries = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else []
    return {entry["scenario"]: Row.model_validate(entry) for entry in entries}


def write_rows(rows: Mapping[str, Row], folder: Path = RESULTS) -> None:
    """Both files, in the scenarios' own order."""
    ordered = [rows[slug] for slug in SCENARIOS if slug in rows]
    text = json.dumps([row.model_dump() for row in ordered], indent=2)
    (folder / ROWS).write_text(text + "\n", encoding="utf-8")
    (folder / TABLE).write_text(table(ordered, read_bounds(folder)), encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, write; 1 where one is not as it should be."""
    parser = argparse.ArgumentParser(prog="python -m bench.scenarios", description="Every scenario, as its user would.")
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", help="all where none is named")
    chosen = parser.parse_args(arguments)
    unknown = [slug for slug in chosen.scenarios if slug not in SCENARIOS]
    if unknown:
        sys.stderr.write(f"Unknown: {', '.join(unknown)}; known: {', '.join(SCENARIOS)}.\n")
        return 2
    label = version_label()
    with tempfile.TemporaryDirectory(prefix="unsweep-scenarios-") as folder:
        for slug in chosen.scenarios or SCENARIOS:
            row = run(slug, Path(folder), label=label)
            write_rows(read_rows() | {slug: row})
            sys.stderr.write(f"{slug}: {row.status}, {'as it should be' if row.holds else 'NOT as it should be'}\n")
    return 0 if all(row.holds for row in read_rows().values()) else 1


if __name__ == "__main__":
    sys.exit(main())
