"""The page's own decisions: when the estimate is confined to what the lidar could follow, and what is refused at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.errors import Refused
from calib_core.full import calibrate as page
from calib_core.full.joint.schedule import CHOSEN, FULL, PARTLY, Schedule
from calib_core.full.odometry.reference import Followed
from calib_core.full.run import Run
from calib_core.settings import CalibrateSettings
from calib_core.types import Plane


@dataclass(frozen=True)
class State:
    """As much of an estimation as the page touches."""

    iterations: int = 0


class Estimator:
    """In the place of the joint estimation: refuses or answers as told, and remembers what it was asked."""

    def __init__(self, *outcomes: Refused | str) -> None:
        self.outcomes = list(outcomes)
        self.asked: list[tuple[Schedule, int]] = []

    def __call__(self, _: object, state: State, schedule: Schedule) -> Any:
        self.asked.append((schedule, state.iterations))
        outcome = self.outcomes.pop(0)
        if isinstance(outcome, Refused):
            raise outcome
        return SimpleNamespace(name=outcome, iterations=7)


def solved(monkeypatch: pytest.MonkeyPatch, estimator: Estimator, *, followed: int, motion: Any = None) -> Any:
    """What the page makes of it. followed: of ten scans. An answer called "wrong" is not plausible."""
    monkeypatch.setattr(page, "estimate_jointly", estimator)

    def with_choice(_run: Run, motion: Any, *_: object) -> Any:
        assert motion[2] == ["everything"]  # which of them count
        return motion[:2]

    monkeypatch.setattr(page, "with_choice", with_choice)
    monkeypatch.setattr(page, "tracked", lambda track, _: np.array([track]))
    monkeypatch.setattr(page, "estimate_chosen", estimator)
    monkeypatch.setattr(page, "begin", lambda *_: (None, State(), 1.0))
    monkeypatch.setattr(page, "implausible", lambda _, end: "why" if end.name == "wrong" else None)
    run: Any = SimpleNamespace(recording=SimpleNamespace(scans=range(10)), say=lambda *_: None)
    track: Any = SimpleNamespace(motions=range(followed), planes=())
    unused: Any = None
    return page.solve(run, track, unused, unused, None, FULL, motion)


def test_an_answer_that_can_be_true_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutation: always solve twice."""
    estimator = Estimator("right")
    assert solved(monkeypatch, estimator, followed=6).name == "right"
    assert [schedule for schedule, _ in estimator.asked] == [FULL]


@pytest.mark.parametrize("first", ["wrong", Refused("solve.offset_ran_away", "it ran away")])
def test_what_was_propagated_over_is_left_out_where_it_spoils_the_answer(
    monkeypatch: pytest.MonkeyPatch, first: Refused | str
) -> None:
    """Mutations: let the refusal of the first attempt through; propagate again; begin to count iterations anew."""
    estimator = Estimator(first, "right")
    assert solved(monkeypatch, estimator, followed=6).name == "right"
    _, (again, iterations) = estimator.asked
    assert again.propagation is None
    assert again.planes is None
    assert again.settling is not None
    assert iterations == (7 if first == "wrong" else 0)


def test_a_choice_goes_on_from_the_motion_that_all_planes_have_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where that leads nowhere, with those chosen alone, over what the lidar alone could follow.

    Mutations: from start values, whatever is known; from the motion again, the second time; which of the choice alone.
    """
    estimator = Estimator("wrong", "right")
    assert solved(monkeypatch, estimator, followed=6, motion=(None, State(iterations=30), "everything")).name == "right"
    (first, of_motion), (again, iterations) = estimator.asked
    assert (first, of_motion, iterations) == (FULL, 30, 7)
    assert again.propagation is None


def test_where_every_scan_was_followed_there_is_nothing_to_leave_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutation: try the same again."""
    estimator = Estimator(Refused("solve.unsettled", "it moves"))
    with pytest.raises(Refused, match="it moves"):
        solved(monkeypatch, estimator, followed=10)
    assert len(estimator.asked) == 1
    assert solved(monkeypatch, Estimator("wrong"), followed=10).name == "wrong"


def asked_of(monkeypatch: pytest.MonkeyPatch, mode: str, *outcomes: Refused | str) -> tuple[list[str], list[str], Any]:
    """With which sensors a solve was asked for ("freed": with them let go), what was said meanwhile, and what came of it."""
    asked: list[str] = []
    said: list[str] = []
    left = list(outcomes)

    def outcome(of: str) -> Any:
        asked.append(of)
        one = left.pop(0)
        if isinstance(one, Refused):
            raise one
        return one

    monkeypatch.setattr(page, "estimate_sensors_too", lambda run, _solved, _schedule: outcome("freed"))
    unused: Any = None
    run = Run(
        unused,
        CalibrateSettings(intrinsics=mode),
        unused,
        unused,
        unused,
        lambda event: said.append(getattr(event, "code", "")),
        unused,
    )
    try:
        judged = page.with_sensors_held(
            run, lambda run: outcome(run.settings.intrinsics), lambda run, solved: (run.settings.intrinsics, solved)
        )
        return asked, said, judged
    except Refused as refused:
        return asked, said, refused.code


def test_sensors_that_run_away_are_held_until_all_else_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """The whole estimation again with the sensors as their data sheets have them, and from its end with them let go; where they
    run away still, held to the end with their doubts in the error bars. Once, and only where sensors were unknowns and the
    solve is what was refused.

    Mutations: let the refusal through; solve again with the same settings; hold them whatever was refused; try again for ever;
    judge the freed solve as a held one; say that they are held where they are not.
    """
    away, still = Refused("solve.offset_ran_away", "too far"), Refused("motion.undetermined", "nothing turns")

    def of(*outcomes: Refused | str, mode: str = "auto") -> tuple[list[str], list[str], Any]:
        return asked_of(monkeypatch, mode, *outcomes)

    assert of("right") == (["auto"], [], ("auto", "right"))
    assert of(away, "held", "freed") == (["auto", "consider", "freed"], [], ("auto", "freed"))
    assert of(away, "held", away) == (["auto", "consider", "freed"], ["sensor.astray"], ("consider", "held"))
    assert of(away, "held", still) == (["auto", "consider", "freed"], [], still.code)
    assert of(away, away) == (["auto", "consider"], [], away.code)
    assert of(still) == (["auto"], [], still.code)
    for ideal in ("off", "consider"):
        assert of(away, mode=ideal) == ([ideal], [], away.code)


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

    def solve(_run: object, followed: Followed, *rest: Any) -> Any:
        late = followed.late or [False] * len(followed.planes)
        names = [("+" if is_late else "") + p.name for p, is_late in zip(followed.planes, late, strict=True)]
        asked.append((rest[-2], names + [f"-{plane.name}" for plane in followed.dropped]))
        assert (rest[-1] is None) == (rest[-2] is FULL)  # a choice begins from a motion that all planes have told
        one = left.pop(0)
        if isinstance(one, Refused):
            raise one
        return one

    seen = [plane for plane in SEEN if plane.name in found]
    of_proposal = tuple(k if k < of else -1 for k in range(len(seen)))
    followed = Followed(
        0, seen, [], proposals=(*seen[:of], *more), of_proposal=of_proposal, late=tuple(k < 0 for k in of_proposal)
    )
    monkeypatch.setattr(page, "follow_or_recall", lambda *_: followed)
    monkeypatch.setattr(page, "initialise", lambda *_: (None, START))
    monkeypatch.setattr(page, "solve", solve)
    monkeypatch.setattr(
        page,
        "motion_by_everything",
        lambda _run, track, *_: (track.planes,) if len(track.planes) == len(seen) else None,
    )
    monkeypatch.setattr(page, "weigh_chosen", lambda *_: 2.0)
    monkeypatch.setattr(page, "weigh", lambda _run, _solved, at_least: at_least)
    monkeypatch.setattr(page, "answer", lambda _run, solved, weighed, _lidar: (solved, weighed))
    settings = CalibrateSettings(estimate_planes=not held)
    unused: Any = None
    run = Run(unused, settings, unused, unused, unused, lambda event: said.append(getattr(event, "code", "")), unused)

    def motion(run: Run, track: Followed, *_: Any) -> Any:
        if comes:
            run.say("info", "planes.found", "one more plane came into view after the start and is used")
        return (track.planes,) if len(track.planes) == len(seen) else None

    monkeypatch.setattr(page, "motion_by_everything", motion)
    try:
        return asked, said, page.calibrate_full(run, planes, None)
    except Refused as refused:
        return asked, said, refused.code


def test_planes_that_nobody_chose_may_be_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """A choice counts as it is, and is weighed as one; an untouched suggestion is no choice. Where planes were dropped, the
    others are thinned out, which is given up where that does not do; what came into view counts, and none of those dropped comes
    back. A touched plane chooses no other.

    Mutations: a proposal as a choice; one that was cut as none; a choice thinned out; weighed whatever it is; tried again for a
    choice, and for an untouched suggestion; all that was followed taken for proposed; what was dropped not told; what came late
    left out where some were dropped, or taken for proposed; three boxes that are left of a suggestion answer; boxes are asked
    again.
    """
    proposed = [replace(plane, suggested=True) for plane in GIVEN]
    names, lost = ["floor", "wall"], Refused("planes.too_few", "two planes do not hold a pose")
    assert counted(monkeypatch, None, "right") == ([(FULL, ["found"])], [], ("right", 1.0))
    assert counted(monkeypatch, GIVEN, "right") == ([(CHOSEN, names)], [], ("right", 2.0))
    partly = [proposed[0], GIVEN[1]]
    assert counted(monkeypatch, partly, "right") == ([(PARTLY, names)], [], ("right", 2.0))
    both = [(PARTLY, names), (CHOSEN, names)]
    assert counted(monkeypatch, partly, lost, "right") == (both, ["planes.open"], ("right", 2.0))
    # A floor was proposed, a wall came into view.
    renamed = [replace(proposed[0], name="hall")]
    assert counted(monkeypatch, renamed, "right", found=names) == ([(FULL, ["hall", "+wall"])], [], ("right", 1.0))
    cut = [replace(proposed[0], outline_m=np.zeros((3, 3)))]
    assert counted(monkeypatch, cut, "right", found=names)[0] == [(PARTLY, ["floor", "+wall"])]
    assert counted(monkeypatch, proposed, lost, found=names, of=2) == ([(FULL, names)], [], "planes.too_few")
    assert counted(monkeypatch, GIVEN, lost) == ([(CHOSEN, names)], [], "planes.too_few")
    late = counted(monkeypatch, proposed[:1], "right", found=[*names, "side"], of=2)
    assert late == ([(PARTLY, ["floor", "+side", "-wall"])], [], ("right", 2.0))
    both = [(PARTLY, ["floor", "-wall"]), (CHOSEN, ["floor", "-wall"])]
    assert counted(monkeypatch, proposed[:1], lost, "right", found=names, of=2) == (
        both,
        ["planes.open"],
        ("right", 2.0),
    )
    boxes = Refused("planes.doubtful", "the planes chosen do not hold the motion")
    assert counted(monkeypatch, proposed[:1], boxes, found=names, of=2) == (both[:1], [], "planes.doubtful")


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
