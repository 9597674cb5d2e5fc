"""What every stage of one calibration shares: the recording's two clocks, the choices made, and whom to tell."""

from __future__ import annotations

import os
from concurrent.futures import Future
from dataclasses import dataclass, field, replace

import numpy as np

from calib_core.errors import Cancelled
from calib_core.events import LogEvent, OnEvent, ShouldCancel, Stage, StageEvent
from calib_core.full.prepare.imu_noise import ImuNoiseLevel
from calib_core.gp.regression import Hyper
from calib_core.settings import CalibrateSettings
from calib_core.types import FloatArray, Recording


class NoStart(Exception):
    """The recording cannot give start values or hold a solve: the reason in words, under a stable code."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(text)
        self.code = code


@dataclass(frozen=True)
class Clocks:
    """Both clocks in seconds of their own epochs. lidar time = imu time + offset, |offset| small after coarse alignment.

    imu_s: (Q,).   scan_s: (M,) first points' times.   sweep_s: (M,) last point after the first.   jitter_mean_std_s: what
    the time offset is unsure by because the mean of the stamps' jitter is part of it.
    """

    lidar_epoch_ns: int
    imu_epoch_ns: int
    imu_s: FloatArray
    scan_s: FloatArray
    sweep_s: FloatArray
    jitter_mean_std_s: float = 0.0

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


def read_clocks(recording: Recording) -> Clocks:
    """Clocks of a recording: the IMU's epoch is the lidar's, moved by the coarse offset."""
    stamps = np.array([scan.stamp_ns for scan in recording.scans], dtype=np.int64)
    epoch = int(stamps[0])
    imu_epoch = epoch - recording.coarse_offset_ns
    sweeps = np.array([int(s.points["offset_ns"].max()) * 1e-9 if len(s.points) else 0.0 for s in recording.scans])
    imu_s = np.asarray((recording.imu.stamps_ns - imu_epoch) * 1e-9, dtype=np.float64)
    scan_s = np.asarray((stamps - epoch) * 1e-9, dtype=np.float64)
    return Clocks(epoch, imu_epoch, imu_s, scan_s, sweeps)


@dataclass
class Context:
    """What every stage of one run needs: the recording, choices, and whom to tell.

    training: of the IMU's interpolation, which goes on beside the search for planes.
    """

    recording: Recording
    settings: CalibrateSettings
    clocks: Clocks
    noise: ImuNoiseLevel
    training: Future[Hyper]
    on_event: OnEvent
    should_cancel: ShouldCancel
    threads: int = field(default_factory=lambda: max(1, min(4, len(os.sched_getaffinity(0)))))
    iterations: int = 0

    @property
    def hyper(self) -> Hyper:
        """How the IMU's readings are interpolated."""
        return self.training.result()

    def stage(self, stage: Stage, fraction: float, text: str = "") -> None:
        """Report progress; stop where the caller asked to."""
        if self.should_cancel():
            raise Cancelled("the calibration was cancelled")
        self.on_event(StageEvent(stage=stage, fraction=min(max(fraction, 0.0), 1.0), text=text))

    def say(self, level: str, code: str, text: str) -> None:
        """A sentence for a person."""
        self.on_event(LogEvent.model_validate({"level": level, "code": code, "text": text}))
