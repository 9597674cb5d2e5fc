"""Where a person could be stuck: each of these goes on by clicks alone, and with a name as long as names may be."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.core.readers.traps import TRAPS, Trap, small, write
from tests.e2e.support import JOB_WAIT_S, Api, faults_in_all_sizes, go_on, until

STEPS = JOB_WAIT_S * 1000
LONG = f"{'as-long-as-a-name-may-be-' * 4}"[:96] + ".bag"


@pytest.fixture(scope="module")
def timeless(api: Api, tmp_path_factory: pytest.TempPathFactory) -> str:
    """A recording whose points have no times, under a name of a hundred characters."""
    path = tmp_path_factory.mktemp("timeless") / LONG
    write(path, small(), Trap(times=lambda absolute_ns, header_ns: {}))
    recording = api.upload(path)
    api.wait_until_ready(recording)
    return recording


@pytest.fixture(scope="module")
def answered(api: Api, timeless: str) -> tuple[str, str]:
    """The same with times made up, and a run of it."""
    read_as(api, timeless, b'{"synthesise_point_time": true, "gyroscope_unit": null}')
    return timeless, api.solve(timeless)


def read_as(api: Api, recording: str, change: bytes) -> None:
    """Have the recording read so, and wait until it is."""
    api.ask("PATCH", f"/api/recordings/{recording}", body=change)
    api.wait_until_ready(recording)
    until(lambda: bool(api.ask("GET", f"/api/recordings/{recording}")["has_planes"]))


def solve_by_clicks(page: Page, recording: str) -> str:
    """From the recording's screen to a run that has ended: its job."""
    go_on(page, "Choose planes")
    go_on(page, "Solve with")
    expect(page).to_have_url(re.compile("job="))
    go = page.get_by_role("button", name=re.compile("Inspect the answer|See why")).last
    expect(go).to_be_enabled(timeout=STEPS)
    return re.findall(r"job=(\w+)", page.url)[0]


def test_a_link_that_was_cut_off_leads_on(page: Page) -> None:
    """It says so, and has a way to the recordings. Mutation: the server is asked for it, whose answer is a pattern."""
    page.goto("/r/5f0c6c9b/planes")
    expect(page.get_by_role("heading", name="There is nothing at this address")).to_be_visible()
    page.get_by_role("link", name="Start page").last.click()
    expect(page.get_by_role("heading", name="Recordings")).to_be_visible()


def test_points_without_times_come_to_a_result(page: Page, api: Api, timeless: str) -> None:
    """The report offers the cure where it says what is wrong; one click, and it is solved like any other.

    Oracle: the run's own document. Mutations: the button not shown; the wish sent as a field of another name; the cure
    still offered once it was taken.
    """
    api.ask("PATCH", f"/api/recordings/{timeless}", body=b'{"synthesise_point_time": false}')
    api.wait_until_ready(timeless)
    page.goto(f"/r/{timeless}/recording")
    expect(page.get_by_role("heading", name="Not usable as it is")).to_be_visible()
    page.get_by_role("button", name="Make up point times").click()
    expect(page.get_by_role("heading", name="Usable, with limits")).to_be_visible(timeout=STEPS)
    expect(page.get_by_role("button", name="Make up point times")).to_have_count(0)
    expect(page.get_by_role("region", name="Lidar")).to_contain_text("made up")
    job = solve_by_clicks(page, timeless)
    page.get_by_role("button", name="Inspect the answer").click()
    page.get_by_role("button", name="See the result").click()
    expect(page.get_by_role("table", name="Transform and time offset").get_by_text("±")).to_have_count(7)
    result = api.ask("GET", f"/api/results/{job}")
    assert result["T_imu_lidar"] is not None
    assert "points.time_synthesised" in {message["code"] for message in result["messages"]}


def test_a_refused_unit_is_put_right_by_its_button(page: Page, api: Api, timeless: str) -> None:
    """Read in degrees a second the run is refused; what it offers first puts it right, and it is read anew.

    Mutations: the button that sends the unit in use already; no step put first; planes asked for before they are found anew
    (the console is not empty then).
    """
    read_as(api, timeless, b'{"synthesise_point_time": true, "gyroscope_unit": "deg_s"}')
    page.goto(f"/r/{timeless}/recording")
    expect(page.get_by_label("Gyroscope unit")).to_have_value("deg_s")
    solve_by_clicks(page, timeless)
    page.get_by_role("button", name="See why").last.click()
    expect(page.get_by_role("heading", name="Refused")).to_be_visible()
    steps = page.get_by_role("region", name="Next step")
    expect(steps.locator("[data-first=true]")).to_have_text("Read the gyroscope in rad/s")
    steps.get_by_role("button", name="Read the gyroscope in rad/s").click()
    expect(page).to_have_url(re.compile("/recording$"))
    expect(page.get_by_label("Gyroscope unit")).to_have_value("rad_s", timeout=STEPS)
    expect(page.get_by_role("heading", name="Usable, with limits")).to_be_visible(timeout=STEPS)


def test_a_refusal_for_want_of_motion_shows_the_motion(page: Page, api: Api, tmp_path: Path) -> None:
    """A rig that stood still is to be recorded again: how is a click away, and so are the planes.

    Mutations: the guide not opened; the way to the next recording left out of it; a link to another recording's planes.
    """
    recording = api.upload(write(tmp_path / "still.bag", small("static", 4.0), TRAPS["twin"]))
    api.wait_for_planes(recording)
    api.wait_until_ready(recording)
    job = api.solve(recording)
    page.goto(f"/r/{recording}/result?job={job}")
    steps = page.get_by_role("region", name="Next step")
    steps.get_by_role("button", name="Record again with this motion").click()
    guide = page.get_by_role("dialog", name="How to record")
    expect(guide.get_by_role("img", name=re.compile("^Good: Turned to and fro"))).to_be_visible()
    guide.get_by_role("link", name="Open the new recording").click()
    expect(page.get_by_role("button", name="Try the sample")).to_be_visible()
    page.go_back()
    steps.get_by_role("link", name="Back to the planes").click()
    expect(page).to_have_url(re.compile(f"/r/{recording}/planes"))
    expect(page.get_by_role("table", name="Detected planes")).to_be_visible()


def test_a_prior_typed_in_the_page_reaches_the_solve(page: Page, api: Api, solved: tuple[str, str]) -> None:
    """A lever arm that is known well leads the answer along its axis.

    Oracle: the product of two normal densities, of the answer without the prior and of the prior. Mutations: the prior kept
    from the run; its sigma sent as it was typed, in metres; what is missing not named, or not led to.
    """
    recording, job = solved
    at_mm, std_mm = height_mm(api, job)
    told_mm, told_std_mm = round(at_mm + 1.5 * std_mm, 2), round(0.3 * std_mm, 3)
    page.goto(f"/r/{recording}/solve?job={job}")
    page.get_by_role("button", name="Add something known").click()
    page.get_by_role("textbox", name="Value of Position z, mm").fill(str(told_mm))
    again = page.get_by_role("button", name="Solve again")
    again.click()
    sigma = page.get_by_role("textbox", name="One standard deviation of Position z, mm")
    expect(page.get_by_role("alert")).to_contain_text("Position z: its standard deviation")
    expect(sigma).to_be_focused()
    sigma.fill(str(told_std_mm))
    again.click()
    expect(page).not_to_have_url(re.compile(job))
    new = re.findall(r"job=(\w+)", page.url)[0]
    until(lambda: api.ask("GET", f"/api/jobs/{new}")["state"] == "done")
    expect(page.get_by_role("button", name="Inspect the answer")).to_be_enabled(timeout=STEPS)
    led_mm, led_std_mm = height_mm(api, new)
    weight = std_mm**-2 / (std_mm**-2 + told_std_mm**-2)
    expected_mm = weight * at_mm + (1.0 - weight) * told_mm
    assert abs(led_mm - expected_mm) < 0.3 * std_mm
    assert led_std_mm < 1.2 * told_std_mm


def height_mm(api: Api, job: str) -> tuple[float, float]:
    """Position z and its standard deviation in a run's document."""
    result = api.ask("GET", f"/api/results/{job}")
    return 1e3 * result["T_imu_lidar"]["translation_m"][2], 1e3 * result["uncertainty"]["translation_std_m"][2]


def test_a_name_of_a_hundred_characters_breaks_no_screen(page: Page, answered: tuple[str, str]) -> None:
    """Each screen of a solved recording in three sizes: nothing is wider than its place, nothing serious for axe.

    Mutations: the name in the header not cut; the table of Storage on a telephone as on a desk.
    """
    recording, _ = answered
    assert len(LONG) == 100
    names = ("recording", "planes", "solve", "inspect", "result", "audit")
    for screen in ("/", "/storage", *(f"/r/{recording}/{name}" for name in names)):
        page.goto(screen)
        expect(page.get_by_text(LONG).first).to_be_attached()
        expect(page.locator("[aria-busy=true]")).to_have_count(0)
        assert (screen, faults_in_all_sizes(page)) == (screen, [])


def test_a_plane_that_is_insisted_on_is_said_first_and_left_out_by_a_button(
    page: Page, api: Api, crowded: tuple[str, str]
) -> None:
    """By clicks only: what was left out counts all the same, of which nothing is foretold; the verdict says it first, not in
    green, and its button leaves it out again and solves. What the first solve has done stays in the second one's list of stages.

    Mutations: the wish left out of the solve; a green verdict; a button that drops it and stays; the number of those beyond doubt
    foretold; stages that are passed over in silence.
    """
    recording, _ = crowded
    page.goto(f"/r/{recording}/planes")
    row = page.get_by_role("row").filter(has_text="left out by run").first
    row.get_by_role("button", name=re.compile("^More for")).click()
    page.get_by_role("menuitem", name="Count it even if doubtful").click()
    until(lambda: [patch["insisted"] for patch in api.planes(recording)["patches"]].count(True) == 1)
    (doubted,) = [patch["name"] for patch in api.planes(recording)["patches"] if patch["insisted"]]
    expect(row).to_contain_text(doubted)
    meter = page.get_by_role("status", name="Do these planes determine the answer")
    expect(meter).to_contain_text(f"No forecast for this choice: {doubted} is used though doubtful")
    expect(meter).not_to_contain_text("Least known")
    go_on(page, "Solve with")
    expect(page).to_have_url(re.compile("job="))
    for stage in ("Read the recording", "Follow planes through the scans"):
        expect(page.get_by_role("listitem").filter(has_text=stage)).to_contain_text("kept", timeout=STEPS)
    go = page.get_by_role("button", name=re.compile("Inspect the answer|See why")).last
    expect(go).to_be_enabled(timeout=STEPS)
    insisted = re.findall(r"job=(\w+)", page.url)[0]
    page.goto(f"/r/{recording}/result?job={insisted}")
    verdict = page.locator("header[data-tone]")
    expect(verdict).to_have_attribute("data-tone", "warning")
    expect(verdict).to_contain_text(
        re.compile(rf"{doubted} is [^.]*, but is used because it was chosen", re.IGNORECASE)
    )
    page.get_by_role("button", name=re.compile("out and solve again$")).click()
    expect(page).to_have_url(re.compile(rf"job=(?!{insisted})"))
    expect(go).to_be_enabled(timeout=STEPS)
    without = api.ask("GET", f"/api/results/{re.findall(r'job=(.*)', page.url)[0]}")
    assert [patch["name"] for patch in api.planes(recording)["patches"] if not patch["confirmed"]] == [doubted]
    assert doubted not in [plane["name"] for plane in without["quality"]["planes"]]
    api.as_detected(recording)
