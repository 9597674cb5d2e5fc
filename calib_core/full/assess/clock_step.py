"""A clock that was set in the middle of a recording: its stretches of time then answer two time offsets.

Where a host's clock is put right, or a driver starts anew, all stamps of one sensor from then on are off by milliseconds, and one
time offset for the whole is wrong for either part. The joint solve bends what it can to it (clock rate, biases), and the offsets
that stretches of time ask for by themselves (parts.py) are still no line:

    x_b = a + c t_b + d [b > k] + e_b,      b != k,

a step d within stretch k on top of a line. A stretch of standstill tells no time: what it asks for is what its readings are wrong
by, as where a gyroscope in steps of 1 deg/s reads nothing of a hand's tremor, and 160 ms. Nor does it know how little it tells:
the noise of an estimated motion looks like turning. So none tells more than its turning does, whose square that grows with. In
recordings without a step, weighted squares about a line are as chance has them.

Walls that are not flat make stretches of time disagree as well, which see other parts of them, and a step on a line of eight
explains half of anything. But they make planes that are seen at the same time disagree, too, and no clock does: by as many
times as these squares are beyond chance (`disagreement.planes_at_once`) those of the stretches are. Seen: rough walls of a
mine, 72 beside 15, told as clocks that were set, where clocks that were, by 1 and 2 ms, have 116 to 2126 beside 0.9 to 1.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_core.full.assess.settings import CLOCK_STEP
from calib_core.result import TimeBlock
from calib_core.types import BoolArray, FloatArray, Recording


@dataclass(frozen=True, slots=True)
class Sides:
    """A recording with a break in it. within_s: the stretch of lidar time in which it is, seconds after the first scan.
    longer_s: what is left of the recording on the side with more of it.   left_out_s: the rest.
    """

    within_s: tuple[float, float]
    longer_s: tuple[float, float]
    left_out_s: tuple[float, float]

    @staticmethod
    def of(within_s: tuple[float, float], first_s: float, last_s: float) -> Sides:
        """Of a recording that goes from first_s to last_s."""
        if within_s[0] - first_s > last_s - within_s[1]:
            return Sides(within_s, (first_s, within_s[0]), (within_s[0], np.inf))
        return Sides(within_s, (within_s[1], last_s), (-np.inf, within_s[1]))


def turning_within(blocks: Sequence[TimeBlock], recording: Recording, time_offset_ns: int) -> FloatArray:
    """By how much the IMU turned to and fro in each stretch [rad/s], (B,), rms: what is slower than readings are noisy.

    time_offset_ns: as in the result, added to the IMU's stamps.
    """
    imu_s = (recording.imu.stamps_ns + time_offset_ns - recording.scans[0].stamp_ns) * 1e-9
    together = max(1, round(CLOCK_STEP.together_s / max(float(np.median(np.diff(imu_s))), 1e-6)))
    out = np.zeros(len(blocks))
    for k, block in enumerate(blocks):
        first, last = np.searchsorted(imu_s, (block.t_start_s, block.t_end_s))
        whole = (last - first) // together
        if whole > 1:
            means = recording.imu.gyro_rad_s[first : first + whole * together].reshape(whole, together, 3).mean(axis=1)
            out[k] = np.sqrt(np.mean(np.sum((means - means.mean(axis=0)) ** 2, axis=1)))
    return out


def misfit(blocks: Sequence[TimeBlock], turning_rad_s: FloatArray | None = None, *, at_once: float = 1.0) -> float:
    """Weighted squares of the time offsets about a line over time; with B stretches, chi-square with B - 2 degrees of freedom.

    turning_rad_s: (B,) as `turning_within` has it; None: all that they say they tell.   at_once: as `planes_at_once` has it.
    """
    t, x, weight = _columns(blocks, turning_rad_s)
    every = np.ones(len(t), dtype=np.bool_)
    return _squares(np.stack([np.ones_like(t), t], axis=1), x, weight, every) / max(at_once, 1.0)


def clock_step(
    blocks: Sequence[TimeBlock], turning_rad_s: FloatArray | None = None, *, at_once: float = 1.0
) -> Sides | None:
    """The step that explains why the stretches of time disagree; None where they agree, or no step explains it.

    turning_rad_s: (B,) as `turning_within` has it; None: all that they say they tell.   at_once: as `planes_at_once` has it.
    How large it is a solve does not tell: biases and the clock's rate have taken up a part of it.
    """
    t, x, weight = _columns(blocks, turning_rad_s)
    if len(t) < CLOCK_STEP.fewest_blocks or not np.all(np.abs(x) < CLOCK_STEP.most_s):
        return None
    if misfit(blocks, turning_rad_s, at_once=at_once) < CLOCK_STEP.misfit:
        return None
    line = np.stack([np.ones_like(t), t], axis=1)
    best: tuple[float, int] | None = None
    for k in range(1, len(t) - 1):
        used = np.arange(len(t)) != k
        after = (np.arange(len(t)) > k).astype(np.float64)
        left = _squares(np.column_stack([line, after]), x, weight, used)
        share = left / max(_squares(line, x, weight, used), 1e-30)
        if best is None or share < best[0]:
            best = share, k
    if best is None or best[0] > CLOCK_STEP.unexplained:
        return None
    k = best[1]
    within = blocks[k].t_start_s, blocks[k].t_end_s
    return Sides.of(within, blocks[0].t_start_s, blocks[-1].t_end_s)


def _columns(
    blocks: Sequence[TimeBlock], turning_rad_s: FloatArray | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Middle [s], offset asked for [s] and weight [1/s^2] of every stretch, 0 of those that tell no time."""
    t = np.array([0.5 * (block.t_start_s + block.t_end_s) for block in blocks])
    std_s = np.array([block.time_offset_std_s for block in blocks])
    telling = std_s < CLOCK_STEP.telling * float(std_s.min(initial=np.inf))
    weight = np.where(telling, 1.0 / np.maximum(std_s, 1e-9) ** 2, 0.0)
    if turning_rad_s is not None and len(t) > 0:
        square = np.maximum(turning_rad_s, 1e-9) ** 2
        weight = np.minimum(weight, CLOCK_STEP.most_told * float(np.median(weight / square)) * square)
    return t - t.mean(), np.array([block.time_offset_shift_s for block in blocks]), weight


def _squares(design: FloatArray, x: FloatArray, weight: FloatArray, used: BoolArray) -> float:
    """What weighted least squares leave."""
    root = np.sqrt(weight[used])
    found = np.linalg.lstsq(design[used] * root[:, None], x[used] * root, rcond=None)[0]
    left = root * (x[used] - design[used] @ found)
    return float(left @ left)
