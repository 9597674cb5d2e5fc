"""Whether the two clocks run at rates so different that one time offset is right in the middle of the recording only.

Crystals differ by some hundred-thousandths, which the joint estimation finds. Stamps that a driver counts up by an IMU's nominal
period are off by what its oscillator is off, thousandths: tens of milliseconds over a recording. With the rate k and the offset o
at the middle t_m,

    turn_imu(t - o - k (t - t_m)) = R_c turn_lidar(t) + b

is least squares in o, k, R_c and b over all turns of a track. A clock that was set in mid-recording makes a rate as well: then
the offsets that stretches of time ask for are a step, not a line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib_core.full.initialise.rotation import best_turns, fit_lags, outlier_weights
from calib_core.full.initialise.settings import AGREEING, CLOCK_RATES
from calib_core.full.initialise.start import LidarTrack, RotationStart
from calib_core.full.initialise.time_offset import GyroTurns, LidarTurns, candidate_lags
from calib_core.full.run import Run
from calib_core.geometry import exp, hat
from calib_core.types import BoolArray, FloatArray


class ClocksApart(Exception):
    """No time offset is right for the whole recording: t_lidar = t_imu + offset + rate (t_lidar - t_middle).

    rate_std: how well the rate is known.   about_ns: where the middle lies on the IMU's clock; stretched about it, its stamps
    keep their offset there.
    """

    def __init__(self, run: Run, rate: float, rate_std: float, time_offset_s: float) -> None:
        self.rate, self.rate_std = rate, rate_std
        self.about_ns = run.clocks.imu_epoch_ns + round(1e9 * (run.clocks.middle_s - time_offset_s))
        super().__init__(f"the clocks run apart by {rate:.2%}")


@dataclass(frozen=True)
class OffsetLine:
    """The time offset as a line over the lidar's time. offset_s: at middle_s, to add to IMU stamps.   rate: its slope.
    R_imu_lidar (3, 3), gyro_bias (3,): that go with it.   rate_std: as the turns that are left scatter.
    """

    offset_s: float
    rate: float
    middle_s: float
    R_imu_lidar: FloatArray
    gyro_bias: FloatArray
    rate_std: float = np.inf

    def at(self, t_s: FloatArray) -> FloatArray:
        """(N,) offsets at instants (N,) of the lidar's clock."""
        return np.asarray(self.offset_s + self.rate * (t_s - self.middle_s))


def require_one_rate(run: Run, track: LidarTrack) -> None:
    """Raises ClocksApart where the turns of a track tell that the clocks part, beyond chance and beyond what crystals do; not
    where the IMU's stamps are to be taken as they are.
    """
    if not may_stretch(run):
        return
    turns, gyro, lags = best_turns(track, run.clocks.imu_s, run.recording.imu.gyro_rad_s)
    if lags and lags[0][1] > AGREEING.trusted:
        line = _line_from(turns, gyro, fit_lags(turns, gyro, lags))
    else:
        line = line_of_a_part(turns, gyro, run.clocks.imu_s)
    if line is None or abs(line.rate) < max(CLOCK_RATES.least, CLOCK_RATES.sigmas * line.rate_std):
        return
    if is_line(turns, gyro, line):
        std = CLOCK_RATES.unsure * line.rate_std
        raise ClocksApart(run, line.rate, std, float(line.at(np.array(run.clocks.middle_s))))


def may_stretch(run: Run) -> bool:
    """Whether the IMU's stamps may be other than they are."""
    return run.settings.imu_sampling != "as-stamped"


def line_of_a_part(turns: LidarTurns, gyro: GyroTurns, imu_s: FloatArray) -> OffsetLine | None:
    """The line of turns that go with the gyroscope's at no one lag, from that of the part in which they do best.

    imu_s: (Q,) of the readings.   None where no part goes with them, or the line does not come to rest.
    """
    first_s, last_s = float(turns.start_s[0]), float(turns.end_s[-1])
    begins_s = np.arange(first_s, max(last_s - CLOCK_RATES.part_s, first_s) + 1e-9, CLOCK_RATES.part_s)
    parts = [turns.between(begin_s, begin_s + CLOCK_RATES.part_s) for begin_s in begins_s.tolist()]
    found = [(part, candidate_lags(part, gyro, imu_s)) for part in parts if len(part.start_s) > AGREEING.fewest_spans]
    part, lags = max(found, key=lambda each: each[1][0][1] if each[1] else -np.inf, default=(turns, []))
    if not lags or lags[0][1] < AGREEING.trusted:
        return None
    of_part = _line_from(part, gyro, fit_lags(part, gyro, lags))
    return None if of_part is None else offset_line(turns, gyro, of_part)


def _line_from(turns: LidarTurns, gyro: GyroTurns, starts: Sequence[RotationStart]) -> OffsetLine | None:
    """From the best of these starts, if it fits."""
    if not starts or starts[0].residual > AGREEING.fits or starts[0].open_axis_imu is not None:
        return None
    start, middle_s = starts[0], 0.5 * float(turns.start_s[0] + turns.end_s[-1])
    return offset_line(turns, gyro, OffsetLine(start.time_offset_s, 0.0, middle_s, start.R_imu_lidar, start.gyro_bias))


def offset_line(turns: LidarTurns, gyro: GyroTurns, line: OffsetLine) -> OffsetLine | None:
    """The line that leaves least of the turns, from one near it; None where it does not come to rest."""
    middle_s = 0.5 * float(turns.start_s[0] + turns.end_s[-1])
    line = replace(line, offset_s=float(line.at(np.array(middle_s))), middle_s=middle_s)
    half_s = 0.5 * float(turns.end_s[-1] - turns.start_s[0])
    for _ in range(CLOCK_RATES.passes):
        left, J, weight = _linearised(turns, gyro, line)
        normal = np.einsum("n,nik,nil->kl", weight, J, J)
        if np.linalg.cond(normal) > CLOCK_RATES.condition:
            return None
        step = -np.linalg.solve(normal, np.einsum("n,nik,ni->k", weight, J, left))
        # No farther than where a linearised motion is one.
        step *= min(1.0, CLOCK_RATES.most_step_s / max(abs(step[0]) + abs(step[1]) * half_s, 1e-12))
        square = float(np.sum(weight * np.sum(left**2, axis=1))) / max(3.0 * float(weight.sum()) - len(step), 1.0)
        line = replace(
            line,
            offset_s=line.offset_s + float(step[0]),
            rate=line.rate + float(step[1]),
            R_imu_lidar=exp(step[2:5]) @ line.R_imu_lidar,
            gyro_bias=line.gyro_bias + step[5:8],
            rate_std=float(np.sqrt(square * np.linalg.inv(normal)[1, 1])),
        )
        if abs(step[0]) + abs(step[1]) * half_s < CLOCK_RATES.rests_s:
            return line
    return None


def is_line(turns: LidarTurns, gyro: GyroTurns, line: OffsetLine) -> bool:
    """Whether what stretches of the turns ask for is nearer to the line than to no slope, and than to any step."""
    left, J, worth = _linearised(turns, gyro, line)
    middles_s = 0.5 * (turns.start_s + turns.end_s)
    edges_s = np.linspace(middles_s[0], middles_s[-1], CLOCK_RATES.stretches + 1)[1:-1]
    stretch = np.searchsorted(edges_s, middles_s)
    along = J[:, :, 0]
    told = np.bincount(stretch, worth * np.sum(along**2, axis=1), CLOCK_RATES.stretches)
    pulled = -np.bincount(stretch, worth * np.sum(along * left, axis=1), CLOCK_RATES.stretches)
    some = told > CLOCK_RATES.telling * np.median(told)
    if np.count_nonzero(some) < CLOCK_RATES.fewest_stretches:
        return False
    at_s = np.array([middles_s[stretch == k].mean() for k in np.flatnonzero(some)])
    offsets_s = pulled[some] / told[some] + line.at(at_s)
    ones, count, weight = np.ones(len(at_s)), len(at_s), np.asarray(told[some], np.float64)
    steps = [np.stack([ones, (np.arange(count) >= k).astype(float)], axis=1) for k in range(1, count)]
    of_line = _squares(np.stack([ones, at_s - line.middle_s], axis=1), offsets_s, weight)
    others = [ones[:, None], *steps]
    return of_line < CLOCK_RATES.nearer * min(_squares(each, offsets_s, weight) for each in others)


def _linearised(turns: LidarTurns, gyro: GyroTurns, line: OffsetLine) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What is left of each turn (N, 3) [rad/s], how it follows offset, rate, rotation (from the left) and bias (N, 3, 8), and
    what each turn counts for (N,): nothing where the gyroscope was not there.
    """
    from_middle_s = 0.5 * (turns.start_s + turns.end_s) - line.middle_s
    lag_s, h = line.at(from_middle_s + line.middle_s), CLOCK_RATES.difference_s
    felt, later, earlier = (gyro.over(turns.start_s - lag_s + by, turns.end_s - lag_s + by) for by in (0.0, h, -h))
    there: BoolArray = np.asarray(np.isfinite(felt + later + earlier).all(axis=1))
    felt, slope = np.where(there[:, None], felt, 0.0), np.where(there[:, None], (later - earlier) / (2.0 * h), 0.0)
    shown = turns.rate_rad_s @ line.R_imu_lidar.T
    left = np.where(there[:, None], felt - shown - line.gyro_bias, 0.0)
    J = np.zeros((len(left), 3, 8))
    J[:, :, 0] = -slope
    J[:, :, 1] = -slope * from_middle_s[:, None]
    J[:, :, 2:5] = hat(shown)
    J[:, :, 5:8] = -np.eye(3)
    worth = np.ones(len(left)) if turns.worth is None else turns.worth
    weight = worth * outlier_weights(np.linalg.norm(left, axis=1)[None], there[None])[0] * there
    return left, J, weight


def _squares(design: FloatArray, values: FloatArray, weight: FloatArray) -> float:
    """What weighted least squares leave."""
    root = np.sqrt(weight)
    found = np.linalg.lstsq(design * root[:, None], values * root, rcond=None)[0]
    return float(np.sum((root * (values - design @ found)) ** 2))
