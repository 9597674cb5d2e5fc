"""Whether the IMU has read a tone at all: what is taken out of readings has to be in them.

A lidar's pattern comes round in its own time, too, and walls that are not flat are then seen to tremble by fractions of a
millimetre: as readings of 23 Hz that is metres a second squared, which a motion of the opposite sign undoes.
"""

from __future__ import annotations

import numpy as np

from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.settings import HEARING
from calib_core.imu.tones import attitudes, tone_readings
from calib_core.types import FloatArray


def is_heard(data: JointData, state: Estimation) -> bool:
    """Of the last of a state's tones: whether gyroscope or accelerometer has read about as much there."""
    hz, values = state.nuisance.tones_hz[-1], state.estimate.sensors.tones()[-1]
    at = attitudes(data.readings.part(0, state.knots), state.estimate.states.R, state.nuisance.tones_zero_s)
    added = tone_readings(hz, values, at.knots_s, at.at_knots)
    claimed = np.sqrt(2.0 * np.mean(added.reshape(-1, 2, 3) ** 2, axis=0).sum(axis=1))
    imu, imu_s = data.run.recording.imu, data.run.clocks.imu_s
    mine = (imu_s >= data.readings.knots_s[0]) & (imu_s <= data.readings.knots_s[state.knots - 1])
    read = np.stack([loudest_near(imu_s[mine], channels[mine], hz) for channels in (imu.gyro_rad_s, imu.accel_m_s2)])
    return bool((claimed < HEARING.times * read).any())


def loudest_near(times_s: FloatArray, channels: FloatArray, hz: float) -> float:
    """The amplitude of the loudest sine near a frequency, of channels (N, 3) together. In the room, a tone has turning axes."""
    even_s = np.linspace(times_s[0], times_s[-1], len(times_s))
    taper = np.hanning(len(even_s))
    tapered = np.stack([np.interp(even_s, times_s, channel - channel.mean()) * taper for channel in channels.T])
    spacing_s = float(even_s[1] - even_s[0])
    near = np.abs(np.fft.rfftfreq(2 * len(even_s), spacing_s) - hz) <= HEARING.around_hz
    spectrum = np.abs(np.fft.rfft(tapered, 2 * len(even_s), axis=1)[:, near])
    return float(2.0 / taper.sum() * np.linalg.norm(spectrum, axis=0).max(initial=0.0))
