"""Readings that an IMU's range cut off: motion there is not what they say."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calib_core.types import BoolArray, FloatArray, ImuData, IntArray

#: The narrowest ranges in common use: 125 deg/s (2.18 rad/s) and 2 g (19.6 m/s2); and a tenth for scale errors. There are
#: narrower ones (75 and 100 deg/s, 1.2 and 1.7 g): an end nearer than these has to be shown by more.
LEAST_GYRO_RANGE_RAD_S = 1.96
LEAST_ACCEL_RANGE_M_S2 = 17.6
#: Of more readings than this share it is said. One in two thousand is a knock.
CLIPPED_SHARE = 5e-4
#: Readings in a row: a smooth peak may have two alike.
_FEWEST = 3
#: Share of an extreme within which readings are alike.
_ALIKE = 1e-4
#: The same number after a change of unit, and of how many steps another is a multiple of one.
_SAME, _OFF_GRID = 1e-6, 0.1
#: Steps are finer than this share of a range: seven bits.
_COARSEST = 0.01
#: A reading beside a flat end is no noise of the end's beyond so many deviations; a run that noise makes once in a thousand
#: recordings is none.
_BEYOND, _CHANCE = 5.0, 1e-3
#: Readings on either side of a run that tell the noise beside it: to a fifth, as the median of so many.
_BESIDE = 32
#: The median of a normal law's size, in deviations.
_MEDIAN_OF_NORMAL = 0.6745


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
    return f"the {worse_sensor(shares)} is clipped in {share:.2%} of its readings, which do not show the true motion"


def worse_sensor(shares: tuple[float, float]) -> str:
    """Which of both is clipped more."""
    return "gyroscope" if shares[0] >= shares[1] else "accelerometer"


def clipped_share(channels: FloatArray, least_range: float = 0.0) -> float:
    """Share of readings that stay within 0.01 % of an axis's extreme for three readings or more in a row.

    A smooth peak leaves its summit as it came, a clipped one's edges are steep.   channels: (Q, 3).   least_range: in the same
    unit; few sensors clip below it: readings that are alike there may be coarse, repeated by the driver, or of a steady motion,
    and are clipped where the noise ends with them.
    """
    shares = np.zeros(channels.shape[1])
    for axis, _, runs in clipped_runs(channels, least_range):
        shares[axis] += float(np.diff(runs).sum()) / len(channels)
    return float(shares.max(initial=0.0))


def clipped_runs(channels: FloatArray, least_range: float) -> Iterator[tuple[int, float, IntArray]]:
    """Each axis, an extreme that cut it off, and where it stays there, (R, 2): from the first reading to before the last.

    Arguments as above.
    """
    for axis in range(channels.shape[1]):
        values = channels[:, axis]
        for extreme in (values.max(), values.min()):
            if abs(extreme) < 0.2 * np.abs(channels).max() or extreme == 0:
                continue
            at = at_end(values, extreme)
            edges = np.flatnonzero(np.diff(np.concatenate([[False], at, [False]]).astype(np.int8)))
            runs = edges.reshape(-1, 2)
            runs = runs[np.diff(runs, axis=1)[:, 0] >= _FEWEST]
            are_cut_off = _are_cut_off if abs(extreme) >= least_range else _are_without_noise
            runs = runs[are_cut_off(values, runs)]
            if len(runs):
                yield axis, float(extreme), runs


def at_end(values: FloatArray, end: float) -> BoolArray:
    """Which of an axis's readings (Q,) are alike the end of its range."""
    return np.asarray(np.abs(values - end) <= _ALIKE * abs(end))


def _are_cut_off(values: FloatArray, runs: IntArray) -> BoolArray:
    """Which of an axis's runs (R, 2) at an extreme are cut off, and no peak that is alike for a while.

    A smooth peak is a parabola. Of one whose top n readings are within a step q of one another, the next has fallen by no more
    than q ((n + 1) / (n - 1))^2, and reads a step less for that. Under noise of deviation s a peak has n readings within q of one
    another at any of the places near it with the chance (q / (s sqrt(2 pi)))^(n - 1).
    """
    if not len(runs):
        return np.zeros(0, dtype=np.bool_)
    extreme = values[runs[0, 0]]
    step, std = _step_of(values), _std_of(values)
    before, after = np.maximum(runs[:, 0] - 1, 0), np.minimum(runs[:, 1], len(values) - 1)
    fallen = np.maximum(np.abs(values[before] - extreme), np.abs(values[after] - extreme))
    count = np.diff(runs, axis=1)[:, 0]
    is_steep = fallen > np.maximum(step * (((count + 1) / (count - 1)) ** 2 + 1.0), _BEYOND * std)
    near = np.count_nonzero(np.abs(values - extreme) < _BEYOND * std)
    by_noise = near * np.minimum(step / max(std * np.sqrt(2.0 * np.pi), 1e-30), 1.0) ** (count - 1)
    return np.asarray(is_steep | (by_noise < _CHANCE))


def _are_without_noise(values: FloatArray, runs: IntArray) -> BoolArray:
    """Which of an axis's runs (R, 2) at an extreme are cut off, though an end of a range is rare so near.

    Steep edges show nothing there: a platform that turns at a steady rate has them. But its readings keep their noise, and those
    that are cut off have none. Of n in a row that are alike the chance is as above, of the noise that readings beside the run
    have. Where any two neighbours are the same more often than that, as of a driver that repeats readings, it is theirs.
    """
    if not len(runs):
        return np.zeros(0, dtype=np.bool_)
    extreme = values[runs[0, 0]]
    inside = ~(at_end(values, values.max()) | at_end(values, values.min()))
    pairs = inside[1:] & inside[:-1]
    repeated = float(np.mean(np.diff(values)[pairs] == 0.0)) if pairs.any() else 1.0
    bent = np.abs(np.diff(values, n=2))
    tells = inside[2:] & inside[1:-1] & inside[:-2]
    std = _std_bent(bent[tells])
    near = np.count_nonzero(at_end(values, extreme) | (np.abs(values - extreme) < _BEYOND * std))
    step = _step_of(values, coarsest=1.0)
    out = np.zeros(len(runs), dtype=np.bool_)
    for number, (start, end) in enumerate(runs.tolist()):
        sides = slice(max(start - _BESIDE, 0), max(start - 2, 0)), slice(end, end + _BESIDE - 2)
        beside = min(_std_bent(bent[side][tells[side]]) for side in sides)
        alike = max(step / max(beside * np.sqrt(2.0 * np.pi), 1e-30), repeated)
        out[number] = near * min(alike, 1.0) ** (end - start - 1) < _CHANCE
    return out


def _step_of(values: FloatArray, coarsest: float = _COARSEST) -> float:
    """The step of readings that are multiples of one, or within what others are alike. coarsest: share of a range."""
    alike = _ALIKE * float(np.abs(values).max())
    apart = np.diff(np.unique(values))
    apart = apart[apart > _SAME * alike / _ALIKE]
    if not len(apart) or not alike < apart.min() <= coarsest * alike / _ALIKE:
        return alike
    multiples = apart / apart.min()
    return float(apart.min()) if np.abs(multiples - np.round(multiples)).max() < _OFF_GRID else alike


def _std_of(values: FloatArray) -> float:
    """The noise of readings [their unit], by what is left of them beside their neighbours' middle."""
    return _std_bent(np.abs(np.diff(values, n=2)))


def _std_bent(sizes: FloatArray) -> float:
    """The same of the sizes of second differences, of which there have to be two: of one it is no noise."""
    return float(np.median(sizes)) / (_MEDIAN_OF_NORMAL * np.sqrt(6.0)) if len(sizes) > 1 else 0.0


def cut_off(channels: FloatArray, least_range: float) -> tuple[BoolArray, float]:
    """(Q, 3) which readings are at the range's end, and the range; none where three or more are not alike there, on any axis and
    either side. Arguments as above."""
    size = np.abs(channels)
    end = float(size.max(initial=0.0))
    at = size >= (1.0 - _ALIKE) * end
    if end < least_range or np.count_nonzero(at) < _FEWEST:
        at = np.zeros(size.shape, dtype=bool)
    return at, end
