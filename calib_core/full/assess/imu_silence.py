"""An IMU that fell silent in the middle of a recording: what lies before and after is joined by what the lidar saw alone.

Where somebody drew the lidar's track aside meanwhile, nothing tells: the planes of one side and those of the other are two
rooms, and no motion fits both.
"""

from __future__ import annotations

import numpy as np

from calib_core.full.assess.clock_step import Sides
from calib_core.full.assess.settings import SILENCE
from calib_core.types import Recording


def imu_silence(recording: Recording, time_offset_ns: int) -> Sides | None:
    """The longest silence between readings, and what of the recording lies on its longer side; None where none is that long.

    time_offset_ns: as in the result, added to the IMU's stamps.
    """
    imu_s = (recording.imu.stamps_ns + time_offset_ns - recording.scans[0].stamp_ns) * 1e-9
    if len(imu_s) < 2:
        return None
    k = int(np.argmax(np.diff(imu_s)))
    within = float(imu_s[k]), float(imu_s[k + 1])
    if within[1] - within[0] < SILENCE.least_s:
        return None
    last_s = (recording.scans[-1].stamp_ns - recording.scans[0].stamp_ns) * 1e-9
    return Sides.of(within, max(0.0, float(imu_s[0])), min(last_s, float(imu_s[-1])))
