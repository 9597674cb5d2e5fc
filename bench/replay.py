"""`python -m bench.replay`: the joint estimation of one recording, with the state before each step written down, or from one.

    python -m bench.replay RECORDING --states DIR                    run, and write DIR/coarse, DIR/propagate, ...
    python -m bench.replay RECORDING --states DIR --first propagate  run from DIR/propagate on, without what was before it

A recording that is refused, or answered wrongly, is looked at this way: the stages before give the same each time, and the
step that goes wrong is run again by itself, in a debugger or after a change.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib_core import api
from calib_core.errors import Refused
from calib_core.events import Event, LogEvent, never_cancel
from calib_core.full.initialise.initialise import initialise
from calib_core.full.initialise.lidar_motion import begin as follow_planes
from calib_core.full.joint.first_estimate import begin
from calib_core.full.joint.replay import load_estimation, save_estimation
from calib_core.full.joint.schedule import FULL
from calib_core.full.joint.solve import STEPS, estimate_jointly
from calib_core.full.prepare.prepare import prepare
from calib_core.settings import CalibrateSettings


def main(arguments: Sequence[str] | None = None) -> int:
    """0: solved; 3: refused, with the reason on stdout."""
    asked = _parser().parse_args(arguments)
    asked.states.mkdir(parents=True, exist_ok=True)
    run = prepare(api.load(asked.recording), CalibrateSettings(), _say, never_cancel)
    try:
        followed = follow_planes(run, None)
        lidar, start = initialise(run, followed.motions, followed.planes, None)
        data, state, _ = begin(run, followed, lidar, start, None, FULL)
        data = replace(data, on_state=lambda name, known: save_estimation(known, asked.states / name))
        if asked.first is not None:
            state = load_estimation(asked.states / asked.first)
        solved = estimate_jointly(data, state, FULL, first=asked.first or STEPS[0][0])
    except Refused as refused:
        print(f"refused ({refused.code}): {refused}")
        return 3
    with np.printoptions(precision=17):
        print(f"{solved.rounds} rounds, cost {solved.minimum.cost!r}")
        print(f"p_imu_lidar {solved.estimate.p_imu_lidar} m, time offset {solved.estimate.time_offset_s!r} s")
    return 0


def _say(event: Event) -> None:
    if isinstance(event, LogEvent):
        print(f"{event.code}: {event.text}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m bench.replay", description=__doc__.split("\n")[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--states", type=Path, required=True, help="folder of the states before each step")
    parser.add_argument(
        "--first", choices=[name for name, _, _ in STEPS], help="begin with this step, from its state there"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
