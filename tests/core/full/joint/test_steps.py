"""The steps of the joint estimation one after the other, told before each, and from any of them on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from calib_core.errors import Refused
from calib_core.factors.support import PlaneExtents
from calib_core.full.joint import bent_surfaces, bounds, solve
from calib_core.full.joint.alternation import Near
from calib_core.full.joint.estimation import Estimation, JointData, Solved
from calib_core.full.joint.policies import Steadying, Tones
from calib_core.full.joint.replay import load_estimation, save_estimation
from calib_core.full.joint.schedule import CHOSEN, FULL, PARTLY, Schedule
from calib_core.full.joint.sensor_state import SensorState
from calib_core.full.joint.tones import with_tone
from calib_core.full.prepare.nuisance import TONE, Nuisance, NuisanceBlock
from tests.core.full.joint.conftest import Half
from tests.core.full.joint.same import same

#: As docs/how-it-works.md has them, one after the other, and what does each.
STEPS = {
    "coarse": solve.coarse_rounds,
    "propagate": solve.propagated,
    "planes": solve.with_new_planes,
    "sensors": solve.with_sensors,
    "settle": solve.settled,
}


def _counting(_data: JointData, state: Estimation, _schedule: Schedule) -> Estimation:
    """In the place of a step: the state says how many there were."""
    return replace(state, rounds=state.rounds + 1)


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[Estimation]:
    """Steps that only count, and the states that the end was reached with."""
    ends: list[Estimation] = []

    def end(_data: JointData, state: Estimation, *_: object) -> tuple[Estimation, object]:
        ends.append(state)
        return state, SimpleNamespace(bins=None)

    monkeypatch.setattr(solve, "STEPS", tuple((name, share, _counting) for name, share, _ in solve.STEPS))
    monkeypatch.setattr(solve, "alternate", end)
    monkeypatch.setattr(solve, "finished", lambda *_: None)
    return ends


def test_a_recording_enters_each_step_once_and_is_told_before_it(
    half: Half, counted: list[Estimation], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Mutations: tell the state after the step; leave a step out; begin one step late."""
    told: list[tuple[str, int]] = []
    monkeypatch.setattr(solve, "with_walks_told", lambda _data, state, *_: state)
    state = replace(half.state, rounds=0)
    data = replace(half.data, on_state=lambda name, known: told.append((name, known.rounds)))
    solve.estimate_jointly(data, state, FULL)
    assert told == [(name, place) for place, name in enumerate(STEPS)]
    assert [end.rounds for end in counted] == [len(STEPS)]
    told.clear()
    solve.estimate_jointly(data, state, FULL, first="sensors")
    assert told == [("sensors", 0), ("settle", 1)]
    assert [end.rounds for end in counted] == [len(STEPS), 2]


def test_the_steps_are_those_of_the_page_in_their_order() -> None:
    """Mutations: no look for new planes; planes looked for before the estimate is propagated."""
    assert [(name, step) for name, _, step in solve.STEPS] == list(STEPS.items())


def test_shares_of_the_progress_go_on_from_one_another() -> None:
    """Mutation: a step that begins before the one before it has ended."""
    shares = [share for _, share, _ in solve.STEPS]
    assert shares[0][0] == 0.0
    assert [end for _, end in shares[:-1]] == [begin for begin, _ in shares[1:]]
    assert all(begin <= end <= 1.0 for begin, end in shares)


def test_the_last_step_from_a_file_ends_where_it_did_from_memory(half: Half, tmp_path: Path) -> None:
    """Settling and all points again, from what was written down before: the same end, bit for bit.

    Mutation: write lengths with fewer digits than they have.
    """
    schedule = replace(FULL, planes=None)
    data = replace(half.data, on_state=lambda name, known: save_estimation(known, tmp_path / name))
    ends: list[Solved] = [solve.estimate_jointly(data, half.state, schedule, first="settle")]
    ends.append(solve.estimate_jointly(half.data, load_estimation(tmp_path / "settle"), schedule, first="settle"))
    assert same(ends[0].estimate, ends[1].estimate)
    assert ends[0].minimum.cost == ends[1].minimum.cost
    assert ends[0].rounds == ends[1].rounds


@pytest.mark.parametrize(("schedule", "looks"), [(FULL, 1), (CHOSEN, 0)])
def test_sensors_that_chosen_boxes_lead_astray_end_the_solve_at_its_first_rest(
    half: Half, counted: list[Estimation], monkeypatch: pytest.MonkeyPatch, schedule: Schedule, looks: int
) -> None:
    """Four boxes took three times as long as the whole suggestion to be refused: tones were found and lost again in what the
    sensors did. Where nobody chose, a tone may bring them back. Mutations: judged at the end alone; at once whoever chose.
    """
    looked: list[Estimation] = []

    def look(_data: JointData, state: Estimation, *_: object) -> Estimation:
        looked.append(state)
        return state

    def astray(*_: object) -> None:
        raise Refused("solve.sensors_astray", "twelve times as large")

    monkeypatch.setattr(solve, "admit_rest", look)
    monkeypatch.setattr(solve, "with_walks_told", lambda _data, state, *_: state)
    monkeypatch.setattr(solve, "require_solution", lambda _: None)
    monkeypatch.setattr(solve, "require_sensors", astray)
    with pytest.raises(Refused, match="twelve times"):
        solve.at_rest(half.data, half.state, schedule)
    assert (len(looked), len(counted)) == (looks, 1)


@pytest.mark.parametrize(
    ("moves", "rounds"), [([0.9], 0), ([1.5, 0.9], 1), ([3.0, 2.0, 1.2, 0.2, 5.0], 3), ([9.0] * 20, 4)]
)
def test_rounds_go_on_until_points_stay_where_they_are(
    half: Half, monkeypatch: pytest.MonkeyPatch, moves: list[float], rounds: int
) -> None:
    """Within a standard deviation of one of them, or for as long as there is patience.

    Mutations: one round more than are needed; the first move forgotten; no end to patience.
    """
    left = iter(moves[1:])

    def once(_data: JointData, state: Estimation, *_: object) -> tuple[Estimation, float]:
        return replace(state, rounds=state.rounds + 1), next(left)

    monkeypatch.setattr(solve, "moving_round", once)
    schedule = replace(FULL, steadying=Steadying(steady=1.0, patience=4))
    state = replace(half.state, rounds=0)
    assert solve.until_steady(half.data, state, schedule, schedule.sensors, moves[0]).rounds == rounds


def test_coarse_rounds_and_the_first_with_sensors_end_steady(half: Half, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three rounds and two more; one and two more. Mutations: `until_steady` left out of either step, or told no move."""
    left: list[float] = []

    def once(_data: JointData, state: Estimation, *_: object) -> tuple[Estimation, float]:
        return replace(state, rounds=state.rounds + 1), left.pop(0)

    monkeypatch.setattr(solve, "moving_round", once)
    state, schedule = replace(half.state, rounds=0), replace(FULL, planes=None)
    left[:] = [9.0, 9.0, 9.0, 2.0, 0.5, 7.0]
    assert solve.coarse_rounds(half.data, state, schedule).rounds == 5
    left[:] = [9.0, 2.0, 0.5, 7.0]
    assert half.data.sensors.blocks
    assert solve.with_sensors(half.data, state, schedule).rounds == 3


def test_before_the_sensors_are_known_a_tone_has_to_shout(half: Half, monkeypatch: pytest.MonkeyPatch) -> None:
    """The motion itself explains thousands by their scales before; then, with the sensors' columns first, the tones are still
    there.

    Mutations: `loud` left out; tones forgotten where the sensors come in, or put before them; materials beside sensors that are
    held.
    """
    asked: list[float] = []

    def once(data: JointData, state: Estimation, rules: Tones, *_: object, least: float, loud: float) -> Estimation:
        assert least == rules.explains_at_once
        asked.append(loud)
        return with_tone(data, state, 1.4, rules) if len(asked) == 1 else state

    monkeypatch.setattr(solve, "admit_tones", once)
    monkeypatch.setattr(solve, "moving_round", lambda _data, state, *_: (state, 0.0))
    state = solve.coarse_rounds(half.data, half.state, FULL)
    assert asked == [FULL.tones.shouts] * 3
    state = replace(state, estimate=replace(state.estimate, sensors=SensorState(state.nuisance, np.arange(25.0))))
    after = solve.admit_sensors(half.data, state)
    assert after.nuisance.sensors == half.data.sensors
    assert after.nuisance.tones_hz == (1.4,)
    np.testing.assert_array_equal(after.estimate.sensors.of(TONE), np.arange(25.0))
    materials = len(half.state.planes)
    assert after.nuisance.size == half.data.sensors.size + materials + 25
    held = replace(half.data.run, settings=half.data.run.settings.model_copy(update={"intrinsics": "consider"}))
    assert solve.admit_sensors(replace(half.data, run=held), half.state).nuisance.materials == 0


def test_of_a_choice_tones_are_heard_anew(half: Half, monkeypatch: pytest.MonkeyPatch) -> None:
    """Clutter that tells the motion is as loud as an engine, and may be none of the choice. Seen: floor, ceiling and a wall were
    chosen, two slow tones of the others stayed, and the answer was 2 deg off, undetermined.

    Mutations: what all planes told stays; heard anew before the choice alone tells the motion; without having to shout.
    """
    order: list[object] = []

    def heard(_data: object, state: Estimation, *_: object, loud: float) -> Estimation:
        order.append(("heard", loud))
        return replace(state, rounds=77)

    monkeypatch.setattr(solve, "one_round", lambda data, state, *_: order.append("round") or half.state)
    monkeypatch.setattr(solve, "heard_anew", heard)
    monkeypatch.setattr(solve, "until_seen", lambda _data, state, *_: state)
    monkeypatch.setattr(solve, "estimate_jointly", lambda _data, state, *_, **__: state)
    after = solve.estimate_chosen(half.data, half.state, CHOSEN)
    assert order == ["round", "round", ("heard", CHOSEN.tones.shouts)]
    assert after.rounds == 77


@pytest.mark.parametrize(
    ("shaken", "without", "with_them", "first"),
    [
        (True, 2900.0, 450_000.0, "tone"),
        (True, 2900.0, 300.0, "sensors"),  # what stood out was the sensors'
        (True, 5.0, 150.0, "sensors"),  # nothing to speak of
        (False, 2900.0, 450_000.0, "sensors"),
    ],
)
def test_a_tone_comes_before_sensors_that_would_take_it_upon_themselves(
    half: Half, monkeypatch: pytest.MonkeyPatch, shaken: bool, without: float, with_them: float, first: str
) -> None:
    """Seen where 18 lines shake an IMU by 3 m/s2: 2,900 without the sensors' parameters, 455,000 with them, and half an hour of
    rounds that came to no rest.

    Mutations: not compared with what it was without; for a calm IMU too; the round before the tone is gone on from.
    """
    heard = {0: without, half.data.sensors.size + len(half.state.planes): with_them}
    monkeypatch.setattr(solve, "loudest", lambda _data, state, _rules: heard[state.nuisance.size])
    monkeypatch.setattr(solve, "moving_round", lambda _data, state, *_: (state, float(len(state.nuisance.tones_hz))))
    asked: list[tuple[int, float]] = []

    def once(data: JointData, state: Estimation, rules: Tones, *_: object, least: float) -> Estimation:
        asked.append((data.sensors.size, least))
        return with_tone(data, state, 0.8, rules)

    monkeypatch.setattr(solve, "admit_tones", once)
    level = replace(half.data.run.noise, shaken=shaken)
    data = replace(half.data, run=replace(half.data.run, noise=level))
    after, moved = solve.first_with_sensors(data, half.state, FULL)
    assert after.nuisance.sensors == half.data.sensors
    assert after.nuisance.tones_hz == ((0.8,) if first == "tone" else ())
    assert moved == len(after.nuisance.tones_hz)
    assert asked == ([(0, FULL.tones.explains_at_once)] if first == "tone" else [])


@pytest.mark.parametrize(
    ("height_m", "rests", "kept"), [(0.08, True, True), (-0.1, True, False), (0.001, False, False)]
)
def test_a_patch_that_follows_another_surface_ends_the_shapes(
    half: Half, monkeypatch: pytest.MonkeyPatch, height_m: float, rests: bool, kept: bool
) -> None:
    """Walls bend by millimetres, a door ajar stands out by 50: 30 times 3 mm is neither, and no shape of a wall is what goes
    away from rest. The state before is gone on from, with the rounds that were taken.

    Mutations: the height's sign counts; the bent state is kept, or where it does not rest; its rounds are forgotten.
    """
    bent_surfaces = Nuisance((NuisanceBlock("surface", ("1:0,0", "1:1,0"), np.full(2, 0.003)),))
    heights = SensorState(bent_surfaces, np.array([0.001, height_m]))
    uneven = replace(half.state, estimate=replace(half.state.estimate, sensors=heights))
    soon: list[int] = []

    def near(_data: JointData, state: Estimation, *_: object, **more: int) -> Near:
        if not more:  # the first, to which nothing is bent yet
            return Near(half.state, rests=True, moved=0.0)
        soon.append(more["soon"])
        return Near(replace(state, rounds=77), rests, moved=0.0)

    monkeypatch.setattr(solve, "near_rest", near)
    monkeypatch.setattr(solve, "admit_surface", lambda *_: uneven)
    after = solve.settled(half.data, half.state, replace(FULL, planes=None))
    assert after.rounds == 77
    assert soon == [FULL.surfaces.rounds]
    assert (after.nuisance.size == 2) == kept


@pytest.mark.parametrize("schedule", [FULL, replace(FULL, planes=None), PARTLY])
@pytest.mark.parametrize("intrinsics", ["auto", "consider"])
@pytest.mark.parametrize(("rests", "moved"), [(False, 0.3), (False, 0.05), (True, 0.3)])
def test_sensors_that_let_nothing_rest_are_let_go_no_further(
    half: Half, monkeypatch: pytest.MonkeyPatch, schedule: Schedule, intrinsics: str, rests: bool, moved: float
) -> None:
    """Of a hum at half the IMU's rate, tones and all points took minutes more, and then refused. Rounds that went away from where
    they hardly moved have been there, held sensors are not let go, and planes that somebody chose are named first.

    Mutations: gone on with; refused with held sensors too, or of chosen planes; of what went away.
    """
    settings = half.data.run.settings.model_copy(update={"intrinsics": intrinsics})
    data = replace(half.data, run=replace(half.data.run, settings=settings))
    monkeypatch.setattr(solve, "near_rest", lambda _data, state, *_, **__: Near(state, rests, moved))
    monkeypatch.setattr(solve, "settle_with_tones", lambda *_: half.state.without_points())
    for later in ("with_culprits_marked", "settle_without_doubtful", "admit_surface", "with_walks_told"):
        monkeypatch.setattr(solve, later, lambda _data, state, *_: state)
    if not rests and moved == 0.3 and intrinsics == "auto" and not schedule.chosen:
        with pytest.raises(Refused, match="did not converge in") as refused:
            solve.settled(data, half.state, schedule)
        assert refused.value.code == "solve.unsettled"
        return
    solve.settled(data, half.state, schedule)


@pytest.mark.parametrize(
    ("doubt", "rest_is", "shaped"), [(0.9, False, 0), (0.9, True, 0), (1.1, True, 1), (1.1, False, None)]
)
def test_what_is_no_plane_beside_the_others_is_given_no_shape(
    half: Half, monkeypatch: pytest.MonkeyPatch, doubt: float, rest_is: bool, shaped: int | None
) -> None:
    """Chosen all the same, a box 4 mm off flat among walls was a wall with a shape then: 5 sigmas off, and nobody was told. The
    others have theirs: without them, for one fence by a street, its ground was flat, and the answer 12 mm off with 2.7 stated.

    shaped: how many of the planes have none; None: all.   rest_is: whether those that are not doubtful are bent.
    Mutations: shapes of every plane; of the first one alone; the bend of all asked again; heights' priors independent; no shape
    where one plane is doubtful.
    """
    support = PlaneExtents(half.state.estimate.normals, np.zeros((len(half.state.planes), 8, 8), bool))
    support.inside[:, 2:6, 2:6] = True
    doubts = np.zeros((len(half.state.planes), 3))
    doubts[-1, 1] = doubt
    monkeypatch.setattr(
        bent_surfaces, "patch_sums", lambda _data, _state, patches, _sampling: (np.ones(patches.count),) * 2
    )
    every, each = len(half.state.planes), 4  # patches of a plane
    bent = {every * each: True, (every - 1) * each: rest_is}
    monkeypatch.setattr(bent_surfaces, "are_bent", lambda weight, *_: bent[len(weight)])
    monkeypatch.setattr(bent_surfaces, "gathered", lambda *_: None)
    monkeypatch.setattr(bent_surfaces, "plane_doubts", lambda *_: doubts)
    state = replace(half.state, support=support)
    after = bent_surfaces.admit_surface(half.data, state, FULL.surfaces, FULL.sampling)
    patches = after.nuisance.surface
    assert (patches is None) == (shaped is None)
    if patches is not None:
        assert sorted(set(patches.planes.tolist())) == list(range(every - (shaped or 0)))
        assert [place.stop - place.start for place, _ in after.nuisance.whiteners] == [patches.count]
        np.testing.assert_array_equal(np.sort(patches.number[patches.number >= 0]), np.arange(patches.count))


def test_planes_are_bent_where_chance_would_hardly_make_as_much() -> None:
    """Three walls whose patches' means are known to 0.1 mm: flat ones never are bent, one of them off by 0.4 mm from place to
    place is enough, and patches without a point say nothing.

    Oracle: the variances that were drawn; of 300 flat ones chance makes none of six sigmas. Mutations: of single patches;
    standard deviations for variances; every excess counts.
    """
    rng = np.random.default_rng(5)
    plane = np.repeat(np.arange(3), 40)
    weight = np.full(plane.shape, 1e8)
    weight[::10] = 0.0

    def bent(*bends_m: float) -> bool:
        off_m = rng.normal(0.0, np.sqrt(1e-8 + np.array(bends_m)[plane] ** 2))
        return bent_surfaces.are_bent(weight, weight * off_m, FULL.surfaces)

    assert not any(bent(0.0, 0.0, 0.0) for _ in range(300))
    assert all(bent(0.0, 0.0004, 0.0) for _ in range(30))
    assert not bent_surfaces.are_bent(weight[:1], np.full(1, 1e6), FULL.surfaces)


def test_a_solve_that_ends_singular_is_refused(half: Half) -> None:
    """Mutation: its missing information handed on, which ended as a defect."""
    bounds.require_solution(half.state)
    assert half.state.minimum is not None
    with pytest.raises(Refused, match="no stable answer"):
        bounds.require_solution(replace(half.state, minimum=replace(half.state.minimum, solution=None)))
