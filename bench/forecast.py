"""`python -m bench.forecast`: the doctor's forecast beside the solve's own sigmas, on every scenario of the simulator.

    python -m bench.forecast                    all scenarios
    python -m bench.forecast vehicle attic      these; the rows of the others stay as they are
    python -m bench.forecast --forecasts        the forecasts anew; the solves' numbers stay as they are
    python -m bench.forecast --table            the table from the rows, nothing is run

A forecast holds where every parameter that the solve does not call weak is within a factor of 1.5 of the solve's
standard deviation, and both call the same ones weak. Rows go to bench/results/forecast.csv, the table to forecast.md.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np

from bench.store import RESULTS
from calib_core.calibrate import calibrate
from calib_core.doctor.outlook import forecast_report, foresee, planes_report
from calib_core.doctor.report import Forecast, ParameterForecast
from calib_core.doctor.sampling import SampledScans
from calib_core.full.joint.undetermined import LIMITS, UNITS
from calib_core.result import COVARIANCE_ORDER, CalibrationResult
from calib_core.settings import CalibrateSettings
from calib_core.simulate import SCENARIOS, generate
from calib_core.types import Recording

ROWS = RESULTS / "forecast.csv"
TABLE = RESULTS / "forecast.md"
FACTOR = 1.5
SEED = 1


@dataclass(frozen=True)
class Row:
    """One parameter of one scenario. forecast, solve: standard deviations [deg, m, s], NaN where there is none.

    said: why there is none, of the forecast.   status: the solve's.   *_cpu_s: processor time of either.
    """

    scenario: str
    parameter: str
    forecast: float
    solve: float
    forecast_weak: bool
    solve_weak: bool
    status: str
    said: str
    forecast_cpu_s: float
    solve_cpu_s: float

    @property
    def ratio(self) -> float:
        """Forecast over solve."""
        return self.forecast / self.solve

    @property
    def holds(self) -> bool:
        """Whether this is what was promised. A refused solve has to be foretold by a forecast without numbers."""
        if np.isnan(self.solve) or np.isnan(self.forecast):
            return bool(np.isnan(self.solve) and np.isnan(self.forecast))
        if self.solve_weak or self.forecast_weak:
            return self.solve_weak and self.forecast_weak
        return 1.0 / FACTOR < self.ratio < FACTOR


def compare(slug: str, seed: int = SEED) -> list[Row]:
    """Both on one recording of a scenario."""
    recording, _ = generate(slug, seed=seed)
    start = time.process_time()
    result = calibrate(recording, CalibrateSettings()).result
    spent_s = round(time.process_time() - start, 1)
    unknown = Row(slug, "", np.nan, np.nan, True, True, result.status, "", 0.0, spent_s)
    rows = [
        replace(unknown, parameter=name, solve=std, solve_weak=weak)
        for name, (std, weak) in zip(COVARIANCE_ORDER, solved(result), strict=True)
    ]
    return foretell(rows, recording)


def foretell(rows: Sequence[Row], recording: Recording) -> list[Row]:
    """The rows of one scenario with its forecast anew."""
    start = time.process_time()
    forecast = forecast_of(recording)
    spent_s = round(time.process_time() - start, 1)
    told: dict[str, ParameterForecast] = {p.name: p for p in forecast.parameters}
    fresh = [replace(row, forecast=np.nan, forecast_weak=True, said=forecast.reason) for row in rows]
    fresh = [
        replace(row, forecast=told[row.parameter].std, forecast_weak=told[row.parameter].weak)
        if row.parameter in told
        else row
        for row in fresh
    ]
    return [replace(row, forecast_cpu_s=spent_s) for row in fresh]


def forecast_of(recording: Recording) -> Forecast:
    """The doctor's forecast of a recording in memory, from the same sample that it takes of a file."""
    sampled = SampledScans.of(recording)
    outlook = foresee(sampled, recording.imu, recording.coarse_offset_ns, whole=recording.scans)
    return forecast_report(
        outlook, planes_report(outlook.proposals, outlook.gravity, outlook.faults), share=sampled.share
    )


def solved(result: CalibrationResult) -> list[tuple[float, bool]]:
    """Standard deviation [deg, m, s] and weakness of the seven parameters; NaN and weak where it was refused."""
    if result.uncertainty is None:
        return [(np.nan, True)] * len(COVARIANCE_ORDER)
    std = np.sqrt(np.diag(np.array(result.uncertainty.covariance)))
    weak = std > LIMITS * UNITS
    shown = np.concatenate([np.degrees(std[:3]), std[3:]])
    return [(float(s), bool(w)) for s, w in zip(shown, weak, strict=True)]


def read_rows(path: Path = ROWS) -> list[Row]:
    """The rows of earlier runs."""
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return [
            Row(
                **{
                    field.name: value == "True"
                    if field.type == "bool"
                    else float(value)
                    if field.type == "float"
                    else value
                    for field, value in ((field, entry[field.name]) for field in fields(Row))
                }  # type: ignore[arg-type]
            )
            for entry in csv.DictReader(file)
        ]


def write_rows(rows: Iterable[Row], path: Path = ROWS) -> None:
    """All rows, in the scenarios' own order."""
    order = list(SCENARIOS)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Row)], lineterminator="\n")
        writer.writeheader()
        for row in sorted(rows, key=lambda row: order.index(row.scenario)):
            numbers = {k: f"{v:.6g}" if isinstance(v, float) else v for k, v in asdict(row).items()}
            writer.writerow(numbers)


def table(rows: Sequence[Row]) -> str:
    """The comparison as Markdown."""
    failed = [row for row in rows if not row.holds]
    known = [row for row in rows if not (row.solve_weak or row.forecast_weak)]
    ratios = np.array([row.ratio for row in known])
    scenarios = list(dict.fromkeys(row.scenario for row in rows))
    lines = [
        "# The doctor's forecast beside the solve",
        "",
        "Standard deviations of the seven parameters, forecast by `unsweep inspect` before any solve, and the solve's own;",
        f"made by `python -m bench.forecast`, seed {SEED}. A forecast holds where it is within a factor of {FACTOR} for every",
        "parameter that the solve does not call weak, and both call the same ones weak.",
        "",
        f"{len(rows) - len(failed)} of {len(rows)} parameters of {len(scenarios)} scenarios hold.",
        f"Of the {len(known)} that are known, forecast over solve is {ratios.min():.2f} to {ratios.max():.2f},",
        f"median {np.median(ratios):.2f}.",
        "",
        "| scenario | parameter | forecast | solve | ratio | weak: forecast | weak: solve | holds |",
        "| --- | --- | ---: | ---: | ---: | --- | --- | --- |",
    ]
    lines += [_line(row) for row in rows]
    lines += ["", "Processor seconds, and what was said where there is no number:", ""]
    lines += ["| scenario | forecast | solve | status | the forecast says |", "| --- | ---: | ---: | --- | --- |"]
    for scenario in scenarios:
        row = next(row for row in rows if row.scenario == scenario)
        lines.append(f"| {scenario} | {row.forecast_cpu_s:.1f} | {row.solve_cpu_s:.1f} | {row.status} | {row.said} |")
    return "\n".join(lines) + "\n"


def _line(row: Row) -> str:
    scale, unit = {"r": (1.0, "deg"), "t": (1e3, "mm"), "d": (1e3, "ms")}[row.parameter[0]]
    values = ["none" if np.isnan(v) else f"{scale * v:.4g} {unit}" for v in (row.forecast, row.solve)]
    known = not (np.isnan(row.ratio) or row.solve_weak or row.forecast_weak)
    ratio = f"{row.ratio:.2f}" if known else ""
    weak = ["weak" if w else "" for w in (row.forecast_weak, row.solve_weak)]
    cells = [row.scenario, row.parameter, *values, ratio, *weak, "yes" if row.holds else "**no**"]
    return f"| {' | '.join(cells)} |"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, write both files; 1 where a forecast does not hold."""
    parser = argparse.ArgumentParser(prog="python -m bench.forecast", description="Forecast beside solve.")
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", help="all where none is named")
    parser.add_argument("--forecasts", action="store_true", help="only the forecasts anew, beside solves run before")
    parser.add_argument("--table", action="store_true", help="only write the table anew")
    chosen = parser.parse_args(arguments)
    unknown = [slug for slug in chosen.scenarios if slug not in SCENARIOS]
    if unknown:
        sys.stderr.write(f"Unknown: {', '.join(unknown)}; known: {', '.join(SCENARIOS)}.\n")
        return 2
    for slug in () if chosen.table else chosen.scenarios or SCENARIOS:
        before = [row for row in read_rows() if row.scenario == slug]
        again = chosen.forecasts and before
        fresh = foretell(before, generate(slug, seed=SEED)[0]) if again else compare(slug)
        write_rows([*(row for row in read_rows() if row.scenario != slug), *fresh])
        wrong = [row.parameter for row in fresh if not row.holds]
        sys.stderr.write(f"{slug}: {'holds' if not wrong else 'fails for ' + ' '.join(wrong)}\n")
    rows = read_rows()
    TABLE.write_text(table(rows), encoding="utf-8")
    return 0 if all(row.holds for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
