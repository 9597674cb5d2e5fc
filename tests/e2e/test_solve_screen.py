"""Solve in a browser: a run drawn from its messages, watched live by two, and cancelled."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from calib_core.simulate import simulate
from tests.e2e.support import (
    JOB_WAIT_S,
    Api,
    Complaints,
    Server,
    go_on,
    keep_screenshot,
    opened,
    serious_faults,
    until,
    wait_for_cloud,
)

both = pytest.mark.parametrize("scheme", ["dark", "light"], indirect=True)


@both
def test_solve(page: Page, api: Api, solved: tuple[str, str], scheme: str) -> None:
    """A finished run is drawn whole from its messages after a reload: seven numbers with error bars, planes by name.

    Fails with the stream's first messages left out; with the standard deviations swapped for the values; with the
    sweeps left out of the steps (the caption has no thickness); with the thickness of these sweeps told on, where Inspect has
    that of all.
    """
    page.goto(f"/r/{solved[0]}/solve?job={solved[1]}")
    expect(page.get_by_role("heading", name="Solved")).to_be_visible()
    answer = page.get_by_role("table", name="The answer so far")
    expect(answer.get_by_text("±")).to_have_count(7)
    spreads = [float(text) for text in re.findall(r"± (\d+\.\d+)", answer.inner_text())]
    assert len(spreads) == 7
    assert max(spreads) < 5.0  # mm, degrees and ms: values are in the hundreds
    expect(
        page.get_by_role("region", name="Distance of points to their plane").get_by_role("listitem")
    ).not_to_have_count(0)
    walls = api.ask("GET", f"/api/results/{solved[1]}/thickness")
    after, before = (f"{1e3 * walls[key]:.1f}" for key in ("after_rms_m", "before_rms_m"))
    told = f"sweeps as solved. All walls of the recording: {after} mm thick ({before} mm with the motion left in)"
    expect(page.get_by_text(told)).to_be_visible()
    expect(page.get_by_role("button", name="Inspect the answer")).to_be_enabled()
    wait_for_cloud(page)
    assert serious_faults(page) == []
    keep_screenshot(page, "solve", scheme)


def test_what_a_solve_can_be_told_is_there_before_the_first(page: Page, api: Api, bag: Path) -> None:
    """Nobody has to solve wrongly first. Oracle: the job's own settings.

    Mutations: no controls before there is a run; the button beside the choices and not of them; a choice that is not sent; the
    run not followed.
    """
    recording = api.upload(bag)
    api.wait_for_planes(recording)
    page.goto(f"/r/{recording}/solve")
    expect(page.get_by_role("heading", name="Nothing has been solved yet")).to_be_visible()
    page.get_by_text("Sensors, gravity and where to start").click()
    page.get_by_label("Lidar sampling").select_option("as stamped")
    page.get_by_role("button", name="Solve", exact=True).click()
    expect(page).to_have_url(re.compile("job="))
    job = re.findall(r"job=(\w+)", page.url)[0]
    assert api.ask("GET", f"/api/jobs/{job}")["settings"]["lidar_sampling"] == "as-stamped"
    api.ask("POST", f"/api/jobs/{job}/cancel")


@pytest.fixture
def long_recording(api: Api, tmp_path: Path) -> str:
    """A recording whose solve lasts: two browsers that draw in software need a while until they look at it."""
    path = tmp_path / "long.bag"
    simulate("paper-normal", path, seed=5, duration_s=25.0)
    recording = api.upload(path)
    api.wait_for_planes(recording)
    return recording


def test_two_browsers_watch_one_run_and_one_of_them_stops_it(
    page: Page, browser: Browser, server: Server, api: Api, long_recording: str
) -> None:
    """A run started in one browser is the run the other sees; what one cancels is cancelled for both.

    Fails with the recording's feed not telling of jobs; with every run that has ended called solved.
    """
    recording = long_recording
    with opened(browser, server.address) as other:
        second = other.new_page()
        complaints = Complaints(second)
        second.goto(f"/r/{recording}/recording")
        steps = second.get_by_role("navigation", name="Steps")
        expect(steps.get_by_role("link", name="Solve")).to_be_visible()
        page.goto(f"/r/{recording}/planes")
        go_on(page, "Solve with")
        expect(page).to_have_url(re.compile("job="))
        job = re.findall(r"job=(\w+)", page.url)[0]
        with server.workers_stand_still():
            steps.get_by_role("link", name="Solve").click()
            expect(second.get_by_role("heading", name="Solving")).to_be_visible()
            expect(second.get_by_text("Start values")).to_be_visible()
            second.get_by_role("button", name="Cancel").click()
        until(lambda: api.ask("GET", f"/api/jobs/{job}")["state"] == "cancelled")
        for one in (page, second):
            expect(one.get_by_role("button", name="Once more as it was")).to_be_visible(timeout=JOB_WAIT_S * 1000)
            expect(one.get_by_role("heading", name="Cancelled")).to_be_visible()
        assert complaints.texts == []


def test_two_recordings_at_once_keep_to_themselves(
    page: Page, browser: Browser, address: str, api: Api, solved: tuple[str, str], bag: Path
) -> None:
    """What is edited and shown of one recording leaves the other as it was, in its browser and on the server.

    Fails with one view for all recordings; with the feed telling everybody everything.
    """
    recording, job = solved
    second_recording = api.upload(bag)
    api.wait_for_planes(second_recording)
    page.goto(f"/r/{recording}/inspect?job={job}&scan=12&show=deskewed")
    until(lambda: api.view(recording)["scan"] == 12)
    before, shown = api.planes(recording), api.view(recording)
    with opened(browser, address) as other:
        second = other.new_page()
        second.goto(f"/r/{second_recording}/planes")
        second.get_by_role("checkbox").first.click()  # not uncheck(): that looks at once, the page draws a moment later
        until(lambda: any(not patch["confirmed"] for patch in api.planes(second_recording)["patches"]))
        assert api.view(second_recording)["mode"] == "planes"
    assert api.planes(recording) == before
    assert api.view(recording) == shown
    expect(page.get_by_text("13 / ")).to_be_visible()
