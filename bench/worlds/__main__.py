"""`python -m bench.worlds`: recordings of a simulator that shares nothing with the estimator's, held against the truth.

    python -m bench.worlds --seeds 1-60              draw, solve, compare; rows go to bench/results/worlds.csv
    python -m bench.worlds --seeds 1-60 --faults all all of them with that kind of faults (by turns where none is named)
    python -m bench.worlds --seeds 7 --bag w7.bag    the recording alone, and its truth to the terminal
    python -m bench.worlds --report                  worlds.md from the rows

What is in the table is not run again.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.campaign import seeds_of, version_label
from bench.runs import PARAMETERS, difference
from bench.store import RESULTS
from bench.tables import append_row
from bench.worlds.draw import World, draw, record
from bench.worlds.faults import FAULTS
from bench.worlds.report import ROWS, TABLE, Row, read, report
from calib_core import api
from calib_core.settings import CalibrateSettings


def solve(world: World, path: Path) -> Row:
    """One recording solved and held against the truth. path: of its bag."""
    started = time.process_time()
    result = api.calibrate(api.load(path), CalibrateSettings()).result
    errors = stds = np.full(7, np.nan)
    nees = float("nan")
    if result.uncertainty is not None:
        covariance = np.array(result.uncertainty.covariance)
        errors = difference(result, world.T_imu_lidar, round(world.time_offset_s * 1e9))
        stds, nees = np.sqrt(np.diag(covariance)), float(errors @ np.linalg.solve(covariance, errors))
    said = next((m.code for m in result.messages if m.level == "error"), "")
    return Row(
        world.seed, world.kind, world.place, world.motion, world.lidar, world.duration_s, result.status, said,
        tuple(errors.tolist()), tuple(stds.tolist()), nees, time.process_time() - started, version_label(),
    )  # fmt: skip


def kind_of(seed: int) -> str:
    """Faults by turns."""
    return FAULTS[seed % len(FAULTS)]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what was asked for, one recording after the other."""
    parser = argparse.ArgumentParser(
        prog="python -m bench.worlds", description="An independent simulator's recordings."
    )
    parser.add_argument("--seeds", type=seeds_of, default=(), help="such as 1-40")
    parser.add_argument("--faults", choices=FAULTS, help="for all of them")
    parser.add_argument("--bag", type=Path, help="write the one seed's recording there, and solve nothing")
    parser.add_argument("--again", action="store_true", help="also what is in the table")
    parser.add_argument("--report", action="store_true", help="write worlds.md from the rows")
    parser.add_argument("--folder", type=Path, default=RESULTS, help="of the results (bench/results)")
    chosen = parser.parse_args(arguments)
    done = {(row.seed, row.faults) for row in read(chosen.folder)}
    for seed in chosen.seeds:
        world = draw(seed, chosen.faults or kind_of(seed))
        if chosen.bag is not None:
            record(world, chosen.bag)
            print(
                f"{world.place}, {world.motion}, {world.lidar}, {world.kind}: T_imu_lidar {world.T_imu_lidar.tolist()},",
                flush=True,
            )
            print(f"time_offset_s {world.time_offset_s:.9f}", flush=True)
            continue
        if (seed, world.kind) in done and not chosen.again:
            continue
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "world.bag"
            record(world, path)
            row = solve(world, path)
        append_row(chosen.folder / ROWS, row, PARAMETERS)
        print(row.line(), flush=True)
    if chosen.report:
        (chosen.folder / TABLE).write_text(report(read(chosen.folder)), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
