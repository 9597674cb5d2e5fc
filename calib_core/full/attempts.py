"""The joint estimation and the assessment, tried in other ways until they give an answer.

    answered                the whole; where data sheets promise too much of a sensor, again with wider priors of its parameters
      solve                 the joint estimation; where propagation spoils it, of the followed scans alone
      judged, weighed       what of it is known; what shows only at the end (`assess/late_parameters.py`) is let in; on it goes
      consistent            where one of the sensors' own parameters runs away: as much is allowed it, if all parts agree then
      with_sensors_held     otherwise: they are held first, and let go at the end

What an attempt that led nowhere has said is taken back (`Run.attempt`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calib_core.errors import Refused
from calib_core.full.assess.confidence import Confidence
from calib_core.full.assess.late_parameters import still_show, with_late_blocks
from calib_core.full.assess.odd_planes import without_odd_planes
from calib_core.full.assess.plausibility import implausible
from calib_core.full.assess.verdict import answer, weigh
from calib_core.full.initialise.clock_rate import ClocksApart, may_stretch
from calib_core.full.initialise.proposed_planes import tracked
from calib_core.full.initialise.settings import CLOCK_RATES
from calib_core.full.initialise.start import LidarTrack, Start
from calib_core.full.joint.bounds import SensorsAstray
from calib_core.full.joint.data_sheets import beyond_by, beyond_sheets, say_beyond, say_roomy, with_room, without_sheet
from calib_core.full.joint.doubtful_planes import level_at_m, require_sound_choice, say_left_out
from calib_core.full.joint.estimation import Estimation, JointData, Solved
from calib_core.full.joint.first_estimate import begin
from calib_core.full.joint.kept_motion import KeptMotion
from calib_core.full.joint.plane_choice import with_choice
from calib_core.full.joint.plane_judgement import with_strayed_marked
from calib_core.full.joint.schedule import FULL, Schedule
from calib_core.full.joint.solve import estimate_chosen, estimate_further, estimate_jointly, motion_by_all
from calib_core.full.odometry.reference import Followed
from calib_core.full.run import Run
from calib_core.method import Answer
from calib_core.settings import CalibrateSettings
from calib_core.types import InitialGuess, Plane


@dataclass(frozen=True)
class MotionByAll:
    """The motion by all planes that were followed, chosen or not: what is known then, the problem it was found in, the track."""

    data: JointData
    state: Estimation
    followed: Followed


@dataclass(frozen=True)
class Task:
    """A joint estimation that is to be done.

    followed: the lidar's track, with the planes that count.   lidar, start: the track as arrays, and the start values.
    guess: what is known beforehand; None for nothing.   settings: the caller's, as attempts change those of the run.
    motion: the motion by all planes that were followed, where those that count are a choice among them; None: it is found by
    those that count.   kept: where that motion is kept for the next solve with these `settings`; None for nowhere.
    """

    followed: Followed
    lidar: LidarTrack
    start: Start
    guess: InitialGuess | None
    settings: CalibrateSettings
    schedule: Schedule = FULL
    motion: MotionByAll | None = None
    kept: KeptMotion | None = None

    def counting(
        self, schedule: Schedule, planes: Sequence[Plane], late: Sequence[bool] = (), dropped: Sequence[Plane] = ()
    ) -> Task:
        """The same task with these planes. late: which of them came into view on the way.   dropped: those that must not."""
        followed = replace(self.followed, planes=list(planes), late=tuple(late), dropped=list(dropped))
        return replace(self, schedule=schedule, followed=followed)


def answered(run: Run, task: Task, further: Callable[[Run], Solved] | None = None) -> Answer:
    """The answer of a task.

    Where a sensor's own parameters lie beyond what its data sheet allows, all is solved with the wide priors of a sensor that
    nobody knows: from where the solve came to rest if every plane still counts there, otherwise from the start, as the narrow
    priors may have cost a plane. Where parameters run away instead, see `consistent` and `with_sensors_held`.

    further: makes a solve out of one that has come to rest; None: the task is solved from the start.
    Raises Refused where no attempt gives an answer.
    """
    unknown = run.settings.intrinsics not in {"off", "consider"}
    unsay = run.attempt()
    from_there: Callable[[Run], Solved] | None = None
    try:
        found = solve(run, task) if further is None else further(run)
        beyond = beyond_sheets(found) if unknown else None
        allowing = None if beyond is None else without_sheet(run, beyond)
        if allowing is None:
            return judged(run, found, task)
        if {plane.name for plane in task.followed.planes} <= {plane.name for plane in found.planes}:
            from_there = partial(estimate_further, solved=found, schedule=FULL)
    except Refused as refused:
        if not (unknown and refused.code.startswith("solve.")):
            raise
        if isinstance(refused, SensorsAstray) and refused.block == "clock_rate" and may_stretch(run):
            rate = 1e-6 * refused.value
            offset_s = task.start.rotation.time_offset_s
            raise ClocksApart(run, rate, CLOCK_RATES.pulled * abs(rate), offset_s) from refused
        beyond = beyond_by(refused) if isinstance(refused, SensorsAstray) else None
        allowing = None if beyond is None else without_sheet(run, beyond)
    if from_there is None:
        unsay()
    if beyond is None or allowing is None:
        roomy = None if beyond is None else with_room(run, beyond)
        found_roomy = None if roomy is None else consistent(roomy, task)
        if beyond is None or found_roomy is None:
            return with_sensors_held(run, task)
        say_roomy(run, beyond)
        return found_roomy
    say_beyond(run, beyond)
    return answered(allowing, task, from_there)


def consistent(run: Run, task: Task) -> Answer | None:
    """The answer of a task, if all parts of the recording agree with it; None otherwise. What bends a sensor's parameters beyond
    all sheets may be a wall or a mount: these have parts disagree, and what the sensor itself does has not.
    """
    unsay = run.attempt()
    try:
        solved = solve(run, task)
        if task.schedule.chosen:
            require_sound_choice(solved)
        solved, trust = weighed(run, solved, task.schedule)
        if not _beyond_noise(trust):
            return answer(run, solved, trust, task.lidar)
    except Refused:
        pass
    unsay()
    return None


def with_sensors_held(run: Run, task: Task) -> Answer:
    """The answer by a solve with the sensors' own parameters held at their priors, which are let go once all else is known. Where
    they run away even then, they stay held, and their priors' uncertainty is counted in the error bars.

    Accelerometers that are far apart make parameters run away: first the solve goes on with these distances as unknowns, if they
    show at its end; then without.   Raises Refused where the solve with held sensors gives no answer.
    """
    held = replace(run, settings=run.settings.model_copy(update={"intrinsics": "consider"}))
    without = solve(held, task)
    unsay, why = run.attempt(), ""
    for begin_from, shows in ((with_late_blocks(run, without, ()), still_show), (without, None)):
        if begin_from is None:
            continue
        try:
            freed = estimate_further(run, solved=begin_from, schedule=FULL)
            if shows is None or shows(freed):
                return judged(run, freed, task)
        except Refused as refused:
            if not refused.code.startswith("solve."):
                raise
            if isinstance(refused, SensorsAstray):
                why = f"; it needs {refused.needed}: check that sensor, if no plane bends or moves"
        unsay()
    text = (
        "with the sensors' own parameters as unknowns the solve found no answer: the parameters are held instead, and the errors "
        "that data sheets allow are counted in the error bars"
    )
    run.say("warning", "sensor.astray", text + why)
    return judged(held, without, task)


def judged(run: Run, solved: Solved, task: Task) -> Answer:
    """The answer made of a solve, with its uncertainty. Raises Refused where it cannot be true, or where the planes that a person
    chose do not hold it.
    """
    if task.schedule.chosen:
        require_sound_choice(solved)
    return answer(run, *weighed(run, solved, task.schedule), task.lidar)


def weighed(run: Run, solved: Solved, schedule: Schedule) -> tuple[Solved, Confidence]:
    """A solve and what is known of the calibration by it. As long as something of the sensors shows only at the end, the solve
    goes on with that as an unknown; then without small planes that alone are at odds with all others. Where that leads nowhere,
    the one before counts.
    """
    unsay = run.attempt()
    trust = weigh(run, solved, is_choice=schedule.chosen)
    while (late := with_late_blocks(run, solved, trust.found)) is not None:
        unsay()
        further = _weighed_further(run, late, schedule)
        if further is None:
            unsay()
            return solved, weigh(run, solved, is_choice=schedule.chosen)
        solved, trust, unsay = further
    rules = schedule.planes
    left = None if rules is None else without_odd_planes(solved, trust.apart, trust.found, rules)
    if left is None:
        return solved, trust
    unsay()
    kept = {plane.name for plane in left.state.planes}
    gone = np.array([plane.name not in kept for plane in solved.planes])
    level_m = level_at_m(solved.planes, solved.estimate)[gone]
    say_left_out(run, [solved.planes[k] for k in np.flatnonzero(gone)], np.zeros((len(level_m), 3)), level_m)
    further = _weighed_further(run, left, schedule)
    if further is not None and _beyond_noise(further[1]) < _beyond_noise(trust):
        return further[:2]
    unsay()
    return solved, weigh(run, solved, is_choice=schedule.chosen)


def _beyond_noise(trust: Confidence) -> frozenset[str]:
    """The ways of taking a recording apart by which its parts disagree."""
    return frozenset(each.name for each in trust.found if each.is_beyond_noise)


def _weighed_further(
    run: Run, begun: Solved, schedule: Schedule
) -> tuple[Solved, Confidence, Callable[[], None]] | None:
    """The solve that goes on from one, what is known by it, and what takes back that this was said; None without an answer."""
    try:
        further = estimate_further(run, begun, FULL)
        unsay = run.attempt()
        return further, weigh(run, further, is_choice=schedule.chosen), unsay
    except Refused as refused:
        if not refused.code.startswith("solve."):
            raise
        return None


def motion_by_everything(run: Run, task: Task, kept: KeptMotion) -> MotionByAll | None:
    """The motion by all planes that were followed, from which the solve of a choice among them begins; None where none fits."""
    freely = replace(run, settings=run.settings.model_copy(update={"estimate_planes": True}))
    followed = task.followed
    found = replace(followed, planes=[replace(plane, suggested=True) for plane in followed.planes])
    data, first, _ = begin(freely, found, task.lidar, task.start, task.guess, FULL)
    try:
        state = kept.recall(run) or motion_by_all(kept.keeping(data), first, FULL)
        state = with_strayed_marked(data, state, FULL)
    except Refused:
        return None
    return MotionByAll(data, state, followed)


def solve(run: Run, task: Task) -> Solved:
    """The joint estimation of a task. Where it gives no plausible answer, and was propagated over scans that the lidar alone
    could not follow, that of the followed scans alone. Raises Refused.
    """
    followed, motion, schedule = task.followed, task.motion, task.schedule
    begin_here = partial(begin, run, followed, task.lidar, task.start, task.guess, schedule)
    begun = None
    iterations = 0
    unsay = run.attempt()
    try:
        if motion is None:
            begun = begin_here()
            data, first, _ = begun
            keeps = task.kept is not None and run.settings == task.settings
            solved = estimate_jointly(task.kept.keeping(data) if keeps and task.kept else data, first, schedule)
        else:
            which: list[int] = tracked(motion.followed, followed.planes).tolist()
            of_all = motion.data, motion.state, which
            solved = estimate_chosen(*with_choice(run, of_all, followed, schedule), schedule)
        if _all_followed(run, followed) or implausible(run, solved) is None:
            return solved
        iterations = solved.iterations
    except Refused:
        if _all_followed(run, followed):
            raise
    unsay()
    run.say(
        "warning", "planes.followed", "only the scans over which the lidar's planes alone could be followed are used"
    )
    alone = replace(schedule, planes=None, propagation=None)
    data, first, _ = begun or begin_here()
    return estimate_jointly(data, replace(first, iterations=iterations), alone)


def _all_followed(run: Run, followed: Followed) -> bool:
    return len(followed.motions) >= len(run.recording.scans)
