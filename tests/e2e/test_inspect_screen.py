"""Inspect in a browser: clouds compared, a bad scan found and left out, the cost of being wrong, an old extrinsic."""

from __future__ import annotations

import io
import json
import re

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Locator, Page, expect

from tests.e2e.support import Api, coloured, keep_screenshot, scene, serious_faults, until, wait_for_cloud

both = pytest.mark.parametrize("scheme", ["dark", "light"], indirect=True)


def strip(page: Page) -> Locator:
    """The plot of every scan's spread."""
    return page.get_by_test_id("scan-strip")


def drag_across(page: Page, plot: Locator, start: float, end: float) -> None:
    """Drag over the plot from one share of its width to another."""
    box = plot.bounding_box()
    assert box is not None
    y = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + start * box["width"], y)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.5 * (start + end) * box["width"], y)
    page.mouse.move(box["x"] + end * box["width"], y)
    page.mouse.up()


@both
def test_inspect(page: Page, api: Api, solved: tuple[str, str], scheme: str) -> None:
    """It opens where the motion shows, the view is in the URL, walls get thinner, and a nudge says what it costs.

    Fails with both clouds in one place, where nothing is to be seen; with before and after swapped; with the nudge not sent.
    """
    recording, job = solved
    page.goto(f"/r/{recording}/inspect?job={job}&scan=40")
    expect(page.get_by_text("41 / ")).to_be_visible()
    until(lambda: [api.view(recording)[key] for key in ("show", "extent", "color_by")] == ["side", "map", "residual"])
    walls = page.get_by_role("region", name="Wall thickness")
    before, after = (float(text) for text in re.findall(r"\d+\.\d", walls.locator("p").first.inner_text())[:2])
    assert after < before
    wait_for_cloud(page)
    assert serious_faults(page) == []
    keep_screenshot(page, "inspect", scheme)
    page.get_by_text("One scan", exact=True).click()
    until(lambda: api.view(recording)["extent"] == "scan")
    page.keyboard.press("m")
    until(lambda: api.view(recording)["extent"] == "map")
    page.get_by_role("button", name="Turn about x: more").click()
    expect(page.get_by_text("with this error")).to_be_visible()
    expect(page).to_have_url(re.compile("rx_deg"))
    blur = api.view(recording)["blur"]
    assert blur["nudged_rms_m"] > blur["solved_rms_m"]
    page.get_by_role("button", name="Back to the answer").click()
    until(lambda: api.view(recording)["nudge"] is None)


@both
def test_wipe_between_raw_and_deskewed(page: Page, api: Api, solved: tuple[str, str], scheme: str) -> None:
    """The line is dragged and stepped, and what is drawn changes at it.

    Fails with the line's place not sent; with the cut made from the wrong camera (nothing changes under the line).
    """
    recording, job = solved
    api.as_detected(recording)  # under their own names in the picture
    page.goto(f"/r/{recording}/inspect?job={job}&scan=40&show=wipe&color=plane")
    line = page.get_by_role("slider", name="Wipe")
    expect(line).to_be_visible()
    wait_for_cloud(page)
    assert serious_faults(page) == []
    keep_screenshot(page, "wipe", scheme)
    box = line.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] - 180, box["y"] + box["height"] / 2)
    page.mouse.up()
    until(lambda: api.view(recording)["wipe"] < 0.35)
    at = api.view(recording)["wipe"]
    expect(line).to_have_attribute("aria-valuenow", str(round(100 * at)))
    line.press("ArrowRight")
    until(lambda: abs(api.view(recording)["wipe"] - at - 0.02) < 0.002)
    line.press("End")
    until(lambda: api.view(recording)["wipe"] == 1.0)
    page.wait_for_timeout(1500)
    all_raw = coloured(page)
    line.press("Home")
    until(lambda: api.view(recording)["wipe"] == 0.0)
    until(lambda: bool(np.mean(coloured(page) != all_raw) > 0.01), wait_s=60.0)


@pytest.mark.parametrize("width", [1280, 390])
def test_the_wipes_line_leaves_the_legend_readable(page: Page, solved: tuple[str, str], width: int) -> None:
    """The line goes behind the legend and the view's tools, and what it is called stands clear of them.

    Fails with the line drawn over the legend (a white stroke through its words); with the names at the line's lower end.
    """
    recording, job = solved
    page.set_viewport_size({"width": width, "height": 844})
    page.goto(f"/r/{recording}/inspect?job={job}&scan=40&show=wipe&wipe=0.1")
    legend = page.get_by_text("Left of the line: raw")
    expect(legend).to_be_visible()
    line, words = page.get_by_role("slider", name="Wipe").bounding_box(), legend.bounding_box()
    assert line is not None
    assert words is not None
    x = line["x"] + line["width"] / 2
    assert words["x"] < x < words["x"] + words["width"]
    clip = {"x": x - 1, "y": words["y"], "width": 2, "height": words["height"]}
    picture = np.asarray(Image.open(io.BytesIO(page.screenshot(clip=clip))).convert("L"))
    assert np.mean(picture > 210) < 0.3
    for name in ("Raw", "De-skewed"):
        box = page.get_by_text(name, exact=True).last.bounding_box()
        assert box is not None
        assert box["y"] + box["height"] < words["y"]


@both
def test_an_old_extrinsic_beside_the_answer(page: Page, api: Api, solved: tuple[str, str], scheme: str) -> None:
    """A pasted extrinsic is shown side by side with raw and de-skewed, its cost is said, and the URL keeps it.

    Fails with the direction of bare numbers not sent; with the old cost taken for the answer's.
    """
    recording, job = solved
    page.goto(f"/r/{recording}/inspect?job={job}&scan=40")
    section = page.get_by_role("region", name="Your old extrinsic")
    paste = section.get_by_role("textbox")
    result = api.ask("GET", f"/api/results/{job}")
    matrix = np.array(result["T_imu_lidar"]["matrix"])
    wrong = matrix.copy()
    wrong[:3, :3] = matrix[:3, :3] @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # a quarter turn about the lidar's x
    section.get_by_text("IMU → lidar", exact=True).click()
    paste.fill(json.dumps(np.linalg.inv(wrong).tolist()))
    section.get_by_role("button", name="Show it").click()
    until(lambda: api.view(recording)["old"] is not None)
    np.testing.assert_allclose(api.view(recording)["old"]["translation_m"], wrong[:3, 3], atol=1e-6)
    expect(section.get_by_role("status")).to_contain_text("thick with it")
    cost = api.view(recording)["old_blur"]
    assert cost["nudged_rms_m"] > 2 * cost["solved_rms_m"]
    page.get_by_text("Side by side", exact=True).click()
    until(lambda: api.view(recording)["show"] == "side")
    wait_for_cloud(page)
    assert serious_faults(page) == []
    keep_screenshot(page, "old-extrinsic", scheme)
    page.reload()
    expect(section.get_by_role("status")).to_contain_text("thick with it")
    section.get_by_role("button", name="Remove").click()
    until(lambda: api.view(recording)["old"] is None)


def test_a_click_on_the_plot_goes_to_the_scan_and_playing_moves_on(
    page: Page, api: Api, solved: tuple[str, str]
) -> None:
    """Scans by plot, by slider's keys and by playing; the canvas orbits under the mouse.

    Fails with the plot's clicks not heard; with the clock of playing not started.
    """
    recording, job = solved
    page.goto(f"/r/{recording}/inspect?job={job}&scan=40&show=deskewed")
    wait_for_cloud(page)
    box = strip(page).bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + 0.755 * box["width"], box["y"] + 20)
    until(lambda: api.view(recording)["scan"] == 75)
    expect(page.get_by_text("76 / ")).to_be_visible()
    page.get_by_role("button", name="Go to the worst scan").click()
    rms = api.ask("GET", f"/api/results/{job}/scans")["rms_m"]
    until(lambda: api.view(recording)["scan"] == int(np.argmax(rms)))
    page.get_by_role("button", name="Play").click()
    until(lambda: api.view(recording)["scan"] not in {75, int(np.argmax(rms))})
    page.get_by_role("button", name="Pause").click()
    before = coloured(page)
    area = scene(page).bounding_box()
    assert area is not None
    page.mouse.move(area["x"] + 400, area["y"] + 300)
    page.mouse.down()
    page.mouse.move(area["x"] + 620, area["y"] + 300, steps=5)
    page.mouse.up()
    until(lambda: bool(np.mean(coloured(page) != before) > 0.01), wait_s=60.0)


def test_a_span_is_left_out_and_solved_again_without(page: Page, api: Api, solved: tuple[str, str]) -> None:
    """Dragged across the plot, said in the list, undone, dragged again, solved: the new run has no scans of it.

    Fails with the spans left out of the new job's settings; with the drag taken for a click.
    """
    recording, job = solved
    page.goto(f"/r/{recording}/inspect?job={job}&scan=40")
    expect(strip(page)).to_be_visible()
    drag_across(page, strip(page), 0.605, 0.655)
    spans = page.get_by_role("list", name="Spans to leave out")
    expect(spans.get_by_role("listitem")).to_have_count(1)
    expect(page).to_have_url(re.compile(r"out=6\.\d*-6\.\d"))
    spans.get_by_role("button", name="Keep").click()
    expect(spans).to_have_count(0)
    drag_across(page, strip(page), 0.655, 0.605)
    low, high = (float(text) for text in re.findall(r"\d+\.\d+", spans.inner_text())[:2])
    assert (low, high) == (pytest.approx(6.05, abs=0.1), pytest.approx(6.55, abs=0.1))
    page.get_by_role("button", name="Solve again without it").click()
    expect(page.get_by_role("button", name="Inspect the answer")).to_be_enabled(timeout=180_000)
    again = re.findall(r"job=(\w+)", page.url)[0]
    assert again != job
    settings = api.ask("GET", f"/api/jobs/{again}")["settings"]
    np.testing.assert_allclose(settings["excluded_spans_s"], [[low, high]], atol=0.01)
    one, other = (api.ask("GET", f"/api/results/{name}")["quality"] for name in (job, again))
    assert one["scans_used"] - other["scans_used"] in {5, 6, 7}
    page.goto(f"/r/{recording}/result?job={again}")
    expect(page.get_by_role("group", name="the command")).to_contain_text("--exclude=6.0")
    expect(page.get_by_role("region", name="Runs of this recording")).to_contain_text("without 6.")
