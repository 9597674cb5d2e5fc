"""Each number is the same on every screen, in the report, and in the file, to the digits that are shown."""

from __future__ import annotations

import math
import re
import urllib.request

from playwright.sync_api import Page, expect

from app.results.verdict import verdict
from calib_core.result import CalibrationResult
from tests.e2e.support import Api, dense_spots, scene, wait_for_cloud


def two_digits(sigma: float, most: int) -> str:
    """A standard deviation as the page writes it: two significant digits, at most so many decimals."""
    return f"{sigma:.{min(most, max(0, 1 - math.floor(math.log10(sigma))))}f}"


def sigmas_of(result: CalibrationResult, *, most: tuple[int, int, int]) -> list[str]:
    """All seven, positions, turns and the clock, in millimetres, degrees and milliseconds."""
    known = result.uncertainty
    assert known is not None
    return [
        *(two_digits(1e3 * std, most[0]) for std in known.translation_std_m),
        *(two_digits(std, most[1]) for std in known.rotation_std_deg),
        two_digits(1e3 * known.time_offset_std_s, most[2]),
    ]


def test_every_screen_says_the_same(page: Page, api: Api, address: str, solved: tuple[str, str]) -> None:
    """Oracle: the downloaded document, rounded here.

    Fails with the solve's table ending in the last iteration; with the verdict's sigma of another axis; with the planes
    that were asked for counted as those that were used.
    """
    recording, job = solved
    result = CalibrationResult.model_validate(api.ask("GET", f"/api/results/{job}"))
    sentence = verdict(result).split(": ", 1)[1]

    page.goto(f"/r/{recording}/result?job={job}")
    answer = page.get_by_role("table", name="Transform and time offset")
    expect(answer.get_by_role("row")).to_have_count(7)
    for sigma in sigmas_of(result, most=(4, 4, 4)):
        expect(answer).to_contain_text(f"± {sigma}")
    expect(page.get_by_role("main")).to_contain_text(sentence[1:])
    rests = page.get_by_role("region", name="What the answer rests on")
    expect(rests).to_contain_text(f"Planes used{len(result.quality.planes)}")

    page.goto(f"/r/{recording}/solve?job={job}")
    table = page.get_by_role("table", name="The answer so far")
    for sigma in sigmas_of(result, most=(3, 4, 4)):
        expect(table).to_contain_text(f"± {sigma}")
    expect(page.get_by_role("complementary", name="Solved")).to_contain_text(sentence[1:])

    with urllib.request.urlopen(f"{address}/api/results/{job}/report", timeout=60) as report:
        text = report.read().decode()
    assert sentence[1:] in text
    assert result.uncertainty is not None
    for std in result.uncertainty.translation_std_m:
        # Value and sigma have cells of their own, the unit another.
        assert re.search(rf"(?<![\d.]){std * 1e3:.2f}(?!\d)", text)


def test_ways_to_look(page: Page, api: Api, solved: tuple[str, str]) -> None:
    """A point under the pointer says whose it is; the room is looked at from above, and points grow.

    Fails with the pointer's place sent in pixels; with a preset not sent; with a size not sent.
    """
    recording, _ = solved
    page.goto(f"/r/{recording}/planes")
    spots = dense_spots(wait_for_cloud(page))
    area = scene(page).bounding_box()
    assert area is not None
    names = "|".join(re.escape(patch["name"]) for patch in api.planes(recording)["patches"])
    page.mouse.move(area["x"] + spots[0][0] + 3, area["y"] + spots[0][1])
    page.mouse.move(area["x"] + spots[0][0], area["y"] + spots[0][1])
    said = page.get_by_text(re.compile(rf"^({names}): \d+\.\d° off (level|plumb); \d+\.\d\d m from the lidar"))
    expect(said).to_be_visible()
    tools = page.get_by_role("group", name="How the scene is looked at")
    tools.get_by_text("Top").click(timeout=120_000)
    expect(tools.get_by_role("radio", name="Top")).to_be_checked()
    tools.get_by_role("button", name="Larger points").click()
    page.wait_for_function(
        "async id => { const view = await (await fetch(`/api/recordings/${id}/view`)).json();"
        " return view.preset === 'top' && view.point_scale === 1.25 && view.looks > 0; }",
        arg=recording,
    )
