"""Whether the lidar's turning and the gyroscope's are one and the same: how well their rates go together, and how large
one is beside the other.

Sizes of rates know neither mounting nor bias to speak of, nor the unit: a gyroscope in other units correlates as well,
with a ratio that is not one. A track that lost its planes does not correlate, whatever its ratio.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.full.initialise.settings import AGREEING, LAGS
from calib_core.full.initialise.start import LidarTrack
from calib_core.full.initialise.time_offset import LidarTurns, least_overlap, masked_correlation, turns_of
from calib_core.imu.silence import spans_silence
from calib_core.types import FloatArray

#: Of a radian.
DEGREES = float(np.degrees(1.0))
_QUARTILES = (25.0, 50.0, 75.0)


@dataclass(frozen=True)
class Agreement:
    """How the rates' sizes go together at the lag where they do best.

    correlation: Pearson's.   ratio: gyroscope over lidar, in the middle of the fast spans;
    ratio_spread: half of what lies between its quartiles, over the ratio.
    """

    correlation: float
    ratio: float
    ratio_spread: float

    @property
    def is_of_a_unit(self) -> bool:
        """Whether one turns about as fast as the other in radians or in degrees: a few leaps of a lost track, laid upon a swing
        that is as short, correlate, too."""
        most = AGREEING.as_fast
        return any(unit / most < self.ratio < unit * most for unit in (1.0, DEGREES, 1.0 / DEGREES))


NO_AGREEMENT = Agreement(0.0, 1.0, np.inf)


def agreement(lidar: LidarTrack, imu_s: FloatArray, gyro_rad_s: FloatArray) -> Agreement:
    """Of a track, by whichever of its turns agree best. imu_s: (Q,), gyro_rad_s: (Q, 3)."""
    found = [agreement_of(turns, imu_s, gyro_rad_s) for turns in turns_of(lidar)]
    return max(found, key=lambda a: a.correlation)


def agreeing_part(lidar: LidarTrack, imu_s: FloatArray, gyro_rad_s: FloatArray) -> tuple[LidarTrack | None, Agreement]:
    """The stretch of a track, half of it or a third, whose rates agree best with the gyroscope's; None where none is trusted.

    A track that goes astray where somebody comes close was right before, and often again after.
    """
    best, part = NO_AGREEMENT, None
    scans = len(lidar.start_s)
    for share in AGREEING.parts:
        length = round(share * scans)
        if lidar.sweep_s[:length].sum() < AGREEING.shortest_part_s:
            continue
        for first in np.linspace(0, scans - length, round(2.0 / share) - 1).astype(int):
            one = lidar.part(slice(first, first + length))
            agreed = agreement(one, imu_s, gyro_rad_s)
            if agreed.is_of_a_unit and agreed.correlation > max(best.correlation, AGREEING.trusted):
                best, part = agreed, one
    return part, best


def agreement_of(turns: LidarTurns, imu_s: FloatArray, gyro_rad_s: FloatArray) -> Agreement:
    """Of turns over spans of time, in order of time."""
    if len(turns.start_s) < AGREEING.fewest_spans or len(imu_s) < 2:
        return NO_AGREEMENT
    t0, t1 = float(turns.start_s[0]), float(turns.end_s[-1])
    lidar_t, imu_t = np.arange(t0, t1, 1 / LAGS.grid_hz), np.arange(imu_s[0], imu_s[-1], 1 / LAGS.grid_hz)
    if len(lidar_t) < 2 or len(imu_t) < 2:
        return NO_AGREEMENT
    norms = np.linalg.norm(turns.rate_rad_s, axis=1)
    top = np.minimum(
        norms, np.percentile(norms, AGREEING.top_percent)
    )  # a few leaps of a track would outweigh all the rest
    middle = 0.5 * (turns.start_s + turns.end_s)
    lidar = np.interp(lidar_t, middle, top)
    width = float(np.median(turns.end_s - turns.start_s))
    imu = mean_rate(imu_s, gyro_rad_s, imu_t - width / 2, imu_t + width / 2)
    valid = np.isfinite(imu)
    if not valid.any():
        return NO_AGREEMENT
    most = max(float(np.percentile(imu[valid], AGREEING.top_percent)), 1e-12)
    imu = np.minimum(np.where(valid, imu, 0.0), most) / most  # whatever the unit
    correlation, overlap = masked_correlation(lidar / max(float(lidar.max()), 1e-12), imu, valid.astype(float))
    score = np.where(overlap >= least_overlap(len(lidar), len(imu)), correlation, -np.inf)
    k = int(np.argmax(score))
    if not np.isfinite(score[k]):
        return NO_AGREEMENT
    lag_s = float(t0 - imu_t[0] + (k - (len(imu) - 1)) / LAGS.grid_hz)
    own = mean_rate(imu_s, gyro_rad_s, turns.start_s - lag_s, turns.end_s - lag_s)
    fast = np.isfinite(own) & (norms > AGREEING.fast_share * np.percentile(norms, AGREEING.top_percent)) & (norms > 0.0)
    if np.count_nonzero(fast) < AGREEING.fewest_spans:
        return Agreement(float(score[k]), 1.0, np.inf)
    low, ratio, high = np.percentile(own[fast] / norms[fast], _QUARTILES)
    return Agreement(float(score[k]), float(ratio), float(0.5 * (high - low) / max(ratio, 1e-12)))


def mean_rate(imu_s: FloatArray, gyro_rad_s: FloatArray, start_s: FloatArray, end_s: FloatArray) -> FloatArray:
    """Size of the mean of the readings over spans (N,): no turn that could wrap around. NaN outside the recording, and where a
    part of the span has no readings.
    """
    steps = np.diff(imu_s)[:, None] * 0.5 * (gyro_rad_s[1:] + gyro_rad_s[:-1])
    total = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    part = [np.stack([np.interp(t, imu_s, total[:, i]) for i in range(3)], axis=1) for t in (start_s, end_s)]
    size = np.linalg.norm(part[1] - part[0], axis=1) / np.maximum(end_s - start_s, 1e-9)
    size[(start_s < imu_s[0]) | (end_s > imu_s[-1]) | spans_silence(imu_s, start_s, end_s)] = np.nan
    return np.asarray(size)
