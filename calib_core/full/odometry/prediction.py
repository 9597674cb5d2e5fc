"""Where a scan is looked for: constant velocity from the last one, and other places where that finds nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.full.odometry.register import ScanMotion
from calib_core.full.odometry.settings import TrackSettings
from calib_core.geometry import exp
from calib_core.types import FloatArray

_NONE = np.zeros(3)


def other_starts(previous: ScanMotion, predicted: ScanMotion, s: TrackSettings, *, thorough: bool) -> list[ScanMotion]:
    """Where else a scan may be that is not where constant velocity has it."""
    starts = [predicted, replace(previous, position=predicted.position, omega_rad_s=_NONE, v_m_s=_NONE)]
    if thorough:
        turns = s.other_turn_rad * np.vstack([np.eye(3), -np.eye(3)])
        starts += [replace(predicted, R=predicted.R @ exp(turn)) for turn in turns]
    return starts


def other_places(predicted: ScanMotion, s: TrackSettings, *, thorough: bool) -> list[ScanMotion]:
    """Where else a scan may be whose orientation is known."""
    starts = [predicted, replace(predicted, v_m_s=_NONE)]
    if thorough:
        starts += [
            replace(predicted, p=predicted.p + step) for step in s.other_step_m * np.vstack([np.eye(3), -np.eye(3)])
        ]
    return starts


def predict(previous: ScanMotion, position: int, dt: float, s: TrackSettings) -> tuple[ScanMotion, FloatArray]:
    """Constant velocity to the next scan, dt [s] later, with the information of that guess."""
    steps = max(abs(dt) / s.tie_s, s.least_tie_steps)
    predicted = replace(
        previous,
        position=position,
        R=previous.R @ exp(previous.omega_rad_s * dt),
        p=previous.p + previous.v_m_s * dt,
    )
    # Acceleration makes the pose's error grow with the square of time and the velocity's with time.
    std = np.array(
        [
            s.tie_rotation_rad * steps**2,
            s.tie_position_m * steps**2,
            s.tie_rate_rad_s * steps,
            s.tie_velocity_m_s * steps,
        ]
    )
    return predicted, np.repeat(1.0 / std**2, 3)
