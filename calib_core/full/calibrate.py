"""The default method, one recording from arrays to an answer: THE page.

    clocks, noise -> planes of the clearest scan -> lidar-only motion -> time offset, rotation, gravity, lever arm
    -> joint estimation, coarse to fine, over all that the recording holds -> what of it is known, and whether it can be

Every stage refuses (`Refused`) what it cannot give, in a sentence for a person.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from calib_core.document import Answer
from calib_core.errors import Refused
from calib_core.full.assess.confidence import Confidence
from calib_core.full.assess.late import still_show, with_late_blocks
from calib_core.full.assess.plausibility import implausible
from calib_core.full.assess.verdict import answer, weigh
from calib_core.full.initialise.given_frame import in_the_tracks_frame
from calib_core.full.initialise.initialise import initialise
from calib_core.full.initialise.kept import follow_or_recall, key_of
from calib_core.full.initialise.proposed import choice_among, late_and_dropped, lost, named, own_and_merged, tracked
from calib_core.full.initialise.start import LidarTrack, Start
from calib_core.full.joint.begin import begin
from calib_core.full.joint.bounds import SensorsAstray
from calib_core.full.joint.choice import with_choice
from calib_core.full.joint.doubt import face_three_ways, require_sound_choice
from calib_core.full.joint.estimation import Estimation, JointData, Solved
from calib_core.full.joint.kept_motion import KeptMotion, called_as
from calib_core.full.joint.schedule import CHOSEN, FULL, PARTLY, Schedule
from calib_core.full.joint.sheets import beyond_by, beyond_sheets, say_beyond, without_sheet
from calib_core.full.joint.solve import estimate_chosen, estimate_further, estimate_jointly, motion_by_all
from calib_core.full.odometry.reference import Followed
from calib_core.full.run import Run
from calib_core.types import InitialGuess, Plane


def calibrate_full(
    run: Run, planes: Sequence[Plane] | None, guess: InitialGuess | None, kept_in: Path | None = None
) -> Answer:
    """The answer of a prepared run. planes: those that count in the joint estimation; None for all that are
    found.   guess: what is known beforehand, None for nothing.   kept_in: folder for what the next solve need not do again."""
    if not run.settings.estimate_planes and not (planes and all(not plane.suggested for plane in planes)):
        text = "the planes are held where a single scan shows them, which may be centimetres off: let them be estimated too, "
        run.say("warning", "planes.held", text + "unless they were surveyed")
    planes = in_the_tracks_frame(run, planes)
    followed = follow_or_recall(run, planes, kept_in)
    lidar, start = initialise(run, followed.motions, followed.planes, guess)
    up = -start.linear.gravity / np.linalg.norm(start.linear.gravity)
    found = named(followed, (), up)
    kept = KeptMotion.of(kept_in, key_of(run) if kept_in else "", run, found, lidar, guess)
    followed = named(followed, planes or (), up)
    # Only without a choice the map may be another scan's.
    choice = choice_among(followed.proposals, planes) if followed.proposals else None
    late, dropped = late_and_dropped(followed, choice) if choice else ([], [])
    unsay = run.attempt()
    own = own_planes(run, followed, choice, late)
    motion: Motion | None = None
    if choice is not None:
        # Where all planes are chosen by hand, what comes into view has told the motion and is not used.
        joins = any(plane.suggested for plane in choice)
        saying = run if joins else run.keeping("planes.found")
        motion = motion_by_everything(saying, found, lidar, start, guess, kept)
        motion = None if motion is None else Motion(motion.data, called_as(motion.state, followed.planes, up), followed)

    asked = run.settings
    is_whole = choice is None and asked.estimate_planes and _called_alike(followed.planes, found.planes)

    def answered(schedule: Schedule, counting: Sequence[Plane], is_late: Sequence[bool] = ()) -> Answer:
        track = replace(followed, planes=list(counting), late=tuple(is_late), dropped=dropped)

        def solved(run: Run) -> Solved:
            return solve(
                run, track, lidar, start, guess, schedule, motion, kept if is_whole and run.settings == asked else None
            )

        def judged(run: Run, solved: Solved) -> Answer:
            if schedule.chosen:
                require_sound_choice(solved)
            return answer(run, *weighed(run, solved, is_choice=schedule.chosen), lidar)

        return with_sensors_as_they_are(run, counting, solved, judged)

    if choice is None:
        return answered(FULL, [replace(plane, suggested=True) for plane in followed.planes], followed.late)
    by_hand = [replace(plane, suggested=False) for plane in choice]
    if not any(plane.suggested for plane in choice):
        return answered(CHOSEN, by_hand)
    came = [replace(plane, suggested=True) for plane in late]
    try:
        return answered(PARTLY, [*own, *came], [False] * len(own) + [True] * len(came))
    except Refused as refused:
        if refused.code == "planes.doubtful":
            raise
        unsay()
        text = "without the doubtful among these planes there is no answer, and all of them count"
        run.say("info", "planes.open", f"{text}: {refused}")
        return answered(CHOSEN, by_hand)


def own_planes(run: Run, followed: Followed, choice: Sequence[Plane] | None, late: Sequence[Plane]) -> list[Plane]:
    """Those of a choice that are planes of their own, and others are named; all of it where these and what came late do not face
    three ways. choice: None for the untouched suggestion, of which the track has its own already."""
    own, gone = ([], lost(followed)) if choice is None else own_and_merged(followed, choice)
    if choice is not None and not face_three_ways(np.array([plane.normal for plane in [*own, *late]])):
        return list(choice)
    for plane in gone:
        run.say("info", "planes.merged", f"{plane.name} is no plane of its own in the straightened sweep: left out")
    return own


def with_sensors_as_they_are(
    run: Run,
    counting: Sequence[Plane],
    solved: Callable[[Run], Solved],
    judged: Callable[[Run, Solved], Answer],
    further: Callable[[Run], Solved] | None = None,
) -> Answer:
    """What is judged of what is solved; where the sensors turn out to be no better than any, by looser priors of theirs: from
    the end on where every plane counts there, else anew, as narrow priors may have cost a plane.

    Where the sensors' own parameters run away, see `with_sensors_held`.   counting: the planes that the solve begins with.
    further: from where another came to rest; None for from the start.
    """
    unknown = run.settings.intrinsics not in {"off", "consider"}
    unsay = run.attempt()
    from_there: Callable[[Run], Solved] | None = None
    try:
        found = (further or solved)(run)
        beyond = beyond_sheets(found) if unknown else None
        allowing = None if beyond is None else without_sheet(run, beyond)
        if allowing is None:
            return judged(run, found)
        if {plane.name for plane in counting} <= {plane.name for plane in found.planes}:
            from_there = partial(estimate_further, solved=found, schedule=FULL)
    except Refused as refused:
        if not (unknown and refused.code.startswith("solve.")):
            raise
        beyond = beyond_by(refused) if isinstance(refused, SensorsAstray) else None
        allowing = None if beyond is None else without_sheet(run, beyond)
    if from_there is None:
        unsay()
    if beyond is None or allowing is None:
        return with_sensors_held(run, solved, judged)
    say_beyond(run, beyond)
    return with_sensors_as_they_are(allowing, counting, solved, judged, from_there)


def with_sensors_held(run: Run, solved: Callable[[Run], Solved], judged: Callable[[Run, Solved], Answer]) -> Answer:
    """The same with the sensors held at their priors, which keeps what would run away with them: let go once all else is known;
    and where they still run away, held to the end and counted in the error bars.

    Accelerometers that are far apart make them run away: what of this kind shows already is let go along, if it shows then.
    """
    held = replace(run, settings=run.settings.model_copy(update={"intrinsics": "consider"}))
    without = solved(held)
    unsay = run.attempt()
    for begin_from, shows in ((with_late_blocks(run, without, ()), still_show), (without, None)):
        if begin_from is None:
            continue
        try:
            freed = estimate_further(run, solved=begin_from, schedule=FULL)
            if shows is None or shows(freed):
                return judged(run, freed)
        except Refused as refused:
            if not refused.code.startswith("solve."):
                raise
        unsay()
    text = (
        "with the sensors' own parameters as unknowns the solve found no answer: the sensors are taken as their data sheets "
        "have them, and what they may be off by is counted in the error bars"
    )
    run.say("warning", "sensor.astray", text)
    return judged(held, without)


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


@dataclass(frozen=True)
class Motion:
    """A motion that all structure has told, the problem that it was told in, and the track's planes."""

    data: JointData
    state: Estimation
    followed: Followed


def motion_by_everything(
    run: Run, followed: Followed, lidar: LidarTrack, start: Start, guess: InitialGuess | None, kept: KeptMotion
) -> Motion | None:
    """The motion that all planes tell that were followed, for a choice to begin from; None where they lead nowhere."""
    freely = replace(run, settings=run.settings.model_copy(update={"estimate_planes": True}))
    found = replace(followed, planes=[replace(plane, suggested=True) for plane in followed.planes])
    data, first, _ = begin(freely, found, lidar, start, guess, FULL)
    try:
        state = kept.recall(run) or motion_by_all(kept.keeping(data), first, FULL)
    except Refused:
        return None
    return Motion(data, state, followed)


def solve(
    run: Run,
    followed: Followed,
    lidar: LidarTrack,
    start: Start,
    guess: InitialGuess | None,
    schedule: Schedule,
    motion: Motion | None,
    kept: KeptMotion | None = None,
) -> Solved:
    """The joint estimation; where what it was propagated over spoils it, that of the followed scans alone.

    motion: of which the planes followed are a choice; None where they tell it themselves.   kept: where that is kept for the
    next solve, None for nowhere.
    """
    begun = None
    iterations = 0
    unsay = run.attempt()
    try:
        if motion is None:
            begun = begin(run, followed, lidar, start, guess, schedule)
            data, first, _ = begun
            solved = estimate_jointly(data if kept is None else kept.keeping(data), first, schedule)
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
    data, first, _ = begun or begin(run, followed, lidar, start, guess, schedule)
    return estimate_jointly(data, replace(first, iterations=iterations), alone)


def _called_alike(some: Sequence[Plane], others: Sequence[Plane]) -> bool:
    return [plane.name for plane in some] == [plane.name for plane in others]


def _all_followed(run: Run, followed: Followed) -> bool:
    return len(followed.motions) >= len(run.recording.scans)
