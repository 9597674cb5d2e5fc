"""Shaking faster than the IMU samples, found by what the lidar's motion leaves of the readings (imu/tones.py).

At an optimum, the links' residuals say towards which change of the readings, at which instant, the whole problem pulls: the
score. Where the model is right, its periodogram is chance, exponential with a mean of at most 1 in units of the links' own
information. The motion and the sensors' parameters take up a part of it, at one frequency next to all: a tone stands out beside
its neighbours, and which one it is says what it explains (tone_choice.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import scipy

from calib_core.factors.imu import link_factors
from calib_core.full.joint.doubtful_planes import face_three_ways
from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.policies import Round, Sampling, Tones
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.round import associate, coarse_stride, gate_of, gathered, one_round, with_bins
from calib_core.full.joint.settings import CHAIN
from calib_core.full.joint.state import Bins, Estimate
from calib_core.full.joint.state_views import problem_of
from calib_core.full.joint.tone_choice import Explaining, explaining, is_one_planes
from calib_core.full.joint.tone_heard import goes_on_at_rest, is_heard
from calib_core.imu.tones import attitudes, tone_readings
from calib_core.types import FloatArray


@dataclass(frozen=True, slots=True)
class Periodogram:
    """hz: (F,).   power: (F, 6) of the score of each channel, gyroscope first; of mean 1 or less by chance."""

    hz: FloatArray
    power: FloatArray

    def of_tones(self, rules: Tones) -> FloatArray:
        """The louder channel's (F,), 0 where no tone can be told: with too few turns, or integrated to nothing."""
        return self._told(self.power.max(axis=1), rules)

    def beside_neighbours(self, rules: Tones) -> FloatArray:
        """(F,) the same with each channel in units of what it is by chance, which its median over so many turns around tells.

        The motion and the sensors' parameters leave a thousandth of it at one frequency, all of it at another.
        """
        around = 2 * rules.neighbours * rules.padded + 1
        # Channel by channel: SciPy is twenty times as quick along a single axis.
        each = [scipy.ndimage.median_filter(np.ascontiguousarray(c), size=around, mode="nearest") for c in self.power.T]
        usual = np.stack(each, axis=1) / np.log(2.0)
        return self._told((self.power / np.maximum(usual, np.finfo(float).tiny)).max(axis=1), rules)

    def turn_hz(self, rules: Tones) -> float:
        """One turn in the recording."""
        return float(rules.padded * self.hz[1])

    def _told(self, power: FloatArray, rules: Tones) -> FloatArray:
        power[(self.hz < rules.fewest_turns * self.turn_hz(rules)) | (self.hz > rules.highest * self.hz[-1])] = 0.0
        return power


def admit_tones(
    data: JointData,
    state: Estimation,
    rules: Tones,
    round_: Round,
    sampling: Sampling,
    *,
    least: float,
    loud: float = 0.0,
) -> Estimation:
    """With the tones that lower the cost by `least` or more, one after the other: beside a strong one a weak one shows nothing.

    loud: as `found_tones` has it. After which more is to be explained than before was none.
    """
    found = found_tones(data, state, rules, round_, sampling, least=least, loud=loud)
    while found:
        if is_hump(data, state, found[0].hz, rules):
            return without_tones(data, state, round_, sampling)
        after = told(data, with_tone(data, state, found[0].hz, rules), round_, sampling)
        if not is_heard(data, after):
            break
        if not goes_on_at_rest(data, after, rules.slow_hz):
            return without_tones(data, state, round_, sampling)
        left = found_tones(data, after, rules, round_, sampling, least=least, loud=loud)
        if left and left[0].decrease > found[0].decrease:
            break
        state, found = after, left
    return state


def admit_rest(
    data: JointData, state: Estimation, rules: Tones, round_: Round, sampling: Sampling, bins: Bins
) -> Estimation:
    """The one that explains the most now: for a state at rest with all points, from which the way back is long.

    bins: of all these points.
    """
    found = found_tones(data, state, rules, round_, sampling, least=rules.explains, bins=bins)
    if not found:
        return state
    if is_hump(data, state, found[0].hz, rules):
        return without_tones(data, state, round_, sampling)
    if is_the_motions(data, state, found, rules):
        return state
    after = told(data, with_tone(data, state, found[0].hz, rules), round_, sampling)
    if not is_heard(data, after):
        return state
    return after if goes_on_at_rest(data, after, rules.slow_hz) else without_tones(data, state, round_, sampling)


def still_pulled(
    data: JointData, state: Estimation, rules: Tones, round_: Round, sampling: Sampling, bins: Bins
) -> Estimation:
    """A state at rest with all points; where something that is no tone was found to pull at the readings, asked anew.

    A motion that starts ten degrees off pulls at them as a lift does, until it has come to where it is.   bins: of these points.
    """
    if not state.untuned:
        return state
    asked = replace(state, untuned=False)
    return state if found_tones(data, asked, rules, round_, sampling, least=rules.explains, bins=bins) else asked


def is_the_motions(data: JointData, state: Estimation, found: Sequence[Explaining], rules: Tones) -> bool:
    """Whether the best of what was found is no line, but of what moves the lidar: another that is as slow and no part of its foot
    explains nearly as much. Lidars whose ranges bend and accelerometers that lag leave that, all along where a hand moves.

    found: the best first. An engine that is heard may have many lines, slow ones too.
    """
    best = found[0]
    if data.run.noise.shaken or best.hz > rules.slow_hz:
        return False
    knots_s = data.readings.knots_s[[0, state.knots - 1]]
    away_hz = rules.foot / float(np.diff(knots_s)[0])
    return any(
        other.hz <= rules.slow_hz
        and abs(other.hz - best.hz) > away_hz
        and other.decrease > rules.rivals * best.decrease
        for other in found[1:]
    )


def is_hump(data: JointData, state: Estimation, hz: float, rules: Tones) -> bool:
    """Whether one more tone at hz were no line beside those that are known, but a part of the same hump.

    What happens once, as a lift that starts, is the sum of many sines. They take it away, and with it what tells the lever arm:
    a cabin's 0.8 m/s2 for two seconds ended four and a half sigmas off, with eight of them and no word. So is a line whose speed
    and strength wander, where it reads as slow as hands move: half a m/s2 at 100.5 Hz, sampled at 100, ended seven sigmas off
    with five. Of an engine's quicker ones a band is believed: no hand makes what they take away.
    """
    knots_s = data.readings.knots_s[[0, state.knots - 1]]
    lines = np.sort([*state.nuisance.tones_hz, hz])
    if data.run.noise.shaken:
        lines = lines[lines <= rules.slow_hz]
        if hz > rules.slow_hz:
            return False
    row = np.cumsum(np.diff(lines, prepend=lines[0]) * float(np.diff(knots_s)[0]) >= rules.hump)
    return bool(np.bincount(row).max() >= rules.hump_of)


def without_tones(data: JointData, state: Estimation, round_: Round, sampling: Sampling) -> Estimation:
    """With what pulls at the readings left in them, for the error bars to count, and two rounds back to where that leads."""
    return told(data, replace(bare(state), untuned=True), round_, sampling)


def heard_anew(
    data: JointData, state: Estimation, rules: Tones, round_: Round, sampling: Sampling, *, loud: float = 0.0
) -> Estimation:
    """With those tones only that show again from two rounds without any: for a state whose planes are no longer those that told
    them.   loud: as `found_tones` has it.

    What clutter taken for planes says of the readings is as loud as an engine. Walls show it again if it was one.
    """
    if not state.nuisance.tones_hz:
        return state
    silent = told(data, bare(state), round_, sampling)
    return admit_tones(data, silent, rules, round_, sampling, least=rules.explains_at_once, loud=loud)


def bare(state: Estimation) -> Estimation:
    """Without tones among the unknowns."""
    return state.with_nuisance(state.nuisance.without_tones())


def found_tones(
    data: JointData,
    state: Estimation,
    rules: Tones,
    round_: Round,
    sampling: Sampling,
    *,
    least: float,
    loud: float = 0.0,
    bins: Bins | None = None,
) -> list[Explaining]:
    """Tones beside those that are known, the one that lowers the cost the most first. bins: of all points, gathered already, for
    a state that has hardly moved since: a second time they would be the most memory of a solve.

    loud: by how much the score has to stand out to begin with, where that is asked for. Where the sensors are held at what they
    are meant to be, and nothing shakes the IMU, it is asked for: of the motion itself cheap sensors make what a tone would. So
    does a plane that was chosen and is none. What coarse readings are off by follows the motion, in lines as a walk has them:
    no tones are told there.
    """
    known = state.nuisance.tones_hz
    if len(known) >= rules.most or state.untuned or data.run.noise.coarse:
        return []
    held = not data.sensors.blocks or data.run.settings.intrinsics == "consider"
    if (held and not data.run.noise.shaken) or any(plane.fault for plane in state.planes):
        loud = max(loud, rules.shouts)
    rules = _told_apart(data, rules)
    of = listen(data, state, rules)
    power = float(of.of_tones(rules).max())
    beside = rules.beside if least <= rules.explains else rules.beside_in_company
    if power < loud or (power < least and of.beside_neighbours(rules).max() < beside):
        return []
    # From scan to scan: a sweep's own points end before the next one begins.
    tried = candidates(of, rules, known, 1.0 / float(np.median(np.diff(data.run.clocks.scan_s))))
    if not tried:
        return []
    if state.observations is None:
        state = associate(
            data, state, gate_of(state, round_.gate_m, sampling), stride=coarse_stride(data, state, sampling)
        )
    problem = gathered(data, state) if bins is None else with_bins(data, state, bins)
    found = explaining(data, problem, with_tones_tried(data, state, tried, rules), len(tried), least)
    if not found or found[0].hz > rules.slow_hz:
        return found
    by_one = is_one_planes(data, problem, with_tones_tried(data, state, [found[0].hz], rules), rules)
    return [one for one in found if one.hz > rules.slow_hz] if by_one else found


def listen(data: JointData, state: Estimation, rules: Tones) -> Periodogram:
    """The score's periodogram where the state is now."""
    # What no plane sees is nothing that the links may be asked of, and their points tell what that is.
    is_open = state.observations is not None and not face_three_ways(state.estimate.normals)
    problem = gathered(data, state) if is_open else problem_of(data, state)
    return score_periodogram(problem, state.estimate, rules)


def loudest(data: JointData, state: Estimation, rules: Tones) -> float:
    """How far the loudest stands out of those that a tone could be."""
    return float(listen(data, state, rules).of_tones(_told_apart(data, rules)).max())


def _told_apart(data: JointData, rules: Tones) -> Tones:
    """The rules as they are where an engine may shake the IMU: what is slow there need not be the biases' own drift."""
    return replace(rules, fewest_turns=rules.fewest_turns_shaken) if data.run.noise.shaken else rules


def with_tones_tried(data: JointData, state: Estimation, tried_hz: Sequence[float], rules: Tones) -> Estimation:
    """With more tones among the unknowns, and the points on planes as they are."""
    toned = state
    for hz in tried_hz:
        toned = with_tone(data, toned, hz, rules)
    return replace(toned, observations=state.observations)


def told(data: JointData, state: Estimation, round_: Round, sampling: Sampling) -> Estimation:
    """Two rounds on: one for the size of new tones, one for their frequency, which can be told from there."""
    for _ in range(2):
        state = one_round(data, state, round_, sampling)
    return state


def with_tone(data: JointData, state: Estimation, hz: float, rules: Tones) -> Estimation:
    """With one more tone among the unknowns, of which nothing is known yet."""
    knots_s = data.readings.knots_s[[0, state.knots - 1]]
    resolution_hz = rules.resolution / float(np.diff(knots_s)[0])
    return state.with_nuisance(state.nuisance.with_tone(hz, resolution_hz, float(knots_s.mean())))


def score_periodogram(problem: JointProblem, estimate: Estimate, rules: Tones) -> Periodogram:
    """Of what the links pull at each of the readings' channels, tapered: a trend does not run into all frequencies."""
    links, changes = problem.seen_links(estimate), problem.bias_changes(estimate)
    score, information = np.empty((2, len(links.Dv), 6))
    for first in range(0, len(score), CHAIN.knots_at_once):
        last = min(first + CHAIN.knots_at_once, len(score))
        states, of = estimate.states.part(first, last + 1), (each[first:last] for each in changes)
        f = link_factors(links.part(first, last), states, estimate.gravity, *of)
        D = np.concatenate([f.r_D_gyro_bias, f.r_D_accel_bias], axis=2)
        score[first:last] = np.einsum("lij,li->lj", D, f.residual)
        information[first:last] = np.einsum("lij,lij->lj", D, D)
    taper = np.hanning(len(score))[:, None]
    size = rules.padded * len(score)
    power = np.abs(np.fft.rfft(score * taper, size, axis=0)) ** 2
    scale = np.sum(information * taper**2, axis=0)
    return Periodogram(
        np.asarray(np.fft.rfftfreq(size, problem.readings.spacing_s), np.float64),
        np.asarray(power / np.maximum(scale, np.finfo(float).tiny)),
    )


def candidates(of: Periodogram, rules: Tones, known_hz: Sequence[float], sweep_hz: float) -> list[float]:
    """Frequencies [Hz] at which a tone may be, of the loudest and of what stands out beside its neighbours the most.

    The lidar's view comes round with each turn of its rotor: of a tone at 1.4 Hz what is seen at 10 - 1.4 and 10 + 1.4 may stand
    out the most, as the motion takes up less there. It lies half their distance from nothing. Known ones, and what is too near
    to one before, are none; nor is anything that the view's own coming round brings, sweep_hz times a second: walls that are not
    flat, seen from a hand that moves.
    """
    turn_hz = of.turn_hz(rules)
    found: list[float] = []

    def add(hz: float) -> None:
        turns = round(hz / sweep_hz)
        if turns > 0 and abs(hz - turns * sweep_hz) < rules.view_hz:
            return
        if hz > rules.fewest_turns * turn_hz and all(
            abs(hz - each) > rules.apart * turn_hz for each in (*known_hz, *found)
        ):
            found.append(hz)

    seen_hz = peaks_hz(of, of.beside_neighbours(rules), rules)
    for hz in (*peaks_hz(of, of.of_tones(rules), rules), *seen_hz):
        add(hz)
    for one_hz, other_hz in combinations(seen_hz, 2):
        add(0.5 * abs(one_hz - other_hz))
    return found


def peaks_hz(of: Periodogram, power: FloatArray, rules: Tones) -> list[float]:
    """The frequencies [Hz] of the greatest (F,), a turn apart at least: nearer is one peak's foot."""
    left, found = power.copy(), []
    for _ in range(rules.tried):
        found.append(float(of.hz[np.argmax(left)]))
        left[np.abs(of.hz - found[-1]) < of.turn_hz(rules)] = 0.0
    return found


def say_tones(data: JointData, state: Estimation) -> None:
    """What shook the IMU unseen, for a person, tone by tone; or that it was no tone. Instead of what an earlier end had."""
    data.run.retract("motion.unseen", "imu.tone")
    if state.untuned:
        shaken = "an engine shakes the IMU at about its sampling rate, " if data.run.noise.shaken else ""
        data.run.say(
            "warning",
            "motion.unseen",
            f"the IMU feels motion that no plane shows, and that is no steady vibration: {shaken}the whole room moves (a lift, a "
            "vehicle, a ship), the mount is loose, or a surface that is not flat bends the motion; it is not taken out, but the "
            "error bars count it; record where nothing but the rig moves"
            + (", with the IMU's low-pass filter on, or at a higher rate" if shaken else ""),
        )
    at_knots = attitudes(data.readings.part(0, state.knots), state.estimate.states.R, state.nuisance.tones_zero_s)
    calm = not data.run.noise.shaken
    shaken = "it is shaken faster than it samples" + (
        ", the whole room sways, or footsteps shake the floor" if calm else ""
    )
    for hz, values in zip(state.nuisance.tones_hz, state.estimate.sensors.tones(), strict=True):
        # Its part that goes with the IMU and that of the room may be nearly the same, each many times as large as their sum.
        both = tone_readings(hz, values, at_knots.knots_s, at_knots.at_knots).reshape(-1, 2, 3)
        gyro, accel = np.sqrt(np.mean(np.sum(both**2, axis=2), axis=0))
        data.run.say(
            "warning",
            "imu.tone",
            f"the IMU reads a tone of {hz + values[24]:.2f} Hz ({accel:.2g} m/s² and {np.degrees(gyro):.2g} deg/s rms) that no "
            f"plane shows: {shaken}; the tone is estimated and taken out, but better record with the IMU's low-pass filter on, "
            "or at a higher rate",
        )
