"""The table of a fleet as JSON and as a page: what it holds, what it lets in, how it is sorted, and how often it is written."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from app.cli.fleet_table import row_line
from app.fleet import overview as overviews
from app.fleet.orders import FleetOrder, FleetOutcome
from app.fleet.overview import JSON_NAME, PAGE_NAME, Overview
from app.fleet.summary import Row, row_of
from calib_core.result import Message, WeakDirection
from tests.core.exporters.results import make_result

SIGMAS = {f"rotation_std_{axis}_deg": 0.01 for axis in "xyz"} | {f"translation_std_{axis}_m": 0.002 for axis in "xyz"}


def row(name, verdict="calibrated", **more):
    known = SIGMAS | {"time_offset_std_s": 1e-5} if verdict in {"calibrated", "weak"} else {}
    return Row.model_validate({"name": name, "recording": f"/r/{name}.bag", "verdict": verdict, **known, **more})


ROWS = [
    row("car-10", duration_s=12.0, translation_std_y_m=0.00225),
    row("car-2", duration_s=30.0, translation_std_y_m=0.0025),
    row("car-3", "weak", translation_std_z_m=4.2, sentence="The height is open."),
    row("dolly", "refused", code="motion.none", sentence="It stands still; record motion."),
    row("lost", "failed", code="job.lost", sentence="The worker was lost.", tries=3),
]


def test_json_has_every_row_and_says_how_far_it_is(tmp_path):
    """Oracle: the rows, read back. Mutations: empty figures left as texts; the recordings of the run before forgotten."""
    page = Overview(tmp_path, ROWS[:3], total=7)
    page.add(ROWS[3])
    page.add(ROWS[4])
    page.write(is_running=False)
    told = json.loads((tmp_path / JSON_NAME).read_text())
    assert (told["schema"], told["done"], told["total"], told["is_running"]) == ("unsweep.fleet/1", 5, 7, False)
    assert told["counts"] == {"calibrated": 2, "weak": 1, "refused": 1, "failed": 1}
    found = {facts["name"]: facts for facts in told["recordings"]}
    assert found["dolly"]["rotation_std_x_deg"] is None
    assert found["car-3"]["translation_std_z_m"] == 4.2
    assert {
        Row.model_validate({k: "" if v is None else v for k, v in facts.items()}).name for facts in found.values()
    } == {each.name for each in ROWS}


def test_the_page_links_documents_and_lets_nobody_s_words_act(tmp_path):
    """Mutations: a link to a document that is not there; names not escaped; a script, a font or a picture from elsewhere."""
    evil = row("<script>alert(1)</script>", sentence='"><img src=x onerror=alert(2)>')
    Overview(tmp_path, [*ROWS, evil, row("a b#c")], total=7).write(is_running=False)
    text = (tmp_path / PAGE_NAME).read_text()
    linked = re.findall(r'href="([^"]+\.json)"', text)
    assert {"car-2.json", "dolly.json", "a%20b%23c.json"} < set(linked)
    assert "lost.json" not in linked
    assert "<script>alert" not in text and "<img" not in text
    assert not re.search(r"https?:|//[a-z]|@import|url\(", text.replace("default-src", ""))
    assert "default-src 'none'" in text


def test_a_verdict_is_told_by_word_and_sign_beside_its_colour(tmp_path):
    """Mutations: a sign for two verdicts; the word left out."""
    Overview(tmp_path, ROWS, total=5).write(is_running=False)
    cells = re.findall(r'<td class="v".*?</td>', (tmp_path / PAGE_NAME).read_text())
    told = {re.sub(r"<[^>]+>", " ", cell).split()[1]: re.sub(r"<[^>]+>", " ", cell).split()[0] for cell in cells}
    assert set(told) == {"calibrated", "weak", "refused", "failed"}
    assert len(set(told.values())) == 4


def test_a_fleet_under_way_is_written_seldom_and_looked_at_often(tmp_path, monkeypatch):
    """A clock of our own. Mutations: written with each row; a page that never looks again, or does so for ever."""
    now_s = [0.0]
    monkeypatch.setattr(overviews.time, "monotonic", lambda: now_s[0])
    page = Overview(tmp_path, [], total=100, where="2 processes on this machine")
    written = 0
    for number in range(100):
        now_s[0] += 0.1
        before = (tmp_path / JSON_NAME).stat().st_ino if number else None
        page.add(row(f"r{number}"))
        written += (tmp_path / JSON_NAME).stat().st_ino != before
    assert 9 <= written <= 11
    assert 'http-equiv="refresh"' in (tmp_path / PAGE_NAME).read_text()
    page.write(is_running=False)
    text = (tmp_path / PAGE_NAME).read_text()
    assert 'http-equiv="refresh"' not in text and text.count('<tr class="calibrated">') == 100


def test_what_a_weak_one_left_open_is_in_its_row(tmp_path):
    """As the verdict has it: what is weak, and what disagrees. Mutations: the reason of refused ones alone; of weak ones alone;
    the first direction alone.
    """
    order = FleetOrder(name="a", recording=tmp_path / "a.bag")
    result = make_result(np.eye(3), np.array([0.1, 0.2, 0.3]), 4_000_000, status="weak")
    open_ = WeakDirection(label="tz", vector=[0.0] * 7, std_scaled=9.0, text="The height is open.")
    result.observability.weak_directions = [open_]
    found = row_of(order, FleetOutcome(document=result.to_json()), 1, None)
    assert (found.verdict, found.sentence) == ("weak", "The height is open.")
    assert "1 sigma up to" in row_line(found) and row_line(found).endswith(": The height is open.")
    result.observability.weak_directions = [open_, open_]
    result.observability.weak_axes = ["ty", "tz"]
    several = row_of(order, FleetOutcome(document=result.to_json()), 1, None)
    assert several.sentence == "The height is open. Weak are position y and position z."
    good = make_result(np.eye(3), np.array([0.1, 0.2, 0.3]), 4_000_000)
    assert row_of(order, FleetOutcome(document=good.to_json()), 1, None).sentence == ""
    good.messages.append(Message(code="solve.disagreement", level="warning", text="parts disagree 3-fold"))
    torn = row_of(order, FleetOutcome(document=good.to_json()), 1, None)
    assert torn.verdict == "calibrated" and torn.sentence.startswith("Parts of the recording disagree")


@pytest.fixture
def opened(tmp_path, browser):
    """The page in a browser, from its file."""
    Overview(tmp_path, ROWS, total=6).write(is_running=False)
    page = browser.new_page()
    complaints = []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto((tmp_path / PAGE_NAME).as_uri())
    yield page
    page.close()
    assert complaints == []


def test_the_page_is_sorted_and_filtered_without_a_network(opened):
    """Figures by size, names as people count, what has no figure last either way; a look again shows the same.

    Mutations: figures compared as words; names letter by letter; the order forgotten when the page is loaded again.
    """

    def names():
        return opened.eval_on_selector_all(
            "tbody tr:not([hidden]) th", "all => all.map(one => one.firstChild.textContent)"
        )

    opened.get_by_role("button", name="recording", exact=True).click()
    assert names() == ["car-2", "car-3", "car-10", "dolly", "lost"]
    opened.get_by_role("button", name="translation, mm").click()
    assert names()[:3] == ["car-10", "car-2", "car-3"]
    opened.get_by_role("button", name="translation, mm").click()
    assert names()[0] == "car-3" and set(names()[3:]) == {"dolly", "lost"}
    assert opened.locator("th[aria-sort=descending]").inner_text().startswith("translation")
    opened.reload()
    assert names()[0] == "car-3"
    opened.get_by_role("button", name="refused").click()
    assert names() == ["dolly"]
    opened.get_by_role("button", name="refused").click()
    opened.get_by_role("searchbox").fill("HEIGHT")
    assert names() == ["car-3"]
    opened.get_by_role("searchbox").fill("nothing like it")
    assert opened.get_by_text("No recording is like that.").is_visible()
