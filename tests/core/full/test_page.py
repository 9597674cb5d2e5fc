"""The page's own decisions: when the estimate is confined to what the lidar could follow, and what is refused at once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.errors import Refused
from calib_core.full import attempts as page
from calib_core.full.initialise.clock_rate import ClocksApart
from calib_core.full.joint.bounds import SensorsAstray
from calib_core.full.joint.data_sheets import Beyond
from calib_core.full.joint.estimation import MapPlane
from calib_core.full.joint.schedule import CHOSEN, FULL, Schedule
from calib_core.full.run import Run
from calib_core.message_log import MessageLog
from calib_core.result import Message
from calib_core.settings import CalibrateSettings


@dataclass(frozen=True)
class State:
    """As much of an estimation as the page touches."""

    iterations: int = 0


class Estimator:
    """In the place of the joint estimation: refuses or answers as told, and remembers what it was asked."""

    def __init__(self, *outcomes: Refused | str) -> None:
        self.outcomes = list(outcomes)
        self.asked: list[tuple[Schedule, int]] = []
        self.said: list[str] = []

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
        data, state, which = motion
        assert which == ["everything"]  # which of them count
        return data, state

    monkeypatch.setattr(page, "with_choice", with_choice)
    monkeypatch.setattr(page, "tracked", lambda track, _: np.array([track]))
    monkeypatch.setattr(page, "estimate_chosen", estimator)
    monkeypatch.setattr(page, "begin", lambda *_: (None, State(), 1.0))
    monkeypatch.setattr(page, "implausible", lambda _, end: "why" if end.name == "wrong" else None)
    run: Any = SimpleNamespace(
        recording=SimpleNamespace(scans=range(10)),
        say=lambda *_: estimator.said.append("said"),
        attempt=lambda: lambda: estimator.said.append("unsaid"),
    )
    track: Any = SimpleNamespace(motions=range(followed), planes=())
    unused: Any = None
    return page.solve(run, page.Task(track, unused, unused, None, unused, FULL, motion))


def test_an_answer_that_can_be_true_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutation: always solve twice."""
    estimator = Estimator("right")
    assert solved(monkeypatch, estimator, followed=6).name == "right"
    assert [schedule for schedule, _ in estimator.asked] == [FULL]
    assert estimator.said == []


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
    assert estimator.said == ["unsaid", "said"]  # not true of the second


def test_a_choice_goes_on_from_the_motion_that_all_planes_have_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where that leads nowhere, with those chosen alone, over what the lidar alone could follow.

    Mutations: from start values, whatever is known; from the motion again, the second time; which of the choice alone.
    """
    estimator = Estimator("wrong", "right")
    assert (
        solved(
            monkeypatch, estimator, followed=6, motion=page.MotionByAll(None, State(iterations=30), "everything")
        ).name
        == "right"
    )
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


class Found(str):
    """The end of a solve, by its name: one of "beyond ..." has a sensor that is not what its sheet has."""

    __slots__ = ()
    planes = (SimpleNamespace(name="floor"),)


def asked_of(
    monkeypatch: pytest.MonkeyPatch,
    mode: str,
    *outcomes: Refused | str,
    counting: str = "floor",
    document: MessageLog | None = None,
) -> tuple[list[str], list[str], Any]:
    """With which sensors a solve was asked for ("freed": with them let go, from an end; "any": by the sheets of any), what was
    said meanwhile, and what came of it. counting: the plane that it begins with.   document: hears everything."""
    asked: list[str] = []
    said: list[str] = []
    heard = MessageLog(lambda _: None, []) if document is None else document

    def hear(event: Any) -> None:
        heard(event)
        if event.code != "solved":
            said.append(event.code)

    left = list(outcomes)

    def outcome(run: Run, of: str) -> Any:
        asked.append(of + " any" * ("lidar" in run.beyond_sheets))
        run.say("info", "solved", f"as {asked[-1]}")
        one = left.pop(0)
        if isinstance(one, Refused):
            raise one
        return Found(one)

    def allowing(run: Run, _: Any) -> Run | None:
        return None if run.beyond_sheets else replace(run, beyond_sheets=frozenset({"lidar"}))

    monkeypatch.setattr(page, "estimate_further", lambda run, solved, schedule: outcome(run, f"freed from {solved}"))
    monkeypatch.setattr(page, "beyond_sheets", lambda found: Beyond("incidence", 5.0) if "beyond" in found else None)
    monkeypatch.setattr(page, "without_sheet", allowing)
    monkeypatch.setattr(page, "consistent", lambda *_: None)
    monkeypatch.setattr(page, "say_beyond", lambda run, _: run.say("warning", "beyond", "not relied on"))
    monkeypatch.setattr(
        page, "with_late_blocks", lambda run, found, _: Found(f"{found} apart") if "wide" in found else None
    )
    monkeypatch.setattr(page, "still_show", lambda found: "still" in found)
    unused: Any = None
    settings = CalibrateSettings(intrinsics=mode)
    run = Run(unused, settings, unused, unused, unused, hear, unused, log=heard)
    track: Any = SimpleNamespace(planes=[SimpleNamespace(name=counting)])
    task = page.Task(track, unused, unused, None, settings)

    def judged(run: Run, solved: Any, of: page.Task) -> Any:
        assert of is task
        return run.settings.intrinsics + " any" * bool(run.beyond_sheets), str(solved)

    monkeypatch.setattr(page, "judged", judged)
    monkeypatch.setattr(page, "solve", lambda run, _: outcome(run, run.settings.intrinsics))
    try:
        return asked, said, page.answered(run, task)
    except Refused as refused:
        return asked, said, refused.code


def test_a_sensor_that_is_no_better_than_any_is_taken_for_any(monkeypatch: pytest.MonkeyPatch) -> None:
    """From the end on where all planes are there still, else anew, and anew where it ended astray; then what runs away by any
    sensor's priors is held as before, by a solve of its own.

    Mutations: from the end on though a plane was lost; anew though none was; never a second time; judged by the sheet; for ever,
    whatever it ends with; where sensors are held or ideal; the held solve begun from what came before.
    """
    astray = SensorsAstray("laser_elevation", 0.0126, 14.0)

    def of(*outcomes: Refused | str, **changes: str) -> tuple[list[str], list[str], Any]:
        mode = changes.pop("mode", "auto")
        return asked_of(monkeypatch, mode, *outcomes, **changes)

    assert of("beyond", "end") == (["auto", "freed from beyond any"], ["beyond"], ("auto any", "end"))
    assert of("beyond", "end", counting="wall 1") == (["auto", "auto any"], ["beyond"], ("auto any", "end"))
    assert of("beyond", "beyond still")[2] == ("auto any", "beyond still")
    assert of(astray, "end") == (["auto", "auto any"], ["beyond"], ("auto any", "end"))
    asked, said, end = of(astray, astray, "held", "freed")
    assert asked == ["auto", "auto any", "consider any", "freed from held any"]
    assert (said, end) == (["beyond"], ("auto any", "freed"))
    asked, _, end = of("beyond", astray, "held", "freed")
    assert asked == ["auto", "freed from beyond any", "consider any", "freed from held any"]
    refused = Refused("solve.unsettled", "it moves")
    asked, said, end = of("beyond", refused, refused)
    assert (asked[-1], said, end) == ("consider any", ["beyond"], "solve.unsettled")
    assert len(asked) == 3
    for mode in ("off", "consider"):
        assert of("beyond", mode=mode) == ([mode], [], (mode, "beyond"))
        assert of(astray, mode=mode) == ([mode], [], astray.code)


def test_a_clock_that_runs_away_is_stretched(monkeypatch: pytest.MonkeyPatch) -> None:
    """By what the solve has found, of which its prior has kept up to a half; not where stamps are to be taken as they are.

    Mutations: the rate's sign; held with the sensors; stretched whatever the settings say.
    """
    clocks = SimpleNamespace(imu_epoch_ns=5, middle_s=3.0)
    task: Any = SimpleNamespace(start=SimpleNamespace(rotation=SimpleNamespace(time_offset_s=1.0)))

    def refused(*_: object) -> None:
        raise SensorsAstray("clock_rate", -800.0, 20.0)

    def run(settings: CalibrateSettings) -> Any:
        return SimpleNamespace(settings=settings, clocks=clocks, attempt=lambda: lambda: None)

    monkeypatch.setattr(page, "solve", refused)
    monkeypatch.setattr(page, "with_sensors_held", lambda *_: "held")
    with pytest.raises(ClocksApart) as apart:
        page.answered(run(CalibrateSettings()), task)
    assert (apart.value.rate, apart.value.rate_std) == pytest.approx((-8e-4, 4e-4))
    assert apart.value.about_ns == 2_000_000_005
    held: Any = page.answered(run(CalibrateSettings(imu_sampling="as-stamped")), task)
    assert held == "held"


def test_what_is_said_of_an_attempt_that_leads_nowhere_is_not_said_of_the_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """That a wall was left out, while it counts in the end. What goes on from an end has all that led there. Mutations: nothing
    unsaid; all, from the first word; what said that a sheet is not relied on; where it goes on from an end, too; which
    parameter ran away.
    """
    astray, away = SensorsAstray("laser_elevation", 0.0126, 14.0), Refused("solve.offset_ran_away", "too far")

    def told(*outcomes: Refused | str, counting: str = "floor") -> list[str]:
        document = MessageLog(lambda _: None, [Message(code="first", level="info", text="before")])
        asked_of(monkeypatch, "auto", *outcomes, counting=counting, document=document)
        return [message.text for message in document.messages]

    assert told("right") == ["before", "as auto"]
    assert told("beyond", "end") == ["before", "as auto", "not relied on", "as freed from beyond any"]
    assert told("beyond", "end", counting="wall 1") == ["before", "not relied on", "as auto any"]
    assert told(astray, "end") == ["before", "not relied on", "as auto any"]
    assert told(away, "held", "freed") == ["before", "as consider", "as freed from held"]
    assert told(away, "held", away)[:2] == ["before", "as consider"]
    assert told(away, "held", away)[2].endswith("are counted in the error bars")  # as the sensors are held
    assert "it needs a laser elevation 14 times as large as is usual" in told(away, "held", astray)[2]


def test_a_solve_is_gone_on_with_where_accelerometers_are_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Weighed again then, with nothing of what was said of the first; as it was where that comes to no end.

    Mutations: the first one's confidence; both sentences, or neither; a refusal of the second let through; what it said kept.
    """
    heard = MessageLog(lambda _: None, [Message(code="first", level="info", text="before")])
    unused: Any = None
    run = Run(unused, CalibrateSettings(), unused, unused, unused, heard, unused, log=heard)

    def weigh(run: Run, solved: Any, *, is_choice: bool) -> Any:
        run.say("info", "weighed", f"{solved}, a choice {is_choice}")
        if str(solved) == "astray":
            raise Refused("solve.inconsistent", "no")
        return SimpleNamespace(found=("disagrees",), of=solved)

    def further(run: Run, solved: Any, schedule: Any) -> Any:
        run.say("info", "further", "goes on")
        return ends[solved]

    def apart(run: Run, solved: Any, found: Any) -> Any:
        assert found == ("disagrees",)
        return next((then for then in ends if then == f"{solved} apart"), None)

    monkeypatch.setattr(page, "weigh", weigh)
    monkeypatch.setattr(page, "estimate_further", further)
    monkeypatch.setattr(page, "with_late_blocks", apart)

    def told(solved: Any) -> tuple[str, str, list[str]]:
        heard.restore(before)
        end, trust = page.weighed(run, solved, CHOSEN)
        return str(end), str(trust.of), [message.text for message in heard.messages]

    before = heard.snapshot()
    ends = {"one apart": "end", "two apart": "astray", "more apart": "one"}
    assert told("none") == ("none", "none", ["before", "none, a choice True"])
    assert told("one") == ("end", "end", ["before", "goes on", "end, a choice True"])
    assert told("two") == ("two", "two", ["before", "two, a choice True"])
    assert told("more") == ("end", "end", ["before", "goes on", "end, a choice True"])


def test_a_solve_is_gone_on_with_where_a_small_plane_is_at_odds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Named, and weighed again without it; as it was where planes disagree all the same, or no rest is found.

    Mutations: left out whatever comes of it; left out without a word, or without its height; asked of planes that a
    person chose.
    """
    heard = MessageLog(lambda _: None, [Message(code="first", level="info", text="before")])
    unused: Any = None
    run = Run(unused, CalibrateSettings(), unused, unused, unused, heard, unused, log=heard)

    def end_of(name: str, *planes: str) -> Any:
        named = tuple(MapPlane(each, found_m=0.6) for each in planes)
        seen = SimpleNamespace(gravity=np.array([0.0, 0.0, -9.8]), normals=np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
        return SimpleNamespace(name=name, planes=named, estimate=seen, state=SimpleNamespace(planes=named))

    def weigh(run: Run, solved: Any, *, is_choice: bool) -> Any:
        run.say("info", "weighed", f"{solved.name}")
        beyond = {"all": ("planes", "lasers"), "torn": ("planes", "lasers"), "better": ("lasers",), "other": ("time",)}
        ways = ("time", "planes", "lasers")
        found = [SimpleNamespace(name=way, is_beyond_noise=way in beyond.get(solved.name, ())) for way in ways]
        return SimpleNamespace(found=found, apart=solved.name)

    def further(run: Run, solved: Any, schedule: Any) -> Any:
        if solved.name == "astray":
            raise Refused("solve.inconsistent", "no")
        return solved

    ends: dict[str, Any] = {}
    monkeypatch.setattr(page, "weigh", weigh)
    monkeypatch.setattr(page, "estimate_further", further)
    monkeypatch.setattr(page, "with_late_blocks", lambda *_: None)
    monkeypatch.setattr(page, "without_odd_planes", lambda solved, apart, found, rules: ends.get(apart))

    def told(schedule: Schedule = FULL) -> tuple[str, list[str]]:
        heard.restore(before)
        end: Any = page.weighed(run, end_of("all", "wall", "table"), schedule)[0]
        return end.name, [message.text for message in heard.messages]

    before = heard.snapshot()
    assert told() == ("all", ["before", "all"])
    left_out = "table does not fit the motion of the other planes (0.6 m below the lidar): left out"
    for name, expected in (
        ("walls", ("walls", ["before", left_out, "walls"])),
        ("better", ("better", ["before", left_out, "better"])),
        ("other", ("all", ["before", "all"])),
        ("torn", ("all", ["before", "all"])),
        ("astray", ("all", ["before", "all"])),
    ):
        ends["all"] = end_of(name, "wall")
        assert told() == expected, name
        assert told(CHOSEN) == ("all", ["before", "all"])


def test_an_answer_with_room_for_a_sensor_counts_where_all_parts_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise nothing was said. Mutations: where parts disagree, too; a refusal let through."""
    heard = MessageLog(lambda _: None, ())
    unused: Any = None
    run = Run(unused, CalibrateSettings(), unused, unused, unused, heard, unused, log=heard)
    task = page.Task(unused, unused, unused, None, CalibrateSettings())

    def solve(run: Run, _: object) -> str:
        run.say("info", "solved", "solved")
        return "end"

    def weighed(_run: Run, solved: str, _schedule: Schedule) -> Any:
        ways = outcomes.pop(0)
        if ways is None:
            raise Refused("motion.undetermined", "no")
        found = [SimpleNamespace(name=way, is_beyond_noise=True) for way in ways]
        return solved, SimpleNamespace(found=found)

    monkeypatch.setattr(page, "solve", solve)
    monkeypatch.setattr(page, "weighed", weighed)
    monkeypatch.setattr(page, "answer", lambda _run, solved, _trust, _lidar: solved)
    outcomes: list[tuple[str, ...] | None] = [(), ("time",), None]
    for expected in ("end", None, None):
        heard.restore(())
        found: Any = page.consistent(run, task)
        assert found == expected
        assert len(heard.messages) == (expected is not None)


def test_what_an_attempt_retracts_is_said_again_where_it_led_nowhere() -> None:
    """Mutations: nothing retracted; all of it; what was retracted stays so."""
    heard = MessageLog(lambda _: None, ())
    unused: Any = None
    run = Run(unused, CalibrateSettings(), unused, unused, unused, heard, unused, log=heard)
    run.say("info", "one", "first")
    run.say("info", "two", "second")
    unsay = run.attempt()
    run.retract("one", "three")
    run.say("info", "one", "another")
    assert [message.text for message in heard.messages] == ["second", "another"]
    unsay()
    assert [message.text for message in heard.messages] == ["first", "second"]


def test_accelerometers_that_are_far_apart_are_let_go_with_the_sensors(monkeypatch: pytest.MonkeyPatch) -> None:
    """They make the sensors run away. Where they show with these held, and still with all let go; else as if they were not asked.

    Mutations: never asked there; believed though nothing shows any more; what is refused with them is the end.
    """
    away = Refused("solve.sensors_astray", "too far")

    def of(*outcomes: Refused | str) -> tuple[list[str], list[str], Any]:
        return asked_of(monkeypatch, "auto", *outcomes)

    asked, _, end = of(away, "held wide", "still")
    assert (asked, end) == (["auto", "consider", "freed from held wide apart"], ("auto", "still"))
    for without in ("gone", away):
        asked, _, end = of(away, "held wide", without, "freed")
        assert asked == ["auto", "consider", "freed from held wide apart", "freed from held wide"]
        assert end == ("auto", "freed")
    assert of(away, "held wide", away, away)[1:] == (["sensor.astray"], ("consider", "held wide"))


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
    assert of(away, "held", "freed") == (["auto", "consider", "freed from held"], [], ("auto", "freed"))
    assert of(away, "held", away) == (["auto", "consider", "freed from held"], ["sensor.astray"], ("consider", "held"))
    assert of(away, "held", still) == (["auto", "consider", "freed from held"], [], still.code)
    assert of(away, away) == (["auto", "consider"], [], away.code)
    assert of(still) == (["auto"], [], still.code)
    for ideal in ("off", "consider"):
        assert of(away, mode=ideal) == ([ideal], [], away.code)
