"""How recordings come in, and planes edited with the mouse in the scene."""

from __future__ import annotations

import json
import re
import tarfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.error import HTTPError

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from tests.e2e.support import (
    JOB_WAIT_S,
    Api,
    at_rest,
    coloured,
    dense_spots,
    keep_screenshot,
    scene,
    serious_faults,
    until,
    wait_for_cloud,
)

both = pytest.mark.parametrize("scheme", ["dark", "light"], indirect=True)

DROP = """([name, text]) => {
  const transfer = new DataTransfer();
  transfer.items.add(new File([text], name));
  window.dispatchEvent(new DragEvent('dragenter', {dataTransfer: transfer}));
  return transfer;
}"""


@pytest.fixture
def as_detected(api: Api, solved: tuple[str, str]) -> Iterator[str]:
    """The solved recording with its planes as detected, before and after, and seen as it opens, whoever looked at it before."""
    api.ask("POST", f"/api/recordings/{solved[0]}/view", body=b'{"preset": "overview", "point_scale": 1}')
    api.as_detected(solved[0])
    yield solved[0]
    api.as_detected(solved[0])


def test_a_folder_is_one_recording(page: Page, folder: Path, tmp_path: Path) -> None:
    """The pieces of a split bag go up as one archive, byte for byte, and what is no piece stays here.

    Oracle: Python's tarfile. Fails with the padding of a file to whole blocks left out; with the checksum one off.
    """
    rig = tmp_path / "rig"
    rig.mkdir()
    rng = np.random.default_rng(1)
    pieces = {"rig_0.bag": rng.bytes(1000), "rig_1.bag": rng.bytes(512), "rig_2.bag": rng.bytes(3)}
    for name, content in {**pieces, "notes.txt": b"not a piece"}.items():
        (rig / name).write_bytes(content)
    page.goto("/")
    page.get_by_test_id("folder-input").set_input_files(rig)
    expect(page.get_by_role("alert")).to_be_visible(timeout=JOB_WAIT_S * 1000)  # random bytes are no bag
    recording = page.url.split("/")[-2]
    with tarfile.open(folder / "data" / "recordings" / recording / "source.tar") as archive:
        found = {member.name: archive.extractfile(member).read() for member in archive.getmembers()}
    assert found == pieces


def test_two_recordings_at_once_are_refused(page: Page) -> None:
    """Two bags that are no pieces of one are not glued together. Fails with the stems not compared."""
    page.goto("/")
    bags = [{"name": name, "mimeType": "", "buffer": b"x"} for name in ("monday.bag", "tuesday.bag")]
    page.get_by_test_id("file-input").set_input_files(bags)
    refusal = page.get_by_role("alert")
    expect(refusal).to_contain_text("2 recordings (monday.bag, tuesday.bag)")
    page.get_by_role("button", name="Close").click()
    expect(refusal).to_have_count(0)


def test_a_drop_on_any_screen(page: Page, solved: tuple[str, str]) -> None:
    """Something dropped over the 3D scene is taken by the page, which goes to it.

    Fails with the drop zone on the start page only.
    """
    page.goto(f"/r/{solved[0]}/planes")
    wait_for_cloud(page)
    transfer = page.evaluate_handle(DROP, ["holiday.bag", "these are not sensor readings"])
    expect(page.get_by_text("Let go to open it")).to_be_visible()
    page.evaluate("transfer => window.dispatchEvent(new DragEvent('drop', {dataTransfer: transfer}))", transfer)
    expect(page.get_by_text("Let go to open it")).to_have_count(0)
    expect(page).not_to_have_url(re.compile(solved[0]))
    expect(page.get_by_role("alert")).to_be_visible(timeout=JOB_WAIT_S * 1000)


@both
def test_a_box_restricts_the_planes(page: Page, api: Api, as_detected: str, scheme: str) -> None:
    """A box dragged over the left half of the scene cuts planes; one key takes it back.

    Oracle: the planes over the API. Fails with the rectangle's corners taken for pixels; with undo of the box lost.
    """
    before = api.planes(as_detected)
    page.goto(f"/r/{as_detected}/planes")
    wait_for_cloud(page)
    page.keyboard.press("b")
    expect(page.get_by_text("Drag a box")).to_be_visible()
    until(lambda: api.view(as_detected)["click"] == "restrict")
    box = scene(page).bounding_box()
    assert box is not None
    drag_until_cut(page, api, as_detected, box)
    after = api.planes(as_detected)
    assert after["restricted"]
    assert sum(patch["n_points"] for patch in after["patches"]) < sum(p["n_points"] for p in before["patches"])
    expect(page.get_by_text("A box leaves part of the room out")).to_be_visible()
    assert serious_faults(page) == []
    keep_screenshot(page, "planes-box", scheme)
    page.keyboard.press("Control+z")
    expect(page.get_by_text("A box leaves part of the room out")).to_have_count(0)
    assert api.planes(as_detected)["patches"] == before["patches"]
    page.keyboard.press("Escape")
    until(lambda: api.view(as_detected)["click"] == "toggle")


def drag_until_cut(page: Page, api: Api, recording: str, box) -> None:
    """Drag over the left half of the canvas until the planes change; the first drag may come before it is ready."""
    start = api.planes(recording)["revision"]
    for _ in range(6):
        page.mouse.move(box["x"] + 4, box["y"] + 60)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 0.5 * box["height"], steps=4)
        page.mouse.move(box["x"] + 0.45 * box["width"], box["y"] + box["height"] - 4, steps=4)
        page.mouse.up()
        page.wait_for_timeout(1500)
        if api.planes(recording)["revision"] != start:
            return
    raise AssertionError("no drag in the canvas reached the planes")


def test_a_click_that_grows_nothing_says_why(page: Page, api: Api, as_detected: str) -> None:
    """Beside the cloud there is no point; on a plane the point is that plane's. The list stays where it is.

    Fails with a click beside the cloud not answered; with the message put above the list.
    """
    page.goto(f"/r/{as_detected}/planes")
    spots = dense_spots(wait_for_cloud(page))
    row = page.get_by_role("button", name=re.compile("More for")).first
    at = row.bounding_box()
    page.keyboard.press("g")
    until(lambda: api.view(as_detected)["click"] == "grow")
    area = scene(page).bounding_box()
    assert area is not None
    corner = {"x": area["width"] - 12, "y": area["height"] - 12}
    click_until_said(page, [corner] * 6, "no point there")
    assert row.bounding_box() == at
    page.get_by_role("button", name="Close the message").click()
    expect(page.get_by_text("no point there")).to_have_count(0)
    click_until_said(page, [{"x": x, "y": y} for x, y in spots[:12]], "already; click a flat part")
    page.keyboard.press("Escape")
    until(lambda: api.view(as_detected)["click"] == "toggle")


def click_until_said(page: Page, places: list[dict[str, float]], words: str) -> None:
    """Click in the canvas until it is said; the first clicks may come before it is ready."""
    for place in places:
        scene(page).click(position=place)
        page.wait_for_timeout(1500)
        if page.get_by_text(words).count() > 0:
            return
    raise AssertionError(f"no click was answered with {words!r}")


def test_the_other_half_of_a_cut_plane_is_grown_and_merged(page: Page, api: Api, as_detected: str) -> None:
    """What a cut has set free becomes a plane by a click, and one with the rest of its wall by the menu.

    Oracle: the planes over the API. Fails with the clicked point not sent; with the merge's partner left out.
    """
    page.goto(f"/r/{as_detected}/planes")
    whole = wait_for_cloud(page)
    before = api.planes(as_detected)["patches"]
    # A wall: the ceiling is wider, but the view that a recording opens with looks through it.
    walls = [patch for patch in before if abs(patch["normal"][2]) < 0.5]
    wide = max(walls, key=lambda patch: patch["area_m2"])
    cut_in_half(api, as_detected, wide)
    until(lambda: float((whole & ~coloured(page)).mean()) > 0.1 * float(whole.mean()))
    page.keyboard.press("g")
    until(lambda: api.view(as_detected)["click"] == "grow")
    for k in range(24):
        spots = dense_spots(whole & ~at_rest(page))  # a few: each comes again, as a busy browser misses a click
        if len(api.planes(as_detected)["patches"]) > len(before):
            break
        assert spots, "nothing in view was set free"
        x, y = spots[k % len(spots)]
        scene(page).click(position={"x": x, "y": y})
        page.wait_for_timeout(1500)
    grown = api.planes(as_detected)["patches"]
    assert len(grown) == len(before) + 1
    assert abs(np.dot(grown[-1]["normal"], wide["normal"])) > 0.99
    page.get_by_role("button", name=f"More for {wide['name']}", exact=True).click()
    page.get_by_role("menuitem", name=f"Merge with {grown[-1]['name']}", exact=True).click()
    until(lambda: len(api.planes(as_detected)["patches"]) == len(before))
    merged = next(patch for patch in api.planes(as_detected)["patches"] if patch["name"] == wide["name"])
    assert merged["n_points"] > 0.9 * wide["n_points"]
    page.keyboard.press("Escape")
    until(lambda: api.view(as_detected)["click"] == "toggle")


def cut_in_half(api: Api, recording: str, patch: dict[str, Any]) -> None:
    """Cut the patch along a level line, wherever a third to two thirds of it stay."""
    path = f"/api/recordings/{recording}/planes/operations"
    along = np.cross(patch["normal"], [0.0, 0.0, 1.0])
    for offset_m in np.arange(-2.0, 2.25, 0.25):
        side = {"normal": along.tolist(), "offset_m": float(offset_m)}
        body = json.dumps({"op": "restrict", "index": patch["index"], "sides": [side]}).encode()
        try:
            api.ask("POST", path, body=body)
        except HTTPError:  # nothing of it is there
            continue
        left = next(one for one in api.planes(recording)["patches"] if one["name"] == patch["name"])
        if 0.33 < left["n_points"] / patch["n_points"] < 0.67:
            return
        api.ask("POST", path, body=b'{"op": "use-suggestion"}')
    raise AssertionError("no line cuts the patch")


def test_a_plane_is_chosen_for_a_box(page: Page, api: Api, as_detected: str) -> None:
    """From its menu the next box is a plane's own. Fails with the target not sent."""
    page.goto(f"/r/{as_detected}/planes")
    page.get_by_role("button", name=re.compile("More for")).nth(1).click()
    page.get_by_role("menuitem", name="Restrict to a box").click()
    until(lambda: api.view(as_detected)["target"] == 1)
    expect(page.get_by_text("Drag a box around the part of")).to_be_visible()
    page.get_by_role("button", name="Cut all planes instead").click()
    until(lambda: api.view(as_detected)["target"] is None)


@pytest.mark.parametrize("size", [(820, 1180), (1180, 820), (1280, 720)])
@pytest.mark.parametrize("screen", ["", "/r/{recording}/recording", "/r/{recording}/planes"])
def test_screens_fit(page: Page, solved: tuple[str, str], screen: str, size: tuple[int, int]) -> None:
    """On a tablet either way up, and on a small laptop, nothing sticks out and the main action is in sight.

    Fails with a fixed width of 900 px on the panel; with rows that may shrink below their content on a tablet, where
    the panel is then drawn over it.
    """
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.goto(screen.format(recording=solved[0]) or "/")
    action = page.get_by_role("button", name=re.compile("^(Try the sample|Choose planes|Solve with)"))
    expect(action).to_be_visible()
    expect(action).to_be_in_viewport(ratio=1.0)
    widest = page.evaluate(
        "Math.max(...[...document.querySelectorAll('body *')].map(e => e.getBoundingClientRect().right))"
    )
    assert widest <= size[0] + 1
    under = page.evaluate(
        """() => {
            const panel = document.querySelector("aside")?.getBoundingClientRect();
            const main = [...document.querySelectorAll("main h1, main h2, main li, main figure")];
            const places = main.filter(e => panel && !e.closest("aside")).map(e => e.getBoundingClientRect());
            return places.filter(r => r.right > panel.left + 1 && r.bottom > panel.top + 1).length;
        }"""
    )
    assert under == 0
