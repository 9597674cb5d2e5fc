"""Readings that an IMU's range cut off: motion there is not what they say."""

from __future__ import annotations

import numpy as np

from calib_core.types import FloatArray, ImuData

#: The narrowest ranges that are sold: 125 deg/s (2.18 rad/s) and 2 g (19.6 m/s2); and a tenth for scale errors.
_LEAST_GYRO_RANGE_RAD_S = 1.96
_LEAST_ACCEL_RANGE_M_S2 = 17.6
#: Of more readings than this share it is said. One in two thousand is a knock.
CLIPPED_SHARE = 5e-4


def clipped(imu: ImuData) -> tuple[float, float]:
    """Shares of the gyroscope's and the accelerometer's readings that are, on the worst axis of each."""
    return (
        clipped_share(imu.gyro_rad_s, _LEAST_GYRO_RANGE_RAD_S),
        clipped_share(imu.accel_m_s2, _LEAST_ACCEL_RANGE_M_S2),
    )


def clipped_text(shares: tuple[float, float]) -> str:
    """The sensor that is clipped more and how much, as a clause; "" where neither is."""
    share = max(shares)
    if share <= CLIPPED_SHARE:
        return ""
    return f"the {worse_sensor(shares)} is clipped in {share:.2%} of its readings: motion there is not what it says"


def worse_sensor(shares: tuple[float, float]) -> str:
    """Which of both is clipped more."""
    return "gyroscope" if shares[0] >= shares[1] else "accelerometer"


def clipped_share(channels: FloatArray, least_range: float = 0.0) -> float:
    """Share of readings that stay within 0.01 % of an axis's extreme for three readings or more in a row.

    A smooth peak leaves its summit at once; a clipped one is flat.   channels: (Q, 3).   least_range: in the same unit;
    no sensor clips below it: readings that are alike there are coarse, or repeated by the driver.
    """
    worst = 0.0
    for axis in range(3):
        values = channels[:, axis]
        for extreme in (values.max(), values.min()):
            if abs(extreme) < least_range or abs(extreme) < 0.2 * np.abs(channels).max() or extreme == 0:
                continue
            at = np.abs(values - extreme) <= 1e-4 * abs(extreme)
            edges = np.flatnonzero(np.diff(np.concatenate([[False], at, [False]]).astype(np.int8)))
            runs = np.diff(edges.reshape(-1, 2), axis=1)
            worst = max(worst, float(runs[runs >= 3].sum()) / values.size)
    return worst
