"""One source for each number and word that a person sees: limits, verdict, strength of the planes."""

from __future__ import annotations

import html
import io
import re
from collections.abc import Collection, Mapping
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError
from rich.console import Console

from app.axes import AXIS_NAMES
from app.cli.options import parse_field_of_view, parse_gravity, parse_points
from app.cli.summary import result_summary
from app.cli.terminal import iteration_table
from app.fleet.overview import sigmas_of
from app.fleet.summary import Row
from app.jobs.orders import StoredRequest
from app.planes.operations import apply
from app.planes.state import PlaneSet, suggested
from app.planes.strength import Strength, foreseen
from app.planes.upright import Room
from app.results.agreement import zero_crossings_told
from app.results.command import command_of
from app.results.report import report_page
from app.results.verdict import CONTRADICTED, DISAGREEMENT, disagreeing, solve_outcome, verdict
from app.schemas.jobs import InitialGuess
from app.schemas.planes import Confirm, Drop
from app.schemas.view import ChangeView
from app.server.facts import usual_numbers
from app.work.functions import meant_guess as start_of
from calib_core import api
from calib_core.audit.limits import Limits
from calib_core.doctor.report import Forecast, ParameterForecast
from calib_core.errors import SettingsError
from calib_core.events import IterationEvent
from calib_core.full.assess.budget_sentences import say_disagreement
from calib_core.full.assess.disagreement import Disagreement
from calib_core.full.assess.observability import LIMITS, UNITS
from calib_core.full.prepare.settings import LENGTH
from calib_core.result import (
    COVARIANCE_ORDER,
    WEAK_DEG,
    WEAK_M,
    WEAK_S,
    CalibrationResult,
    Message,
    Uncertainty,
    WeakDirection,
)
from calib_core.settings import CalibrateSettings, ReadSettings
from calib_core.types import Narrowed
from tests.app.support import world

PROPOSALS = world.make_proposals()
#: The growth of a forecast's standard deviations with all planes.
ALL = np.ones(7)
FORECAST = Forecast(
    parameters=(
        ParameterForecast(name="rx", std=0.01, unit="deg", weak=False),
        ParameterForecast(name="tz", std=0.004, unit="m", weak=False),
        ParameterForecast(name="dt", std=0.0001, unit="s", weak=False),
    )
)


def test_the_limits_shown_are_those_that_the_estimator_judges_by():
    """Oracle: the estimator's own. Mutations: 0.02 deg for 0.5; an audit's usual limits of its own."""
    np.testing.assert_allclose(LIMITS * UNITS, [np.radians(WEAK_DEG)] * 3 + [WEAK_M] * 3 + [WEAK_S])
    assert Limits().per_axis() == pytest.approx([WEAK_DEG] * 3 + [1e3 * WEAK_M] * 3 + [1e3 * WEAK_S])
    assert tuple(AXIS_NAMES) == COVARIANCE_ORDER


def test_numbers_that_pages_need_are_those_of_whoever_uses_them():
    """Oracle: the settings' own, and what a view refuses. Mutations: 90 points written in facts.py; a span of half a second,
    of which a solve says that it has too few scans; sizes of points that a view does not take.
    """
    usual = usual_numbers()
    settings = CalibrateSettings()
    assert usual.max_rounds == settings.max_rounds
    assert parse_points(None, "paper") == usual.paper_points_per_plane_per_scan
    assert parse_field_of_view(None, "paper") == usual.paper_field_of_view_deg
    assert parse_gravity("latitude:48.1").std_m_s2 == usual.latitude_gravity_std_m_s2
    assert usual.shortest_span_s >= LENGTH.fewest_scans * 0.1
    for size in (usual.smallest_points, usual.largest_points):
        assert ChangeView(point_scale=size).point_scale == size
        with pytest.raises(ValidationError):
            ChangeView(point_scale=size * 1.01 if size > 1.0 else size * 0.99)


class Kept:
    """Stands for what an inspection kept: each plane left out makes every axis worse, that of rank 1 position z above all."""

    def __init__(self) -> None:
        self.asked: list[frozenset[int]] = []
        self.narrowed: list[Mapping[int, Narrowed]] = []

    def growth(self, places: Collection[int], narrowed: Mapping[int, Narrowed]) -> np.ndarray:
        self.asked.append(frozenset(places))
        self.narrowed.append(narrowed)
        if not places:
            return np.full(7, np.inf)
        growth = np.full(7, 3.0 ** (len(PROPOSALS.patches) - len(places)))
        growth[5] *= 1.0 if 1 in places else 100.0
        return growth


def test_strength_is_the_weakest_forecast_and_never_rises_when_a_plane_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the forecast's own problem, over all orders of dropping. Mutations: the ranks in the report taken for places; the
    growth of the axis that was worst with all planes; a whole suggestion asked for; asked again for what was told.
    """
    count = len(PROPOSALS.patches)
    start, kept = suggested(PROPOSALS), Kept()
    # The report lists them in another order. The last one is not among the suggested.
    room = Room(ranks={place: (place + 1) % count for place in range(count)}, foresight=Path("kept"))
    monkeypatch.setattr(api, "foresight", lambda folder: kept if folder == Path("kept") else None)
    strength = Strength()
    whole = foreseen(FORECAST, strength.growth(room, "a", start, start))
    assert whole is not None
    assert (whole.name, whole.std, whole.limit, kept.asked) == ("Position z", pytest.approx(0.004), WEAK_M, [])
    rng = np.random.default_rng(1)
    for _ in range(20):
        planes, before = start, whole.std / whole.limit
        for place in rng.permutation(count):
            planes = apply(planes, Drop(op="drop", index=int(place)), proposals=PROPOSALS, grow=lambda *_: None)
            now = foreseen(FORECAST, strength.growth(room, "a", planes, start))
            assert now is None or now.std / now.limit >= before
            before = np.inf if now is None else now.std / now.limit
        assert before == np.inf
    assert len(set(kept.asked)) == len(kept.asked) > count
    less = apply(start, Drop(op="drop", index=0), proposals=PROPOSALS, grow=lambda *_: None)
    seen = foreseen(FORECAST, strength.growth(room, "a", less, start))
    assert seen is not None
    assert (seen.name, seen.std) == ("Position z", pytest.approx(0.004 * 9.0 * 100.0))
    everything = start
    for place in range(count):
        everything = apply(everything, Confirm(op="confirm", index=place), proposals=PROPOSALS, grow=lambda *_: None)
    assert foreseen(FORECAST, strength.growth(room, "a", everything, start)) == whole  # more is not promised
    assert strength.growth(Room(ranks=room.ranks), "older report", less, start) is None
    assert foreseen(FORECAST, None) is None
    assert foreseen(None, np.ones(7)) is None


def test_boxes_narrow_what_is_foreseen(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wall shrank from 8.8 to 0.9 m2, and its gauge did not move. Oracle: the corners left, by hand.

    Mutations: a choice with its boxes taken for that without them; the place in the set for the one in the report; a box of the
    set passed over, or one of a plane that is left out heard; a box that leaves all of it asked for; a plane of which a box
    leaves nothing counted.
    """
    count = len(PROPOSALS.patches)
    start, kept = suggested(PROPOSALS), Kept()
    room = Room(ranks={place: (place + 1) % count for place in range(count)}, foresight=Path("kept"))
    monkeypatch.setattr(api, "foresight", lambda _: kept)
    strength = Strength()
    patch = start.patches[0]
    corners = np.array(patch.outline_m)
    along = np.linalg.svd(np.array(patch.normal)[None])[2][1]
    heights = corners @ along
    middle = 0.5 * (heights.min() + heights.max())

    def boxed(offset_m: float, place: int = 0, **of_set: object) -> PlaneSet:
        side = (*along.tolist(), -offset_m)
        patches = list(start.patches)
        if not of_set:
            patches[place] = patches[place].model_copy(update={"region": (side,)})
        return PlaneSet(patches=tuple(patches), region=(side,) if of_set else ())

    def growth(planes: PlaneSet) -> np.ndarray | None:
        return strength.growth(room, "a", planes, start)

    np.testing.assert_array_equal(growth(boxed(heights.min() - 0.1)), np.ones(7))
    assert kept.asked == []
    growth(boxed(middle))
    (narrowed,) = kept.narrowed
    assert list(narrowed) == [room.ranks[0]]
    np.testing.assert_array_equal(narrowed[1].whole, corners)
    left = narrowed[1].left @ along
    assert (left.min(), left.max()) == (pytest.approx(middle), pytest.approx(heights.max()))
    growth(boxed(middle))
    growth(boxed(middle + 0.01))
    assert len(kept.asked) == 2
    growth(boxed(middle, of_set=True))
    assert (len(kept.asked), room.ranks[0] in kept.narrowed[-1]) == (3, True)
    out = next(place for place, each in enumerate(start.patches) if not each.confirmed)
    asked = len(kept.asked)
    np.testing.assert_array_equal(growth(boxed(middle, place=out)), np.ones(7))
    assert len(kept.asked) == asked
    growth(boxed(heights.max() + 0.1))
    assert (room.ranks[0] in kept.asked[-1], kept.narrowed[-1]) == (False, {})


def test_another_axis_may_be_the_worst_without_a_plane() -> None:
    """Oracle: by hand, 0.01 deg times 45 of 0.5 deg, 4 mm times 2 of 20. Mutation: the axis that was worst with all planes."""
    growth = np.ones(7)
    growth[[0, 5]] = 45.0, 2.0
    found = foreseen(FORECAST, growth)
    assert found is not None
    assert (found.name, found.std, found.weak) == ("Turn x", pytest.approx(0.45), False)


def test_what_disagrees_is_named_and_no_sentence_below_says_otherwise():
    """A page said that parts disagree by more than noise explains, and of stretches of time that they lie as noise has it: it was
    places on the planes. Oracle: the library's own sentence, all ways of it. Mutations: not named; one of several words cut off;
    stretches that contradict each other are as noise has them, on the page or in the report; planes taken for stretches.
    """
    blocks = world.make_evidence().parts.time_blocks
    nothing, more = np.zeros((7, 7)), np.eye(7)

    def answered(*beyond):
        run = SimpleNamespace(said=[])
        run.say = lambda *words: run.said.append(words)
        ways = ("time", "surfaces", "planes", "range", "lasers")
        say_disagreement(
            run, [Disagreement(way, 1.74, more if way in beyond else nothing) for way in ways], more, is_torn=False
        )
        (level, code, text), evidence = run.said[0], world.make_evidence()
        said = Message(code=code, level=level, text=text)
        return world.make_result().model_copy(update={"evidence": evidence, "messages": [said]})

    bent = answered("surfaces")
    assert verdict(bent).startswith(
        "Calibrated. Parts of the recording (places on the planes) disagree by more than noise"
    )
    assert solve_outcome(bent).stretches == "48 of 56 bars do, as expected from noise"
    assert "lie farther off" not in report_page(bent)
    torn = answered("time", "surfaces", "planes", "range", "lasers")
    every = ["stretches of time", "places on the planes", "planes", "near and far points", "lasers"]
    assert disagreeing(torn) == every
    assert (
        solve_outcome(torn).stretches == "48 of 56 bars do, but some of the others lie farther off than noise explains"
    )
    assert report_page(torn).count("but some of the others lie farther off than noise explains") == 2
    assert report_page(answered("time")).count("lie farther off than noise explains") == 1
    assert report_page(answered("planes")).count("lie farther off than noise explains") == 1
    far = [block.model_copy(update={"translation_shift_m": [9.0] * 3, "time_offset_shift_s": 9.0}) for block in blocks]
    assert zero_crossings_told(far, torn=True).endswith("bars do, fewer than noise explains")


def test_what_disagrees_is_in_the_first_sentence_and_in_the_colour():
    """Mutation: the colour by status alone."""
    result = world.make_result()
    assert (solve_outcome(result).tone, "disagree" in verdict(result)) == ("good", False)
    said = Message(code=DISAGREEMENT, level="warning", text="the parts disagree 9.2 times")
    doubtful = result.model_copy(update={"messages": [*result.messages, said]})
    outcome = solve_outcome(doubtful)
    assert outcome.tone == "doubtful"
    assert outcome.verdict.startswith("Calibrated. Parts of the recording disagree")
    assert DISAGREEMENT in outcome.codes
    assert outcome.planes_used == len(result.quality.planes)
    refused = doubtful.model_copy(update={"status": "refused", "T_imu_lidar": None, "uncertainty": None})
    assert solve_outcome(refused).tone == "bad"


def test_what_was_given_and_is_wrong_comes_first():
    """Mutation: said of the recording's parts, which it tears apart."""
    result = widened(world.make_result(), 300.0)
    said = [Message(code=code, level="warning", text=code) for code in (DISAGREEMENT, CONTRADICTED)]
    doubtful = result.model_copy(update={"status": "weak", "messages": [*result.messages, *said]})
    assert verdict(doubtful) == f"Weak. {CONTRADICTED.capitalize()}."
    assert solve_outcome(doubtful).tone == "doubtful"


def cluttered() -> CalibrationResult:
    """An answer whose parts disagree, so that its error bars were widened."""
    result = world.make_result()
    said = Message(code=DISAGREEMENT, level="warning", text="the parts disagree 9.2 times")
    return widened(result.model_copy(update={"messages": [*result.messages, said]}), 9.2)


def weak() -> CalibrationResult:
    """An answer that leaves one direction open."""
    result = widened(world.make_result(), 300.0)
    open_one = WeakDirection(label="tz", vector=[0.0] * 7, std_scaled=90.0, text="The height is not determined.")
    seen = result.observability.model_copy(update={"weak_directions": [open_one]})
    return result.model_copy(update={"status": "weak", "observability": seen})


def widened(result: CalibrationResult, times: float) -> CalibrationResult:
    """The same with error bars so many times as wide."""
    known = result.uncertainty
    assert known is not None
    wide = Uncertainty(
        rotation_std_deg=[times * std for std in known.rotation_std_deg],
        translation_std_m=[times * std for std in known.translation_std_m],
        time_offset_std_s=times * known.time_offset_std_s,
        gravity_std_m_s2=known.gravity_std_m_s2,
        covariance=(times**2 * np.array(known.covariance)).tolist(),
    )
    return result.model_copy(update={"uncertainty": wide})


def rounded(value: float, std: float) -> tuple[str, str]:
    """Both to the second digit of the standard deviation."""
    digits = next(n for n in range(12) if round(std, n) >= 10 ** (1 - n))
    return f"{value:.{digits}f}", f"{std:.{digits}f}"


@pytest.mark.parametrize("made", [world.make_result, cluttered, weak], ids=["clean", "cluttered", "weak"])
def test_report_terminal_list_and_file_say_the_same_numbers(made):
    """Oracle: the file, rounded here, as it is read back. Mutations: the report's sigma of another axis; an angle's digits of
    another turn; the terminal's in metres; the list of runs with the covariance before it was widened; the planes asked for
    instead of those used.
    """
    result = CalibrationResult.model_validate_json(made().to_json())
    known, transform = result.uncertainty, result.T_imu_lidar
    assert known is not None
    assert transform is not None
    screen = Console(file=io.StringIO(), width=240)
    screen.print(result_summary(result))
    page, printed, listed = report_page(result), screen.file.getvalue(), solve_outcome(result)
    assert result.time_offset_s is not None
    pairs = [
        # The sigmas of the rotation are of turns about the lidar's axes; angles have the digits of the surest.
        *((angle, min(known.rotation_std_deg)) for angle in transform.euler_xyz_deg),
        *((0.0, std) for std in known.rotation_std_deg),
        *((1e3 * p, 1e3 * std) for p, std in zip(transform.translation_m, known.translation_std_m, strict=True)),
        (1e3 * result.time_offset_s, 1e3 * known.time_offset_std_s),
    ]
    assert all(std < 1000.0 for _, std in pairs)
    numbers = [number for value, std in pairs for number in rounded(value, std)[0 if value else 1 :]]
    for number in numbers:
        assert re.search(rf"(?<![\d.]){re.escape(number)}(?!\d)", page), number
        assert re.search(rf"(?<![\d.]){re.escape(number)}(?!\d)", printed), number
    assert (listed.translation_std_m, listed.rotation_std_deg) == (known.translation_std_m, known.rotation_std_deg)
    assert listed.verdict in printed
    word, sentences = listed.verdict.split(". ", 1)
    assert f"<b>{word}.</b> {sentences}</div>" in html.unescape(page)
    assert re.fullmatch(r"([A-Z][^.]*(\.\d[^.]*)*\. ?)+", sentences), sentences  # each a whole one
    assert f"on {listed.planes_used} planes" in printed
    assert listed.planes_used == len(result.quality.planes)


def test_verdict_names_the_axes_that_the_tables_show_as_weak():
    """A direction between two axes, and a second one. Mutations: the first direction alone; a second sentence about a direction
    that is an axis, which its own says already.
    """
    made = weak()
    slanting = made.observability.weak_directions[0].model_copy(
        update={"label": None, "text": "The lever arm is open."}
    )

    def told(axes, *directions):
        seen = made.observability.model_copy(update={"weak_axes": axes, "weak_directions": list(directions)})
        return verdict(made.model_copy(update={"observability": seen}))

    assert told(["ty", "tz"], slanting) == "Weak. The lever arm is open. Weak are position y and position z."
    assert told(["tz"], *made.observability.weak_directions) == "Weak. The height is not determined."
    two = told(["ry", "ty", "tz"], *made.observability.weak_directions, slanting)
    assert two == "Weak. The height is not determined. Weak are turn y, position y and position z."
    assert told([], slanting) == "Weak. The lever arm is open."  # of a document from before


def test_what_is_not_known_is_no_number_to_the_hundredth_of_a_millimetre():
    """A lever arm that only its standing prior holds, everywhere that it is printed. Mutation: 9135.06 mm, as it was."""
    made = weak()
    assert made.uncertainty is not None
    unknown = made.uncertainty.model_copy(
        update={"translation_std_m": [0.0012, 9.13506, 0.0031], "rotation_std_deg": [0.01, 0.02, 190.0]}
    )
    result = made.model_copy(update={"uncertainty": unknown, "status": "calibrated"})
    screen = Console(file=io.StringIO(), width=240)
    screen.print(result_summary(result))
    step = IterationEvent(
        iteration=1, round=1, cost=1.0, matrix=[], planes=[], euler_xyz_deg=[0.0] * 3, translation_m=[0.0] * 3, time_offset_s=0.0,
        rotation_std_deg=unknown.rotation_std_deg, translation_std_m=unknown.translation_std_m, time_offset_std_s=2.0,
    )  # fmt: skip
    screen.print(iteration_table(step))
    row = Row(name="a", recording="a", verdict="weak", translation_std_x_m=9.13506, rotation_std_x_deg=190.0)
    fleet = " ".join(sigma.text for sigma in sigmas_of(row))
    for said in (report_page(result), screen.file.getvalue(), solve_outcome(result).verdict, fleet):
        assert "9.1 m" in said
        assert "not determined" in said
        assert "9135" not in said
    assert "2.0 s" in screen.file.getvalue()


@pytest.mark.parametrize(
    ("slip", "meant"),
    [((0, 0, 0.0), True), ((0, 1, 0.008), True), ((0, 1, 0.02), False), ((2, 2, -2.0), False), ((3, 0, 1.0), False)],
)
def test_a_guess_s_rotation_is_judged_alike_by_the_command_line_and_the_page(tmp_path, slip, meant):
    """The page's shown command repeats its run: what one takes for a rotation the other does too, and for the same one.

    Mutations: 1e-3 on R R^T in app/work/functions.py, as it was; the page's matrix taken as it stands.
    """
    rows = np.eye(4)
    rows[slip[0], slip[1]] += slip[2]
    wire = InitialGuess(matrix=rows.tolist(), time_offset_s=-0.02)
    (file,) = command_of(world.make_result(), ReadSettings(), StoredRequest(initial_guess=wire)).files
    path = tmp_path / file.name
    path.write_text(file.text)
    if not meant:
        for refused in (lambda: start_of(wire), lambda: api.read_initial_guess(path)):
            with pytest.raises(SettingsError, match="T_imu_lidar"):
                refused()
        return
    page, line = start_of(wire), api.read_initial_guess(path)
    np.testing.assert_array_equal(page.R_imu_lidar, line.R_imu_lidar)
    np.testing.assert_allclose(page.R_imu_lidar @ page.R_imu_lidar.T, np.eye(3), atol=1e-14)
    assert page.time_offset_ns == line.time_offset_ns == -20_000_000


def test_a_forecast_that_is_useless_says_so_and_what_to_do():
    """Where the motion does not tell an axis, another motion is asked for; where too few planes are left, more planes.

    Mutations: weak by what the planes fix alone; one advice for both; an axis that only a prior holds taken for known; the
    forecast's first advice, which is about a turn, given for a position.
    """
    good = foreseen(FORECAST, ALL)
    assert good is not None
    assert (good.weak, good.text) == (False, "")

    def with_std(std: float, *, weak: bool = False) -> Forecast:
        changed = tuple(
            p.model_copy(update={"std": std, "weak": weak, "advice": "Tilt the rig."}) if p.name == "tz" else p
            for p in FORECAST.parameters
        )
        return FORECAST.model_copy(update={"parameters": changed, "advice": ("Turn about x.", "Tilt the rig.")})

    for forecast in (with_std(1.5), with_std(0.001, weak=True)):
        useless = foreseen(forecast, ALL)
        assert useless is not None
        assert useless.weak
        assert "Position z" in useless.text
        assert useless.text.endswith("does not determine it. Tilt the rig.")
    silent = with_std(1.5).model_copy(
        update={"parameters": tuple(p.model_copy(update={"advice": ""}) for p in with_std(1.5).parameters)}
    )
    asked = foreseen(silent, ALL)
    assert asked is not None
    assert asked.text.endswith("Record again, with turns about all three axes.")
    starved = foreseen(with_std(0.019), 1.1 * ALL)
    assert starved is not None
    assert starved.weak
    assert starved.text.endswith("Confirm more planes.")


def test_what_has_a_number_is_not_called_unknown():
    """Mutation: unknown for each axis beyond its limit, above its own standard deviation."""

    def said(name: str, std: float) -> str:
        changed = (
            p.model_copy(update={"std": std, "weak": True}) if p.name == name else p for p in FORECAST.parameters
        )
        found = foreseen(FORECAST.model_copy(update={"parameters": tuple(changed)}), ALL)
        assert found is not None
        return found.text.split(", whichever")[0]

    assert said("tz", 0.035) == "Position z would stay weak, ± 35 mm"
    assert said("rx", 2.0) == "Turn x would stay weak, ± 2.0°"
    assert said("tz", 1.0) == "Position z would stay unknown"
    assert said("rx", 180.0) == "Turn x would stay unknown"
    assert said("tz", 0.001) == "Position z would rest on what is known beforehand"
