"""The default method, one recording from arrays to an answer: THE page.

    clocks, noise -> planes of the clearest scan -> lidar-only motion -> time offset, rotation, gravity, lever arm
    -> joint estimation, coarse to fine, over all that the recording holds -> what of it is known, and whether it can be

Every stage refuses (`Refused`) what it cannot give, in a sentence for a person. The page itself is `by_planes`; around it, all
planes stand in for a choice that gives no answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib_core.errors import Refused
from calib_core.full.attempts import MotionByAll, Task, answered, motion_by_everything
from calib_core.full.initialise.given_frame import in_the_tracks_frame
from calib_core.full.initialise.initialise import initialise
from calib_core.full.initialise.kept_track import follow_or_recall, key_of
from calib_core.full.initialise.proposed_planes import choice_among, late_and_dropped, lost, named, own_and_merged
from calib_core.full.joint.doubtful_planes import face_three_ways
from calib_core.full.joint.kept_motion import KeptMotion, called_as
from calib_core.full.joint.schedule import CHOSEN, FULL, PARTLY
from calib_core.full.odometry.reference import Followed
from calib_core.full.run import Run
from calib_core.method import Answer
from calib_core.types import FloatArray, InitialGuess, Plane

#: What refusals are about that other planes might not meet; the others are about readings, clouds, or a rig that stood still.
_OF_PLANES = frozenset({"planes", "start", "solve"})


class ByChoice(Refused):
    """A choice of planes, by hand or what is left of a suggestion, gives no answer; code and text are the refusal's."""

    def __init__(self, refused: Refused) -> None:
        super().__init__(refused.code, str(refused))


def calibrate_full(
    run: Run,
    planes: Sequence[Plane] | None,
    guess: InitialGuess | None,
    cache_dir: Path | None = None,
    *,
    told_at_ns: int | None = None,
) -> Answer:
    """The answer of a prepared run.

    planes: those that count in the joint estimation; None for all that are found. Where a choice gives no answer and all that are
    found without it do, theirs is given, and said: it is worth more than none, and each is judged by what is seen of it.
    guess: what is known beforehand, None for nothing.   cache_dir: folder for what the next solve need not do again.
    told_at_ns: stamp of the scan that the planes are told in, where scans were left out; None: none were.
    """
    unsay = run.attempt()
    try:
        return by_planes(run, planes, guess, cache_dir, told_at_ns)
    except Refused as failed:
        by_hand = any(not plane.suggested for plane in planes or ())
        is_held = not run.settings.estimate_planes  # the frame is theirs
        if not (by_hand or isinstance(failed, ByChoice)) or is_held or failed.code.partition(".")[0] not in _OF_PLANES:
            raise
        say_again = run.attempt()
        unsay()
        try:
            answer = by_planes(run, None, guess, cache_dir)
        except Refused:
            say_again()
            raise failed from None
        why = str(failed).partition(";")[0].replace("the chosen planes", "they", 1)  # without what to do
        text = f"the chosen planes give no answer ({why}); the answer uses all planes that were found instead"
        run.say("warning", "planes.instead", f"{text}: check these, or choose walls, floor and ceiling")
        return answer


def by_planes(
    run: Run,
    planes: Sequence[Plane] | None,
    guess: InitialGuess | None,
    cache_dir: Path | None,
    told_at_ns: int | None = None,
) -> Answer:
    """The answer by a choice of planes, or by all that are found, of which those that turn out to be none are left out.

    Raises Refused.
    """
    _say_of_held_planes(run, planes)
    planes, begins = in_the_tracks_frame(run, planes, told_at_ns)
    followed = follow_or_recall(run, planes, cache_dir, begins)
    lidar, start = initialise(run, followed.motions, followed.planes, guess)
    up = -start.linear.gravity / np.linalg.norm(start.linear.gravity)
    found, followed = named(followed, (), up), named(followed, planes or (), up)
    of_found = Task(found, lidar, start, guess, run.settings)
    kept = KeptMotion.of(cache_dir, key_of(run) if cache_dir else "", run, found, lidar, guess)
    # Only without a choice the map may be another scan's.
    choice = choice_among(followed.proposals, planes) if followed.proposals else None
    if choice is not None:
        try:
            return of_choice(run, replace(of_found, followed=followed), choice, of_found, kept, up)
        except Refused as refused:
            raise ByChoice(refused) from refused
    for plane in lost(followed):
        _say_merged(run, plane)
    every = [replace(plane, suggested=True) for plane in followed.planes]
    is_as_found = run.settings.estimate_planes and _called_alike(followed.planes, found.planes)
    task = of_found.counting(FULL, every, followed.late)
    return answered(run, replace(task, kept=kept if is_as_found else None))


def of_choice(
    run: Run, task: Task, choice: Sequence[Plane], of_found: Task, kept: KeptMotion, up: FloatArray
) -> Answer:
    """The answer where a person chose among the planes that were followed: all planes tell the motion first, the chosen ones go
    on from there.

    Where all were chosen by hand they count, whatever they are. Otherwise those that nobody insists on are left out where they
    turn out not to be planes, and planes that came into view on the way count as well.
    task, of_found: with the planes called as the person calls them, and as the program does.   up: (3,) unit, map frame.
    """
    late, dropped = late_and_dropped(task.followed, choice) if choice else ([], [])
    unsay = run.attempt()
    own = own_planes(run, task.followed, choice, late)
    all_by_hand = not any(plane.suggested for plane in choice)
    # Where all planes are chosen by hand, what comes into view has told the motion and is not used.
    motion = motion_by_everything(run.keeping("planes.found") if all_by_hand else run, of_found, kept)
    if motion is not None:
        state = called_as(motion.state, task.followed.planes, up)
        task = replace(task, motion=MotionByAll(motion.data, state, task.followed))
    by_hand = task.counting(CHOSEN, [replace(plane, suggested=False) for plane in choice], dropped=dropped)
    if all_by_hand:
        return answered(run, by_hand)
    came = [replace(plane, suggested=True) for plane in late]
    is_late = [False] * len(own) + [True] * len(came)
    try:
        return answered(run, task.counting(PARTLY, [*own, *came], is_late, dropped))
    except Refused as refused:
        if refused.code == "planes.doubtful":
            raise
        unsay()
        text = "without the doubtful ones among these planes there is no answer, so all of them are used"
        run.say("info", "planes.open", f"{text}: {refused}")
        return answered(run, by_hand)


def own_planes(run: Run, followed: Followed, choice: Sequence[Plane], late: Sequence[Plane]) -> list[Plane]:
    """The chosen planes without those that are another's in the straightened sweep, which are said; all of the choice where the
    others, with the late ones, do not face three ways.
    """
    own, gone = own_and_merged(followed, choice)
    if not face_three_ways(np.array([plane.normal for plane in [*own, *late]])):
        return list(choice)
    for plane in gone:
        _say_merged(run, plane)
    return own


def _say_merged(run: Run, plane: Plane) -> None:
    run.say("info", "planes.merged", f"{plane.name} is part of another plane in the straightened sweep: left out")


def _say_of_held_planes(run: Run, planes: Sequence[Plane] | None) -> None:
    """That planes are held which nobody has surveyed: proposed ones, or none in particular."""
    if not run.settings.estimate_planes and not (planes and all(not plane.suggested for plane in planes)):
        text = "the planes are held where a single scan shows them, which may be wrong by centimetres"
        run.say("warning", "planes.held", f"{text}: let the solve estimate them, unless they were surveyed")


def _called_alike(some: Sequence[Plane], others: Sequence[Plane]) -> bool:
    return [plane.name for plane in some] == [plane.name for plane in others]
