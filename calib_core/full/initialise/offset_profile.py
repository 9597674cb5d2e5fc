"""How well the lidar's turning and the gyroscope's go together at every time offset around an answer.

Evidence apart from the solve: it knows neither planes' residuals nor the mounting, only that both are one body.
"""

from __future__ import annotations

import numpy as np

from calib_core.full.initialise.settings import AGREEING, PROFILE
from calib_core.full.initialise.start import LidarTrack
from calib_core.full.initialise.stream_lag import likeness
from calib_core.full.initialise.time_offset import turns_of
from calib_core.result import OffsetProfile
from calib_core.types import FloatArray


def offset_profile(
    lidar: LidarTrack, imu_s: FloatArray, gyro_rad_s: FloatArray, time_offset_s: float
) -> OffsetProfile | None:
    """Likeness of the turns (stream_lag.py) around an answer, by whichever of them agree best; None of a body that hardly turned.

    imu_s: (Q,).   gyro_rad_s: (Q, 3).   time_offset_s: the answer's, between the two clocks' own epochs.
    """
    turning_rad_s = float(np.sqrt(np.mean(np.sum(lidar.omega_rad_s**2, axis=1))))
    if turning_rad_s < AGREEING.least_turning_rad_s or len(imu_s) < 2:
        return None
    steps = round(PROFILE.reach_s / PROFILE.step_s)
    away_s: FloatArray = PROFILE.step_s * np.arange(-steps, steps + 1, dtype=np.float64)
    found = [likeness(turns, imu_s, gyro_rad_s, time_offset_s + away_s) for turns in turns_of(lidar)]
    best = max(found, key=lambda curve: float(curve.max()))
    top = int(np.argmax(best))
    if not np.isfinite(best[top]):
        return None
    best_s = float(away_s[top] + PROFILE.step_s * _between(best, top))
    sweep = max(1, round(float(np.median(lidar.sweep_s)) / PROFILE.step_s))
    return OffsetProfile(
        first_s=-PROFILE.reach_s,
        step_s=PROFILE.step_s,
        likeness=[round(float(value), 4) if np.isfinite(value) else None for value in best],
        best_s=round(best_s, 5),
        text=f"The highest, {best[top]:.3f}, is at {round(1e3 * best_s, 1) + 0.0:+.1f} ms{_meaning(best, top, best_s, sweep)}.",
    )


def _meaning(curve: FloatArray, top: int, best_s: float, sweep: int) -> str:
    """What a highest value there says of the answer, which is in the curve's middle. sweep: of the lidar, in steps."""
    # Noise alone keeps the highest value from 1, so that a fall of no more is no fall.
    fallen = curve < curve[top] - max(1.0 - float(curve[top]), PROFILE.least_fall)
    if abs(best_s) > PROFILE.step_s and fallen[len(curve) // 2]:
        return (
            f", more than its step of {1e3 * PROFILE.step_s:.0f} ms away: the rotation rates disagree with the answer"
        )
    beside = [at for at in (top - sweep, top + sweep) if 0 <= at < len(curve) and np.isfinite(curve[at])]
    if not all(fallen[at] for at in beside):
        return (
            f", but {1e3 * PROFILE.step_s * sweep:.0f} ms away the match is equally good within noise: the motion is too smooth "
            "to tell the time offset by rotation rates alone"
        )
    return ", which agrees with the answer"


def _between(curve: FloatArray, top: int) -> float:
    """Where between its neighbours the parabola through a highest value and them is highest, in steps from it."""
    if not 0 < top < len(curve) - 1 or not np.isfinite(curve[top - 1 : top + 2]).all():
        return 0.0
    before, here, after = curve[top - 1 : top + 2]
    bend = before - 2.0 * here + after
    return 0.0 if bend >= 0.0 else float(0.5 * (before - after) / bend)
