"""Two tabs of one recording: each acts as its own screen says."""

from __future__ import annotations

from playwright.sync_api import BrowserContext, Page

from tests.e2e.support import Api, dense_spots, scene, until, wait_for_cloud


def test_a_click_on_inspect_drops_no_plane_that_the_other_tab_shows(
    page: Page, context: BrowserContext, api: Api, solved: tuple[str, str]
) -> None:
    """Planes are opened in a second tab, then a wall is clicked in the first, which shows Inspect; it has its own scene again.

    Fails with clicks judged by the shared view alone; with the scene left as the other tab had it.
    """
    recording, _ = solved
    api.as_detected(recording)
    page.goto(f"/r/{recording}/inspect")
    wait_for_cloud(page)
    other = context.new_page()
    other.goto(f"/r/{recording}/planes")
    wait_for_cloud(other)
    until(lambda: api.view(recording)["mode"] == "planes")
    before = api.planes(recording)["revision"]
    box = scene(page).bounding_box()
    assert box is not None
    for x, y in dense_spots(wait_for_cloud(page))[:3]:
        page.mouse.click(box["x"] + x, box["y"] + y)
    page.bring_to_front()
    page.evaluate("window.dispatchEvent(new Event('focus'))")  # a browser without windows gives none of its own
    until(lambda: api.view(recording)["mode"] == "inspect")
    assert api.planes(recording)["revision"] == before
    other.close()
