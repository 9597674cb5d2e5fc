"""Whether the IMU's axes and unit fit the lidar's motion at all: mirrored axes, flipped signs, a gyroscope 57 times off.

The lidar's track turns and accelerates; an IMU rigidly joined to it does the same but for a rotation. Two things are
compared. Turns: the best orthogonal map from the lidar's to the gyroscope's is a rotation unless an odd number of the
gyroscope's axes is flipped; then it is a reflection. Accelerations: with the rotation from the turns, the linear start
leaves several times the usual misfit unless the accelerometer's axes are those of the gyroscope. Trying the sign
patterns tells which axes to name. A gyroscope with two axes flipped and an accelerometer with the same two flipped
are one and the same to this test.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from calib_core.full.initialise.agreement import DEGREES, agreement, mean_rate
from calib_core.full.initialise.linear import linear_start
from calib_core.full.initialise.settings import SIGNS
from calib_core.full.initialise.start import LidarTrack, LinearStart, RotationStart
from calib_core.full.initialise.time_offset import GyroTurns, turns_of
from calib_core.intrinsics import STANDARD_GRAVITY_M_S2
from calib_core.types import FloatArray, ImuData

#: What a mirrored cloud looks like too.
_ALL = "accelerometer's x, y and z axes"


def unit_complaint(lidar: LidarTrack, imu_s: FloatArray, imu: ImuData) -> str:
    """A clause where the gyroscope turns as the lidar does, but 57 times as fast or as slowly; else "".

    Only where the rates go together: the ratio to a track that was lost says nothing.
    """
    speed = float(np.percentile(np.linalg.norm(lidar.omega_rad_s, axis=1), SIGNS.fast_percent))
    if speed < SIGNS.moving_rad_s:
        return ""
    found = agreement(lidar, imu_s, imu.gyro_rad_s)
    if found.correlation < SIGNS.together or found.ratio_spread > SIGNS.steady:
        return ""
    if abs(abs(np.log(found.ratio)) - np.log(DEGREES)) > SIGNS.steady:
        return ""
    unit = "deg_s" if found.ratio > 1.0 else "rad_s"
    return (
        f"the gyroscope turns {found.ratio:.3g} times as fast as the lidar, so its readings are in another unit than was"
        f" assumed; pass --gyroscope-unit {unit}"
    )


def gravity_complaint(imu_s: FloatArray, imu: ImuData, gravity_m_s2: float) -> str:
    """A clause where what the accelerometer shows is nearer to ten times gravity, or to a tenth of it, than to it; else "".

    Reading by reading, and on average over as long as a rig is shaken to and fro: a drone's frame reads three times gravity.
    """
    over = mean_rate(imu_s, imu.accel_m_s2, imu_s, imu_s + SIGNS.gravity_over_s)
    shown = [np.linalg.norm(imu.accel_m_s2, axis=1), over[np.isfinite(over)]]
    ratios = [float(np.median(each)) / gravity_m_s2 for each in shown if len(each)]
    ratio = min(ratios, key=lambda each: abs(np.log(max(each, 1e-9))))
    if ratio * np.sqrt(STANDARD_GRAVITY_M_S2) > 1.0 and ratio < np.sqrt(STANDARD_GRAVITY_M_S2):
        return ""
    return (
        f"the accelerometer shows {ratio:.3g} times gravity, so its readings are in another unit than was assumed; pass "
        f"--accelerometer-unit {'m_s2' if ratio > 1.0 else 'g'}"
    )


def axis_complaint(
    lidar: LidarTrack,
    imu_s: FloatArray,
    imu: ImuData,
    start: RotationStart,
    linear: LinearStart,
    gravity_m_s2: float,
    *,
    doubted: bool = False,
) -> str:
    """A clause that names axes whose signs are wrong, where flipping them explains the motion; else "".

    doubted: whether the gyroscope turns gravity the other way round than the accelerometer has it: then less has to be explained.
    """
    if not SIGNS.suspicious_rms <= linear.rms < np.inf:  # nor of what came to no number
        return ""
    gyro = GyroTurns(imu_s, imu.gyro_rad_s)
    lag_s, rotation = _best_lag(lidar, gyro, start.time_offset_s, handed=1.0)
    mirrored_lag_s, reflection = _best_lag(lidar, gyro, start.time_offset_s, handed=-1.0)
    patterns = [np.array(signs) for signs in product((1.0, -1.0), repeat=3)]
    trials: list[tuple[float, str]] = []
    for signs in patterns[1:]:
        named = _listed(signs)
        if np.prod(signs) < 0:  # an odd number of gyroscope axes: the turns say so by themselves
            trial = replace(start, time_offset_s=mirrored_lag_s, R_imu_lidar=signs[:, None] * reflection)
            trials.append((_rms(lidar, imu_s, imu.accel_m_s2, trial, gravity_m_s2), f"gyroscope's {named}"))
            if signs[2] < 0 and np.sum(signs < 0) == 1:  # any other odd number of both is this one, turned
                both = _rms(lidar, imu_s, imu.accel_m_s2 * signs, trial, gravity_m_s2)
                trials.append((both, f"gyroscope's {named} and of the accelerometer's {named}"))
        trial = replace(start, time_offset_s=lag_s, R_imu_lidar=rotation)
        sensor = "accelerometer's" if np.prod(signs) < 0 else "gyroscope's or the accelerometer's"
        trials.append((_rms(lidar, imu_s, imu.accel_m_s2 * signs, trial, gravity_m_s2), f"{sensor} {named}"))
    best, named = min((each for each in trials if np.isfinite(each[0])), default=(np.inf, ""))
    if best > (SIGNS.explains_what_is_doubted if doubted else SIGNS.explains) * linear.rms:
        return ""
    # A lidar whose clouds are mirrored and an accelerometer with all three signs turned round are the same to both motions.
    where = "in the IMU's driver" + (", or the lidar's if its clouds are mirrored," if named == _ALL else "")
    return (
        f"the signs of the {named} do not fit the lidar's motion: with these signs flipped, accelerations and rotations fit"
        f" {linear.rms / best:.0f} times as well; correct the axes {where} and record again"
    )


def _turn_rates(lidar: LidarTrack, gyro: GyroTurns, offset_s: float) -> tuple[FloatArray, FloatArray]:
    """Mean rates of lidar and gyroscope over the same spans, each (N, 3)."""
    turns = turns_of(lidar)[-1]
    own = gyro.over(turns.start_s - offset_s, turns.end_s - offset_s)
    shared = np.isfinite(own[:, 0])
    return turns.rate_rad_s[shared], own[shared]


def _best_lag(lidar: LidarTrack, gyro: GyroTurns, near_s: float, *, handed: float) -> tuple[float, FloatArray]:
    """The lag near a given one, and the map there, at which the turns agree best through a map of determinant `handed`."""
    best = (np.inf, near_s, np.eye(3))
    for lag_s in near_s + np.arange(-SIGNS.around_s, SIGNS.around_s + 0.5 * SIGNS.step_s, SIGNS.step_s):
        a, b = _turn_rates(lidar, gyro, float(lag_s))
        if len(a) < SIGNS.fewest_spans:
            continue
        a, b = a - np.median(a, axis=0), b - np.median(b, axis=0)
        u, _, vt = np.linalg.svd(b.T @ a)
        through = u @ np.diag([1.0, 1.0, handed * float(np.linalg.det(u @ vt))]) @ vt
        misfit = float(np.median(np.linalg.norm(b - a @ through.T, axis=1)))
        if misfit < best[0]:
            best = (misfit, float(lag_s), through)
    return best[1], best[2]


def _rms(
    lidar: LidarTrack, imu_s: FloatArray, accel_m_s2: FloatArray, trial: RotationStart, gravity_m_s2: float
) -> float:
    return linear_start(lidar, imu_s, accel_m_s2, trial, gravity_m_s2=gravity_m_s2).rms


def _listed(signs: FloatArray) -> str:
    axes = [axis for axis, sign in zip("xyz", signs, strict=True) if sign < 0]
    return f"{axes[0]} axis" if len(axes) == 1 else f"{', '.join(axes[:-1])} and {axes[-1]} axes"
