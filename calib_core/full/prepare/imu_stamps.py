"""The recording with its IMU's readings at the times at which they were taken, as far as they themselves tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.events import LogEvent, OnEvent
from calib_core.full.prepare.settings import STAMPS
from calib_core.full.run import LineStd
from calib_core.imu.lost_readings import Restored, restored
from calib_core.imu.sample_rows import LEAST
from calib_core.imu.sampling import Sampling, study_sampling
from calib_core.settings import CalibrateSettings
from calib_core.types import IntArray, Recording


def as_taken(recording: Recording, settings: CalibrateSettings, on_event: OnEvent) -> tuple[Recording, LineStd]:
    """The recording with even stamps where sampling was even, and how well the line through the jittering ones is known.

    Their mean is part of the time offset and cannot be told from it; nothing where the stamps are used as they are.
    """
    if settings.imu_sampling == "as-stamped":
        return recording, LineStd()
    imu = recording.imu
    sampling = study_sampling(imu.stamps_ns, np.hstack([imu.gyro_rad_s, imu.accel_m_s2]))
    forced = settings.imu_sampling == "even"
    topic = imu.topic or "the IMU"
    if sampling is None:
        if forced or _is_uneven(imu.stamps_ns):
            text = f"the stamps of {topic} fit no even sampling: {_AS_STAMPED}"
            on_event(LogEvent(level="warning" if forced else "info", code="imu.sampling", text=text))
        return recording, LineStd()
    even = forced or sampling.is_even
    if even or sampling.jitter_s > STAMPS.worth_saying * sampling.period_s:
        on_event(LogEvent(level="info", code="imu.sampling", text=_in_words(sampling, topic, forced=forced)))
    if not even:
        return recording, LineStd()
    duration_s = float(imu.stamps_ns[-1] - imu.stamps_ns[0]) * 1e-9
    line = LineStd.of(sampling.mean_std_s, sampling.every_std_s, duration_s)
    return replace(recording, imu=replace(imu, stamps_ns=sampling.even_ns)), line


def with_lost(
    recording: Recording, settings: CalibrateSettings, on_event: OnEvent
) -> tuple[Recording, Restored | None]:
    """With what was lost of the IMU's readings, a few in a row, as far as their neighbours tell it; said."""
    found = None if settings.imu_sampling == "as-stamped" else restored(recording.imu)
    if found is None:
        return recording, None
    topic, one_in = recording.imu.topic or "the IMU", len(found.imu.stamps_ns) / len(found.index)
    gyro, accel = np.sqrt(found.variance.reshape(-1, 2, 3).mean(axis=(0, 2)))
    text = (
        f"{len(found.index)} readings of {topic} are missing, one in {one_in:.0f}: they are restored from those around them, to "
        f"within {np.degrees(gyro):.2g} deg/s and {accel:.2g} m/s²; record them with a longer queue"
    )
    on_event(LogEvent(level="info", code="imu.lost", text=text))
    return replace(recording, imu=found.imu), found


_AS_STAMPED = "each reading is taken to be sampled at its stamp"


def _is_uneven(stamps_ns: IntArray) -> bool:
    if len(stamps_ns) < LEAST:
        return False
    steps = np.diff(stamps_ns)
    short, long = np.percentile(steps, [STAMPS.tail_percent, 1e2 - STAMPS.tail_percent])
    return bool(long - short > STAMPS.uneven * np.median(steps))


def _in_words(sampling: Sampling, topic: str, *, forced: bool) -> str:
    stamps = f"the stamps of {topic} jitter by {1e3 * sampling.jitter_s:.2g} ms"
    share, std = 100.0 * sampling.in_sampling, 100.0 * sampling.in_sampling_std
    shown = f"{share:.1f} ± {std:.1f} % of the jitter shows in the readings"
    evenly = f"readings are taken to be sampled evenly, every {1e3 * sampling.period_s:.4g} ms"
    if 1.0 - sampling.in_rows > STAMPS.worth_counting:
        evenly += f", except {100.0 * (1.0 - sampling.in_rows):.0f} % of them, whose stamps fit no even sampling"
    if sampling.late_s > 0.0:
        evenly += (
            f"; stamps are on average {1e3 * sampling.late_s:.2g} ms later than the most punctual ones, and this delay is part "
            "of the time offset: without it the offset would be greater by as much"
        )
    if forced:
        return f"{stamps}; {evenly}, as asked"
    if sampling.is_even:
        says = "but the sampling does not" if sampling.is_surely_even else "but the sampling probably does not"
        if sampling.is_mixed:
            says = "less than half of this is in the sampling itself"
        return f"{stamps}, {says} ({shown}): {evenly}"
    if sampling.is_as_stamped:
        says = "more than half of this is in the sampling itself" if sampling.is_mixed else "and so does the sampling"
        return f"{stamps}, {says} ({shown}): {_AS_STAMPED}"
    if sampling.fits_neither:
        return f"{stamps}; the readings fit neither sampling at the stamps nor even sampling ({shown}): {_AS_STAMPED}"
    if sampling.compared < LEAST:
        return f"{stamps}; too few readings come without a loss to tell whether the sampling does: {_AS_STAMPED}"
    return f"{stamps}; whether the sampling does cannot be told from this motion: {_AS_STAMPED}"
