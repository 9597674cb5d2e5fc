"""Start values from an initial guess, as far as the motion of both sensors does not refute it.

A guess is where to begin. One that is turned upside down, or was written the other way round, leads the solve astray for minutes;
and what both sensors' turning leaves under it, next to what it leaves under the rotation of its own, says so at once. Where it
is held instead, by priors, there is no other start: it is refused.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.errors import Refused
from calib_core.full.initialise.rotation import best_turns, fit_lags, is_worse, left_by
from calib_core.full.initialise.settings import AGREEING, ROTATING
from calib_core.full.initialise.start import LidarTrack, LinearStart, RotationStart
from calib_core.full.run import Run
from calib_core.geometry import log
from calib_core.types import FloatArray, InitialGuess

#: The code of a calibration that is held and that the recording refutes.
HELD_REFUTED = "start.held_refuted"


def start_from_guess(
    run: Run, track: LidarTrack, found: list[RotationStart], guess: InitialGuess
) -> tuple[RotationStart, bool]:
    """The time offset and rotation to start from: what was found, with what the guess has put in its place; and whether the
    rotation is the guess's.

    found: starts that the motion of both sensors tells, best first, maybe none. What they refute of the guess is said
    (`start.guess_refuted`), and not begun with. Raises Refused where priors hold it there.
    """
    if found and guess.R_imu_lidar is not None and _is_held(run):
        _require_held(run, track, found[0], guess, guess.R_imu_lidar)
    base = found[0] if found else RotationStart(0.0, np.eye(3), np.zeros(3), 1.0, 0.0, None)
    if guess.time_offset_ns is not None:
        base = _at_offset(run, track, found, base, run.clocks.offset_s(guess.time_offset_ns))
    R = guess.R_imu_lidar
    if R is None or (found and _refuted(run, track, base, R)):
        return base, False
    return replace(base, R_imu_lidar=R, open_axis_imu=None), True


def _is_held(run: Run) -> bool:
    """Whether priors hold the rotation closer than the turning could refute."""
    tight = {prior.axis for prior in run.settings.priors if prior.std <= ROTATING.held_rad}
    return {"rx", "ry", "rz"} <= tight


def _require_held(
    run: Run, track: LidarTrack, own: RotationStart, guess: InitialGuess, R_imu_lidar: FloatArray
) -> None:
    """Raise Refused where the turning of both sensors leaves much more under what is held than under a rotation of its own.

    What a rotation leaves is 2 sin(e/2) of the turning at the most where it is wrong by e: a tenth more than its own (`is_worse`)
    is 5.7 deg at the least, ten times what the axes of a gyroscope may be off those of its accelerometer. An open turn about
    the only axis leaves nothing. A time offset that is held may be off by as much as a guessed one.
    """
    if own.residual > AGREEING.fits:
        return
    turns, gyro, _ = best_turns(track, run.clocks.imu_s, run.recording.imu.gyro_rad_s)
    offset_s = own.time_offset_s if guess.time_offset_ns is None else run.clocks.offset_s(guess.time_offset_ns)
    around_s = offset_s + np.arange(-ROTATING.guess_s, ROTATING.guess_s + 0.5 * ROTATING.step_s, ROTATING.step_s)
    held = min(float(left_by(turns, gyro, at_s, R_imu_lidar[None])[0]) for at_s in around_s.tolist())
    alone = float(left_by(turns, gyro, own.time_offset_s, own.R_imu_lidar[None])[0])
    if not is_worse(held, alone):
        return
    away: list[str] = []
    if own.open_axis_imu is None:
        away.append(f"turned by {np.degrees(np.linalg.norm(log(own.R_imu_lidar.T @ R_imu_lidar))):.3g} deg")
    if abs(offset_s - own.time_offset_s) > ROTATING.guess_s:
        away.append(f"off by {offset_s - own.time_offset_s:+.3g} s")
    from_own = f", from which it is {' and '.join(away)}" if away else ""
    raise Refused(
        HELD_REFUTED,
        f"with it the rotations of lidar and IMU differ by {100 * held:.0f} % of their size, while they differ by "
        f"{100 * alone:.0f} % with the recording's own rotation and time offset{from_own}",
    )


def _at_offset(
    run: Run, track: LidarTrack, found: list[RotationStart], base: RotationStart, offset_s: float
) -> RotationStart:
    """The start at a time offset that was given; that of the turning itself where no turning fits there."""
    near = [each for each in found if abs(each.time_offset_s - offset_s) < ROTATING.guess_s]
    if near or not run.settings.estimate_time_offset or base.residual > AGREEING.fits:
        return replace(near[0] if near else base, time_offset_s=offset_s)
    turns, gyro, _ = best_turns(track, run.clocks.imu_s, run.recording.imu.gyro_rad_s)
    there = fit_lags(turns, gyro, [(offset_s, 0.0)])
    if there and not is_worse(there[0].residual, base.residual):
        return replace(there[0], time_offset_s=offset_s)
    away_s = offset_s - base.time_offset_s
    run.say(
        "warning",
        "start.guess_refuted",
        f"the time offset of the initial guess is {abs(away_s):.3g} s {'above' if away_s > 0 else 'below'} the one at which the "
        "rotations of both sensors agree: the solve starts from that one instead",
    )
    return base


def _refuted(run: Run, track: LidarTrack, base: RotationStart, R_imu_lidar: np.ndarray) -> bool:
    """Whether the turning of both sensors leaves much more under a rotation that was given than under its own; says so."""
    if base.residual > AGREEING.fits or base.open_axis_imu is not None:
        return False
    turns, gyro, _ = best_turns(track, run.clocks.imu_s, run.recording.imu.gyro_rad_s)
    asked = np.stack([base.R_imu_lidar, R_imu_lidar, R_imu_lidar.T])
    own, given, inverse = left_by(turns, gyro, base.time_offset_s, asked).tolist()
    if not is_worse(given, own):
        return False
    away_deg = np.degrees(np.linalg.norm(log(base.R_imu_lidar.T @ R_imu_lidar)))
    inverted = "" if is_worse(inverse, own) else "; its inverse fits, so it may be T_lidar_imu"
    run.say(
        "warning",
        "start.guess_refuted",
        f"the rotation of the initial guess is {away_deg:.3g} deg from the one with which the rotations of both sensors "
        f"agree{inverted}: the solve starts from that one instead",
    )
    return True


def with_lever_arm(run: Run, found: LinearStart, as_given: LinearStart, p_imu_lidar: FloatArray) -> LinearStart:
    """The linear start with a lever arm (3,) that was given, where the motions do not refute it; says so where they do.

    as_given: the linear start with that lever arm held. What leaves as little of both motions as their own is no worse, and what
    priors will hold is no matter of the start.
    """
    is_held = any(prior.axis in {"tx", "ty", "tz"} for prior in run.settings.priors)
    if is_held or not is_worse(as_given.rms, found.rms):
        return replace(found, p_imu_lidar=p_imu_lidar)
    away_m = float(np.linalg.norm(p_imu_lidar - found.p_imu_lidar))
    run.say(
        "warning",
        "start.guess_refuted",
        f"the translation of the initial guess is {away_m:.2g} m from the one with which the motions of both sensors agree: the "
        "solve starts from that one instead",
    )
    return found
