"""Which planes count under which schedule, and what is said of the others: the page's decisions about a choice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.errors import Refused
from calib_core.full import attempts
from calib_core.full import calibrate as page
from calib_core.full.joint.schedule import CHOSEN, FULL, PARTLY, Schedule
from calib_core.full.odometry.reference import Followed
from calib_core.full.run import Run
from calib_core.message_log import MessageLog
from calib_core.settings import CalibrateSettings
from calib_core.types import Plane

GIVEN = [Plane("floor", np.array([0.0, 0.0, 1.0]), 1.0), Plane("wall", np.array([1.0, 0.0, 0.0]), 3.0)]
#: Gravity along a wall: nothing here is upright.
START = SimpleNamespace(linear=SimpleNamespace(gravity=np.array([0.0, -9.8, 0.0])))
SEEN = [Plane("found", np.array([0.0, 0.0, 1.0]), 1.0), *GIVEN, Plane("side", np.array([0.0, 1.0, 0.0]), 2.0)]


def counted(
    monkeypatch: pytest.MonkeyPatch,
    planes: list[Plane] | None,
    *outcomes: Refused | str,
    found: Sequence[str] = ("found",),
    of: int = 1,
    more: Sequence[Plane] = (),
    held: bool = False,
    comes: bool = False,
) -> tuple[list[tuple[Schedule, list[str]]], list[str], Any]:
    """Under which schedules a solve was asked for with which planes, what was said meanwhile, and what came of it.

    A plane that came late has a plus before its name, one that shall not come back a minus.   of: so many were proposed, and
    more, which the track does not have.   comes: one comes into view.
    """
    asked: list[tuple[Schedule, list[str]]] = []
    said: list[str] = []
    left = list(outcomes)
    unused: Any = None

    def solve(_run: Any, task: attempts.Task) -> Any:
        followed, late = task.followed, task.followed.late or [False] * len(task.followed.planes)
        names = [("+" if is_late else "") + p.name for p, is_late in zip(followed.planes, late, strict=True)]
        asked.append((task.schedule, names + [f"-{plane.name}" for plane in followed.dropped]))
        # A choice begins from a motion that all planes have told.
        assert (task.motion is None) == (task.schedule is FULL)
        assert task.kept is None or task.schedule is FULL
        one = left.pop(0)
        if isinstance(one, Refused):
            _run.say("info", "of an attempt", "a wall was left out")
            raise one
        return one

    seen = [plane for plane in SEEN if plane.name in found]
    of_proposal = tuple(k if k < of else -1 for k in range(len(seen)))
    followed = Followed(
        0, seen, [], proposals=(*seen[:of], *more), of_proposal=of_proposal, late=tuple(k < 0 for k in of_proposal)
    )
    monkeypatch.setattr(page, "in_the_tracks_frame", lambda _run, planes, _told_at_ns: (planes, None))
    monkeypatch.setattr(page, "follow_or_recall", lambda *_: followed)
    monkeypatch.setattr(page, "initialise", lambda *_: (None, START))
    monkeypatch.setattr(attempts, "solve", solve)
    monkeypatch.setattr(page, "called_as", lambda state, *_: state)
    judged: list[object] = []
    monkeypatch.setattr(attempts, "beyond_sheets", lambda _solved: None)
    monkeypatch.setattr(attempts, "require_sound_choice", judged.append)
    monkeypatch.setattr(attempts, "weighed", lambda _run, solved, is_choice: (solved, is_choice and solved in judged))
    monkeypatch.setattr(attempts, "answer", lambda _run, solved, weighed, _lidar: (solved, weighed))
    settings = CalibrateSettings(estimate_planes=not held)
    log = MessageLog(lambda event: said.append(getattr(event, "code", "")), [])
    run = Run(unused, settings, unused, unused, unused, log, unused, log=log)

    def motion(run: Run, task: attempts.Task, _: Any) -> Any:
        if comes:
            run.say("info", "planes.found", "one more plane came into view after the start and is used")
        return attempts.MotionByAll(unused, unused, task.followed) if len(task.followed.planes) == len(seen) else None

    monkeypatch.setattr(page, "motion_by_everything", motion)
    try:
        answer = page.calibrate_full(run, planes, None)
    except Refused as refused:
        return asked, [code for code in said if code != "of an attempt"], refused.code
    assert "of an attempt" not in [message.code for message in log.messages]  # what it said is not true of the answer
    return asked, [code for code in said if code != "of an attempt"], answer


def test_planes_that_nobody_chose_may_be_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """A choice counts as it is, and is weighed as one; an untouched suggestion is no choice. Where planes were dropped, the
    others are thinned out, which is given up where that does not do; what came into view counts, and none of those dropped comes
    back. A touched plane chooses no other.

    Mutations: a proposal as a choice; one that was cut as none; a choice thinned out; weighed whatever it is; tried again for a
    choice, and for an untouched suggestion; all that was followed taken for proposed; what was dropped not told; what came late
    left out where some were dropped, or taken for proposed.
    """
    proposed = [replace(plane, suggested=True) for plane in GIVEN]
    names, lost = ["floor", "wall"], Refused("planes.too_few", "two planes do not hold a pose")
    assert counted(monkeypatch, None, "right") == ([(FULL, ["found"])], [], ("right", False))
    assert counted(monkeypatch, GIVEN, "right") == ([(CHOSEN, names)], [], ("right", True))
    partly = [proposed[0], GIVEN[1]]
    assert counted(monkeypatch, partly, "right") == ([(PARTLY, names)], [], ("right", True))
    both = [(PARTLY, names), (CHOSEN, names)]
    assert counted(monkeypatch, partly, lost, "right") == (both, ["planes.open"], ("right", True))
    # A floor was proposed, a wall came into view.
    renamed = [replace(proposed[0], name="hall")]
    assert counted(monkeypatch, renamed, "right", found=names) == ([(FULL, ["hall", "+wall"])], [], ("right", False))
    cut = [replace(proposed[0], outline_m=np.zeros((3, 3)))]
    assert counted(monkeypatch, cut, "right", found=names)[0] == [(PARTLY, ["floor", "+wall"])]
    late = counted(monkeypatch, proposed[:1], "right", found=[*names, "side"], of=2)
    assert late == ([(PARTLY, ["floor", "+side", "-wall"])], [], ("right", True))
    both = [(PARTLY, ["floor", "-wall"]), (CHOSEN, ["floor", "-wall"])]
    assert counted(monkeypatch, proposed[:1], lost, "right", found=names, of=2) == (
        both,
        ["planes.open"],
        ("right", True),
    )


def test_where_a_choice_gives_no_answer_all_that_were_found_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """Said, with why the choice gives none, and without what its own attempts said; where they give none either, the choice is
    why. Planes that are held stand, and so does what is wrong with the readings; what is no choice is not tried twice.

    Seen: a lawn that rolls by 2 cm among three planes chosen, nothing but a refusal, and an answer within its sigmas by all.
    Mutations: never; beside what the chosen planes had said; for any refusal; beside planes that are held; the refusal of the
    others told; nothing said of it; boxes are asked again by hand; a suggestion tried twice; what is left of one not again.
    """
    proposed = [replace(plane, suggested=True) for plane in GIVEN]
    names = ["floor", "wall"]
    boxes = Refused("planes.doubtful", "the chosen planes do not determine the motion; choose walls")
    by_all, partly = (FULL, names), (PARTLY, ["floor", "-wall"])
    right = ("right", False)
    said = ["planes.instead"]
    assert counted(monkeypatch, proposed[:1], boxes, "right", found=names, of=2) == ([partly, by_all], said, right)
    for why in (boxes, Refused("start.no_overlap", "no start")):
        assert counted(monkeypatch, GIVEN, why, "right", found=names, of=2) == ([(CHOSEN, names), by_all], said, right)
    astray = Refused("solve.diverged", "no point lies on the floor")
    tried = [(CHOSEN, names), (CHOSEN, names), by_all]  # with the sensors held, too
    assert counted(monkeypatch, GIVEN, astray, astray, "right", found=names, of=2) == (tried, said, right)
    lost = Refused("planes.too_few", "two planes do not hold a pose")
    neither = ([(CHOSEN, names), by_all], [], "planes.doubtful")
    assert counted(monkeypatch, GIVEN, boxes, lost, found=names, of=2) == neither
    untouched = counted(monkeypatch, proposed, lost, found=names, of=2)
    assert untouched == ([by_all], [], "planes.too_few")  # it was by all that were found
    by_choice = [(CHOSEN, names)]
    still = Refused("motion.none", "it stood still")
    assert counted(monkeypatch, GIVEN, still, found=names, of=2) == (by_choice, [], "motion.none")
    held = counted(monkeypatch, GIVEN, boxes, found=names, of=2, held=True)
    assert held == (by_choice, [], "planes.doubtful")


def test_what_is_wrong_with_a_choice_is_said_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without what to do about it alone. Mutations: the cure said too; the choice named twice."""
    asked: list[object] = []

    def by_planes(_run: Run, planes: object, *_: object) -> str:
        asked.append(planes)
        if planes is not None:
            raise Refused(
                "planes.doubtful", "the chosen planes do not determine the motion: they face two ways; choose walls"
            )
        return "right"

    told: list[str] = []
    unused: Any = None
    log = MessageLog(lambda event: told.append(getattr(event, "text", "")), [])
    run = Run(unused, CalibrateSettings(), unused, unused, unused, log, unused, log=log)
    monkeypatch.setattr(page, "by_planes", by_planes)
    answer: Any = page.calibrate_full(run, GIVEN, None)
    assert answer == "right"
    assert asked == [GIVEN, None]
    why = "they do not determine the motion: they face two ways"
    text = f"the chosen planes give no answer ({why}); the answer uses all planes that were found"
    assert told == [f"{text} instead: check these, or choose walls, floor and ceiling"]


def test_proposals_that_are_no_planes_of_their_own_are_left_out_and_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an untouched suggestion as of what is left of one, where the others face three ways; what is insisted on counts.

    Mutations: not said of either; they count beside the others; left out though they are needed; those insisted on.
    """
    bent = Plane("bent", np.array([0.6, 0.0, 0.8]), 2.5, suggested=True)
    names = ["floor", "wall", "side"]
    proposed = [replace(plane, suggested=True) for plane in SEEN[1:]]
    merged = ["planes.merged"]

    def of(planes: list[Plane], *more: Plane) -> Any:
        return counted(monkeypatch, planes, "right", found=names, of=3, more=more)[:2]

    assert of([*proposed, bent], bent) == ([(FULL, names)], merged)
    other = replace(bent, name="other", normal=np.array([0.0, 0.6, 0.8]))
    assert of([*proposed, bent], bent, other) == ([(PARTLY, [*names, "-other"])], merged)
    assert of([*proposed[:2], bent, other], bent, other) == ([(PARTLY, [*names[:2], "bent", "other", "-side"])], [])
    insisted = replace(bent, suggested=False)
    assert of([*proposed, insisted], bent) == ([(PARTLY, [*names, "bent"])], [])


def test_planes_that_are_held_where_a_scan_shows_them_are_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seen: a true floor called bent, and sigmas eight times as wide, beside planes held as they were proposed. Mutations: never;
    of planes that somebody has surveyed too; of those that are estimated.
    """
    proposed = [replace(plane, suggested=True) for plane in GIVEN]
    for planes in (None, [], proposed, [proposed[0], GIVEN[1]]):
        assert counted(monkeypatch, planes, "right", held=True)[1][0] == "planes.held"
    assert "planes.held" not in counted(monkeypatch, GIVEN, "right", held=True)[1]
    assert "planes.held" not in counted(monkeypatch, proposed, "right")[1]


def test_what_comes_into_view_is_not_said_to_be_used_beside_a_choice_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """It has told the motion alone. Mutations: said always; kept beside a suggestion too; all sentences kept."""
    partly = [replace(GIVEN[0], suggested=True), GIVEN[1]]
    assert counted(monkeypatch, GIVEN, "right", comes=True)[1] == []
    assert counted(monkeypatch, partly, "right", comes=True)[1] == ["planes.found"]
    told: list[str] = []
    unused: Any = None
    run = Run(
        unused,
        CalibrateSettings(),
        unused,
        unused,
        unused,
        lambda event: told.append(getattr(event, "code", "")),
        unused,
    )
    run.keeping("planes.found").say("warning", "planes.lost", "out of sight")
    assert told == ["planes.lost"]
