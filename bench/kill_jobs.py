"""What the workers of bench.kills run: the real jobs, but for the solve's own arithmetic, whose answer is kept.

A solve tells its steps, a hundredth of a second each, and then writes the kept answer as any other would be written.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

from app.arrays.trajectory import read_trajectory
from app.jobs.orders import Order
from app.schemas.jobs import Outcome
from app.work import functions
from calib_core import api
from calib_core.calibrate import Calibration
from calib_core.errors import Cancelled
from calib_core.events import IterationEvent, OnEvent, ShouldCancel, StageEvent
from calib_core.result import CalibrationResult

#: Environment: the folder of the job that really solved.
KEPT = "UNSWEEP_BENCH_KEPT"
STEPS = 100
STEP_S = 0.01


def run_job(order: Order, on_event: OnEvent, should_cancel: ShouldCancel) -> Outcome:
    """The ordered job."""
    kept = Path(os.environ[KEPT])

    def answered(*_: object, on_event: OnEvent, should_cancel: ShouldCancel, **__: object) -> Calibration:
        for step in range(STEPS):
            if should_cancel():
                raise Cancelled("Stopped as asked.")
            on_event(StageEvent(stage="solve", fraction=step / STEPS, text="solving"))
            on_event(step_of(step))
            time.sleep(STEP_S)
        result = CalibrationResult.model_validate_json((kept / "result.json").read_text(encoding="utf-8"))
        return Calibration(result, read_trajectory(kept / "trajectory.npz"))

    if (kept / "result.json").exists():
        vars(api)["calibrate"] = answered
    return functions.run_job(order, on_event, should_cancel)


def step_of(step: int) -> IterationEvent:
    """A step of a solve that moves nothing."""
    return IterationEvent(
        iteration=step,
        round=0,
        cost=1.0 / (step + 1),
        matrix=[[float(row == column) for column in range(4)] for row in range(4)],
        translation_m=[0.0] * 3,
        euler_xyz_deg=[0.0] * 3,
        time_offset_s=0.0,
        rotation_std_deg=[0.1] * 3,
        translation_std_m=[0.01] * 3,
        time_offset_std_s=0.001,
        planes=[],
    )
