"""The joint estimation, coarse to fine, as its schedule has it: the page that is the whole of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.factors.support import CELL_M, PlaneExtents
from calib_core.full.joint.estimation import Estimation, JointData, Solved
from calib_core.full.joint.plane_set import add_planes, drop_planes
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.propagate import propagate
from calib_core.full.joint.round import map_time_s, one_round, outlined_cells
from calib_core.full.joint.schedule import PlaneSet, Sampling, Schedule, Settling
from calib_core.full.joint.settle import alternate, settle
from calib_core.full.joint.surface import admit_surface

#: How far along the estimation is, as a share of its usual time: where the motion is known (and of that, where the coarse
#: rounds are done), and where a part of the points has settled. For whoever watches; nothing depends on it.
_MOTION, _SETTLED = 0.6, 0.75
_COARSE = 0.3


def estimate_jointly(data: JointData, state: Estimation, schedule: Schedule) -> Solved:
    """From start values to the fixed point, with every point and all that the recording holds. Raises Refused."""
    state = estimate_motion(data.portion(0.0, _MOTION), state, schedule)
    rules, settling, sampling = schedule.planes, schedule.settling, schedule.sampling
    assert settling is not None
    if rules is not None:
        added = add_planes(data, state, state.positions, rules)
        state = state if added is state else one_round(data.portion(_MOTION, _MOTION), added, rules.settle_in, sampling)
    state = admit_sensors(data, state)
    if data.sensors.blocks:
        state = one_round(data.portion(_MOTION, _MOTION), state, schedule.sensors, sampling)
    if rules is not None:
        state = drop_planes(data, state, rules)
    state = settle(data.portion(_MOTION, _SETTLED), state, settling, sampling)
    if rules is not None:
        state = settle_without_doubtful(data.portion(_SETTLED, _SETTLED), state, rules, settling, sampling)
    uneven = admit_surface(data, state, schedule.surfaces, sampling)
    if uneven is not state:
        state = settle(data.portion(_SETTLED, _SETTLED), uneven, settling, sampling)
    state, problem = alternate(data.portion(_SETTLED, 1.0), state, settling, sampling)
    return finished(data, state, problem)


def settle_without_doubtful(
    data: JointData, state: Estimation, rules: PlaneSet, settling: Settling, sampling: Sampling
) -> Estimation:
    """Settled again without what turns out to be no plane, in as many turns as there are."""
    for _ in range(rules.turns):
        left = drop_planes(data, state, rules, settled=True)
        if left is state:
            break
        state = settle(data, left, settling, sampling)
    return state


def estimate_motion(data: JointData, state: Estimation, schedule: Schedule) -> Estimation:
    """Coarse rounds over what was tracked, then the estimate propagated over the rest."""
    state = with_outlines(data, state)
    rounds = (schedule.motion, *schedule.coarse)
    for k, each in enumerate(rounds):
        part = data.portion(_COARSE * k / len(rounds), _COARSE * (k + 1) / len(rounds))
        state = one_round(part, state, each, schedule.sampling)
    further = propagate(data.portion(_COARSE, 1.0), state, schedule)
    if further is state:
        for instead in schedule.instead:
            further = one_round(data, further, instead, schedule.sampling)
    return further


def admit_sensors(data: JointData, state: Estimation) -> Estimation:
    """From here on the sensors' own parameters are unknowns: before, the motion is too rough for them to show."""
    if not data.sensors.blocks:
        return state
    return replace(
        state,
        nuisance=data.sensors,
        estimate=replace(state.estimate, nuisance=np.zeros(data.sensors.size)),
        priors=replace(state.priors, nuisance_std=data.sensors.prior_std),
        observations=None,
        minimum=None,
    )


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
            f"nothing is used of {', '.join(narrow)}: an outline has to be {2 * CELL_M:.1f} m wide at least",
        )
    return replace(state, support=PlaneExtents(state.estimate.normals, within))


def finished(data: JointData, state: Estimation, problem: JointProblem) -> Solved:
    """What the stages after need of the end."""
    assert state.minimum is not None
    assert state.observations is not None
    return Solved(
        problem=problem,
        estimate=state.estimate,
        minimum=state.minimum,
        observations=state.observations,
        lidar_noise=state.lidar_noise,
        map_time_s=map_time_s(data, state),
        planes=state.planes,
        rounds=state.rounds,
        iterations=state.iterations,
        nuisance=state.nuisance,
    )
