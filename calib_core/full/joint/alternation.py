"""To where support, noise, gates and motion no longer change one another: with a part of the points, then with all.

That place depends on the recording alone, not on the start values: what follows is the same from any start.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from calib_core.factors.lidar_plane import Gate, LidarNoise
from calib_core.factors.support import PlaneExtents
from calib_core.full.joint.bounds import last_move, require_rest
from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.policies import Sampling, Settling
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.residuals import moved_in_gate
from calib_core.full.joint.round import anchored, associate, coarse_stride, descend, gate_of, measure, survey
from calib_core.full.joint.settings import DOUBTING, WATCHING
from calib_core.full.joint.state import Estimate
from calib_core.solver.levenberg import Minimum, Outcome, SharedEquations
from calib_core.types import BoolArray

#: Cosine of a wall seen slantwise, at 60 degrees.
_SLANTWISE = np.array(0.5)


#: The state without what it condemns, or as it is.
Judge = Callable[[Estimation], Estimation]


class Near(NamedTuple):
    """How near to rest a state is. rests: whether it is there, or on the way.   moved: by how much its round moved points, in
    standard deviations of one of them.
    """

    state: Estimation
    rests: bool
    moved: float

    def is_restless(self, settling: Settling) -> bool:
        """Whether its rounds ended because none came nearer to rest than those before."""
        return not self.rests and self.moved >= settling.judged


def settle(data: JointData, state: Estimation, settling: Settling, sampling: Sampling) -> Estimation:
    """With a part of the points, as near to rest as they come."""
    return near_rest(data, state, settling, sampling).state


def near_rest(
    data: JointData,
    state: Estimation,
    settling: Settling,
    sampling: Sampling,
    judge: Judge | None = None,
    turns: int = 0,
    soon: int | None = None,
) -> Near:
    """The same, and whether that is on the way to rest: rounds that move points farther and farther end where they moved least.
    So do those that still move them by much after `soon` rounds, where that is asked for. Rounds that go to and fro by much, none
    nearer to rest than those before, end where they are.

    judge: asked as soon as rounds hardly move, or cease to move less, and once more of what stays; from what it leaves, all
    begins anew.   turns: most times that it does.
    """
    found = _rounds_to_rest(data, state, settling, sampling, judge if turns > 0 else None, soon)
    while not isinstance(found, Near):
        turns -= 1
        found = _rounds_to_rest(data, found, settling, sampling, judge if turns > 0 else None, soon)
    return found


def _rounds_to_rest(
    data: JointData, state: Estimation, settling: Settling, sampling: Sampling, judge: Judge | None, soon: int | None
) -> Near | Estimation:
    """How near to rest they come; or, as soon as the judge condemns something, what it leaves."""
    history, shared = History(), SharedEquations()
    stillest, doubted = state.without_points(), None
    for _ in range(settling.rounds):
        free = not history.holds_cells
        # Points as they were given before, and what was gathered of them, would be there beside the new ones.
        state = state.without_points()
        state, gate = _round_towards_rest(data, state, history, settling, sampling, shared)
        moved = history.moves[-1]
        if free and history.holds_cells:
            judge = judge or doubted
        if judge is not None and (moved < settling.judged or stalls(history.moves, settling)):
            left = _left_by(judge, state)
            if left is not None:
                return left
            if moved < settling.judged:
                judge, doubted = None, judge
        same = history.same_cells(state, settling, gate)
        if rests(moved, settling, led_about=history.led_about, same=same is not None):
            return Near(state if same is None else with_cells(state, same), rests=True, moved=moved)
        if moved == min(history.moves):
            stillest = state.without_points()
        is_late = len(history.moves) == soon and moved >= settling.judged
        if is_late or goes_away(history.moves, settling):
            stillest = replace(stillest, rounds=state.rounds, iterations=state.iterations)
            stillest = associate(data, stillest, gate, stride=coarse_stride(data, stillest, sampling))
            return Near(stillest, rests=False, moved=min(history.moves))
        if is_restless(history.moves, settling):
            return Near(state, rests=False, moved=moved)
    return Near(state, rests=True, moved=history.moves[-1])


def _round_towards_rest(
    data: JointData,
    state: Estimation,
    history: History,
    settling: Settling,
    sampling: Sampling,
    shared: SharedEquations,
) -> tuple[Estimation, Gate]:
    """Planes surveyed and noise measured where they are not held, points given anew, one step of the descent; and their gate."""
    if data.run.settings.estimate_planes:  # otherwise the frame is that of the planes given
        state = anchored(data, state)
    learning = gate_of(state, settling.learning_m, sampling)
    if not history.holds_cells:
        state = history.surveyed(survey(data, state, learning, sampling), settling)
    if not (history.led_about or noise_swings(history.noises, settling.still / learning.sigmas)):
        state = measure(data, state, learning, sampling)
        history.noises.append(state.lidar_noise)
    gate = gate_of(state, settling.settling_m, sampling)
    part = _nearer(data, len(history.moves), WATCHING.settling_round)
    state = associate(part, state, gate, stride=coarse_stride(data, state, sampling))
    before = state.estimate
    # A single step: what another one would add, the next round's first step does.
    state, problem = descend(data, state, iterations=1, tolerance=settling.least_decrease, shared=shared, roughly=True)
    history.moves.append(moved_in_gate(problem, before, state.estimate))
    return state, gate


def _left_by(judge: Judge, state: Estimation) -> Estimation | None:
    """What a judge leaves of it, points to be given anew; None where it condemns nothing."""
    left = judge(state)
    return None if left is state else left.without_points()


@dataclass
class History:
    """What rounds on the way to rest have found, one after the other.

    A cell whose own points move the planes just enough to put it out, and in again without them, would swing for ever: it
    stays out. So would a noise that goes to and fro between two values: the last one stays. Where both lead each other about
    and rounds come no nearer to rest, what all of the last surveys have seen stays, and the noise. A few cells that come and
    go while nothing moves stay out, and all is at rest.

    cells: of each survey.   noises: of each measurement.   moves: by how much each round moved points.   led_about: by cells and
    noise, which are held from then on.   last: cells and noise of the round before.
    """

    cells: list[BoolArray] = field(default_factory=list)
    noises: list[LidarNoise] = field(default_factory=list)
    moves: list[float] = field(default_factory=list)
    led_about: bool = False
    last: tuple[BoolArray, LidarNoise] | None = None

    @property
    def holds_cells(self) -> bool:
        """Whether planes are surveyed no more."""
        return self.led_about or swings(self.cells)

    def surveyed(self, state: Estimation, settling: Settling) -> Estimation:
        """After a survey; with the cells that are held from then on where they have begun to swing, or to lead about."""
        assert state.support is not None
        self.cells.append(state.support.inside)
        self.led_about = wanders(self.moves, settling)
        if not self.holds_cells:
            return state
        seen = self.cells[-DOUBTING.wandering - 1 :] if self.led_about else self.cells[-2:]
        return with_cells(state, np.all(seen, axis=0))

    def same_cells(self, state: Estimation, settling: Settling, gate: Gate) -> BoolArray | None:
        """The cells that this round and the one before it have, where these are the same but for a few, and the noise is."""
        assert state.support is not None
        before, self.last = self.last, (state.support.inside, state.lidar_noise)
        if before is None or not is_same(self.last, before, settling, gate):
            return None
        return self.last[0] & before[0]


def with_cells(state: Estimation, inside: BoolArray) -> Estimation:
    """With these cells of the planes' own, as they were laid out last."""
    assert state.support is not None
    return replace(state, support=PlaneExtents(state.support.normals, inside))


def rests(move: float, settling: Settling, *, led_about: bool, same: bool) -> bool:
    """Whether a round that moved points by so much is the last. led_about: its cells and noise are held.   same: so they were."""
    return move < settling.unmoved or (move < settling.led_about if led_about else same and move < settling.still)


def is_same(
    found: tuple[BoolArray, LidarNoise], last: tuple[BoolArray, LidarNoise], settling: Settling, gate: Gate
) -> bool:
    """Whether a round has surveyed the cells of the one before it, all but a few, and its noise."""
    differing, few = np.count_nonzero(found[0] ^ last[0]), settling.flickering * np.count_nonzero(found[0] | last[0])
    return bool(differing <= few) and is_same_noise(found[1], last[1], settling.still / gate.sigmas)


def is_same_noise(new: LidarNoise, old: LidarNoise, part: float) -> bool:
    """Whether two noises are the same but for this part of them.

    The noise is that across a wall seen slantwise: what is left of the unevenness, which is measured in micrometres, differs
    from round to round by as many as no point feels.
    """
    new_std_m, old_std_m = (float(noise.distance_std_m(_SLANTWISE)) for noise in (new, old))
    limits_differ = (new.farthest_m, new.nearest_m, new.sieve_m) != (old.farthest_m, old.nearest_m, old.sieve_m)
    return not limits_differ and abs(new_std_m - old_std_m) <= part * old_std_m


def stalls(moves: Sequence[float], settling: Settling) -> bool:
    """Whether rounds have ceased to move points less and less: something in them does not stand still."""
    return len(moves) > settling.farther - 1 and moves[-1] > settling.stalled * moves[-2]


def wanders(moves: Sequence[float], settling: Settling) -> bool:
    """Whether rounds that hardly move points any more have ceased to come nearer to rest, so many in a row."""
    last = np.array(moves[-DOUBTING.wandering - 1 :])
    is_told = len(moves) > DOUBTING.wandering + 1 and moves[-1] < settling.judged
    return is_told and bool(np.all(last[1:] > settling.stalled * last[:-1]))


def goes_away(moves: Sequence[float], settling: Settling) -> bool:
    """Whether rounds that moved points by so much, one after the other, are leaving the place where they would rest."""
    last = moves[-settling.farther - 1 :]
    growing = len(last) > settling.farther and bool(np.all(np.diff(last) > 0.0))
    return growing and last[-1] > settling.times_farther * min(moves)


def is_restless(moves: Sequence[float], settling: Settling) -> bool:
    """Whether rounds come no nearer to rest: the last of them all moved points by much, and by as much as those before."""
    some = settling.restless
    last, before = moves[-some:], moves[:-some]
    return len(before) >= some and min(last) >= max(settling.judged, settling.stalled * min(before))


def is_lost(decreases: Sequence[float], settling: Settling) -> bool:
    """Whether descents lead to no fixed point: each of the last predicted much at its start, and as much as those before.

    What one about the point where the one before had ended still has to find is a part of what that one found, where there is a
    point that they lead to.
    """
    last, before = decreases[-settling.lost :], decreases[: -settling.lost]
    return bool(before) and min(last) >= max(settling.lost_decrease, settling.stalled * min(before))


def alternate(
    data: JointData, state: Estimation, settling: Settling, sampling: Sampling, shared: SharedEquations | None = None
) -> tuple[Estimation, JointProblem]:
    """With all points: associate, descend to the fixed point, and again until the gates no longer feel it.

    shared: has the equations of its last steps after it.

    Raises Refused where the calibration still moves after the last round, or where descents led to no fixed point twice: points
    that are given anew once may well show them one.
    """
    last = state.rounds + settling.descents(data.run.settings.max_rounds)
    k, lost, shared = 0, 0, shared or SharedEquations()
    shared.kept = None  # of other unknowns, or of a part of the points
    while True:
        state = associate(_nearer(data, k, WATCHING.resting_round), state, gate_of(state, 0.0, sampling), stride=1)
        before = state.without_points()
        state, problem, arrived = to_fixed_point(
            data, state, settling, most=min(data.run.settings.max_rounds, last - state.rounds), shared=shared
        )
        lost += not arrived
        if moved_in_gate(problem, before.estimate, state.estimate) < settling.settled:
            return state, problem
        if state.rounds >= last or lost >= settling.anew:
            require_rest(before, state, settling.unsettled_sigmas)
            return state, problem
        state, k = state.without_points(), k + 1
        del problem


def to_fixed_point(
    data: JointData, state: Estimation, settling: Settling, *, most: int, shared: SharedEquations
) -> tuple[Estimation, JointProblem, bool]:
    """Solve, preintegrate about the new biases, solve again, until nothing changes or there were so many. And whether that led
    to such a point, or so far: not where descents are lost.

    Each descent finds a part of what the one before it did, and each step within one; what is left after a step that is told by
    that to be the last is not looked at. Where steps are used up and the calibration stands still, more of them would be along
    what hardly anything tells, a drift down a street.
    """
    last, tolerance = state.rounds + most, settling.least_decrease
    firsts: list[float] = []
    problem: JointProblem | None = None
    while True:
        problem, start = None, state  # two problems at once would be the most memory of a solve
        state, problem = descend(
            data, state, iterations=settling.iterations, tolerance=tolerance, relative=settling.least_share,
            shared=shared, along_valleys=True,
        )  # fmt: skip
        assert state.minimum is not None
        is_along_a_valley = state.minimum.outcome in (Outcome.EXHAUSTED, Outcome.CREEPING)
        if is_along_a_valley and stands_still(start, state, settling.stands_sigmas):
            return state, problem, True
        first = state.minimum.first_decrease
        next_one = first * min(1.0, first / firsts[-1]) if firsts else first
        firsts.append(first)
        small = first < settling.fixed_point or next_one < settling.least_decrease
        if (small and state.minimum.outcome is not Outcome.SINGULAR) or state.rounds >= last:
            return state, problem, True
        if is_lost(firsts, settling):
            return state, problem, False
        tolerance = last_step(state.minimum, settling)


def stands_still(before: Estimation, after: Estimation, sigmas: float) -> bool:
    """Whether a descent has moved the calibration by less than this part of its standard deviations."""
    moved, std = last_move(before, after)
    return bool(np.all(np.abs(moved) <= sigmas * std))


def last_step(minimum: Minimum[Estimate], settling: Settling) -> float:
    """From which decrease on a step is the last one: what this descent's steps left of one another, of that, is nothing."""
    if minimum.outcome is not Outcome.CONVERGED or minimum.solution is None:
        return settling.least_decrease
    left = minimum.solution.predicted_decrease / minimum.first_decrease
    return min(settling.last_decrease, settling.least_decrease / max(left, settling.least_share))


def _nearer(data: JointData, k: int, share: float) -> JointData:
    """Each of a number of rounds that nobody knows is such a share of what is left."""
    left = 1.0 - share
    return data.portion(1.0 - left**k, 1.0 - left ** (k + 1))


def swings(cells: Sequence[BoolArray]) -> bool:
    """Whether the surveys have gone to and fro twice. Once may be on the way to rest: noise is still being learnt."""
    if len(cells) < DOUBTING.to_and_fro:
        return False
    one, other = cells[-2:]
    to_and_fro = np.array_equal(other, cells[-3]) and np.array_equal(one, cells[-4])
    return to_and_fro and not np.array_equal(one, other)


def noise_swings(noises: Sequence[LidarNoise], part: float) -> bool:
    """The same of the noise, which is the same but for such a part of it."""
    if len(noises) < DOUBTING.to_and_fro:
        return False
    before, last_but_two, last_but_one, last = noises[-4:]
    to_and_fro = is_same_noise(last, last_but_two, part) and is_same_noise(last_but_one, before, part)
    return to_and_fro and not is_same_noise(last, last_but_one, part)
