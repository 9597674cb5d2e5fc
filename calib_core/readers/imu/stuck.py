"""Axes that read one and the same number while others do not: no sensor that has noise does.

An axis alone is told by those beside it. Of several at once a driver may hold the last reading, or coarse steps hide how still it
stands: they are stuck where the axes that go on, the other sensor's too, tell that it moved meanwhile.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calib_core.phrasing import joined
from calib_core.types import BoolArray, Clue, Finding, FloatArray, IntArray

#: judged: for so long, and with so large a share of the readings of other axes meanwhile, and of its own otherwise, each another
#: than the one before. Readings come in steps, and a fine one is seldom read twice; held ones hold all axes.
_LEAST_S, _CHANGING = 1.0, 0.9
#: judged: it moved where means over so long differ by so many times what one reading differs from the next: white noise gives a
#: fifth at 100 Hz, noise behind a filter of 10 Hz one to two, and the slowest hand more than ten.
_MEAN_S, _BEYOND_NOISE = 0.25, 3.0
_SENSORS = (("gyroscope", "rad/s"), ("accelerometer", "m/s²"))


class _Stay(NamedTuple):
    """An axis of a sensor that reads one number from `first` to `last`."""

    sensor: int
    axis: int
    first: int
    last: int


def stuck_axis(
    stamps_ns: IntArray, gyro_rad_s: FloatArray, accel_m_s2: FloatArray, topic: str, *, begin_ns: int
) -> Finding | None:
    """What is stuck for longest, and when; None where nothing is.

    stamps_ns: (Q,).   gyro_rad_s, accel_m_s2: (Q, 3).   begin_ns: the recording's start, on the clock of the stamps.
    """
    values = np.hstack([gyro_rad_s, accel_m_s2])
    changes = np.diff(values, axis=0) != 0.0
    stays = [_Stay(k // 3, k % 3, *_longest_stay(changes[:, k])) for k in range(6)]
    stuck = [stay for stay in stays if _is_stuck(stay, stamps_ns, values, changes)]
    if not stuck:
        return None
    longest = max(stuck, key=lambda stay: int(stamps_ns[stay.last] - stamps_ns[stay.first]))
    axes = [s.axis for s in stuck if (s.sensor, s.first, s.last) == (longest.sensor, longest.first, longest.last)]
    since_s = 1e-9 * float(stamps_ns[longest.first] - begin_ns)
    stays_s = 1e-9 * float(stamps_ns[longest.last] - stamps_ns[longest.first])
    return Finding(
        code="imu.stuck",
        level="warning",
        text=_told(longest, axes, values[longest.first], topic)
        + f" without any change for {stays_s:.1f} s, from {since_s:z.1f} s on, while other axes change:"
        + (" it is stuck, or not measured." if len(axes) == 1 else " they are stuck, or not measured."),
        evidence=(Clue("unchanged for", round(stays_s, 3), "s"),),
        consequence="what the IMU says is not how it moved: a calibration from these readings would be wrong",
    )


def _told(stay: _Stay, axes: list[int], reading: FloatArray, topic: str) -> str:
    sensor, unit = _SENSORS[stay.sensor]
    numbers = list(dict.fromkeys(f"{reading[3 * stay.sensor + axis]:.4g}" for axis in axes))
    noun, verb = ("axis", "reads") if len(axes) == 1 else ("axes", "read")
    return f"The {sensor}'s {joined(['xyz'[axis] for axis in axes])} {noun} on {topic} {verb} {joined(numbers)} {unit}"


def _is_stuck(stay: _Stay, stamps_ns: IntArray, values: FloatArray, changes: BoolArray) -> bool:
    """Whether it is no sensor's reading. values: (Q, 6), the gyroscope's axes and the accelerometer's.   changes: (Q - 1, 6)."""
    column, first, last = 3 * stay.sensor + stay.axis, stay.first, stay.last
    otherwise = np.delete(changes[:, column], np.s_[first:last])
    moves = len(otherwise) == 0 or otherwise.mean() > _CHANGING
    if 1e-9 * float(stamps_ns[last] - stamps_ns[first]) < _LEAST_S or not moves:
        return False
    goes_on = changes[first:last].mean(axis=0) > _CHANGING
    beside = [3 * stay.sensor + axis for axis in range(3) if axis != stay.axis]
    return bool(goes_on[beside].all()) or _moved(stamps_ns[first:last], values[first:last, goes_on])


def _moved(stamps_ns: IntArray, values: FloatArray) -> bool:
    """Whether any of these readings tells of motion, beyond its noise. values: (M, K)."""
    stretch = (stamps_ns - stamps_ns[0]) // round(_MEAN_S * 1e9)
    starts = np.flatnonzero(np.diff(stretch, prepend=-1))
    sizes = np.diff(starts, append=len(stamps_ns))
    means = np.add.reduceat(values, starts, axis=0) / sizes[:, None]
    noise = np.diff(values, axis=0).std(axis=0) / np.sqrt(2.0)
    return bool((means[sizes >= 0.5 * np.median(sizes)].std(axis=0) > _BEYOND_NOISE * noise).any())


def _longest_stay(changes: BoolArray) -> tuple[int, int]:
    """First and last reading of the longest run of equal ones. changes: (Q - 1,) whether each differs from the one before."""
    ends = np.flatnonzero(np.append(changes, True))
    begins = np.append(0, ends[:-1] + 1)
    k = int(np.argmax(ends - begins))
    return int(begins[k]), int(ends[k])
