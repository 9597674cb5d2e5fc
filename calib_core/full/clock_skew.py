"""A recording whose two clocks run at different rates is solved with the IMU's stamps stretched to the lidar's rate, and answered
for its stamps as they are.

    calibrate.py, forecast.py, known_extrinsic.py -> without_skew -> prepare, calibrate_full: ClocksApart
                                                  -> again, with stretched stamps

With t_lidar = s + o + k (t_lidar - t_m) a stamp s runs by 1 - k to the lidar's second: s' = a + (s - a) / (1 - k) runs alike,
where a is where the lidar's middle t_m lies on the IMU's clock, whose offset stays what it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from calib_core.errors import Refused
from calib_core.events import LogEvent
from calib_core.full.initialise.clock_rate import ClocksApart
from calib_core.full.initialise.settings import CLOCK_RATES
from calib_core.intrinsics import CLOCK_RATE_STD_PPM
from calib_core.method import Answer
from calib_core.result import Intrinsic
from calib_core.types import Recording

#: The code of what is said where clocks' rates differ.
RATE = "clock.rate"
_Solved = TypeVar("_Solved")


@dataclass(frozen=True, slots=True)
class ClockSkew:
    """rate: k, that of the offset beside the lidar's time.   rate_std: how well it is known.   about_ns: a, the IMU's clock."""

    rate: float
    rate_std: float
    about_ns: int

    @property
    def left_std_ppm(self) -> float:
        """What the rates may still differ by."""
        return math.hypot(CLOCK_RATE_STD_PPM, 1e6 * self.rate_std)

    def after(self, first: ClockSkew | None) -> ClockSkew:
        """One that does what another did first, and this then."""
        if first is None:
            return self
        return ClockSkew(_together(first.rate, self.rate), self.rate_std, first.about_ns)

    def applied(self, recording: Recording) -> Recording:
        """The recording with the IMU's stamps stretched."""
        away_ns = recording.imu.stamps_ns - self.about_ns
        stamps_ns = self.about_ns + np.rint(away_ns / (1.0 - self.rate)).astype(np.int64)
        return replace(recording, imu=replace(recording.imu, stamps_ns=stamps_ns))

    def told(self, recording: Recording) -> LogEvent:
        """The warning, with its evidence and the way around it."""
        stamps_ns = recording.imu.stamps_ns
        ms = 1e-6 * abs(self.rate) * float(stamps_ns[-1] - stamps_ns[0])
        how = "slow" if self.rate > 0.0 else "fast"
        text = (
            f"the IMU's stamps run {abs(self.rate):.2%} {how} beside the lidar's, {ms:.0f} ms over the recording, as if a driver "
            "counted them up with a period that is not the sensor's: the stamps were rescaled; let the driver stamp readings as "
            "they arrive, or keep the stamps as they are with `--imu-sampling as-stamped`"
        )
        return LogEvent(level="warning", code=RATE, text=text)

    def found(self, answer: Answer) -> ClockSkew:
        """The same with the rate of an answer for the recording's own stamps."""
        rate_ppm, std_ppm = answer.clock_rate_ppm or (1e6 * self.rate, 1e6 * self.rate_std)
        return ClockSkew(1e-6 * rate_ppm, 1e-6 * std_ppm, self.about_ns)

    def undone(self, answer: Answer, recording: Recording) -> Answer:
        """The answer that was found with stretched stamps, for the recording's own."""
        at_ns = recording.scans[0].stamp_ns + round(1e9 * (answer.time_offset_at_s or 0.0))
        gained_ns = round(self.rate * (at_ns - answer.time_offset_ns - self.about_ns))
        rate_ppm, std_ppm = answer.clock_rate_ppm or (0.0, 0.0)
        whole_ppm = 1e6 * _together(self.rate, 1e-6 * rate_ppm)
        return replace(
            answer,
            time_offset_ns=answer.time_offset_ns + gained_ns,
            clock_rate_ppm=(whole_ppm, std_ppm),
            intrinsics=tuple(_of_the_clock(each, whole_ppm) for each in answer.intrinsics),
            remarks=tuple(said for said in answer.remarks if said.code != "sensor.clock"),
        )


def without_skew(
    recording: Recording,
    solve: Callable[[Recording, float], _Solved],
    begin_again: Callable[[ClockSkew], None] | None = None,
) -> tuple[_Solved, ClockSkew | None]:
    """What `solve` makes of the recording, or of it with the IMU's stamps stretched, and by what.

    solve: takes a recording, and by how much its clocks' rates may differ [ppm].   begin_again: told before each further attempt.
    Raises what solve does, Refused where stretched stamps still run apart.
    """
    skew: ClockSkew | None = None
    for _ in range(1 + CLOCK_RATES.stretched):
        try:
            if skew is None:
                return solve(recording, CLOCK_RATE_STD_PPM), None
            return solve(skew.applied(recording), skew.left_std_ppm), skew
        except ClocksApart as apart:
            skew = ClockSkew(apart.rate, apart.rate_std, apart.about_ns).after(skew)
            if begin_again is not None:
                begin_again(skew)
    raise Refused(
        RATE,
        "the IMU's stamps do not run at a constant rate beside the lidar's: let the IMU's driver stamp readings as they arrive, "
        "or keep the stamps as they are with `--imu-sampling as-stamped`",
    )


def _together(first: float, then: float) -> float:
    """The rate of two, one after the other."""
    return 1.0 - (1.0 - first) * (1.0 - then)


def _of_the_clock(parameter: Intrinsic, rate_ppm: float) -> Intrinsic:
    if parameter.block != "clock_rate":
        return parameter
    return parameter.model_copy(update={"value": rate_ppm, "significant": True})
