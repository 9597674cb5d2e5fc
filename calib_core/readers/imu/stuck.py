"""An axis that reads one and the same number while those beside it do not: no sensor that has noise does."""

from __future__ import annotations

import numpy as np

from calib_core.types import BoolArray, Evidence, Finding, FloatArray, IntArray

#: judged: for so long, and with so large a share of the readings of other axes meanwhile, and of its own otherwise, each another
#: than the one before. Readings come in steps, and a fine one is seldom read twice; held ones hold all axes.
_LEAST_S, _CHANGING = 1.0, 0.9


def stuck_axis(stamps_ns: IntArray, gyro_rad_s: FloatArray, accel_m_s2: FloatArray, topic: str) -> Finding | None:
    """The axis that is stuck for longest, and when; None where none is. stamps_ns: (Q,).   gyro_rad_s, accel_m_s2: (Q, 3)."""
    found: list[tuple[float, str]] = []
    for sensor, unit, values in (("gyroscope", "rad/s", gyro_rad_s), ("accelerometer", "m/s²", accel_m_s2)):
        changes = np.diff(values, axis=0) != 0.0
        for axis in range(3):
            first, last = _longest_stay(changes[:, axis])
            since_s, stays_s = (
                1e-9 * float(stamps_ns[first] - stamps_ns[0]),
                1e-9 * float(stamps_ns[last] - stamps_ns[first]),
            )
            meanwhile = np.delete(changes[first:last], axis, axis=1)
            otherwise = np.delete(changes[:, axis], np.s_[first:last])
            moves = len(otherwise) == 0 or otherwise.mean() > _CHANGING
            if stays_s < _LEAST_S or not moves or not (meanwhile.mean(axis=0) > _CHANGING).all():
                continue
            text = (
                f"The {sensor}'s {'xyz'[axis]} axis on {topic} reads {values[first, axis]:.4g} {unit} and nothing else for "
                f"{stays_s:.1f} s, from {since_s:.1f} s on, while its other axes go on: it is stuck, or not measured."
            )
            found.append((stays_s, text))
    if not found:
        return None
    stays_s, text = max(found)
    return Finding(
        code="imu.stuck",
        level="warning",
        text=text,
        evidence=(Evidence("unchanged for", round(stays_s, 3), "s"),),
        consequence="what the IMU says is not how it moved: a calibration from these readings would be wrong",
    )


def _longest_stay(changes: BoolArray) -> tuple[int, int]:
    """First and last reading of the longest run of equal ones. changes: (Q - 1,) whether each differs from the one before."""
    ends = np.flatnonzero(np.append(changes, True))
    begins = np.append(0, ends[:-1] + 1)
    k = int(np.argmax(ends - begins))
    return int(begins[k]), int(ends[k])
