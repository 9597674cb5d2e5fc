"""IMU data of given readings."""

from __future__ import annotations

import numpy as np

from calib_core.types import FloatArray, ImuData
from tests.core.readers import build


def data(gyro: FloatArray, accel: FloatArray) -> ImuData:
    """A hundred a second, from `build.EPOCH_NS` on. gyro, accel: (N, 3) [rad/s], [m/s2]."""
    return ImuData(build.EPOCH_NS + np.arange(len(gyro), dtype=np.int64) * 10_000_000, gyro, accel)
