"""What is wrong with planes that a person chose, and that count all the same."""

from __future__ import annotations

from calib_core.full.assess.settings import PLAUSIBLE
from calib_core.full.joint.doubtful_planes import standings
from calib_core.full.joint.estimation import Solved
from calib_core.full.joint.residuals import plane_residuals
from calib_core.full.planes.plane_tests import WORDS, doubts, fault_of, is_mostly_bent
from calib_core.full.run import Run


def say_doubtful_choice(run: Run, solved: Solved, *, faults_count: bool = True, torn: bool = False) -> None:
    """Name the doubtful among the planes that a person chose: they count all the same.

    faults_count: whether what moves or bends is said, too; what no point lies on is, always.   torn: stretches of time contradict
    each other, and what strayed in the motion by all is why: a plane that few others hold against is followed, and fits.

    Doubtful is also what was while gates were wide: narrow ones see of a box before a wall what lies near the plane.
    """
    stand = standings(solved.problem, solved.estimate)
    seen = [
        (fault_of(row) or plane.fault or ("moved" if torn and plane.strayed else "")) if faults_count else None
        for row, plane in zip(doubts(stand), solved.planes, strict=True)
    ]
    points = [count for _, count in plane_residuals(solved.problem, solved.estimate)]
    for plane, fault, count in zip(solved.planes, seen, points, strict=True):
        if plane.chosen and count < PLAUSIBLE.unseen_share * sum(points):
            seen_by = f"{count} of {sum(points):,} points lie" if count else "no point lies"
            what = f"{plane.name} {WORDS[fault]}, and {seen_by} on it" if fault else f"{seen_by} on {plane.name}"
            text = f"{what} in the end: it has next to no effect on the answer, and may not be where it was placed"
            run.say("warning", "planes.unseen", text)
        elif plane.chosen and fault:
            run.say(
                "warning",
                "planes.doubted",
                f"{plane.name} {WORDS[fault]}, but is used because it was chosen: leave it out and solve again",
            )
    if faults_count and is_mostly_bent(stand):
        run.say(
            "warning",
            "planes.bent",
            "most of the chosen planes are not flat, or are not planes at all; choose walls, floor and ceiling, or use the "
            "suggested planes",
        )
