"""Accelerometers that sit apart: what is told of their places against drawn ones, and whole recordings against their truth."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest

from calib_core.calibrate import calibrate
from calib_core.full.assess import late_parameters
from calib_core.full.assess.late_parameters import Told, told_of
from calib_core.full.joint.estimation import Estimation, JointData, Solved
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.sensor_state import SensorState
from calib_core.full.joint.state import Bins
from calib_core.full.prepare.nuisance import Nuisance, NuisanceBlock
from calib_core.intrinsics import Block
from calib_core.result import CalibrationResult
from calib_core.settings import CalibrateSettings
from calib_core.simulate import generate, parse_faults
from calib_core.types import FloatArray
from tests.core.full.answers import errors_of
from tests.core.full.assess.made_information import solution_of

PRIOR_M = 0.02
#: By which a place of each axis is beside their middle, and the middle of them all.
MIDDLE = np.kron(np.full((3, 1), 3**-0.5), np.eye(3))
BESIDE = np.linalg.qr(np.eye(9) - MIDDLE @ MIDDLE.T)[0][:, :6]


def _told(rng: np.random.Generator, true_m: FloatArray, stds_m: FloatArray) -> Told | None:
    """What a recording says of places (9,) that it knows by these standard deviations (6,) along directions of its own."""
    axes = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    information = BESIDE @ (axes / stds_m**2) @ axes.T @ BESIDE.T  # of the middle, nothing
    read = information @ true_m + BESIDE @ axes @ (rng.normal(size=6) / stds_m)
    spread = np.linalg.inv(information + np.eye(9) / PRIOR_M**2)
    return told_of(BESIDE.T @ spread @ read, BESIDE.T @ spread @ BESIDE, PRIOR_M, 0.25, 3)


@pytest.mark.parametrize("stds_mm", [(1.0,) * 6, (0.1, 3.0, 11.0, 11.0, 11.0, 11.0)], ids=["alike", "some hardly"])
def test_chance_is_as_likely_as_it_says(stds_mm: tuple[float, ...]) -> None:
    """All in one place, in 2000 recordings: what is said to come once in so many comes once in so many (Kolmogorov's law). All of
    them beside the IMU's place by a centimetre are no farther apart, and drawn along.

    Mutations: the prior's share left in the values, or in their spread; the middle taken for one of them.
    """
    rng = np.random.default_rng(3)
    places = [_told(rng, MIDDLE @ (0.01 * rng.normal(size=3)), 1e-3 * np.array(stds_mm)) for _ in range(2000)]
    assert kstest([each.chance() for each in places if each is not None], "uniform").pvalue > 0.01
    assert None not in places


@pytest.mark.parametrize("size_m", [1e-3, 4e-3])
def test_a_size_is_told_to_a_third(size_m: float) -> None:
    """Through noise as large and twice as large in half of the six, by the median of 200. Mutation: the squares' mean,
    noise and all."""
    rng = np.random.default_rng(4)
    stds_m = size_m * np.array([0.05, 0.1, 0.3, 1.0, 2.0, 2.0])
    told = [_told(rng, size_m * rng.normal(size=9), stds_m) for _ in range(200)]
    sizes_m = [each.size_m for each in told if each is not None]
    assert len(sizes_m) == 200
    assert float(np.median(sizes_m)) == pytest.approx(size_m, rel=0.34)


@pytest.mark.parametrize("stds_mm", [(0.3,) * 6, (0.45, 0.45, 0.45, 2.0, 4.0, 4.0)], ids=["all told", "half of them"])
def test_what_nothing_tells_is_as_wide_as_the_size_is_unsure(stds_mm: tuple[float, ...]) -> None:
    """The middle of three places of 5 mm, in 1500 recordings, by what is allowed for one. Mutations: the size itself, by which it
    is 1.5 to 2 times as far; as if all six told it.
    """
    rng = np.random.default_rng(6)
    squares = []
    for _ in range(1500):
        true_m = 5e-3 * rng.normal(size=9)
        told = _told(rng, true_m, 1e-3 * np.array(stds_mm))
        assert told is not None
        squares.append((true_m @ MIDDLE[:, 0]) ** 2 / told.allowed_m**2)
    assert 0.8 < float(np.mean(squares)) < 1.15


def test_errors_that_are_larger_than_stated_make_chance_more_likely() -> None:
    """Closed form: of two numbers, chance is exp(-square / 2). Mutation: the ratio not squared."""
    two = Told(np.array([3e-3, 4e-3]), np.full(2, 1e-3))
    assert two.chance() == pytest.approx(np.exp(-12.5))
    assert two.chance(2.0) == pytest.approx(np.exp(-12.5 / 4.0))


def test_what_is_hardly_told_is_not_asked() -> None:
    """Directions known no better than they are allowed; fewer than three others say nothing. Mutations: all six asked; one is
    enough."""
    rng = np.random.default_rng(5)
    assert _told(rng, np.zeros(9), np.array([1e-3, 1e-3, 1.0, 1.0, 1.0, 1.0])) is None
    places = _told(rng, np.zeros(9), np.array([1e-3, 1e-3, 1e-3, 1.0, 1.0, 1.0]))
    assert places is not None
    assert places.at.shape == (3,)
    np.testing.assert_allclose(places.std, 1e-3)


@dataclass
class Ended:
    """The end of a solve, as far as it is asked here."""

    nuisance: Any
    state: str = "end"


@pytest.mark.parametrize(
    ("at_mm", "ratio", "wanted", "before", "apart"),
    [
        (6.0, 1.0, "auto", (), True),
        (2.0, 1.0, "auto", (), False),  # once in two thousand
        (6.0, 3.0, "auto", (), False),  # the parts of the recording disagree as much
        (6.0, 1.0, ("clock_rate", "size_effect"), (), True),
        (6.0, 1.0, ("clock_rate",), (), False),
        (6.0, 1.0, "consider", (), False),
        (6.0, 1.0, "off", (), False),
        (6.0, 1.0, "auto", ("size_effect",), False),  # among the unknowns already
    ],
)
def test_who_is_asked(
    monkeypatch: pytest.MonkeyPatch, at_mm: float, ratio: float, wanted: Any, before: tuple[str, ...], apart: bool
) -> None:
    """Six numbers, each known to a millimetre: a square of 216 or of 24. Mutations: chance not asked; any ratio passed over;
    asked whatever is wanted; asked a second time."""
    places = Told(np.full(6, 1e-3 * at_mm), np.full(6, 1e-3))
    monkeypatch.setattr(
        late_parameters, "late_told", lambda _solved, _stds, asked: {b: places for b in asked if b == "size_effect"}
    )
    monkeypatch.setattr(late_parameters, "with_late", lambda state, _, size_m: (state, size_m))
    monkeypatch.setattr(late_parameters, "_listening_anew", lambda _, state: state)
    monkeypatch.setattr(late_parameters, "_bend_s2_m", lambda _: 1e-4)
    run: Any = SimpleNamespace(settings=SimpleNamespace(intrinsics=wanted))
    solved: Any = Ended(SimpleNamespace(places=dict.fromkeys(before), lasers=0))
    found: Any = [
        SimpleNamespace(is_beyond_noise=True, ratio=ratio),
        SimpleNamespace(is_beyond_noise=False, ratio=4.0),
    ]
    on = late_parameters.with_late_blocks(run, solved, found)
    assert (on is not None) is apart
    assert on is None or on.state == ("end", places.allowed_m)


@pytest.mark.parametrize("at_m", [5e-4, 0.08])
def test_a_chips_own_size_is_none_nor_is_one_that_no_imu_has(monkeypatch: pytest.MonkeyPatch, at_m: float) -> None:
    """Half a millimetre, beyond all chance; and eight centimetres, as walls asked for in a flat of five rooms that were none: the
    translation was then "not determined", to 10 m. Mutations: of any size; the one; the other.
    """
    monkeypatch.setattr(
        late_parameters, "late_told", lambda *_: {"size_effect": Told(np.full(6, at_m), np.full(6, 1e-5))}
    )
    monkeypatch.setattr(late_parameters, "_bend_s2_m", lambda _: 1e-4)
    run: Any = SimpleNamespace(settings=SimpleNamespace(intrinsics="auto"))
    solved: Any = Ended(SimpleNamespace(places={}, lasers=0))
    assert late_parameters.with_late_blocks(run, solved, ()) is None


def _sensors(sizes: dict[Block, int], prior_std: FloatArray, values: FloatArray) -> SensorState:
    """Blocks of so many parameters each, one after the other, with these standard deviations (N,) and values (N,)."""
    ends = np.cumsum(list(sizes.values()))
    blocks = [
        NuisanceBlock(block, tuple(map(str, range(count))), prior_std[end - count : end])
        for (block, count), end in zip(sizes.items(), ends, strict=True)
    ]
    return SensorState(Nuisance(tuple(blocks)), values)


@pytest.mark.parametrize(("at_mm", "known_mm", "shows"), [(6.0, 1.0, True), (0.5, 1.0, False), (6.0, 40.0, False)])
def test_what_was_let_go_along_has_to_show_still(at_mm: float, known_mm: float, shows: bool) -> None:
    """Of six known to a millimetre, or no better than they were allowed. Mutations: whatever they come to; a small size's chance
    left out."""
    allowed_m, sides = 8e-3, np.where(np.arange(9) % 2 > 0, 1.0, -1.0)
    beside = BESIDE @ BESIDE.T @ sides
    information = np.eye(9) / allowed_m**2 + BESIDE @ BESIDE.T / (1e-3 * known_mm) ** 2
    values = np.concatenate([np.zeros(2), 1e-3 * at_mm * beside, [0.0]])
    sensors = _sensors({"eccentricity": 2, "size_effect": 9, "clock_rate": 1}, np.full(12, allowed_m), values)
    every = np.eye(15)
    every[5:14, 5:14] = information
    solved: Any = SimpleNamespace(
        nuisance=sensors.blocks,
        estimate=SimpleNamespace(sensors=sensors),
        problem=SimpleNamespace(layout=lambda _: SimpleNamespace(nuisance=lambda: slice(3, 15))),
        minimum=SimpleNamespace(solution=solution_of(every)),
    )
    assert late_parameters.still_show(solved) is shows
    solved.nuisance = Nuisance()
    assert not late_parameters.still_show(solved)


@pytest.mark.parametrize(("at_s2", "std_s2", "shows"), [(5e-5, 5e-6, True), (5e-6, 5e-6, False), (5e-5, 1e-4, False)])
def test_a_filter_that_was_let_go_along_has_to_show_still(at_s2: float, std_s2: float, shows: bool) -> None:
    """Of both triads, beside accelerometers in one place, which show nothing. Mutations: of places alone; of any block."""
    allowed = np.full(12, 1e-4)
    allowed[:9] = 8e-3
    variance = np.concatenate([np.full(9, 8e-3) ** 2, 1.0 / (1.0 / allowed[9:11] ** 2 + 1.0 / std_s2**2), [1.0]])
    values = np.concatenate([np.zeros(9), [at_s2, at_s2, 0.0]])
    sensors = _sensors({"size_effect": 9, "low_pass_spread": 2, "clock_rate": 1}, allowed, values)
    solved: Any = SimpleNamespace(
        nuisance=sensors.blocks,
        estimate=SimpleNamespace(sensors=sensors),
        problem=SimpleNamespace(layout=lambda _: SimpleNamespace(nuisance=lambda: slice(0, 12))),
        minimum=SimpleNamespace(solution=solution_of(np.diag(1.0 / variance))),
    )
    assert late_parameters.still_show(solved) is shows


def _calibrated(faults: str) -> tuple[CalibrationResult, float]:
    """A hand-held recording with these faults, and the square of its error (NEES of the seven)."""
    recording, truth = generate("handheld", seed=4, duration_s=12.0, faults=parse_faults(faults))
    result = calibrate(recording, CalibrateSettings(crispness=False)).result
    assert result.uncertainty is not None
    errors = errors_of(result, truth)
    return result, float(errors @ np.linalg.solve(np.array(result.uncertainty.covariance), errors))


def test_accelerometers_apart_are_found_and_taken_out() -> None:
    """By the middle of three that nobody knows better than they are near one another. Passed once in a thousand: 24.3.

    Mutations: none allowed for; the slope of the turn left out of what they feel; their places by columns.
    """
    result, nees = _calibrated("industrial,size-effect=8mm")
    assert result.status == "calibrated"
    assert nees < 24.3
    found = [each for each in result.intrinsics if each.block == "size_effect"]
    assert [each.name for each in found] == [row + column for row in "xyz" for column in "xyz"]
    assert 0.004 < found[0].prior_std < 0.016
    told = {each.code: each.text for each in result.messages}
    assert "accelerometers are up to" in told["sensor.size_effect"]
    # Who would name the IMU would know no more of the translation.
    assert "in rotation" in told["sensor.priors"]
    assert "in translation" not in told["sensor.priors"]
    assert result.uncertainty is not None
    # Of the middle, nothing more is known.
    assert np.linalg.norm(result.uncertainty.translation_std_m) == pytest.approx(found[0].prior_std, rel=0.2)


def test_accelerometers_in_one_place_stay_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """And with all of them at zero the problem that one step is taken in costs what the solve has ended with.

    Mutations: what one step tells counts whatever it is, chance and all; lasers moved from zero once more; none held.
    """
    costs: list[float] = []
    here, told = late_parameters.with_bins, late_parameters.late_told

    followed: list[bool] = []

    def ended(solved: Solved, *asked: Any, lasers_follow: bool = True) -> Any:
        costs.append(solved.problem.cost(solved.estimate))
        followed.append(lasers_follow)
        return told(solved, *asked, lasers_follow=lasers_follow)

    def with_bins(data: JointData, tried: Estimation, bins: Bins) -> JointProblem:
        problem = here(data, tried, bins)
        costs.append(problem.cost(tried.estimate))
        return problem

    held: list[int] = []
    eliminated = late_parameters.solve_arrow
    monkeypatch.setattr(
        late_parameters, "solve_arrow", lambda system: held.append(len(system.frozen)) or eliminated(system)
    )
    monkeypatch.setattr(late_parameters, "late_told", ended)
    monkeypatch.setattr(late_parameters, "with_bins", with_bins)
    result, nees = _calibrated("industrial")
    assert nees < 24.3
    assert not [each for each in result.intrinsics if each.block == "size_effect"]
    before, tried = costs
    assert tried == pytest.approx(before, rel=1e-5)
    assert held[0] >= 4 * 16
    assert followed == [False]  # nothing shows while lasers are held: nothing is asked again


@pytest.mark.parametrize(("at_mm", "asked", "apart"), [(1.5, 1, False), (2.0, 2, False), (6.0, 2, True)])
def test_lasers_follow_where_something_may_show(
    monkeypatch: pytest.MonkeyPatch, at_mm: float, asked: int, apart: bool
) -> None:
    """Six numbers known to a millimetre: squares of 13, 24 and 216; chance makes 38 once in a million. While lasers are held half
    of that is worth another look. Mutations: the first look counts; a second one always."""
    follow: list[bool] = []

    def told(_solved: object, _stds: object, _asked: object, *, lasers_follow: bool = True) -> dict[str, Told]:
        follow.append(lasers_follow)
        told_mm = at_mm if not lasers_follow or apart else 0.5
        return {"size_effect": Told(np.full(6, 1e-3 * told_mm), np.full(6, 1e-3))}

    monkeypatch.setattr(late_parameters, "late_told", told)
    monkeypatch.setattr(late_parameters, "with_late", lambda state, _, size_m: (state, size_m))
    monkeypatch.setattr(late_parameters, "_listening_anew", lambda _, state: state)
    monkeypatch.setattr(late_parameters, "_bend_s2_m", lambda _: 1e-4)
    run: Any = SimpleNamespace(settings=SimpleNamespace(intrinsics="auto"))
    solved: Any = Ended(SimpleNamespace(places={}, lasers=128))
    assert (late_parameters.with_late_blocks(run, solved, ()) is not None) is apart
    assert follow == [False, True][:asked]


@pytest.mark.parametrize(("sign", "asked"), [(1.0, True), (-1.0, False)])
def test_no_filter_sharpens(monkeypatch: pytest.MonkeyPatch, sign: float, asked: bool) -> None:
    """A spread below zero is none; a skew may be. Mutation: of either sign."""
    blocks = {"low_pass_spread": slice(0, 2), "low_pass_skew": slice(2, 4)}
    step = sign * np.array([5e-5, 5e-5, 1e-6, 1e-6])
    tried: Any = SimpleNamespace(nuisance=SimpleNamespace(places=blocks), estimate=None)
    layout: Any = SimpleNamespace(nuisance=lambda: slice(0, 4))
    problem: Any = SimpleNamespace(linearise=lambda _: None, layout=lambda _: layout, frozen=())
    monkeypatch.setattr(late_parameters, "with_late", lambda state, *_: state)
    monkeypatch.setattr(late_parameters, "with_bins", lambda *_: problem)
    monkeypatch.setattr(
        late_parameters, "solve_arrow", lambda _: SimpleNamespace(information=np.eye(4), step_shared=step)
    )
    spread = SimpleNamespace(matrix=np.diag([1e-12, 1e-12, 1e-14, 1e-14]))
    monkeypatch.setattr(late_parameters, "covariance", lambda _: spread)
    solved: Any = SimpleNamespace(state=tried, data=None, problem=SimpleNamespace(bins=None))
    told = late_parameters.late_told(solved, {"low_pass_spread": 1e-4, "low_pass_skew": 4e-6}, list(blocks))
    assert (told["low_pass_spread"] is not None) is asked
    assert told["low_pass_skew"] is not None


@dataclass
class Listening:
    """A state, as far as tones are asked of it."""

    nuisance: Any
    untuned: bool = True


@pytest.mark.parametrize(
    ("shaken", "tones", "dropped"), [(False, (1.8,), True), (True, (80.0,), False), (False, (), False)]
)
def test_what_was_heard_of_a_calm_imu_is_listened_for_again(
    monkeypatch: pytest.MonkeyPatch, shaken: bool, tones: tuple[float, ...], dropped: bool
) -> None:
    """Walks are as usual; tones stay where an engine is heard. Mutations: tones stay; an engine's go; none looked for again."""
    gone: list[str] = []
    monkeypatch.setattr(late_parameters, "with_usual_walks", lambda _, state: gone.append("walks") or state)
    monkeypatch.setattr(late_parameters, "bare", lambda state: gone.append("tones") or state)
    run: Any = SimpleNamespace(noise=SimpleNamespace(shaken=shaken))
    state: Any = Listening(SimpleNamespace(tones_hz=tones))
    after = late_parameters._listening_anew(run, state)
    assert gone == ["walks", *(["tones"] if dropped else [])]
    assert after.untuned is shaken


@pytest.mark.parametrize(
    ("wanted", "skew", "admitted"),
    [
        ("auto", 0.0, {"low_pass_spread": 1e-4, "low_pass_skew": 1.5 * 5e-5**1.5}),
        ("auto", 9.0, {"low_pass_spread": 1e-4, "low_pass_skew": 4e-6}),
        (("low_pass_spread",), 0.0, {"low_pass_spread": 1e-4}),
    ],
)
def test_what_smears_is_allowed_to_be_as_lopsided_as_a_pole(
    monkeypatch: pytest.MonkeyPatch, wanted: Any, skew: float, admitted: dict[str, float]
) -> None:
    """Unless it shows by itself, or is not asked for. Mutations: not allowed for; as much as is tried, whatever the spread."""
    tells = {
        "low_pass_spread": Told(np.full(2, 5e-5), np.full(2, 5e-6)),
        "low_pass_skew": Told(np.full(2, skew * 1e-7), np.full(2, 1e-7)),
    }
    let_go: dict[str, float] = {}
    monkeypatch.setattr(
        late_parameters, "late_told", lambda _solved, _stds, asked: {b: tells[b] for b in asked if b in tells}
    )
    monkeypatch.setattr(late_parameters, "with_late", lambda _, block, std: let_go.update({block: std}) or "on")
    monkeypatch.setattr(late_parameters, "_listening_anew", lambda _, state: state)
    monkeypatch.setattr(late_parameters, "_bend_s2_m", lambda _: 1e-4)
    run: Any = SimpleNamespace(settings=SimpleNamespace(intrinsics=wanted))
    solved: Any = Ended(SimpleNamespace(places={}, lasers=0))
    assert late_parameters.with_late_blocks(run, solved, ()) is not None
    assert let_go == pytest.approx(admitted)
