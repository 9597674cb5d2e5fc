"""`python -m bench.rooms`: random rigs in random rooms (rigs.py), solved and held against the truth.

    python -m bench.rooms --seeds 100-299 --mixed    draw, solve, compare; rows go to bench/results/rooms.csv
    python -m bench.rooms --seeds 1-3 --extremes all each kind of extremes.py with each seed's rig
    python -m bench.rooms --seeds 0-39 --start-only  the lidar-only track and the start values alone, to the terminal
    python -m bench.rooms --clutter 1-10             the cluttered room, seed by seed
    python -m bench.rooms --bounds --seeds 100-299   what is possible for these rigs: room_bounds.csv
    python -m bench.rooms --report                   rooms.md from the rows

What is in the table is not run again. `--mixed`: every third rig has the faults of a profile, by turns.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench import room_bounds
from bench.campaign import seeds_of, version_label
from bench.extremes import EXTREMES, extreme
from bench.rigs import cluttered, draw, rate_deg_s
from bench.room_rows import ROWS, Row, key_of, read
from bench.rooms_report import TABLE, report
from bench.runs import PARAMETERS, compare
from bench.store import RESULTS
from bench.tables import append_row
from calib_core import api
from calib_core.errors import Refused
from calib_core.events import ignore_event, never_cancel
from calib_core.full.initialise.initialise import initialise
from calib_core.full.initialise.lidar_motion import begin
from calib_core.full.prepare.prepare import prepare
from calib_core.geometry import log
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Scenario, Truth, generate, parse_faults
from calib_core.types import Plane, Recording

#: Shorter than a person would record: what decides a start is the room, not how long one stays.
DURATION_S = 12.0
Made = tuple[Recording, Truth]


def solve(
    place: str,
    seed: int,
    lidar: str,
    scenario: Scenario,
    *,
    faults: str = "",
    planes: Sequence[Plane] | None = None,
    made: Made | None = None,
) -> Row:
    """One recording solved and held against the truth."""
    recording, truth = made or generate(scenario, seed=seed, faults=parse_faults(faults))
    started = time.process_time()
    result = api.calibrate(recording, CalibrateSettings(), planes=planes).result
    errors, stds, nees = compare(result, truth)
    wrong = [m for m in result.messages if m.level == "error"]
    names = [body.name for body in scenario.scene.bodies]
    return Row(
        place, seed, lidar, sum(n.startswith("box") for n in names), sum(n == "person trunk" for n in names),
        rate_deg_s(truth, scenario.duration_s), faults or "ideal",
        result.status, wrong[0].code if wrong else "", wrong[0].text if wrong else "",
        errors, stds, nees, result.quality.scans_used, result.quality.scans_total, len(result.quality.planes),
        sum(m.text.endswith("left out") for m in result.messages), time.process_time() - started, version_label(),
    )  # fmt: skip


def faults_of(seed: int) -> str:
    """Of a mixed campaign: two rigs of three have ideal sensors, the third those of a profile, by turns."""
    return "" if seed % 3 else ("industrial", "consumer")[seed // 3 % 2]


def start_of(scenario: Scenario, seed: int) -> str:
    """How far the lidar was followed, and how far off the start values are."""
    recording, truth = generate(scenario, seed=seed)
    started = time.process_time()
    run = prepare(recording, CalibrateSettings(), ignore_event, never_cancel)
    try:
        followed = begin(run, None)
        _, start = initialise(run, followed.motions, followed.planes, None)
    except Refused as error:
        return f"{error.code}: {error}"
    seconds = time.process_time() - started
    T = np.asarray(truth.T_imu_lidar)
    turn = np.degrees(np.linalg.norm(log(T[:3, :3].T @ start.rotation.R_imu_lidar)))
    arm = float(np.linalg.norm(start.linear.p_imu_lidar - T[:3, 3]))
    late_ms = 1e-6 * (run.clocks.offset_ns(start.rotation.time_offset_s) - truth.time_offset_ns)
    seen = sum(m.share > 0 for m in followed.motions)
    wrong = "  WRONG" if turn > 5.0 or abs(late_ms) > 25.0 else ""
    return (
        f"followed {seen:3d}/{len(recording.scans)} {len(followed.planes):2d} planes {turn:6.2f} deg {late_ms:8.1f} ms"
        f" {1e3 * arm:6.0f} mm correlation {start.rotation.correlation:.3f} rms {start.linear.rms:.2f} {seconds:.1f} s{wrong}"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what was asked for, one recording after the other."""
    parser = argparse.ArgumentParser(prog="python -m bench.rooms", description="Random rigs in random rooms.")
    parser.add_argument("--seeds", type=seeds_of, default=(), help="such as 0-39")
    parser.add_argument("--clutter", type=seeds_of, default=(), help="seeds of the cluttered room")
    parser.add_argument("--extremes", nargs="*", default=[], metavar="KIND", help=f"all, or of {', '.join(EXTREMES)}")
    parser.add_argument("--report", action="store_true", help="write rooms.md from the rows")
    parser.add_argument("--mixed", action="store_true", help="every third rig with the faults of a profile")
    parser.add_argument("--faults", default="", help="for all rigs, such as consumer")
    parser.add_argument("--duration-s", type=float, default=DURATION_S, help="of a recording (%(default)s)")
    parser.add_argument("--again", action="store_true", help="also what is in the table")
    parser.add_argument("--start-only", action="store_true", help="track and start values, no solve")
    parser.add_argument("--bare", action="store_true", help="the buildings alone: no boxes, nobody")
    parser.add_argument("--bounds", action="store_true", help="what is possible for these rigs, no solve")
    parser.add_argument("--folder", type=Path, default=RESULTS, help="of the results (bench/results)")
    chosen = parser.parse_args(arguments)
    done = {key_of(row.kind, row.place, row.seed) for row in read(chosen.folder)}
    bounded = room_bounds.read(chosen.folder)
    kinds = list(EXTREMES) if chosen.extremes == ["all"] else chosen.extremes
    tasks = [("extreme", kind, seed) for seed in chosen.seeds for kind in kinds]
    if not kinds:
        room = "bare" if chosen.bare else "clutter"
        tasks = [("drawn", "", seed) for seed in chosen.seeds] + [(room, room, seed) for seed in chosen.clutter]
    for kind, which, seed in tasks:
        if not chosen.again and not chosen.start_only and not chosen.bounds and key_of(kind, which, seed) in done:
            continue
        faults = faults_of(seed) if chosen.mixed and kind == "drawn" else chosen.faults
        if kind == "extreme":
            place, name, scenario = extreme(which, seed, duration_s=chosen.duration_s)
        elif kind in ("clutter", "bare"):
            place, name, scenario = which, "VLP-16", cluttered(duration_s=chosen.duration_s, bare=chosen.bare)
        else:
            place, name, scenario = draw(seed, duration_s=chosen.duration_s, bare=chosen.bare)
        if chosen.bounds:
            if chosen.again or (place, seed) not in bounded:
                bound = room_bounds.compute(place, seed, scenario)
                append_row(chosen.folder / room_bounds.ROWS, bound, room_bounds.NORMS)
                print(
                    f"{seed:4d} {place:6s} {name:8s} {1e3 * bound.ideal[1]:7.2f} mm, cheap {1e3 * bound.cheap[1]:7.2f} mm",
                    flush=True,
                )
            continue
        if chosen.start_only:
            print(f"{seed:4d} {place:6s} {name:8s} {start_of(scenario, seed)}", flush=True)
            continue
        row = solve(place, seed, name, scenario, faults=faults)
        append_row(chosen.folder / ROWS, row, PARAMETERS)
        print(row.line(), flush=True)
    if chosen.report:
        (chosen.folder / TABLE).write_text(report(chosen.folder), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
