r"""Readings that the range cut off, as those around them tell what was there, and how little that is.

A gyroscope is cut off by turns, which are smooth: what is flat at the range's end was a peak that went in by the slope m_0 of the
readings before and came out by m_1 of those after, T later. A cubic has just these four; where the slopes are alike it is a
parabola of height m T / 4. How much higher or lower it was nobody knows: as much as that is allowed for, the same over all of the
peak, as it is off on one side.

An accelerometer is cut off by knocks, which are over within a few readings and may be of any size: what it read then, and next to
it, says next to nothing, and a line stands in its place, so that neither noise nor interpolation is told by it. A knock that a
narrow range cuts off takes the velocity with it otherwise, and an answer many of its standard deviations away.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.imu.clipping import LEAST_ACCEL_RANGE_M_S2, LEAST_GYRO_RANGE_RAD_S, at_end, clipped_runs, cut_off
from calib_core.imu.lost_readings import Restored
from calib_core.types import FloatArray, ImuData

#: judged: so many of its ranges a knock may have been. Steel on steel is hundreds of g, but for a thousandth of a second; of what
#: is felt through a mount no more comes to a reading. It is only to be far more than what the velocity is known to.
_KNOCK = 10.0


def unclipped(imu: ImuData) -> Restored | None:
    """With the peaks of turns that were cut off, and how well they and knocks are known; None where nothing was cut off."""
    read = np.hstack([imu.gyro_rad_s, imu.accel_m_s2])
    variance, run = np.zeros(read.shape), np.zeros(len(read), dtype=np.int64)
    gyro = imu.gyro_rad_s.copy()
    at_s = (imu.stamps_ns - imu.stamps_ns[0]) * 1e-9
    for axis, _, runs in clipped_runs(imu.gyro_rad_s, LEAST_GYRO_RANGE_RAD_S):
        for start, end in runs[(runs[:, 0] >= 2) & (runs[:, 1] <= len(read) - 2)].tolist():
            beyond = _beyond(at_s[start - 2 : end + 2], imu.gyro_rad_s[start - 2 : end + 2, axis])
            gyro[start:end, axis] += beyond
            variance[start:end, axis] = beyond**2
            run[start:end] = np.maximum(run[start:end], end - start)
    knocked, range_m_s2 = cut_off(imu.accel_m_s2, LEAST_ACCEL_RANGE_M_S2)
    for axis, end_m_s2, _ in clipped_runs(imu.accel_m_s2, LEAST_ACCEL_RANGE_M_S2):  # scales and biases set ends apart
        knocked[:, axis] |= at_end(imu.accel_m_s2[:, axis], end_m_s2)
    knocked[1:-1] |= knocked[:-2] | knocked[2:]
    variance[:, 3:][knocked] = (_KNOCK * range_m_s2) ** 2
    run[knocked.any(axis=1)] = np.maximum(run[knocked.any(axis=1)], 1)
    (index,) = np.nonzero(run)
    if not len(index):
        return None
    accel = imu.accel_m_s2.copy()
    for values, gone in zip(accel.T, knocked.T, strict=True):
        values[gone] = np.interp(at_s[gone], at_s[~gone], values[~gone])
    return Restored(replace(imu, gyro_rad_s=gyro, accel_m_s2=accel), index, variance[index], run[index])


def _beyond(at_s: FloatArray, values: FloatArray) -> FloatArray:
    """By how much a peak went beyond its end, (N - 4,). at_s, values: (N,), with two readings before it and two after."""
    way, end = np.sign(values[2]), values[2]
    (t0, t1), (x0, x1) = at_s[[1, -2]], values[[1, -2]]
    rises = max(0.0, way * (x0 - values[0]) / (t0 - at_s[0]))
    falls = max(0.0, way * (x1 - values[-1]) / (at_s[-1] - t1))
    T = t1 - t0
    s = (at_s[2:-2] - t0) / T
    cubic = (1.0 + 2.0 * s) * (1.0 - s) ** 2 * way * x0 + s**2 * (3.0 - 2.0 * s) * way * x1
    cubic += s * (1.0 - s) ** 2 * T * rises + s**2 * (1.0 - s) * T * falls
    return np.asarray(way * np.maximum(cubic - way * end, 0.0))
