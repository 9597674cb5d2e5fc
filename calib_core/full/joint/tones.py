"""Shaking faster than the IMU samples, found by what the lidar's motion leaves of the readings (imu/tones.py).

At an optimum, the links' residuals say towards which change of the readings, at which instant, the whole problem pulls: the
score. Where the model is right, its periodogram is chance, exponential with a mean of at most 1 in units of the links' own
information (the motion takes up a part of it). A tone stands out by hundreds and thousands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_core.factors.imu import link_factors
from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.policies import Round, Sampling, Tones
from calib_core.full.joint.present import problem_of
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.round import one_round
from calib_core.full.joint.sensors import tone_values
from calib_core.full.joint.state import Estimate
from calib_core.full.prepare.nuisance import TONE
from calib_core.types import FloatArray


@dataclass(frozen=True, slots=True)
class Periodogram:
    """hz: (F,).   power: (F, 6) of the score of each channel, gyroscope first; of mean 1 or less by chance."""

    hz: FloatArray
    power: FloatArray

    def of_tones(self, rules: Tones) -> FloatArray:
        """The louder channel's (F,), 0 where no tone can be told: with too few turns, or integrated to nothing."""
        power = self.power.max(axis=1)
        power[(self.hz < rules.fewest_turns * self.turn_hz(rules)) | (self.hz > rules.highest * self.hz[-1])] = 0.0
        return power

    def turn_hz(self, rules: Tones) -> float:
        """One turn in the recording."""
        return float(rules.padded * self.hz[1])


def admitted_from(data: JointData, rules: Tones, least: float) -> float:
    """How far a tone has to stand out: by `least`; where the sensors are held at what they are meant to be, and nothing
    shakes the IMU, by what no sensor makes of the motion itself."""
    held = not data.sensors.blocks or data.run.settings.intrinsics == "consider"
    return max(least, rules.shouts) if held and not data.run.noise.shaken else least


def admit_tones(
    data: JointData, state: Estimation, rules: Tones, round_: Round, sampling: Sampling, *, least: float
) -> Estimation:
    """With the tones that stand out by `least` or more, one after the other: beside a strong one a weak one shows nothing.

    What is louder with a tone than without it was none.
    """
    if len(state.nuisance.tones_hz) >= rules.most:
        return state
    heard, least = listen(data, state, rules), admitted_from(data, rules, least)
    while found := beside_known(data, state, heard, rules, least):
        after = told(data, with_tone(data, state, found[0], rules), round_, sampling)
        left = listen(data, after, rules)
        if left.power.max() > heard.power.max():
            break
        state, heard = after, left
    return state


def admit_rest(data: JointData, state: Estimation, rules: Tones, round_: Round, sampling: Sampling) -> Estimation:
    """With all that stand out now: for a state at rest with all points, from which the way back is long."""
    least = admitted_from(data, rules, rules.stands_out)
    found = beside_known(data, state, listen(data, state, rules), rules, least)
    if not found:
        return state
    for hz in found:
        state = with_tone(data, state, hz, rules)
    return told(data, state, round_, sampling)


def listen(data: JointData, state: Estimation, rules: Tones) -> Periodogram:
    """The score's periodogram where the state is now."""
    return score_periodogram(problem_of(data, state), state.estimate, rules)


def loudest(data: JointData, state: Estimation, rules: Tones) -> float:
    """How far the loudest stands out of those that a tone could be."""
    return float(listen(data, state, rules).of_tones(rules).max())


def beside_known(data: JointData, state: Estimation, of: Periodogram, rules: Tones, least: float) -> list[float]:
    """Frequencies [Hz] at which the score stands out beside the tones that are known, the loudest first."""
    known = state.nuisance.tones_hz
    # From scan to scan: a sweep's own points end before the next one begins.
    sweep_hz = 1.0 / float(np.median(np.diff(data.run.clocks.scan_s)))
    return standing_out(of, rules, least, known, sweep_hz)[: rules.most - len(known)]


def told(data: JointData, state: Estimation, round_: Round, sampling: Sampling) -> Estimation:
    """Two rounds on: one for the size of new tones, one for their frequency, which can be told from there."""
    for _ in range(2):
        state = one_round(data, state, round_, sampling)
    return state


def with_tone(data: JointData, state: Estimation, hz: float, rules: Tones) -> Estimation:
    """With one more tone among the unknowns, of which nothing is known yet."""
    knots_s = data.readings.knots_s[[0, state.knots - 1]]
    nuisance = state.nuisance.with_tone(hz, rules.resolution / float(np.diff(knots_s)[0]), float(knots_s.mean()))
    values, end = state.estimate.nuisance, nuisance.places[TONE].stop
    more = nuisance.size - state.nuisance.size
    values = np.insert(values, end - more, np.zeros(more))
    return state.with_nuisance(nuisance, values)


def score_periodogram(problem: JointProblem, estimate: Estimate, rules: Tones) -> Periodogram:
    """Of what the links pull at each of the readings' channels, tapered: a trend does not run into all frequencies."""
    f = link_factors(problem.links, estimate.states, estimate.gravity, *problem.bias_changes(estimate))
    D = np.concatenate([f.r_D_gyro_bias, f.r_D_accel_bias], axis=2)
    score = np.einsum("lij,li->lj", D, f.residual)
    information = np.einsum("lij,lij->lj", D, D)
    taper = np.hanning(len(score))[:, None]
    size = rules.padded * len(score)
    power = np.abs(np.fft.rfft(score * taper, size, axis=0)) ** 2
    scale = np.sum(information * taper**2, axis=0)
    return Periodogram(
        np.asarray(np.fft.rfftfreq(size, problem.readings.spacing_s), np.float64),
        np.asarray(power / np.maximum(scale, np.finfo(float).tiny)),
    )


def standing_out(
    of: Periodogram, rules: Tones, least: float, known_hz: Sequence[float], sweep_hz: float
) -> list[float]:
    """Frequencies [Hz] at which any channel's score stands out by `least` or more, the loudest first.

    known_hz: of tones that are in play already. Near them nothing new can be told, nor at their images: the lidar's view comes
    round sweep_hz times a second.
    """
    turn_hz, power = of.turn_hz(rules), of.of_tones(rules)
    sweeps_hz = np.arange(0.0, of.hz[-1] + sweep_hz, sweep_hz)

    def silence(tone_hz: float) -> None:
        for image_hz in np.concatenate([sweeps_hz + tone_hz, np.abs(sweeps_hz - tone_hz)]):
            power[np.abs(of.hz - image_hz) < rules.apart * turn_hz] = 0.0

    for tone_hz in known_hz:
        silence(tone_hz)
    found: list[float] = []
    while power.max() > least:
        found.append(float(of.hz[np.argmax(power)]))
        silence(found[-1])
    return found


def say_tones(data: JointData, state: Estimation) -> None:
    """What shook the IMU unseen, for a person, tone by tone."""
    for hz, values in zip(state.nuisance.tones_hz, tone_values(state.nuisance, state.estimate.nuisance), strict=True):
        parts = values[:24].reshape(4, 2, 3)
        gyro, accel = np.sqrt(0.5 * np.sum(parts**2, axis=(0, 2)))
        data.run.say(
            "warning",
            "imu.tone",
            f"the IMU reads a tone of {hz + values[24]:.2f} Hz ({accel:.2g} m/s2 and {np.degrees(gyro):.2g} deg/s rms) that "
            "nothing moved by: it is shaken faster than it samples; the tone is estimated along and taken out, but record with "
            "the IMU's own low-pass filter on, or at a higher rate",
        )
