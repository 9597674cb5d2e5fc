"""A result for people: the sentence and the page."""

from __future__ import annotations

import io
import re

from rich.console import Console

from app.cli.summary import result_summary
from app.results.report import report_page
from app.results.verdict import tone, verdict
from calib_core.result import Message, WeakDirection
from tests.app.support import world


def test_the_verdict_says_how_well_the_worst_axis_is_known():
    """Oracle: the world's sigmas. Mutation: min instead of max flatters."""
    assert verdict(world.make_result()) == (
        "Calibrated. One standard deviation is 0.030 deg, 3.0 mm and 0.40 ms at most."
    )
    assert verdict(world.make_result("refused")) == "Refused. Nothing moves; record motion."
    weak = world.make_result("weak")
    weak.observability.weak_directions.append(
        WeakDirection(label="tz", vector=[0.0] * 7, std_scaled=4.0, text="Turn more.")
    )
    assert verdict(weak) == "Weak. Turn more."


def test_an_answer_that_contradicts_itself_is_weak_in_its_first_words():
    """Mutations: as if the error bars allowed for it; without them; the disagreement told instead of a weak axis."""
    torn = world.make_result("weak")
    torn.messages.append(Message(code="solve.disagreement", level="warning", text="the parts disagree 8.4 times"))
    assert verdict(torn) == (
        "Weak. Parts of the recording contradict each other, so that errors may be larger than stated. One standard deviation is "
        "0.030 deg, 3.0 mm and 0.40 ms at most."
    )
    torn.observability.weak_directions.append(
        WeakDirection(label="tz", vector=[0.0] * 7, std_scaled=4.0, text="Turn more.")
    )
    assert verdict(torn).endswith("Turn more.")


def test_an_answer_that_rests_on_what_is_doubtful_says_so_first_and_is_not_green():
    """Where a person insists on a plane. Mutations: green; after the sigmas; two planes told as one; said of one left out."""
    result = world.make_result()
    left_out = Message(code="planes.bent", level="warning", text="wall 5 is not flat: left out")
    result.messages.append(left_out)
    assert (tone(result), verdict(result)[:30]) == ("good", "Calibrated. One standard devia")
    text = "wall 6 is not flat, but is used because it was chosen: leave it out and solve again"
    result.messages.append(Message(code="planes.doubted", level="warning", text=text))
    assert tone(result) == "doubtful"
    assert verdict(result).startswith(f"Calibrated. W{text[1:]}. One standard deviation is")
    result.messages.append(Message(code="planes.doubted", level="warning", text=text.replace("6", "7")))
    assert verdict(result).startswith(
        "Calibrated. 2 planes are doubtful, but are used because they were chosen: leave them out and solve again. One standard "
        "deviation is"
    )


def test_an_answer_that_some_chosen_planes_have_no_part_in_says_so_first_and_is_not_green():
    """Seen: the planes of another recording, one of which fits by chance, and a green answer. Mutations: green; after the sigmas;
    two told as one; nothing of what is doubtful beside."""
    result = world.make_result()
    text = (
        "no point lies on side 1 in the end: it has next to no effect on the answer, and may not be where it was placed"
    )
    result.messages.append(Message(code="planes.unseen", level="warning", text=text))
    assert tone(result) == "doubtful"
    assert verdict(result).startswith(f"Calibrated. N{text[1:]}. One standard deviation is")
    result.messages.append(Message(code="planes.unseen", level="warning", text=text.replace("1", "2")))
    told = (
        "2 of the chosen planes have next to no effect on the answer, and may not be where they were placed. One standard "
        "deviation is"
    )
    assert verdict(result).startswith(f"Calibrated. {told}")
    result.messages.append(Message(code="planes.doubted", level="warning", text="wall is not flat"))
    assert verdict(result).startswith(f"Calibrated. Wall is not flat. {told}")


def test_an_answer_by_other_planes_than_were_chosen_says_so_first_and_is_not_green():
    """Mutations: green; after the sigmas."""
    result = world.make_result()
    text = (
        "the chosen planes do not determine the motion: floor is not flat; the answer uses all planes that were found"
    )
    result.messages.append(Message(code="planes.instead", level="warning", text=text))
    assert tone(result) == "doubtful"
    assert verdict(result).startswith(f"Calibrated. T{text[1:]}. One standard deviation is")


def test_the_summary_says_when_the_time_offset_holds():
    """As report and page do. Oracle: by hand. Mutations: no word; of clocks that were taken to run alike, too."""

    def told(result):
        console = Console(width=200, file=io.StringIO(), highlight=False)
        console.print(result_summary(result))
        return console.file.getvalue()

    result = world.make_result()
    assert "after the recording began" not in told(result)
    result.clock_rate_ppm, result.clock_rate_ppm_std, result.time_offset_at_s = 12.34, 0.42, 9.96
    words = "The offset holds 10.0 s after the recording began; from there it changes by 12.34 ± 0.42 µs per second."
    assert words in told(result)


def test_an_offset_that_was_held_has_no_sigma():
    """Held by a prior of a nanosecond it would be known to 0.0000010 ms. Mutation: the prior's sigma told, anywhere."""
    result = world.make_result()
    assert result.uncertainty is not None
    result.uncertainty.time_offset_std_s = 1e-9
    result.provenance.settings["estimate_time_offset"] = False
    assert verdict(result) == (
        "Calibrated. One standard deviation is 0.030 deg and 3.0 mm at most; the time offset was held, not estimated."
    )
    console = Console(file=io.StringIO(), width=120)
    console.print(result_summary(result))
    *_, last = (line for line in console.file.getvalue().splitlines() if "1 sigma" in line)
    assert re.search(r"1 sigma +held(?! +[-\d])", last)
    assert re.search(r">Time offset \[ms\]</th><td[^>]*>[-\d.]+</td><td[^>]*>held</td>", report_page(result))


def test_the_page_stands_alone_and_escapes_what_files_say():
    """Mutation: not escaping the recording's name runs its script."""
    page = report_page(world.make_result(name="<script>alert(1)</script>.bag"))
    assert "<script" not in page
    assert "&lt;script&gt;" in page
    assert "http" not in page
    assert ">100.0<" in page  # to the digits of its sigma, 1.0 mm
    assert "Nothing moves" in report_page(world.make_result("refused"))
