"""What every round of the joint estimation is made of: lay points on planes, descend, hold what is not determined.

A round lays the current motion under the points (`associate`), gathers them into factors, preintegrates about the current
biases and descends. Each step takes what is known and gives what is known then.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.errors import Cancelled
from calib_core.events import ignore_event
from calib_core.factors.lidar_plane import Gate
from calib_core.full.joint import association
from calib_core.full.joint.bounds import require_bounds, require_points
from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.lidar_noise import measure_noise
from calib_core.full.joint.live_motion import iteration_event
from calib_core.full.joint.moments import gather
from calib_core.full.joint.policies import Round, Sampling
from calib_core.full.joint.priors import Held
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.settings import HOLDING, WATCHING
from calib_core.full.joint.state import CALIBRATION, TIME_OFFSET, TRANSLATION, Bins, Estimate
from calib_core.full.joint.state_views import frozen_columns, map_pose, outlined_cells, present_view, problem_of
from calib_core.full.joint.thinning import across_lasers
from calib_core.full.joint.undetermined import (
    UNITS,
    data_information,
    is_hardly_determined,
    still_undetermined,
    towards_priors,
    turns_about,
    without_lever_arm,
)
from calib_core.full.joint.unseen_directions import unseen_counts
from calib_core.full.prepare.nuisance import named_lasers
from calib_core.solver.arrow import FROZEN, ArrowSolution, NotPositiveDefinite, solve_shared
from calib_core.solver.levenberg import SharedEquations, minimise
from calib_core.types import FloatArray


def one_round(data: JointData, state: Estimation, round_: Round, sampling: Sampling) -> Estimation:
    """A round as its policy has it: survey, association, descent, and what is to be held from there on."""
    return watched_round(data, state, round_, sampling)[0]


def watched_round(
    data: JointData, state: Estimation, round_: Round, sampling: Sampling
) -> tuple[Estimation, JointProblem]:
    """The same with the problem that was descended, by which what it has moved can be told."""
    gate = gate_of(state, round_.gate_m, sampling) if round_.margin_by_noise else Gate(extra_m=round_.gate_m)
    if round_.survey:
        state = survey(data, state, gate, sampling)
    state = associate(data, state, gate, stride=round_.stride or coarse_stride(data, state, sampling))
    frozen = tuple(range(CALIBRATION)) if round_.motion_alone else ()
    state, problem = descend(
        data, state, iterations=round_.iterations, tolerance=round_.least_decrease, also_frozen=frozen
    )
    return (hold(data, state, problem) if round_.hold else state), problem


def gate_of(state: Estimation, extra_m: float, sampling: Sampling) -> Gate:
    """A gate of the noise and so much more; hits too near to another plane, for the noise there is, do not count."""
    margin_m = float(np.clip(sampling.margin_sigmas * state.lidar_noise.range_std_m, *sampling.margins_m))
    return Gate(extra_m=extra_m, margin_m=margin_m)


def coarse_stride(data: JointData, state: Estimation, sampling: Sampling) -> int:
    """Every so many-th point is used in the coarse rounds."""
    target = float(np.clip(sampling.points / len(state.positions), *sampling.points_per_scan))
    return _stride_to(target, data, state, sampling)


def _stride_to(target: float, data: JointData, state: Estimation, sampling: Sampling) -> int:
    """Which leaves so many points of a typical scan."""
    some = state.positions[:: max(1, len(state.positions) // sampling.typical_scans)]
    typical = np.median(data.run.clocks.scan_points[list(some)])
    return across_lasers(max(1, int(typical // target)))


def associate(data: JointData, state: Estimation, gate: Gate, *, stride: int) -> Estimation:
    """Points given to planes under the present estimate."""
    run, total = data.run, len(state.positions)
    told = 0

    def tell(done: int) -> None:
        nonlocal told
        if done // WATCHING.told_every_scans > told // WATCHING.told_every_scans:
            run.stage("solve", done / total, f"round {state.rounds + 1}")
        told = done

    view = present_view(data, state)
    if stride == 1:  # what comes to rest with all points is asked what each laser says of it (by_laser.py)
        view = replace(view, apart=named_lasers(run.recording.scans))
    observations = association.associate(
        view, state.positions, state.lidar_noise, gate, state.support, stride=stride, on_scans=tell
    )
    return replace(state, observations=observations)


def survey(data: JointData, state: Estimation, gate: Gate, sampling: Sampling) -> Estimation:
    """How far each plane reaches."""
    view, stride = present_view(data, state), coarse_stride(data, state, sampling)
    support = association.survey(
        view, state.positions, state.lidar_noise, gate, stride=stride, within=outlined_cells(data, state)
    )
    return replace(state, support=support)


def measure(data: JointData, state: Estimation, gate: Gate, sampling: Sampling) -> Estimation:
    """How noisy the lidar is, within the planes' support."""
    step = max(1, len(state.positions) // sampling.noise_scans)
    stride = _stride_to(sampling.noise_points, data, state, sampling)
    view, some = present_view(data, state), state.positions[::step]
    given = data.run.settings.range_std_m
    noise = measure_noise(view, some, state.lidar_noise, gate, state.support, stride=stride, range_std_m=given)
    return replace(state, lidar_noise=noise)


def descend(
    data: JointData,
    state: Estimation,
    *,
    iterations: int,
    tolerance: float,
    relative: float = 0.0,
    also_frozen: tuple[int, ...] = (),
    shared: SharedEquations | None = None,
    roughly: bool = False,
    along_valleys: bool = False,
) -> tuple[Estimation, JointProblem]:
    """Preintegrate and gather about the present estimate, then descend. also_frozen: more shared columns to hold.

    tolerance, relative, shared, roughly, along_valleys: as `minimise` has them.

    Raises Refused where the answer has left its bounds, and Cancelled.
    """
    data.laid_out.let_go()
    problem = gathered(data, state)
    require_points(len(problem.bins.knot), [plane.name for plane in state.planes])
    problem = replace(problem, frozen=problem.frozen + also_frozen)
    run, names, number = data.run, [plane.name for plane in state.planes], state.rounds + 1
    count = state.iterations

    def report(estimate: Estimate, cost: float, solution: ArrowSolution) -> None:
        nonlocal count
        count += 1
        if run.should_cancel():
            raise Cancelled("the calibration was cancelled")
        if run.on_event is not ignore_event:
            run.on_event(iteration_event(run, problem, estimate, cost, solution, (count, number), names))

    minimum = minimise(
        problem, state.estimate, max_iterations=iterations, tolerance=tolerance, relative=relative, on_step=report,
        shared=shared or SharedEquations(), roughly=roughly, along_valleys=along_valleys,
    )  # fmt: skip
    after = replace(
        state, estimate=minimum.estimate, minimum=minimum, rounds=number, iterations=count, unseen=problem.bins.unseen
    )
    require_bounds(data, state, after)
    return after, problem


def gathered(data: JointData, state: Estimation) -> JointProblem:
    """The problem about the present estimate with the points that were given to planes."""
    assert state.observations is not None
    about = problem_of(data, state)
    bins = gather(state.observations, about.motion(state.estimate), state.estimate)
    unseen = unseen_counts(bins, state.estimate, about.readings, state.unseen)
    return with_bins(data, state, replace(bins, unseen=unseen))


def with_bins(data: JointData, state: Estimation, bins: Bins) -> JointProblem:
    """The same with points as they were gathered when fewer of the sensors' parameters were in play."""
    problem = replace(problem_of(data, state), bins=bins)
    return replace(problem, frozen=frozen_columns(data, problem, state.estimate))


def hold(data: JointData, state: Estimation, problem: JointProblem) -> Estimation:
    """Hold the directions that the data do not determine: translation at zero, the others where they are, both as far as a prior
    does not say otherwise.

    What was held is let go only when the data, judged with it held, say clearly more than noise could. So is the turn about the
    only axis of a motion, which start values leave where walls are plumb: while the motion is rough it looks known to a degree.
    """
    information = _information(data, state, problem)
    if information is None:
        return state
    known, before = _known(data, state, information), _held(state)
    if not before and data.only_axis_imu is not None:
        before = turns_about(data.only_axis_imu @ state.estimate.R_imu_lidar, known)
    directions = still_undetermined(known, before)
    if directions.shape[1] == 0:
        return replace(state, priors=replace(state.priors, held=()))
    now = state.priors.calibration_vector(state.estimate) / UNITS
    only_shift = np.linalg.norm(directions[TRANSLATION], axis=0) > HOLDING.shift_share
    at = now + directions @ np.where(only_shift, -(directions.T @ now), 0.0)
    at += directions @ towards_priors(directions, state.priors, at)
    held = tuple(Held(each / UNITS, float(each @ at), HOLDING.held_std) for each in directions.T)
    return replace(state, priors=replace(state.priors, held=held))


def released(data: JointData, state: Estimation) -> Estimation:
    """Without what was held and is clearly determined where the last round ended; the state itself where that is nothing.

    What is known of a direction was judged by a part of the points, about a motion that was still rough.
    """
    before = _held(state)
    if not before or state.information is None:
        return state
    known = _known(data, state, state.information)
    kept = tuple(
        held for held, vector in zip(state.priors.held, before, strict=True) if is_hardly_determined(known, vector)
    )
    return state if len(kept) == len(before) else replace(state, priors=replace(state.priors, held=kept))


def _held(state: Estimation) -> list[FloatArray]:
    """The directions that are held, unit vectors (7,) in the scaled units."""
    return [held.vector * UNITS for held in state.priors.held]


def _known(data: JointData, state: Estimation, information: FloatArray) -> FloatArray:
    """(7, 7), scaled units: what the data alone say of the calibration. information: (S, S), priors included."""
    known = data_information(information, state.priors)
    if not data.turned:
        known = without_lever_arm(known)
    if not data.run.settings.estimate_time_offset:
        known[TIME_OFFSET, TIME_OFFSET] = FROZEN
    return known


def _information(data: JointData, state: Estimation, problem: JointProblem) -> FloatArray | None:
    """Of the shared unknowns (S, S), from the descent that just ended unless it held more than the settings do."""
    frozen = frozen_columns(data, problem, state.estimate)
    if state.information is not None and problem.frozen == frozen:
        return state.information
    try:
        return solve_shared(replace(problem, frozen=frozen).linearise(state.estimate))[0]
    except NotPositiveDefinite:
        return None


def anchored(data: JointData, state: Estimation) -> Estimation:
    """The map frame laid on the lidar at the first used scan's time, wherever the estimate has let it drift.

    Planes' cells are counted in the map frame: it must not depend on where the search began.
    """
    R, p = map_pose(data, state)
    return replace(state, estimate=state.estimate.seen_from(R, p))
