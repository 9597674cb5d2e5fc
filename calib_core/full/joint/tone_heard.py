"""Whether the IMU has read a tone at all: what is taken out of readings has to be in them.

A lidar's pattern comes round in its own time, too, and walls that are not flat are then seen to tremble by fractions of a
millimetre: as readings of 23 Hz that is metres a second squared, which a motion of the opposite sign undoes. And what is as slow
as the hand's own motion is in the readings of any motion: where planes leave a direction open, it can be told from it by a
standstill alone, through which a tone goes on.
"""

from __future__ import annotations

import numpy as np

from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.settings import HEARING
from calib_core.full.prepare.imu_noise import longest_still
from calib_core.imu.tones import attitudes, tone_readings
from calib_core.types import FloatArray


def is_heard(data: JointData, state: Estimation) -> bool:
    """Of the last of a state's tones: whether gyroscope or accelerometer has read about as much there."""
    hz, _, added = _claimed(data, state)
    claimed = np.sqrt(2.0 * np.mean(added.reshape(-1, 2, 3) ** 2, axis=0).sum(axis=1))
    imu, imu_s = data.run.recording.imu, data.run.clocks.imu_s
    mine = (imu_s >= data.readings.knots_s[0]) & (imu_s <= data.readings.knots_s[state.knots - 1])
    read = np.stack([loudest_near(imu_s[mine], channels[mine], hz) for channels in (imu.gyro_rad_s, imu.accel_m_s2)])
    return bool((claimed < HEARING.times * read).any())


def goes_on_at_rest(data: JointData, state: Estimation, slow_hz: float) -> bool:
    """Of the last of a state's tones: whether the readings of a standstill may have it too.

    Asked up to slow_hz, where hands move, and where no engine is heard anyway: a rotor that starts later shakes faster.
    """
    hz, knots_s, added = _claimed(data, state)
    return data.run.noise.shaken or hz > slow_hz or is_in_standstill(data, knots_s, added)


def _claimed(data: JointData, state: Estimation) -> tuple[float, FloatArray, FloatArray]:
    """Of the last of a state's tones: its frequency [Hz], the knots (K,) [s, IMU clock], what it adds to the readings (K, 6)."""
    hz, values = state.nuisance.tones_hz[-1], state.estimate.sensors.tones()[-1]
    at = attitudes(data.readings.part(0, state.knots), state.estimate.states.R, state.nuisance.tones_zero_s)
    return hz, at.knots_s + state.nuisance.tones_zero_s, tone_readings(hz, values, at.knots_s, at.at_knots)


def is_in_standstill(data: JointData, knots_s: FloatArray, claimed: FloatArray) -> bool:
    """Whether the longest standstill may have what a tone adds to the readings: True where there is none that could tell.

    knots_s: (K,) IMU clock.   claimed: (K, 6).   The share of it that the readings there have is a line's slope, each channel
    counting by how little it scatters: within its error, it has to reach what is_heard asks of a tone's size.
    """
    imu, imu_s = data.run.recording.imu, data.run.clocks.imu_s
    still = longest_still(imu_s, imu.gyro_rad_s, imu.accel_m_s2)
    if still is None:
        return True
    times_s, read = imu_s[still], np.hstack([imu.gyro_rad_s[still], imu.accel_m_s2[still]])
    known = (times_s >= knots_s[0]) & (times_s <= knots_s[-1])
    if not known.any():
        return True
    tone = np.stack([np.interp(times_s[known], knots_s, channel) for channel in claimed.T], axis=1)
    tone, read = tone - tone.mean(axis=0), read[known]  # what does not change may be a bias
    weight = 1.0 / np.maximum(read.std(axis=0), data.run.noise.sample_std) ** 2
    information = float((weight * tone**2).sum())
    pull = float((weight * tone * read).sum())
    return pull + HEARING.sigmas * np.sqrt(information) >= information / HEARING.times


def loudest_near(times_s: FloatArray, channels: FloatArray, hz: float) -> float:
    """The amplitude of the loudest sine near a frequency, of channels (N, 3) together. In the room, a tone has turning axes."""
    even_s = np.linspace(times_s[0], times_s[-1], len(times_s))
    taper = np.hanning(len(even_s))
    tapered = np.stack([np.interp(even_s, times_s, channel - channel.mean()) * taper for channel in channels.T])
    spacing_s = float(even_s[1] - even_s[0])
    near = np.abs(np.fft.rfftfreq(2 * len(even_s), spacing_s) - hz) <= HEARING.around_hz
    spectrum = np.abs(np.fft.rfft(tapered, 2 * len(even_s), axis=1)[:, near])
    return float(2.0 / taper.sum() * np.linalg.norm(spectrum, axis=0).max(initial=0.0))
