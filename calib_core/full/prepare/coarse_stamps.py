"""Stamps that are all whole milliseconds, or whole ticks of some other clock, and what the time offset is unsure by for it.

A driver that counts milliseconds, a host whose clock ticks 64 times a second, a recorder that writes three digits: the instants
are gone, and what is left is cut down to a step q, or rounded to the nearest; nobody can say which. With U = true - stamped, and
p the part of the step that is a reading's own (q, or less where several bear one stamp and were spread,
`readers/imu/bundles.py`):

    cut:  0 <= U < p,  E U = p / 2          rounded:  E U = p / 2 - q / 2

The mean over a recording is part of the time offset and cannot be told from it. Where the phases of the true instants spread over
the step, as where both clocks run apart, the mean is that of the law, w = 0; where sampling keeps step with the ticks, as at
100 Hz exactly, every U is the same one and unknown, w = p. So

    variance of the mean = ((p / 2)^2 + ((q - p) / 2)^2) / 2 + w^2 / 12

about the stamps as they are: 0.35 to 0.46 of a step. Stamps that are whole multiples of the period at which they come are those
of a clock that the sensor itself goes by, where chance would seldom make them so. So are those that come in step and are
multiples of much more than drivers count: of milliseconds that were cut, few recordings would begin on a hundredth.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_core.full.prepare.settings import STEPS
from calib_core.full.run import StampStep
from calib_core.types import ImuData, IntArray, Scan

#: Standard deviations in the width of a uniform law.
_UNIFORM_STDS = np.sqrt(12.0)


def imu_step(imu: ImuData) -> StampStep | None:
    """Of the IMU's stamps."""
    whose = f"the stamps of {imu.topic or 'the IMU'}"
    if imu.stamp_step_ns:
        share = float(np.median(np.diff(imu.stamps_ns))) / imu.stamp_step_ns
        return _of_step(whose, imu.stamp_step_ns, min(share, 1.0), 0.0, len(imu.stamps_ns))
    return _of_stamps(whose, imu.stamps_ns)


def exact_stamps(stamps_ns: IntArray, whose: str) -> str | None:
    """What is said of stamps (Q,) that are taken for those of a clock that starts the sampling, and may not be; None for all
    others."""
    if len(stamps_ns) < STEPS.fewest_stamps:
        return None
    step_ns = _step_ns(stamps_ns, least_ns=0)
    if step_ns == 0 or not _kept_by_sensor(stamps_ns, step_ns):
        return None
    step_ms, period_ms = 1e-6 * step_ns, 1e-6 * float(np.median(np.diff(stamps_ns)))
    how = f"multiples of {step_ms:.4g} ms that come in step, every {period_ms:.4g} ms"
    if _are_multiples(stamps_ns, _period_ns(stamps_ns, step_ns)):  # most drivers that cut stamps count milliseconds
        step_ms, how = min(step_ms, 1e3 * STEPS.usual_s), f"multiples of the {period_ms:.4g} ms from one to the next"
    return (
        f"the stamps of {whose} are {how}: they are taken for exact, as if their clock started the sampling; if instead a driver "
        f"cuts them to steps of {step_ms:.4g} ms, the time offset may be off by up to that much more than is stated"
    )


def scan_step(stamps_ns: IntArray, topic: str) -> StampStep | None:
    """Of the scans' stamps (M,)."""
    return _of_stamps(f"the stamps of {topic or 'the lidar'}", stamps_ns)


def point_step(scans: Sequence[Scan], topic: str) -> StampStep | None:
    """Of the points' times after their scan's, whose phases spread over any step: there are hundreds of instants in a sweep."""
    places: IntArray = np.unique(np.linspace(0, len(scans) - 1, min(len(scans), STEPS.scans)).astype(np.int64))
    times: list[IntArray] = []
    least_ns = round(STEPS.least_of_points_s * 1e9)
    for place in places:
        times.append(np.unique(scans[int(place)].points["offset_ns"].astype(np.int64)))
        if _step_ns(times[-1], least_ns=least_ns) == 0:  # what some are no multiples of, all of them are not
            return None
    if not times or max(len(each) for each in times) < STEPS.fewest_instants:
        return None
    every = np.concatenate(times)
    step_ns = _step_ns(every, least_ns=least_ns)
    if step_ns == 0:
        return None
    return _of_step(f"the times of the points on {topic or 'the lidar'}", step_ns, 1.0, 1.0, len(every))


def _of_stamps(whose: str, stamps_ns: IntArray) -> StampStep | None:
    if len(stamps_ns) < STEPS.fewest_stamps:
        return None
    step_ns = _step_ns(stamps_ns, least_ns=0)
    if step_ns == 0 or _kept_by_sensor(stamps_ns, step_ns):
        return None
    return _of_step(whose, step_ns, 1.0, _spread(stamps_ns, step_ns), len(stamps_ns))


def _of_step(whose: str, step_ns: int, share: float, spread: float, count: int) -> StampStep:
    """share: of the step that is a reading's own."""
    mean_variance = 0.5 * ((0.5 * share) ** 2 + (0.5 * (1.0 - share)) ** 2)
    width = share * (1.0 - spread)
    step_s = step_ns * 1e-9
    return StampStep(
        whose, step_s, step_s * float(np.sqrt(mean_variance + (width / _UNIFORM_STDS) ** 2)), spread, count
    )


def _step_ns(stamps_ns: IntArray, *, least_ns: int) -> int:
    """The largest step of which all stamps are multiples; 0 for none."""
    for step_s in sorted((*(10.0**-k for k in range(1, STEPS.decades + 1)), *STEPS.ticks_s), reverse=True):
        step_ns = round(step_s * 1e9)
        if step_ns >= least_ns and _are_multiples(stamps_ns, step_ns):
            return step_ns
    return 0


def _are_multiples(stamps_ns: IntArray, step_ns: int) -> bool:
    off = (stamps_ns + step_ns // 2) % step_ns - step_ns // 2
    # All as far beside the steps: a clock that keeps step with them by itself, which is one draw and not one a stamp.
    if np.ptp(off) <= STEPS.same_ns < abs(off[0]):
        return False
    return bool((np.abs(off) <= STEPS.rounding_s * 1e9).all())


def _kept_by_sensor(stamps_ns: IntArray, step_ns: int) -> bool:
    """Whether multiples of a step are stamps of a clock that starts the sampling: multiples of the period itself, of many steps
    each, or in step and multiples of more than drivers count."""
    period_ns, rare_ns = _period_ns(stamps_ns, step_ns), STEPS.chance * min(step_ns, STEPS.usual_s * 1e9)
    if period_ns < rare_ns or np.diff(stamps_ns).min() < 0.5 * period_ns:
        return False
    if _are_multiples(stamps_ns, period_ns):
        return True
    phases = (stamps_ns - stamps_ns[0] + period_ns // 2) % period_ns - period_ns // 2
    in_step = bool((np.abs(phases) <= 2.0 * STEPS.rounding_s * 1e9).all())
    return in_step and step_ns >= rare_ns and step_ns * 1e-9 not in STEPS.ticks_s


def _period_ns(stamps_ns: IntArray, step_ns: int) -> int:
    """At which stamps come, in whole steps: seconds since 1970 in double precision leave some hundred nanoseconds of it."""
    return step_ns * round(float(np.median(np.diff(stamps_ns))) / step_ns)


def _spread(stamps_ns: IntArray, step_ns: int) -> float:
    """How much of a step the phases cover, by how far the stamps scatter about a line: a quarter of a step for all of it."""
    t = (stamps_ns - stamps_ns[0]).astype(np.float64)
    steps = np.diff(t)
    number = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(steps / np.median(steps)), 1.0))])
    off = t - np.polyval(np.polyfit(number, t, 1), number)
    return float(min(4.0 * np.median(np.abs(off - np.median(off))) / step_ns, 1.0))
