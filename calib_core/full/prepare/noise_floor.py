"""White noise's density from the readings' own spectrum: the lowest band that is flat, above the motion and between lines.

Integrated over 0.1 to 10 s, a sensor's noise counts by its density at low frequencies. An engine shakes the readings in
lines from 25 Hz on, a sensor's own filter takes noise away towards its end, and motion fills the lowest hertz. So the
spectrum is looked at in stretches of ten hertz from below. In each its lower parts are noise and what rises above them is
lines: the mean of those that chi-square's law allows, truncated where the lines begin. The first stretch that goes on as low
as it begins is the floor; one that falls is still motion.

A road shakes a rig in no lines but in a band, whose rise and top go on as low as they begin, too. A sensor's filter lets noise
pass less and less as frequency grows, never more. So the floor is nowhere above what is seen anywhere below it, motion
included: between what a hand does and what a road does lies a valley.

Slepian tapers of six half bandwidths keep a line's or the motion's power (seventy decibels above the noise) to its own place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from calib_core.full.prepare.settings import SPECTRUM
from calib_core.full.prepare.tapers import slepian_tapers, without_line
from calib_core.types import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class Floor:
    """density: continuous-time, per channel (C,), in the values' unit per root hertz; NaN where no stretch is flat.

    relative_std: (C,) of it, by chance.
    """

    density: FloatArray
    relative_std: FloatArray


@dataclass(frozen=True, slots=True)
class _Spectrum:
    """hz: (F,).   power: (F, C) two-sided density: white noise's variance times the period.

    freedom: of chi-square, of one value.   seconds: that the average over many of them is worth.
    """

    hz: FloatArray
    power: FloatArray
    freedom: float
    seconds: float

    def freedom_of(self, values: int) -> float:
        """Of the mean of so many values."""
        return max(self.freedom, 2.0 * self.seconds * values * float(self.hz[1]))


def noise_floor(stamps_s: FloatArray, values: FloatArray, *, lowest_hz: float) -> Floor:
    """The floor of each channel's spectrum. stamps_s: (Q,) increasing.   values: (Q, C).   lowest_hz: motion ends here."""
    nothing = np.full(values.shape[1], np.nan)
    period = float(np.median(np.diff(stamps_s)))
    even = _evenly(stamps_s, values, period)
    size = min(len(even), round(SPECTRUM.segment_s / period))
    half_width_hz = SPECTRUM.half_bandwidths / (size * period)
    first_hz, last_hz = max(lowest_hz, half_width_hz), 0.5 / period - half_width_hz
    if size < SPECTRUM.fewest_readings or last_hz - first_hz < SPECTRUM.stretch_hz:
        return Floor(nothing, nothing)
    spectrum = _spectrum(even, size, period)
    hz = spectrum.hz
    density, std = nothing.copy(), nothing.copy()
    for channel in range(values.shape[1]):
        for low_hz in np.arange(first_hz, last_hz - SPECTRUM.stretch_hz + 1e-9, SPECTRUM.step_hz):
            stretch = spectrum.power[(hz >= low_hz) & (hz < low_hz + SPECTRUM.stretch_hz), channel]
            level, noise = _level(stretch, spectrum.freedom)
            halves = list(zip(np.array_split(stretch, 2), np.array_split(noise, 2), strict=True))
            if level <= 0.0 or noise.mean() < SPECTRUM.least_noise or not all(kept.any() for _, kept in halves):
                continue
            lower, upper = (float(part[kept].mean()) for part, kept in halves)
            chance = np.sqrt(sum(2.0 / spectrum.freedom_of(int(kept.sum())) for _, kept in halves))
            if np.log(lower / upper) < np.log(SPECTRUM.fall) + SPECTRUM.fall_sigmas * chance:
                density[channel] = np.sqrt(min(level, _most_seen(spectrum, channel, half_width_hz, low_hz)))
                std[channel] = np.sqrt(0.5 / spectrum.freedom_of(int(noise.sum())))
                break
    return Floor(density, std)


def _most_seen(spectrum: _Spectrum, channel: int, first_hz: float, below_hz: float) -> float:
    """The most that noise's power can be beyond a frequency: the least that there is below it, as far as chance leaves that open.

    As wide a part of the spectrum is looked at as has to be noise of a stretch. inf where there is none below.
    """
    inside = (spectrum.hz >= first_hz) & (spectrum.hz < below_hz)
    power, width = spectrum.power[inside, channel], round(SPECTRUM.least_noise * SPECTRUM.stretch_hz / spectrum.hz[1])
    if len(power) < width:
        return np.inf
    means = np.convolve(power, np.full(width, 1.0 / width), "valid")
    return float(means.min() * np.exp(SPECTRUM.fall_sigmas * np.sqrt(2.0 / spectrum.freedom_of(width))))


def _evenly(stamps_s: FloatArray, values: FloatArray, period: float) -> FloatArray:
    """The readings one period apart, (N, C): those that are missing lie on the line between their neighbours."""
    at = np.concatenate([[0], np.cumsum(np.maximum(np.round(np.diff(stamps_s) / period), 1.0))])
    every = np.arange(at[-1] + 1)
    return np.stack([np.interp(every, at, channel) for channel in values.T], axis=1)


def _spectrum(even: FloatArray, size: int, period: float) -> _Spectrum:
    """Of readings (N, C) one period apart, in segments of so many that overlap by three quarters."""
    tapers = slepian_tapers(size, SPECTRUM.half_bandwidths, SPECTRUM.tapers)
    count = 1 + int(np.ceil(SPECTRUM.overlap * (len(even) / size - 1.0)))
    starts = np.linspace(0, len(even) - size, count).astype(int)
    total = np.zeros((size // 2 + 1, even.shape[1]))
    looked_at = np.zeros(len(even))
    for start in starts:
        piece = without_line(even[start : start + size])
        total += np.mean(np.abs(np.fft.rfft(tapers[:, :, None] * piece, axis=1)) ** 2, axis=0)
        looked_at[start : start + size] += np.sum(tapers**2, axis=0)
    # Two numbers, sine and cosine, for each taper; those of segments that overlap tell partly the same.
    shared = 0.0
    for apart in np.abs(starts[:, None] - starts).ravel():
        if apart < size:
            shared += float(np.sum((tapers[:, apart:] @ tapers[:, : size - apart].T) ** 2))
    return _Spectrum(
        np.asarray(np.fft.rfftfreq(size, period), np.float64),
        total / count * period,
        2.0 * (count * SPECTRUM.tapers) ** 2 / shared,
        float(looked_at.sum() ** 2 / np.sum(looked_at**2)) * period,
    )


def _level(power: FloatArray, freedom: float) -> tuple[float, BoolArray]:
    """The noise's mean power in a stretch (F,) and which values are noise, (F,) bool.

    From the lower quarter up: a value counts below the quantile of the law that the level so far gives it, and the mean of
    what is cut off there is less than the level by a known factor.
    """
    half = 0.5 * freedom
    quarter = 0.5 * SPECTRUM.least_noise
    level = float(np.quantile(power, quarter)) * half / float(scipy.special.gammaincinv(half, quarter))
    cut = float(scipy.special.gammaincinv(half, SPECTRUM.line_quantile)) / half
    kept_mean = float(scipy.special.gammainc(half + 1.0, half * cut)) / SPECTRUM.line_quantile
    noise = np.zeros(power.shape, np.bool_)
    for _ in range(SPECTRUM.passes):
        inside = power <= cut * level
        if not inside.any() or np.array_equal(inside, noise):
            break
        noise = inside
        level = float(power[noise].mean()) / kept_mean
    return level, noise
