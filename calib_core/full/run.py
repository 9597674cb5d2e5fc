"""What every stage of one calibration shares: the recording, its two clocks, the noise, the choices, whom to tell."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from calib_core.errors import Cancelled
from calib_core.events import Event, LogEvent, OnEvent, ShouldCancel, Stage, StageEvent
from calib_core.gp.regression import Hyper
from calib_core.imu.lost_readings import Restored
from calib_core.imu.preintegration import NoiseDensity
from calib_core.intrinsics import CLOCK_RATE_STD_PPM, Block, Sensor
from calib_core.message_log import MessageLog
from calib_core.settings import CalibrateSettings
from calib_core.threads import usual_threads
from calib_core.types import FloatArray, IntArray, Level, Recording


@dataclass(frozen=True, slots=True)
class StampStep:
    """The step of stamps that are cut to whole milliseconds, or to whole ticks of some other clock.

    whose: the stamps, in words.   step_s: they are multiples of this.   std_s: what that adds to the time offset's standard
    deviation.   spread: 0 to 1, how much of the step the true instants' phases cover.   count: of stamps that were looked at.
    """

    whose: str
    step_s: float
    std_s: float
    spread: float
    count: int

    @property
    def text(self) -> str:
        """To a person: what, by which evidence, what follows and what to do."""
        kept = "" if self.spread > 0.5 else ", and the sensor samples in step with them"
        return (
            f"{self.whose}, all {self.count} of them, are multiples of {1e3 * self.step_s:.4g} ms{kept}: what was cut off is "
            f"part of the time offset, and {1e3 * self.std_s:.2g} ms of its standard deviation; let the driver stamp to "
            "microseconds"
        )


@dataclass(frozen=True, slots=True)
class LineStd:
    """How well the line through jittering stamps is known.

    mean_std_s: of its mean, which is part of the time offset.   rate_std_ppm: of its slope, which is part of the clocks' rate.
    """

    mean_std_s: float = 0.0
    rate_std_ppm: float = 0.0

    @staticmethod
    def of(mean_std_s: float, every_std_s: float, duration_s: float) -> LineStd:
        """Of stamps spread evenly over so long, whose mean would be known to every_std_s were there nothing but noise: the slope
        of a line through N of them is known to sigma sqrt(12 / N) / duration.
        """
        return LineStd(mean_std_s, 1e6 * 2.0 * math.sqrt(3.0) * every_std_s / duration_s)

    def beside(self, other: LineStd) -> LineStd:
        """Of two clocks, each with its own."""
        return LineStd(math.hypot(self.mean_std_s, other.mean_std_s), math.hypot(self.rate_std_ppm, other.rate_std_ppm))


@dataclass(frozen=True)
class Clocks:
    """Both clocks in seconds of their own epochs. lidar time = imu time + offset, |offset| small after coarse alignment.

    imu_s: (Q,).   scan_s: (M,) first points' times.   sweep_s: (M,) last point after the first.   scan_points: (M,) how
    many there are.   line: what the time offset and the clocks' rate are unsure by because stamps jitter.   late_ns: of scans
    that were taken before their stamp says, by stamp: how late it is.   steps: of stamps and times that a clock's ticks cut.
    sieve_std_s: what the time offset is unsure by for clouds that a grid thinned.
    """

    lidar_epoch_ns: int
    imu_epoch_ns: int
    imu_s: FloatArray
    scan_s: FloatArray
    sweep_s: FloatArray
    scan_points: IntArray
    line: LineStd = LineStd()
    late_ns: Mapping[int, int] = field(default_factory=dict)
    steps: tuple[StampStep, ...] = ()
    sieve_std_s: float = 0.0

    @property
    def steps_std_s(self) -> float:
        """What the time offset is unsure by for what was cut off, of stamps and of clouds, however long the recording is."""
        return math.hypot(self.sieve_std_s, *(step.std_s for step in self.steps))

    @property
    def offset_std_s(self) -> float:
        """What the time offset is unsure by for all that the stamps themselves are off, of which no residual knows."""
        return float(np.hypot(self.line.mean_std_s, self.steps_std_s))

    @property
    def middle_s(self) -> float:
        """The lidar's time, in the middle of the recording, at which the time offset holds where the clocks' rates differ."""
        return 0.5 * float(self.scan_s[0] + self.scan_s[-1])

    def at_rate(self, rate_ppm: float) -> Clocks:
        """The lidar's stamps as they would be if its clock ran at the IMU's rate: t - rate (t - middle), sweep by sweep."""
        if rate_ppm == 0.0:
            return self
        away_s = self.scan_s + 0.5 * self.sweep_s - self.middle_s
        return replace(self, scan_s=self.scan_s - 1e-6 * rate_ppm * away_s)

    def as_stamped(self, times_s: FloatArray, rate_ppm: float) -> FloatArray:
        """The inverse of `at_rate`, of instants (N,)."""
        rate = 1e-6 * rate_ppm
        return np.asarray((times_s - rate * self.middle_s) / (1.0 - rate))

    def offset_ns(self, time_offset_s: float) -> int:
        """The contract's time offset in nanoseconds: exact epochs' difference plus the estimate."""
        return self.lidar_epoch_ns - self.imu_epoch_ns + round(time_offset_s * 1e9)

    def offset_s(self, time_offset_ns: int) -> float:
        """The inverse of `offset_ns`."""
        return (time_offset_ns - (self.lidar_epoch_ns - self.imu_epoch_ns)) * 1e-9


@dataclass(frozen=True, slots=True)
class ImuNoiseLevel:
    """density: continuous-time white noise. sample_std: (6,) of one reading, gyro first. source: in words.

    shaken: whether a reading scatters by more than that noise makes, as where an engine runs; True where nobody has looked.
    coarse: whether readings stay on one step for longer than that noise would let them (`imu/quantisation.py`).
    """

    density: NoiseDensity
    sample_std: FloatArray
    source: str
    shaken: bool = True
    coarse: bool = False


@dataclass(frozen=True)
class Run:
    """What every stage needs, as `prepare` leaves it; handed on unchanged, but for `portion` and what an attempt tries otherwise.

    recording: its IMU's readings at the times at which they were taken, and as far as they were lost or cut off, restored.
    training: the fit of the IMU's interpolation, on a thread of its own beside the search for planes; `hyper` waits for it.
    farthest_m, nearest_m: the longest and the shortest range of a sample's returns; nearest_m is 0 where the shortest is too
    long to be the end of a blind zone.   sieve_m: edge of the voxels by which the clouds were thinned, 0 where they were not.
    restored: which readings were restored, None for none.
    threads: how many a stage may use.   portion: the part of the running stage that progress from 0 to 1 stands for now.
    beyond_sheets: sensors that have shown not to be what their data sheets say, whose priors are wider (`joint/data_sheets.py`).
    room: how many times as much as any sensor's a kind of parameter is allowed, where one ran away.
    clock_rate_std_ppm: by how much the clocks' rates may differ, or what is left of it where stamps were stretched
    (`clock_skew.py`).
    log: the result's messages, from which what an attempt has said can be taken back; None where there is no result, as in a
    forecast.
    """

    recording: Recording
    settings: CalibrateSettings
    clocks: Clocks
    noise: ImuNoiseLevel
    training: Future[Hyper]
    on_event: OnEvent
    should_cancel: ShouldCancel
    farthest_m: float = float("inf")
    nearest_m: float = 0.0
    sieve_m: float = 0.0
    restored: Restored | None = None
    threads: int = field(default_factory=usual_threads)
    portion: tuple[float, float] = (0.0, 1.0)
    beyond_sheets: frozenset[Sensor] = frozenset()
    room: tuple[Block, float] | None = None
    clock_rate_std_ppm: float = CLOCK_RATE_STD_PPM
    log: MessageLog | None = None

    @property
    def hyper(self) -> Hyper:
        """How the IMU's readings are interpolated."""
        return self.training.result()

    def heed_cancel(self) -> None:
        """Stop where the caller asked to."""
        if self.should_cancel():
            raise Cancelled("the calibration was cancelled")

    def stage(self, stage: Stage, fraction: float, text: str = "") -> None:
        """Report progress; stop where the caller asked to."""
        self.heed_cancel()
        low, high = self.portion
        within = low + (high - low) * min(max(fraction, 0.0), 1.0)
        self.on_event(StageEvent(stage=stage, fraction=within, text=text))

    def within(self, low: float, high: float) -> Run:
        """The same run, whose progress from 0 to 1 is this portion of what it was."""
        start, end = self.portion
        width = end - start
        return replace(self, portion=(start + width * low, start + width * high))

    def say(self, level: Level, code: str, text: str) -> None:
        """A sentence for a person."""
        self.on_event(LogEvent(level=level, code=code, text=text))

    def attempt(self) -> Callable[[], None]:
        """Begin what may lead nowhere. Returns a function; a call of it takes what was said since out of the result's messages.
        Whoever watches has heard it.
        """
        if self.log is None:
            return lambda: None
        return partial(self.log.restore, self.log.snapshot())

    def retract(self, *codes: str) -> None:
        """Keep out of the document what was said under these codes: it is looked at again."""
        if self.log is not None:
            self.log.retract(codes)

    def keeping(self, code: str) -> Run:
        """The same run without the sentences of one code, for who uses it in a way of which they would not be true."""

        def tell(event: Event) -> None:
            if not (isinstance(event, LogEvent) and event.code == code):
                self.on_event(event)

        return replace(self, on_event=tell)
