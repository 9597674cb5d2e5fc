"""Nothing flashes: what is not drawn yet is not shown, and of all frames that a dark page shows while its scene opens, turns and
its steps change, none is white.
"""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from tests.e2e.support import PICTURE_WAIT_MS, scene, until, wait_for_cloud

#: Brighter than this is white: of a dark page no more than words and buttons are.
WHITE = 200
#: Of 255: so far from the scene's own background is another colour. The light one is 47 darker than white.
OTHER = 20
#: Where more of the frame is white than this, one sees a flash; words are two per cent.
FLASH = 0.1


@contextmanager
def every_frame(page: Page) -> Iterator[list[float]]:
    """How much of each frame that the browser shows meanwhile is white."""
    shares: list[float] = []
    devtools = page.context.new_cdp_session(page)

    def keep(frame: dict[str, str]) -> None:
        image = np.asarray(Image.open(io.BytesIO(base64.b64decode(frame["data"]))).convert("L"))
        shares.append(float(np.mean(image > WHITE)))
        devtools.send("Page.screencastFrameAck", {"sessionId": frame["sessionId"]})

    devtools.on("Page.screencastFrame", keep)
    devtools.send("Page.startScreencast", {"format": "jpeg", "quality": 50, "maxWidth": 640, "maxHeight": 360})
    yield shares
    devtools.send("Page.stopScreencast")
    devtools.detach()


@pytest.fixture
def drawn_per_s() -> None:
    """Every frame counts here."""
    return


#: The scene's own page as it is before anything is drawn.
NOT_DRAWN = "<!doctype html><html style='background: white'><body></body></html>"
#: What says on it that the first picture is sent.
PICTURE = "document.querySelector('iframe').contentDocument.body.innerHTML = '<p data-testid=floating-panel>first picture</p>'"
BACKGROUND = "getComputedStyle(document.querySelector(\"section[aria-label='3D scene']\")).backgroundColor"


@pytest.mark.parametrize("scheme", ["dark", "light"], indirect=True)
def test_what_is_not_drawn_yet_is_not_shown(page: Page, solved: tuple[str, str]) -> None:
    """The scene's page is there, white, and nothing is drawn on it: one sees the background and a word, until there is a picture.

    Mutations: the canvas called drawn as soon as it is loaded; what covers it gone from the start, or see-through.
    """
    recording, _ = solved
    page.route("**/scene/*/*/", lambda route: route.fulfill(body=NOT_DRAWN, content_type="text/html"))
    page.goto(f"/r/{recording}/planes")
    opening = page.get_by_text("Opening the 3D scene")
    expect(opening).to_be_visible()
    page.wait_for_function(
        "document.querySelector('iframe').contentDocument.documentElement.style.background === 'white'"
    )
    page.wait_for_timeout(1000)  # what is about to come into sight has come
    assert (other := off_background(page)) < FLASH, f"{other:.0%} of the scene is not its background before it is drawn"
    page.evaluate(PICTURE)
    expect(opening).to_have_css("opacity", "0")
    assert off_background(page) > 1.0 - FLASH


def off_background(page: Page) -> float:
    """How much of the scene's place is of another colour than the page says its background is."""
    box = scene(page).bounding_box()
    assert box is not None
    wanted = [int(part) for part in re.findall(r"\d+", page.evaluate(BACKGROUND))[:3]]
    picture = page.screenshot(
        clip={"x": box["x"], "y": box["y"], "width": box["width"], "height": box["height"]}, timeout=PICTURE_WAIT_MS
    )
    image = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), dtype=np.int16)
    return float(np.mean(np.abs(image - np.array(wanted)).max(axis=2) > OTHER))


def test_no_frame_is_white(page: Page, solved: tuple[str, str]) -> None:
    """The scene is opened, turned, looked at from the top, and left and come back to by its steps.

    Mutations: the page behind it white; the scene made light.
    """
    recording, job = solved
    page.goto("/")
    expect(page.get_by_role("link", name="room.bag").first).to_be_visible()
    with every_frame(page) as shares:
        page.goto(f"/r/{recording}/planes")
        wait_for_cloud(page)
        opened = len(shares)
        box = scene(page).bounding_box()
        assert box is not None
        x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
        page.mouse.move(x, y)
        page.mouse.down()
        for step in range(1, 8):
            page.mouse.move(x + 25 * step, y + 6 * step)
        page.mouse.up()
        page.get_by_text("Top", exact=True).click()
        until(lambda: len(shares) > opened + 3, wait_s=20.0)
        for name in ("inspect", "result", "inspect", "planes"):
            page.get_by_role("link", name=name.capitalize()).first.click()
            page.wait_for_url(f"**/{name}*")
            page.wait_for_timeout(700)
        page.goto(f"/r/{recording}/inspect?job={job}&show=wipe")
        wait_for_cloud(page)
    assert len(shares) > 20, "too few frames were seen to say that none is white"
    assert max(shares) < FLASH, f"frame {int(np.argmax(shares))} of {len(shares)} is {max(shares):.0%} white"
