"""The time offset, first of all: how far a body turns in a given time is the same in any frame.

The gyroscope's turns are correlated with the lidar's at every lag the two recordings allow; the best lags go on to the
rotation. The lidar's turns are taken within its sweeps or between scans one or three apart, whichever agrees best: the
first follows the quickest motion, the last is the least noisy, and a sweep that sees its planes for a moment only says
nothing by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from calib_core.full.initialise.settings import LAGS
from calib_core.full.initialise.start import LidarTrack
from calib_core.geometry import exp, log
from calib_core.imu.integrated_rotation import turned_since
from calib_core.imu.silence import spans_silence
from calib_core.types import BoolArray, FloatArray


@dataclass(frozen=True)
class LidarTurns:
    """The lidar's turns over spans of time. start_s, end_s: (N,) lidar clock. rate_rad_s: (N, 3) rotation vector per second.

    worth: (N,) what each counts for beside the others, None for all alike.
    """

    start_s: FloatArray
    end_s: FloatArray
    rate_rad_s: FloatArray
    worth: FloatArray | None = None

    def between(self, first_s: float, last_s: float) -> LidarTurns:
        """Those within a span of the lidar's time."""
        some = (self.start_s >= first_s) & (self.end_s <= last_s)
        worth = None if self.worth is None else self.worth[some]
        return LidarTurns(self.start_s[some], self.end_s[some], self.rate_rad_s[some], worth)


def turns_of(track: LidarTrack) -> list[LidarTurns]:
    """LidarTurns within the sweeps, where these last, and between scans one and three apart."""
    lasts = track.sweep_s > 0.0
    within = LidarTurns(track.start_s[lasts], (track.start_s + track.sweep_s)[lasts], track.omega_rad_s[lasts])
    out = [within] if lasts.any() else []
    period = float(np.median(np.diff(track.start_s))) if len(track.start_s) > 1 else 0.0
    for apart in LAGS.apart_scans:
        if len(track.start_s) <= apart:
            continue
        T = track.start_s[apart:] - track.start_s[:-apart]
        rate = log(np.swapaxes(track.R[:-apart], 1, 2) @ track.R[apart:]) / T[:, None]
        whole = (apart + 0.5) * period > T
        out.append(LidarTurns(track.start_s[:-apart][whole], track.start_s[apart:][whole], rate[whole]))
    return out


class GyroTurns:
    """How far the gyro turned over any span, from its running product of rotations. Times on the IMU's clock [s]."""

    def __init__(self, stamps_s: FloatArray, gyro_rad_s: FloatArray) -> None:
        self._t = stamps_s
        self._gyro = gyro_rad_s
        self._R = turned_since(stamps_s, gyro_rad_s)

    def tells(self, start_s: FloatArray, end_s: FloatArray) -> BoolArray:
        """(N,) whether it says how far it turned over spans: within the recording, and in no part of them silent."""
        inside = (start_s >= self._t[0]) & (end_s <= self._t[-1])
        return np.asarray(inside & ~spans_silence(self._t, start_s, end_s))

    def at(self, t_s: FloatArray) -> FloatArray:
        """Orientation at instants within the recording, from its first sample: (N, 3, 3). The rate is linear between samples."""
        k = np.clip(np.searchsorted(self._t, t_s, side="right") - 1, 0, len(self._t) - 2)
        tau = (t_s - self._t[k])[:, None]
        slope = (self._gyro[k + 1] - self._gyro[k]) / (self._t[k + 1] - self._t[k])[:, None]
        return self._R[k] @ exp(self._gyro[k] * tau + 0.5 * slope * tau**2)

    def over(self, start_s: FloatArray, end_s: FloatArray) -> FloatArray:
        """(N, 3) rotation vectors per second; NaN where it says nothing of the span."""
        out = log(np.swapaxes(self.at(start_s), 1, 2) @ self.at(end_s)) / (end_s - start_s)[:, None]
        out[~self.tells(start_s, end_s)] = np.nan
        return out


def candidate_lags(turns: LidarTurns, gyro: GyroTurns, imu_s: FloatArray) -> list[tuple[float, float]]:
    """The lags (seconds to add to IMU stamps) at which the turns' sizes agree best, with their correlations, best first.

    Of a motion that repeats itself the ones nearest to the stamps' own that are nearly as good go with them.
    """
    t0, t1 = turns.start_s[0], turns.end_s[-1]
    lidar_t = np.arange(t0, t1, 1 / LAGS.grid_hz)
    norms = np.linalg.norm(turns.rate_rad_s, axis=1)
    # A few spans in which the track leapt would outweigh all others in a correlation.
    norms = np.minimum(norms, LAGS.top_times * np.percentile(norms, LAGS.top_percent))
    lidar = np.interp(lidar_t, 0.5 * (turns.start_s + turns.end_s), norms)
    imu_t = np.arange(imu_s[0], imu_s[-1], 1 / LAGS.grid_hz)
    width = float(np.median(turns.end_s - turns.start_s))
    mean = gyro.over(imu_t - width / 2, imu_t + width / 2)
    imu = np.linalg.norm(mean, axis=1)
    valid = np.isfinite(imu)
    imu = np.where(valid, imu, 0.0)
    correlation, overlap = masked_correlation(lidar, imu, valid.astype(float))
    # Sample k of the correlation pairs lidar sample i with imu sample i - (k - (len(imu) - 1)).
    shift = np.arange(len(correlation)) - (len(imu) - 1)
    lag = t0 - imu_t[0] + shift / LAGS.grid_hz
    score = np.where(overlap >= least_overlap(len(lidar), len(imu)), correlation, -np.inf)
    best: list[tuple[float, float]] = []
    nearest = nearest_peaks(lag, score)
    while len(best) < LAGS.candidates and np.isfinite(score.max()):
        k = int(np.argmax(score))
        best.append((float(lag[k]), float(correlation[k])))
        score[np.abs(lag - lag[k]) < LAGS.apart_s] = -np.inf
    more = [k for k in nearest if np.isfinite(score[k])]
    return best + [(float(lag[k]), float(correlation[k])) for k in sorted(more, key=lambda k: -correlation[k])]


def nearest_peaks(lag_s: FloatArray, score: FloatArray) -> list[int]:
    """The few peaks nearest to no lag at all that are nearly as high as the highest, by number; none of what is not compared."""
    if not np.isfinite(score.max()):
        return []
    least = 1.0 - max(LAGS.nearly * (1.0 - score.max()), LAGS.nearly_share)
    peaks = np.flatnonzero((score[1:-1] >= np.maximum(score[:-2], score[2:])) & (score[1:-1] >= least)) + 1
    nearest: list[int] = []
    for k in peaks[np.argsort(np.abs(lag_s[peaks]))]:
        if len(nearest) < LAGS.nearest and all(abs(lag_s[k] - lag_s[other]) >= LAGS.apart_s for other in nearest):
            nearest.append(int(k))
    return nearest


def least_overlap(lidar: int, imu: int) -> float:
    """Samples by which two streams of so many samples have to overlap at a lag."""
    return min(LAGS.half_overlap * min(lidar, imu), max(LAGS.overlap_s * LAGS.grid_hz, LAGS.overlap_share * lidar))


def masked_correlation(a: FloatArray, b: FloatArray, mask_b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pearson's correlation of a with b at every shift, over the samples that overlap, and how many do."""
    # scipy.signal has this ready, but takes a second to import.
    size = len(a) + len(b) - 1
    fast = scipy.fft.next_fast_len(size, real=True)

    def cross(x: FloatArray, y: FloatArray) -> FloatArray:
        return np.asarray(scipy.fft.irfft(scipy.fft.rfft(x, fast) * scipy.fft.rfft(y[::-1], fast), fast)[:size])

    ones = np.ones_like(a)
    n = np.maximum(cross(ones, mask_b), 1.0)
    mean_a, mean_b = cross(a, mask_b) / n, cross(ones, b * mask_b) / n
    var_a = cross(a**2, mask_b) / n - mean_a**2
    var_b = cross(ones, b**2 * mask_b) / n - mean_b**2
    cov = cross(a, b * mask_b) / n - mean_a * mean_b
    floor = LAGS.least_variance * float(np.var(a)) + 1e-12
    return cov / np.sqrt(np.maximum(var_a, floor) * np.maximum(var_b, floor)), np.rint(n)
