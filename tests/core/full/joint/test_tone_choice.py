"""Which of the frequencies that stand out are tones: what each explains, and that round-off explains nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.full.joint import tone_choice
from calib_core.full.joint.estimation import Estimation, JointData, LastReadings
from calib_core.full.joint.round import gathered, one_round, with_bins
from calib_core.full.joint.schedule import FULL
from calib_core.full.joint.sensor_state import SensorState
from calib_core.full.joint.sensors import true_readings
from calib_core.full.joint.solve import admit_sensors
from calib_core.full.joint.state import Bins
from calib_core.full.joint.tone_choice import Explaining, explaining, is_one_planes
from calib_core.full.joint.tones import with_tones_tried
from calib_core.full.prepare.nuisance import TONE, Nuisance
from calib_core.imu.tones import PARAMETERS
from calib_core.solver.arrow import solve_arrow, solve_shared
from calib_core.types import FloatArray
from tests.core.full.joint.conftest import Half

RULES = FULL.tones


def _explaining(
    data: JointData, state: Estimation, tried: list[float], least: float = 0.0, bins: Bins | None = None
) -> list[Explaining]:
    problem = gathered(data, state) if bins is None else with_bins(data, state, bins)
    return explaining(data, problem, with_tones_tried(data, state, tried, RULES), len(tried), least)


def test_what_a_tone_explains_is_what_the_normal_equations_say(half: Half) -> None:
    """Beside all that follows it. Oracle: two solves of the whole system, with the tone and without. Mutations: nothing else
    follows; the tones' own blocks taken together; the gradient of the others forgotten.
    """
    tried = [1.4, 0.6, 3.0]
    found = _explaining(half.data, half.state, tried)

    def decrease(state: Estimation) -> float:
        return solve_arrow(gathered(half.data, state).linearise(state.estimate)).predicted_decrease

    without = decrease(half.state)
    by = {hz: decrease(with_tones_tried(half.data, half.state, [hz], RULES)) - without for hz in tried}
    assert [each.hz for each in found] == sorted(tried, key=lambda hz: -by[hz])
    assert [each.decrease for each in found] == pytest.approx([by[each.hz] for each in found], rel=1e-4)
    most = _explaining(half.data, half.state, tried, 0.5 * found[0].decrease)
    assert most[0] == found[0]
    assert len(most) < 3 or found[2].decrease > 0.5 * found[0].decrease


def test_what_a_tone_explains_is_no_matter_of_the_lasers(half: Half) -> None:
    """Their parameters are held while tones are tried. Oracle: two solves of the whole system in which they follow.

    Mutation: all parameters of the sensors held, which leaves a tone what they explain.
    """
    before = half.state
    toned = Nuisance().with_tone(1.4, 0.01, float(half.data.readings.knots_s[before.knots // 2]))
    sine = np.zeros(PARAMETERS)
    sine[:3] = 0.005, -0.01, 0.0075  # of the gyroscope: the accelerometer is read anew by its delay
    known = half.data.readings.part(0, before.knots)
    shaken = true_readings(known, SensorState(toned, sine), before.estimate.states.R)
    data = replace(half.data, readings=shaken, asked=LastReadings())
    state = one_round(data, admit_sensors(data, before), FULL.sensors, FULL.sampling)
    assert state.nuisance.lasers

    def decrease(state: Estimation) -> float:
        return solve_arrow(gathered(data, state).linearise(state.estimate)).predicted_decrease

    without = decrease(state)
    tried = [1.4, 3.0]
    by = [decrease(with_tones_tried(data, state, [hz], RULES)) - without for hz in tried]
    assert by[0] > RULES.explains
    found = {each.hz: each.decrease for each in _explaining(data, state, tried)}
    assert [found[hz] for hz in tried] == pytest.approx(by, rel=0.02)


def test_points_that_are_gathered_already_explain_as_much(half: Half) -> None:
    """Oracle: gathered with the tones among the unknowns, all linked anew.

    Mutations: what the points were laid out with taken as it was, when fewer parameters were in play; their columns as before."""
    state = one_round(half.data, admit_sensors(half.data, half.state), FULL.sensors, FULL.sampling)
    bins = gathered(half.data, state).bins
    tried = [1.4, 3.0]
    toned = with_tones_tried(half.data, state, tried, RULES)
    anew = explaining(half.data, gathered(half.data, toned), toned, 2, 0.0)
    kept = _explaining(half.data, state, tried, bins=bins)
    assert [each.hz for each in kept] == [each.hz for each in anew]
    assert [each.decrease for each in kept] == pytest.approx([each.decrease for each in anew], rel=1e-9)


def _beside_ones(half: Half, tried: list[float]) -> tuple[Estimation, int, FloatArray, FloatArray]:
    """A state with two tones tried, the column where the first begins, an information of ones, and a gradient by lot."""
    state = with_tones_tried(half.data, half.state, tried, RULES)
    problem = gathered(half.data, state)
    first = problem.layout(state.estimate).nuisance().start + state.nuisance.places[TONE].stop - 2 * PARAMETERS
    size = len(solve_shared(problem.linearise(state.estimate))[1])
    return state, first, np.eye(size), np.random.default_rng(1).normal(size=size)


@pytest.mark.parametrize("left", [-1e-13, 1e-13])
def test_what_all_else_makes_up_of_a_tone_explains_nothing(
    half: Half, monkeypatch: pytest.MonkeyPatch, left: float
) -> None:
    """Round-off is left of it, of either sign: seen to end in a defect. Oracle: an information of ones, in which the third number
    of the first tone is another unknown's twin. Mutations: taken for information; the whole tone left out; other tones' too.
    """
    tried = [1.4, 3.0]
    state, first, S, g = _beside_ones(half, tried)
    S[first + 2, 0] = S[0, first + 2] = 1.0
    S[first + 2, first + 2] = 1.0 + left
    monkeypatch.setattr(tone_choice, "solve_shared", lambda _: (S, g))
    found = {each.hz: each.decrease for each in explaining(half.data, gathered(half.data, half.state), state, 2, 0.0)}
    own = g[first : first + 2 * PARAMETERS].reshape(2, PARAMETERS)
    expected = 0.5 * np.sum(own**2, axis=1) - [0.5 * own[0, 2] ** 2, 0.0]
    assert [found[hz] for hz in tried] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("left", [0.0, -1e-7])
def test_of_nothing_nothing_is_explained(half: Half, monkeypatch: pytest.MonkeyPatch, left: float) -> None:
    """A number of which the equations say nothing, or by round-off less: "Eigenvalues did not converge" ended a corridor's solve.

    Oracle: an information of ones without it. Mutation: scaled by how little there is.
    """
    tried = [1.4, 3.0]
    state, first, S, g = _beside_ones(half, tried)
    S[first + 2, first + 2] = left
    S[first + 2, first + 3] = S[first + 3, first + 2] = 1e-9
    monkeypatch.setattr(tone_choice, "solve_shared", lambda _: (S, g))
    found = {each.hz: each.decrease for each in explaining(half.data, gathered(half.data, half.state), state, 2, 0.0)}
    own = g[first : first + 2 * PARAMETERS].reshape(2, PARAMETERS)
    expected = 0.5 * np.sum(own**2, axis=1) - [0.5 * own[0, 2] ** 2, 0.0]
    assert [found[hz] for hz in tried] == pytest.approx(expected, rel=1e-9)


def test_what_came_out_below_nothing_says_how_large_round_off_is(half: Half, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a tone along which no plane shows anything 62,000 was "explained" where the readings pulled by two: a lever arm known to
    2 mm was undetermined. Oracle: an information of ones, in which two numbers of the first tone have another unknown for their
    sum but for -1e-7, one number of the second is another's twin but for 5e-7, and one but for a hundredth.

    Mutations: each number asked by itself; what is as small and positive told; what is a hundredth not.
    """
    tried = [1.4, 3.0]
    state, first, S, g = _beside_ones(half, tried)
    second = first + PARAMETERS
    half_each = np.sqrt(0.5 * (1.0 + 1e-7))
    for own, other, coupled, left in (
        (first + 2, 0, half_each, 0.0), (first + 3, 0, half_each, 0.0), (second + 2, 1, 1.0, 5e-7), (second + 4, 2, 1.0, 1e-2),
    ):  # fmt: skip
        S[own, other] = S[other, own] = coupled
        S[own, own] = 1.0 + left
    monkeypatch.setattr(tone_choice, "solve_shared", lambda _: (S, g))
    found = {each.hz: each.decrease for each in explaining(half.data, gathered(half.data, half.state), state, 2, 0.0)}
    of_first, of_second = (np.sum(g[of : of + PARAMETERS] ** 2) for of in (first, second))
    of_first += 0.5 * (g[first + 2] - g[first + 3]) ** 2 - g[first + 2] ** 2 - g[first + 3] ** 2
    of_second += (g[second + 4] - g[2]) ** 2 / 1e-2 - g[second + 2] ** 2 - g[second + 4] ** 2
    assert [found[hz] for hz in tried] == pytest.approx([0.5 * of_first, 0.5 * of_second], rel=1e-6)


def test_no_tone_lowers_the_cost_by_more_than_there_is(half: Half, monkeypatch: pytest.MonkeyPatch) -> None:
    """Seen: 4e16 of a million, and the readings bent by it. Mutations: taken for the loudest; cut down to all there is."""
    tried = [1.4, 3.0]
    state = with_tones_tried(half.data, half.state, tried, RULES)
    problem = gathered(half.data, state)
    last = problem.layout(state.estimate).nuisance().start + state.nuisance.places[TONE].stop
    size, cost = len(solve_shared(problem.linearise(state.estimate))[1]), problem.cost(state.estimate)
    for share, heard in ((0.9, True), (1.1, False)):
        g = np.zeros(size)
        g[last - 1] = np.sqrt(2.0 * share * cost)
        monkeypatch.setattr(tone_choice, "solve_shared", lambda _, g=g: (np.eye(size), g))
        assert [each.hz for each in explaining(half.data, gathered(half.data, half.state), state, 2, 1.0)] == (
            [3.0] if heard else []
        )


def _heaving(half: Half, plane: int | None, hz: float, most_m: float) -> Bins:
    """Points of one plane that heave along its normal; of None, of all planes, as they do where the rig is shaken."""
    bins = gathered(half.data, half.state).bins
    along = np.array([0.5, -0.3, 0.8])
    normals = half.state.estimate.normals[bins.plane]
    by = (bins.plane == plane).astype(float) if plane is not None else normals @ along
    moved = np.tile(np.eye(5), (len(by), 1, 1))
    moved[:, 4, 3] = most_m * by * np.sin(2.0 * np.pi * hz * half.data.readings.knots_s[bins.knot])
    return replace(bins, scatter=moved @ bins.scatter @ np.swapaxes(moved, 1, 2))


@pytest.mark.parametrize("most_m", [0.02, 0.05])
def test_what_a_single_plane_says_and_all_others_deny_is_no_tone(half: Half, most_m: float) -> None:
    """Seen: a floor that stood for two, 12 cm apart, was two tones of 0.1 and 0.4 Hz, `calibrated`, and NEES 50. Mutations: no
    plane is left out; one suffices that does not see it either; any loss is denial; what all planes together say.
    """
    toned = with_tones_tried(half.data, half.state, [0.8], RULES)

    def is_one(plane: int | None) -> bool:
        problem = with_bins(half.data, half.state, _heaving(half, plane, 0.8, most_m))
        assert explaining(half.data, problem, toned, 1, RULES.explains)
        return is_one_planes(half.data, problem, toned, RULES)

    assert not is_one(None)
    assert all(is_one(plane) for plane in range(len(half.state.planes)))


@pytest.mark.parametrize(
    ("seen", "decrease", "denied"), [(60.0, 0.0, True), (40.0, 0.0, False), (60.0, 29.0, True), (60.0, 31.0, False)]
)
def test_who_hardly_sees_a_tone_does_not_deny_it(
    half: Half, monkeypatch: pytest.MonkeyPatch, seen: float, decrease: float, denied: bool
) -> None:
    """Of what all planes tell the others would see 60, or 40 where chance hides 50. Mutations: who does not see it denies it;
    denied by any less, or by none at all.
    """
    every, size = np.eye(PARAMETERS), np.zeros(PARAMETERS)
    size[0] = 10.0
    left = iter([(every, size, np.ones(PARAMETERS))])
    others = (every * 2.0 * seen / 100.0, np.sqrt(4.0 * seen * decrease) * size / 100.0, np.ones(PARAMETERS))
    monkeypatch.setattr(tone_choice, "_left_by_others", lambda *_: next(left, others))
    problem = gathered(half.data, half.state)
    assert is_one_planes(half.data, problem, with_tones_tried(half.data, half.state, [0.8], RULES), RULES) is denied
