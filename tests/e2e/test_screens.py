"""One test a screen, in both colour schemes: it works by roles and labels, and axe finds nothing serious."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Page, expect

from tests.e2e.support import Api, keep_screenshot, serious_faults, until, wait_for_cloud

both = pytest.mark.parametrize("scheme", ["dark", "light"], indirect=True)


@both
def test_start(page: Page, solved: tuple[str, str], scheme: str) -> None:
    """The start page lists what is there, opens the server's folder, and shows its keys.

    Fails with the keyboard help not bound to `?`; with the placeholder ink a shade lighter (axe: contrast).
    """
    page.goto("/")
    row = page.get_by_role("link", name="room.bag").first
    expect(row).to_contain_text("Calibrated")
    expect(page.get_by_role("button", name="Try the sample")).to_be_enabled()
    assert serious_faults(page) == []
    keep_screenshot(page, "start", scheme)
    page.keyboard.press("?")
    keys = page.get_by_role("dialog", name="Keyboard")
    expect(keys).to_contain_text("Try the sample")
    assert serious_faults(page) == []
    page.keyboard.press("Escape")
    page.keyboard.press("f")
    expect(page.get_by_role("dialog", name="Recordings on the server")).to_contain_text("notes.txt")


@both
def test_recording(page: Page, solved: tuple[str, str], scheme: str) -> None:
    """The doctor's verdict, the sensors, and a span dragged out by keyboard.

    Fails with the span's handles not focusable; with the report's findings not listed.
    """
    page.goto(f"/r/{solved[0]}/recording")
    expect(page.get_by_role("heading", name="Usable, with limits")).to_be_visible()
    expect(page.get_by_role("region", name="Lidar")).to_contain_text("/velodyne_points")
    expect(page.get_by_role("region", name="Findings").get_by_role("listitem").first).to_be_visible()
    assert serious_faults(page) == []
    keep_screenshot(page, "recording", scheme)
    start = page.get_by_role("slider", name="Start of the span")
    start.focus()
    start.press("PageUp")
    expect(start).to_have_attribute("aria-valuetext", "1.0 seconds")
    expect(page.get_by_role("button", name="Use this span")).to_be_enabled()


@both
def test_planes(page: Page, api: Api, solved: tuple[str, str], scheme: str) -> None:
    """A plane dropped in the list changes the sentence, is undone by key, and another browser would see the same.

    Fails with undo not bound; with the answer of an operation not put into the cache.
    """
    page.goto(f"/r/{solved[0]}/planes")
    sentence = page.get_by_role("status", name="Do these planes determine the answer")
    expect(sentence).to_contain_text("planes")
    wait_for_cloud(page)
    assert serious_faults(page) == []
    keep_screenshot(page, "planes", scheme)
    before = sentence.inner_text()
    page.get_by_role("checkbox").first.uncheck()
    expect(sentence).not_to_have_text(before)
    assert sum(not patch["confirmed"] for patch in api.planes(solved[0])["patches"]) == 1
    page.keyboard.press("Control+z")
    expect(page.locator("tr[data-confirmed=false]")).to_have_count(0)
    page.get_by_role("button", name=re.compile("More for")).first.click()
    page.get_by_role("menuitem", name="Rename").click()
    page.get_by_role("textbox", name="New name").fill(f"wall {scheme}")
    page.keyboard.press("Enter")
    until(lambda: any(patch["name"] == f"wall {scheme}" for patch in api.planes(solved[0])["patches"]))


@both
def test_solve(page: Page, solved: tuple[str, str], scheme: str) -> None:
    """A finished run is drawn whole from its messages after a reload.

    Fails with the stream's first messages left out; with the standard deviations swapped for the values.
    """
    page.goto(f"/r/{solved[0]}/solve?job={solved[1]}")
    expect(page.get_by_role("heading", name="Solved")).to_be_visible()
    answer = page.get_by_role("table", name="The answer so far")
    expect(answer.get_by_text("±")).to_have_count(7)
    expect(page.get_by_role("button", name="Inspect the answer")).to_be_enabled()
    wait_for_cloud(page)
    assert serious_faults(page) == []
    keep_screenshot(page, "solve", scheme)


@both
def test_inspect(page: Page, api: Api, solved: tuple[str, str], scheme: str) -> None:
    """The view is in the URL, walls get thinner, and a nudge says what it costs.

    Fails with before and after swapped; with the nudge not sent.
    """
    recording, job = solved
    page.goto(f"/r/{recording}/inspect?job={job}&scan=40&show=both")
    expect(page.get_by_text("41 / ")).to_be_visible()
    walls = page.get_by_role("region", name="Wall thickness")
    before, after = (float(text) for text in re.findall(r"\d+\.\d", walls.locator("p").first.inner_text())[:2])
    assert after < before
    wait_for_cloud(page)
    assert serious_faults(page) == []
    keep_screenshot(page, "inspect", scheme)
    page.keyboard.press("m")
    until(lambda: api.view(recording)["show"] == "map")
    page.get_by_role("button", name="Turn about x: more").click()
    expect(page.get_by_text("with this error")).to_be_visible()
    expect(page).to_have_url(re.compile("rx_deg"))
    page.get_by_role("button", name="Back to the answer").click()
    until(lambda: api.view(recording)["nudge"] is None)


@both
def test_result(page: Page, solved: tuple[str, str], scheme: str) -> None:
    """The verdict, the transform both ways, an export and the command are there.

    Fails with the inverse's translation not turned; with the export's format ignored.
    """
    recording, job = solved
    page.goto(f"/r/{recording}/result?job={job}")
    expect(page.get_by_role("heading", name="Calibrated")).to_be_visible()
    numbers = page.get_by_role("table", name="Transform and time offset")
    forward = numbers.get_by_role("row", name="p x").inner_text()
    page.get_by_text("T_lidar_imu", exact=True).click()
    expect(numbers.get_by_role("row", name="p x")).not_to_have_text(forward)
    page.get_by_text("T_imu_lidar", exact=True).click()
    page.get_by_role("combobox", name="Format").select_option("urdf")
    expect(page.get_by_role("group", name="the urdf text")).to_contain_text("rpy")
    expect(page.get_by_role("group", name="the command")).to_contain_text("unsweep calibrate room.bag")
    assert serious_faults(page) == []
    keep_screenshot(page, "result", scheme)
