"""Readings that an IMU's range cut off: motion there is not what they say."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calib_core.types import BoolArray, FloatArray, ImuData, IntArray

#: The narrowest ranges that are sold: 125 deg/s (2.18 rad/s) and 2 g (19.6 m/s2); and a tenth for scale errors.
LEAST_GYRO_RANGE_RAD_S = 1.96
LEAST_ACCEL_RANGE_M_S2 = 17.6
#: Of more readings than this share it is said. One in two thousand is a knock.
CLIPPED_SHARE = 5e-4
#: Readings in a row: a smooth peak may have two alike.
_FEWEST = 3
#: Share of an extreme within which readings are alike.
_ALIKE = 1e-4


def clipped(imu: ImuData) -> tuple[float, float]:
    """Shares of the gyroscope's and the accelerometer's readings that are, on the worst axis of each."""
    return (
        clipped_share(imu.gyro_rad_s, LEAST_GYRO_RANGE_RAD_S),
        clipped_share(imu.accel_m_s2, LEAST_ACCEL_RANGE_M_S2),
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
    shares = [0.0, *(float(np.diff(runs).sum()) / len(channels) for _, runs in clipped_runs(channels, least_range))]
    return max(shares)


def clipped_runs(channels: FloatArray, least_range: float) -> Iterator[tuple[int, IntArray]]:
    """Each axis with where it stays at an extreme, (R, 2): from the first reading to before the last. Arguments as above."""
    for axis in range(channels.shape[1]):
        values = channels[:, axis]
        for extreme in (values.max(), values.min()):
            if abs(extreme) < least_range or abs(extreme) < 0.2 * np.abs(channels).max() or extreme == 0:
                continue
            at = np.abs(values - extreme) <= _ALIKE * abs(extreme)
            edges = np.flatnonzero(np.diff(np.concatenate([[False], at, [False]]).astype(np.int8)))
            runs = edges.reshape(-1, 2)
            yield axis, runs[np.diff(runs, axis=1)[:, 0] >= _FEWEST]


def cut_off(channels: FloatArray, least_range: float) -> tuple[BoolArray, float]:
    """(Q, 3) which readings are at the range's end, and the range; none where three or more are not alike there, on any axis and
    either side. Arguments as above."""
    size = np.abs(channels)
    end = float(size.max(initial=0.0))
    at = size >= (1.0 - _ALIKE) * end
    if end < least_range or np.count_nonzero(at) < _FEWEST:
        at = np.zeros(size.shape, dtype=bool)
    return at, end
