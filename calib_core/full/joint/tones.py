"""Shaking faster than the IMU samples, found by what the lidar's motion leaves of the readings (imu/tones.py).

At an optimum, the links' residuals say towards which change of the readings, at which instant, the whole problem pulls: the
score. Where the model is right, its periodogram is chance, exponential with a mean of at most 1 in units of the links' own
information (the motion takes up a part of it). A tone stands out by hundreds and thousands.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_core.factors.imu import link_factors
from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.round import one_round, problem_of
from calib_core.full.joint.schedule import Round, Sampling, Tones
from calib_core.full.joint.sensors import tone_values
from calib_core.full.joint.state import Estimate
from calib_core.full.prepare.nuisance import TONE
from calib_core.types import FloatArray


@dataclass(frozen=True, slots=True)
class Periodogram:
    """hz: (F,).   power: (F, 6) of the score of each channel, gyroscope first; of mean 1 or less by chance."""

    hz: FloatArray
    power: FloatArray


def admit_tones(
    data: JointData, state: Estimation, rules: Tones, round_: Round, sampling: Sampling, *, least: float
) -> Estimation:
    """With the tones that stand out by `least` or more, one after the other: beside a strong one a weak one shows nothing."""
    while len(state.nuisance.tones_hz) < rules.most:
        problem = problem_of(data, state)
        hz = loudest(score_periodogram(problem, state.estimate, rules), rules, least)
        if hz is None or any(abs(hz - other) < rules.apart / _seconds(problem) for other in state.nuisance.tones_hz):
            break
        state = with_tone(state, hz, rules.resolution / _seconds(problem), float(np.mean(problem.readings.knots_s[[0, -1]])))
        # Once for its size, once for its frequency, which can be told from there on.
        for _ in range(2):
            state = one_round(data, state, round_, sampling)
    return state


def with_tone(state: Estimation, hz: float, resolution_hz: float, zero_s: float) -> Estimation:
    """With one more tone among the unknowns, of which nothing is known yet."""
    nuisance = state.nuisance.with_tone(hz, resolution_hz, zero_s)
    values, end = state.estimate.nuisance, nuisance.places[TONE].stop
    more = nuisance.size - state.nuisance.size
    values = np.insert(values, end - more, np.zeros(more))
    return replace(
        state,
        nuisance=nuisance,
        estimate=replace(state.estimate, nuisance=values),
        priors=replace(state.priors, nuisance_std=nuisance.prior_std),
        observations=None,
        minimum=None,
    )


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
    return Periodogram(np.fft.rfftfreq(size, problem.readings.spacing_s), power / np.maximum(scale, np.finfo(float).tiny))


def loudest(of: Periodogram, rules: Tones, least: float) -> float | None:
    """Frequency [Hz] at which any channel's score stands out most, by `least` or more; None where none does."""
    seconds = 1.0 / (rules.padded * (of.hz[1] - of.hz[0]))
    heard = (of.hz > rules.fewest_turns / seconds) & (of.hz < rules.highest * of.hz[-1])
    power = np.where(heard[:, None], of.power, 0.0).max(axis=1)
    at = int(np.argmax(power))
    return float(of.hz[at]) if power[at] > least else None


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


def _seconds(problem: JointProblem) -> float:
    return float(problem.readings.knots_s[-1] - problem.readings.knots_s[0])
