"""The recording with its IMU's readings at the times at which they were taken, as far as they themselves tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.events import LogEvent, OnEvent
from calib_core.imu.sampling import Sampling, study_sampling
from calib_core.settings import CalibrateSettings
from calib_core.types import Recording

#: Jitter below this share of the period is not worth a sentence where nothing follows from it.
_WORTH_SAYING = 0.02


def as_taken(recording: Recording, settings: CalibrateSettings, on_event: OnEvent) -> tuple[Recording, float]:
    """The recording with even stamps where sampling was even, and the standard deviation of the jitter's mean [s].

    The mean is part of the time offset and cannot be told from it: 0 where the stamps are used as they are.
    """
    if settings.imu_sampling == "as-stamped":
        return recording, 0.0
    imu = recording.imu
    sampling = study_sampling(imu.stamps_ns, np.hstack([imu.gyro_rad_s, imu.accel_m_s2]))
    forced = settings.imu_sampling == "even"
    if sampling is None:
        if forced:
            text = f"the stamps of {imu.topic or 'the IMU'} follow no even sampling; readings are taken as sampled when stamped"
            on_event(LogEvent(level="warning", code="imu.sampling", text=text))
        return recording, 0.0
    even = forced or sampling.is_even
    if even or sampling.jitter_s > _WORTH_SAYING * sampling.period_s:
        on_event(LogEvent(level="info", code="imu.sampling", text=_in_words(sampling, imu.topic, forced=forced)))
    if not even:
        return recording, 0.0
    return replace(recording, imu=replace(imu, stamps_ns=sampling.even_ns)), sampling.mean_std_s


def _in_words(sampling: Sampling, topic: str, *, forced: bool) -> str:
    stamps = f"the stamps of {topic or 'the IMU'} jitter by {1e3 * sampling.jitter_s:.2g} ms"
    shown = (
        f"{100.0 * sampling.in_sampling:.1f} +- {100.0 * sampling.in_sampling_std:.1f} % of it shows in the readings"
    )
    evenly = f"readings are taken as sampled evenly, every {1e3 * sampling.period_s:.4g} ms"
    if forced:
        return f"{stamps}; {evenly}, as asked"
    if sampling.is_even:
        return f"{stamps}, the sampling does not ({shown}): {evenly}"
    if sampling.is_as_stamped:
        return f"{stamps}, and so does the sampling ({shown}): readings are taken as sampled when stamped"
    return f"{stamps}; whether the sampling does cannot be told from this motion: readings are taken as sampled when stamped"
