"""What a result's solve took out of its recording's readings, taken out of them once more: for those who compare the two.

What was only considered was not taken out and stays. Signs: calib_core/intrinsics.py. Ticks and vibrations of the IMU stay, too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.imu.intrinsics import ImuIntrinsics
from calib_core.intrinsics import KINDS, NAMES, Block
from calib_core.result import CalibrationResult
from calib_core.types import FloatArray, ImuData, Recording


def estimated(result: CalibrationResult) -> dict[tuple[str, str], float]:
    """The values that the solve worked with, by block and name."""
    return {(each.block, each.name): each.value for each in result.intrinsics if each.state == "estimated"}


def ideal_readings(recording: Recording, result: CalibrationResult) -> ImuData:
    """The IMU's readings as an ideal one's, biases left in, and its stamps at one offset from the lidar's clock all through."""
    imu, found = recording.imu, estimated(result)
    if not any(KINDS[block].owner in {"imu", "clock"} and (block, name) in found for block in NAMES for name in NAMES[block]):
        return imu
    stamps_ns = imu.stamps_ns
    if result.clock_rate_ppm and ("clock_rate", "rate") in found:
        first_ns = recording.scans[0].stamp_ns if len(recording.scans) else int(stamps_ns[0])
        since_s = (stamps_ns - first_ns + (result.time_offset_ns or 0)) * 1e-9 - (result.time_offset_at_s or 0.0)
        stamps_ns = stamps_ns + np.rint(1e3 * result.clock_rate_ppm * since_s).astype(np.int64)

    def values(block: Block) -> FloatArray:
        return np.array([found.get((block, name), 0.0) for name in NAMES[block]])

    own = ImuIntrinsics(
        gyro_scale=values("gyroscope_scale"),
        gyro_axes=values("gyroscope_axes"),
        gyro_rotation=values("gyroscope_rotation"),
        accel_scale=values("accelerometer_scale"),
        accel_axes=values("accelerometer_axes"),
        accel_delay_s=float(values("accelerometer_delay")[0]),
        g_sensitivity=values("g_sensitivity"),
    )
    at_s = (imu.stamps_ns - imu.stamps_ns[0]) * 1e-9
    # Late by the delay: what happened at an instant is read so much after it.
    read = np.stack([np.interp(at_s + own.accel_delay_s, at_s, axis) for axis in imu.accel_m_s2.T], axis=1)
    accel = read @ np.linalg.inv(own.accel).T
    gyro = (imu.gyro_rad_s - accel @ own.g_sensitivity.reshape(3, 3).T) @ np.linalg.inv(own.gyro).T
    return replace(imu, stamps_ns=stamps_ns, gyro_rad_s=gyro, accel_m_s2=accel)
