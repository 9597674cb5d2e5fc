"""The joint estimation, coarse to fine, as its schedule has it: the page that is the whole of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from calib_core.factors.support import CELL_M, PlaneExtents
from calib_core.full.joint.alternation import Near, alternate, near_rest, settle
from calib_core.full.joint.bent_surfaces import (
    admit_surface,
    is_bent_wall,
    is_rough,
    say_uneven,
    shape_shift,
    unevenness_m,
)
from calib_core.full.joint.bias_walks import say_walks, with_walks_told
from calib_core.full.joint.bounds import require_sensors, require_solution, restless
from calib_core.full.joint.estimation import COUNTING, Estimation, JointData, Solved
from calib_core.full.joint.plane_judgement import (
    settle_without_doubtful,
    with_culprits_marked,
    without_clutter,
    without_doubtful,
    without_faulty,
)
from calib_core.full.joint.plane_set import add_planes
from calib_core.full.joint.policies import Round, Sampling
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.propagate import propagate, until_seen
from calib_core.full.joint.residuals import moved_in_gate
from calib_core.full.joint.round import one_round, released, watched_round
from calib_core.full.joint.schedule import Schedule
from calib_core.full.joint.settings import WATCHING
from calib_core.full.joint.state_views import first_used_s, outlined_cells
from calib_core.full.joint.tones import admit_rest, admit_tones, heard_anew, loudest, say_tones, still_pulled
from calib_core.full.prepare.nuisance import Nuisance, unknowns_of
from calib_core.full.run import Run
from calib_core.solver.broken_down import arithmetic_or_refused
from calib_core.solver.levenberg import SharedEquations


@arithmetic_or_refused()
def estimate_jointly(data: JointData, state: Estimation, schedule: Schedule, *, first: str = "coarse") -> Solved:
    """From start values to the fixed point, with every point and all that the recording holds. Raises Refused.

    first: the step to begin with, from the state that `data.on_state` was told before it.
    """
    for name, share, step in STEPS[_names().index(first) :]:
        data.on_state(name, state)
        if step is settled:  # begins with giving points anew; those of before would be there all the while
            state = state.without_points()
        state = step(data.portion(*share), state, schedule)
    state = state.without_points()
    return at_rest(data, state, schedule)


@arithmetic_or_refused()
def motion_by_all(data: JointData, state: Estimation, schedule: Schedule) -> Estimation:
    """From start values to a motion over the whole recording: the steps before it matters which planes count. Raises Refused."""
    matters = _names().index(COUNTING)
    for name, share, step in STEPS[:matters]:
        data.on_state(name, state)
        state = step(data.portion(*share), state, schedule)
    data.on_state(COUNTING, state)
    return state


@arithmetic_or_refused()
def estimate_chosen(data: JointData, state: Estimation, schedule: Schedule) -> Solved:
    """From a motion by all to the fixed point of the planes that count (plane_choice.py). Raises Refused."""
    assert schedule.propagation is not None
    here = _MOTION
    part = data.portion(here, here)
    state = with_outlines(data, state)
    for each in (replace(schedule.motion, survey=True), schedule.coarse[-1]):
        state = one_round(part, state, each, schedule.sampling)
    tones = schedule.tones
    state = heard_anew(part, state, tones, schedule.coarse[-1], schedule.sampling, loud=tones.shouts)
    assert state.observations is not None
    last_s = float(state.observations.time_s.max()) - state.estimate.time_offset_s
    seen_at = int(np.searchsorted(data.readings.knots_s, last_s))
    return estimate_jointly(data, until_seen(data, state, seen_at, schedule.propagation), schedule, first=COUNTING)


@arithmetic_or_refused()
def estimate_further(run: Run, solved: Solved, schedule: Schedule) -> Solved:
    """From where a solve came to rest, as the run has the sensors: let go where they were held, with its priors of them.
    Raises Refused.

    What would run away with them while the motion is rough, does not when all else is known.
    """
    assert schedule.settling is not None
    sensors = unknowns_of(run)
    data = replace(solved.data, run=run, sensors=sensors)
    state = admit_materials(data, replace(solved.state.with_priors_of(sensors), rounds=0))
    near = near_rest(data, state, schedule.settling, schedule.sampling)
    return at_rest(data, restful(data, near, schedule), schedule)


def restful(data: JointData, near: Near, schedule: Schedule) -> Estimation:
    """The state near rest. Raises Refused where no round came nearer to it while the sensors' parameters are unknowns: tones and
    all points would be asked for nothing, and held first, the sensors may well let it rest. Chosen planes are judged before.
    """
    assert schedule.settling is not None
    held = not data.sensors.blocks or data.run.settings.intrinsics == "consider"
    if near.is_restless(schedule.settling) and not (held or schedule.chosen):
        raise restless(near.state, near.moved)
    return near.state


def at_rest(data: JointData, state: Estimation, schedule: Schedule) -> Solved:
    """With all points, to the fixed point: they show what shakes the IMU unseen where a part of them does not. Raises Refused."""
    assert schedule.settling is not None
    data, whole = data.portion(WATCHING.settled_share, 1.0), data
    data.laid_out.forget()
    shared = SharedEquations()
    rules = schedule.tones
    state, problem = alternate(data, state, schedule.settling, schedule.sampling, shared)
    state = still_pulled(data, state, rules, schedule.sensors, schedule.sampling, problem.bins)
    freed = with_walks_told(data, released(data, state), problem)
    if freed is not state:
        del state, problem
        whole_again = data.portion(1.0, 1.0)
        state, problem = alternate(whole_again, freed.without_points(), schedule.settling, schedule.sampling, shared)
    if (
        schedule.chosen
    ):  # boxes have sensors go astray, and what that does to the readings would be taken for tones, for long
        require_sensors(state, whole.limits.sensor_sigmas)
    for _ in range(rules.turns):
        after = admit_rest(data, state, rules, schedule.sensors, schedule.sampling, problem.bins)
        if after is state:
            break
        nearly = replace(schedule.settling, rounds=rules.settling_rounds)
        after = settle(data.portion(1.0, 1.0), after, nearly, schedule.sampling)
        state, problem = alternate(data.portion(1.0, 1.0), after, schedule.settling, schedule.sampling, shared)
    require_solution(state)
    require_sensors(state, whole.limits.sensor_sigmas)
    say_tones(whole, state)
    say_walks(whole, state)
    return finished(whole, state, problem, shared)


def estimate_motion(data: JointData, state: Estimation, schedule: Schedule) -> Estimation:
    """Coarse rounds over what was tracked, then the estimate propagated over the rest."""
    state = coarse_rounds(data.portion(0.0, WATCHING.coarse_share), state, schedule)
    return propagated(data.portion(WATCHING.coarse_share, 1.0), state, schedule)


def coarse_rounds(data: JointData, state: Estimation, schedule: Schedule) -> Estimation:
    """The motion alone, then everything but the sensors' parameters, over what was tracked."""
    state = with_outlines(data, state)
    rounds, moved = (schedule.motion, *schedule.coarse), 0.0
    for k, each in enumerate(rounds):
        part = data.portion(k / len(rounds), (k + 1) / len(rounds))
        state, moved = moving_round(part, state, each, schedule.sampling)
        # One that shouts: before the sensors' parameters, which would take it upon themselves.
        tones = schedule.tones
        least, loud = tones.explains_at_once, tones.shouts
        state = admit_tones(part.portion(1.0, 1.0), state, tones, each, schedule.sampling, least=least, loud=loud)
    return until_steady(data.portion(1.0, 1.0), state, schedule, rounds[-1], moved) if schedule.coarse else state


def moving_round(data: JointData, state: Estimation, round_: Round, sampling: Sampling) -> tuple[Estimation, float]:
    """A round, and how far it has moved points, in standard deviations of one of them."""
    after, problem = watched_round(data, state, round_, sampling)
    return after, moved_in_gate(problem, state.estimate, after.estimate)


def until_steady(data: JointData, state: Estimation, schedule: Schedule, round_: Round, moved: float) -> Estimation:
    """The same round again while the last one still moved points by more than they scatter. moved: by that.

    Planes and sensors would be judged by a motion that is on its way, and narrower gates would leave its points behind.
    """
    for _ in range(schedule.steadying.patience):
        if moved < schedule.steadying.steady:
            break
        state, moved = moving_round(data, state, round_, schedule.sampling)
    return state


def propagated(data: JointData, state: Estimation, schedule: Schedule) -> Estimation:
    """Over the rest of the recording; where there is none, what the schedule has instead."""
    further = propagate(data, state, schedule)
    if further is state:
        for instead in schedule.instead:
            further = one_round(data, further, instead, schedule.sampling)
    return further


def with_new_planes(data: JointData, state: Estimation, schedule: Schedule) -> Estimation:
    """Planes that have come into view."""
    if schedule.planes is None:
        return state
    added = add_planes(data, state, state.positions, schedule.planes)
    return state if added is state else one_round(data, added, schedule.planes.settle_in, schedule.sampling)


def with_sensors(data: JointData, state: Estimation, schedule: Schedule) -> Estimation:
    """The sensors' own parameters, without what is no plane by far before, and once these are known."""
    state, moved = first_with_sensors(data, without_clutter(data, state, schedule), schedule)
    least = schedule.tones.explains_at_once
    state = admit_tones(data, state, schedule.tones, schedule.sensors, schedule.sampling, least=least)
    if schedule.planes is not None:
        state = without_faulty(data, state, schedule, settled=False)
    return until_steady(data, state, schedule, schedule.sensors, moved)


def first_with_sensors(data: JointData, state: Estimation, schedule: Schedule) -> tuple[Estimation, float]:
    """The first round with the sensors' parameters, and how far it has moved points.

    They take from the readings what seemed a tone, the motion itself by a wrong scale. Where the IMU is shaken and more stands
    out with them than without, they have taken a tone upon themselves: it comes before them then.
    """
    if not data.sensors.blocks:
        return state, 0.0
    tones, sampling = schedule.tones, schedule.sampling
    after, moved = moving_round(data, admit_sensors(data, state), schedule.sensors, sampling)
    if not data.run.noise.shaken:
        return after, moved
    louder = loudest(data, after, tones)
    if louder < tones.taken or louder < loudest(data, state, tones):
        return after, moved
    held, round_ = replace(data, sensors=Nuisance()), schedule.coarse[-1]
    toned = admit_tones(held, state, tones, round_, sampling, least=tones.explains_at_once)
    if toned is state:
        return after, moved
    return moving_round(data, admit_sensors(data, toned), schedule.sensors, sampling)


def settled(data: JointData, state: Estimation, schedule: Schedule) -> Estimation:
    """To rest with a part of the points, without planes that turn out to be none."""
    assert schedule.settling is not None
    rules = schedule.planes
    judge = None if rules is None else partial(without_doubtful, data, schedule=schedule)
    turns = 0 if rules is None else rules.turns
    state = restful(data, near_rest(data, state, schedule.settling, schedule.sampling, judge, turns), schedule)
    state = settle_with_tones(data.portion(1.0, 1.0), state, schedule)
    wandering = with_walks_told(data, state)
    if wandering is not state:
        state = settle(data.portion(1.0, 1.0), wandering, schedule.settling, schedule.sampling)
    if schedule.chosen:
        state = with_culprits_marked(data.portion(1.0, 1.0), state, schedule)
    if schedule.planes is not None:
        state = settle_without_doubtful(data.portion(1.0, 1.0), state, schedule)
    uneven = admit_surface(data, state, schedule.surfaces, schedule.sampling)
    if uneven is state:
        return state
    soon, state = schedule.surfaces.rounds, state.without_points()
    near = near_rest(data.portion(1.0, 1.0), uneven, schedule.settling, schedule.sampling, soon=soon)
    bent = near.state
    if not (near.rests and is_bent_wall(bent, schedule.surfaces)):
        shift = shape_shift(state, near, schedule.settling, schedule.surfaces)
        return replace(state, rounds=bent.rounds, iterations=bent.iterations, shape_shift=shift)
    bent = with_rough_surface(data, bent, schedule)
    say_uneven(data, bent, schedule.surfaces)
    return bent


def with_rough_surface(data: JointData, state: Estimation, schedule: Schedule) -> Estimation:
    """With heights that may be as large as they have turned out, where that is far more than a wall's are.

    What pulls them flat by a wall's measure pulls everything else away then. Cells by the leaf's edge may come and go while they
    are surveyed. The stillest of these rounds is taken then, which comes to rest once they are not.
    """
    assert schedule.settling is not None
    surface, rules = state.nuisance.surface, schedule.surfaces
    if surface is None or not is_rough(state, rules):
        return state
    wider = state.with_nuisance(state.nuisance.with_surface(surface, unevenness_m(state), rules.alike_m))
    rough = near_rest(data.portion(1.0, 1.0), wider, schedule.settling, schedule.sampling, soon=rules.rounds).state
    if is_bent_wall(rough, rules):
        return rough
    return replace(state, rounds=rough.rounds, iterations=rough.iterations)


def settle_with_tones(data: JointData, state: Estimation, schedule: Schedule) -> Estimation:
    """Settled again with what shook the IMU unseen, where anything did: before any plane is judged for it."""
    assert schedule.settling is not None
    rules, before = schedule.tones, state
    nearly = replace(schedule.settling, rounds=rules.settling_rounds)
    for _ in range(rules.most):
        # Where one tone is, others are: bands of an engine come in several lines.
        least = rules.explains if state.nuisance.tones_hz else rules.explains_in_company
        after = admit_tones(data, state, rules, schedule.sensors, schedule.sampling, least=least)
        if after is state:
            break
        # What is left stands out from less once the gates are narrow again.
        state = settle(data, after, nearly, schedule.sampling)
    return state if state is before else settle(data, state, schedule.settling, schedule.sampling)


def admit_sensors(data: JointData, state: Estimation) -> Estimation:
    """From here on the sensors' own parameters are unknowns: before, the motion is too rough for them to show."""
    if not data.sensors.blocks:
        return state
    return admit_materials(data, state.with_nuisance(state.nuisance.with_sensors(data.sensors)))


def admit_materials(data: JointData, state: Estimation) -> Estimation:
    """And what each plane's material does to ranges: walls that are dark or let light in read long or short beside the others,
    and lasers' angles would answer for it. The same state where that is known already, or the sensors are held.
    """
    nuisance = state.nuisance.with_materials(len(state.planes))
    if nuisance is state.nuisance or data.run.settings.intrinsics == "consider":
        return state
    return state.with_nuisance(nuisance)


def with_outlines(data: JointData, state: Estimation) -> Estimation:
    """Support as the given outlines have it, until it is surveyed; planes whose outline has no room for a cell are named."""
    within = outlined_cells(data, state)
    if within is None:
        return state
    narrow = [plane.name for plane, cells in zip(state.planes, within, strict=True) if not cells.any()]
    if narrow:
        data.run.say(
            "warning",
            "planes.narrow",
            f"no points are used of {', '.join(narrow)}: an outline must be at least {2 * CELL_M:.1f} m wide",
        )
    return replace(state, support=PlaneExtents(state.estimate.normals, within))


def finished(data: JointData, state: Estimation, problem: JointProblem, shared: SharedEquations) -> Solved:
    """What the stages after need of the end."""
    assert state.minimum is not None
    assert state.observations is not None
    return Solved(
        problem=problem,
        estimate=state.estimate,
        minimum=state.minimum,
        observations=state.observations,
        lidar_noise=state.lidar_noise,
        map_time_s=first_used_s(data, state),
        planes=state.planes,
        rounds=state.rounds,
        iterations=state.iterations,
        data=data,
        state=state,
        shared=shared,
    )


_MOTION = WATCHING.motion_share
#: The steps in their order, each with the share of the progress that it usually takes. All points come after them.
STEPS: tuple[tuple[str, tuple[float, float], Callable[[JointData, Estimation, Schedule], Estimation]], ...] = (
    ("coarse", (0.0, _MOTION * WATCHING.coarse_share), coarse_rounds),
    ("propagate", (_MOTION * WATCHING.coarse_share, _MOTION), propagated),
    (COUNTING, (_MOTION, _MOTION), with_new_planes),
    ("sensors", (_MOTION, _MOTION), with_sensors),
    ("settle", (_MOTION, WATCHING.settled_share), settled),
)


def _names() -> list[str]:
    return [name for name, _, _ in STEPS]
