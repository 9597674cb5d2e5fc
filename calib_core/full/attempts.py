"""What is tried until a joint estimation gives an answer: over all of the recording or over what was followed alone, with the
sensors as their data sheets have them, as any may be, or held; and what shows only at its end.

An attempt that leads nowhere has said nothing: `Run.attempt` takes back what it has.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from calib_core.errors import Refused
from calib_core.full.assess.confidence import Confidence
from calib_core.full.assess.late import still_show, with_late_blocks
from calib_core.full.assess.plausibility import implausible
from calib_core.full.assess.verdict import answer, weigh
from calib_core.full.initialise.proposed import tracked
from calib_core.full.initialise.start import LidarTrack, Start
from calib_core.full.joint.begin import begin
from calib_core.full.joint.bounds import SensorsAstray
from calib_core.full.joint.choice import with_choice
from calib_core.full.joint.doubt import require_sound_choice
from calib_core.full.joint.estimation import Estimation, JointData, Solved
from calib_core.full.joint.kept_motion import KeptMotion
from calib_core.full.joint.schedule import FULL, Schedule
from calib_core.full.joint.sheets import beyond_by, beyond_sheets, say_beyond, without_sheet
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

    followed: the lidar's track, with the planes that count.   lidar, start, guess: what it begins with.   motion: of which these
    planes are a choice; None where they tell it themselves.   kept: where that motion is kept for the next solve with
    these `settings`, None for nowhere.
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
        """The same with these planes. late: which of them came into view.   dropped: what shall not come into view again."""
        followed = replace(self.followed, planes=list(planes), late=tuple(late), dropped=list(dropped))
        return replace(self, schedule=schedule, followed=followed)


def answered(run: Run, task: Task, further: Callable[[Run], Solved] | None = None) -> Answer:
    """What is judged of what is solved; where the sensors turn out to be no better than any, by looser priors of theirs: from
    the end on where every plane counts there, else anew, as narrow priors may have cost a plane.

    Where the sensors' own parameters run away, see `with_sensors_held`.   further: from where another came to rest; None for
    from the start.
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
        beyond = beyond_by(refused) if isinstance(refused, SensorsAstray) else None
        allowing = None if beyond is None else without_sheet(run, beyond)
    if from_there is None:
        unsay()
    if beyond is None or allowing is None:
        return with_sensors_held(run, task)
    say_beyond(run, beyond)
    return answered(allowing, task, from_there)


def with_sensors_held(run: Run, task: Task) -> Answer:
    """The same with the sensors held at their priors, which keeps what would run away with them: let go once all else is known;
    and where they still run away, held to the end and counted in the error bars.

    Accelerometers that are far apart make them run away: what of this kind shows already is let go along, if it shows then.
    """
    held = replace(run, settings=run.settings.model_copy(update={"intrinsics": "consider"}))
    without = solve(held, task)
    unsay = run.attempt()
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
        unsay()
    text = (
        "with the sensors' own parameters as unknowns the solve found no answer: the sensors are taken as their data sheets "
        "have them, and what they may be off by is counted in the error bars"
    )
    run.say("warning", "sensor.astray", text)
    return judged(held, without, task)


def judged(run: Run, solved: Solved, task: Task) -> Answer:
    """The answer, with what is known by it. Raises Refused where a choice of planes does not hold it, or it cannot be true."""
    is_choice = task.schedule.chosen
    if is_choice:
        require_sound_choice(solved)
    return answer(run, *weighed(run, solved, is_choice=is_choice), task.lidar)


def weighed(run: Run, solved: Solved, *, is_choice: bool) -> tuple[Solved, Confidence]:
    """What is known by a solve; gone on with what of the sensors shows only at its end, until nothing more does."""
    unsay = run.attempt()
    trust = weigh(run, solved, is_choice=is_choice)
    while (late := with_late_blocks(run, solved, trust.found)) is not None:
        unsay()
        try:
            further = estimate_further(run, late, FULL)
            unsay_further = run.attempt()
            trust = weigh(run, further, is_choice=is_choice)
        except Refused as refused:
            if not refused.code.startswith("solve."):
                raise
            unsay()
            return solved, weigh(run, solved, is_choice=is_choice)
        solved, unsay = further, unsay_further
    return solved, trust


def motion_by_everything(run: Run, task: Task, kept: KeptMotion) -> MotionByAll | None:
    """The motion that all planes tell that were followed, for a choice to begin from; None where they lead nowhere."""
    freely = replace(run, settings=run.settings.model_copy(update={"estimate_planes": True}))
    followed = task.followed
    found = replace(followed, planes=[replace(plane, suggested=True) for plane in followed.planes])
    data, first, _ = begin(freely, found, task.lidar, task.start, task.guess, FULL)
    try:
        state = kept.recall(run) or motion_by_all(kept.keeping(data), first, FULL)
    except Refused:
        return None
    return MotionByAll(data, state, followed)


def solve(run: Run, task: Task) -> Solved:
    """The joint estimation; where what it was propagated over spoils it, that of the followed scans alone."""
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
    run.say("warning", "planes.followed", "only the scans that the lidar alone could follow are used")
    alone = replace(schedule, planes=None, propagation=None)
    data, first, _ = begun or begin_here()
    return estimate_jointly(data, replace(first, iterations=iterations), alone)


def _all_followed(run: Run, followed: Followed) -> bool:
    return len(followed.motions) >= len(run.recording.scans)
