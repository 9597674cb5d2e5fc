"""What is kept of recordings: found again by name, note and order, and none too long for its place."""

from __future__ import annotations

from pathlib import Path

from playwright.sync_api import Page, expect

from tests.e2e.support import Api, faults_in_all_sizes, until

LONG = f"{'as-long-as-a-name-may-be-' * 4}"[:96] + ".bag"


def test_recordings_are_named_noted_found_and_sorted(page: Page, api: Api, tmp_path: Path) -> None:
    """A note typed on one screen finds its recording on another; names sort; a long one is cut, not the page.

    Mutations: the note not sent; the note not searched; the order ignored; a name that pushes the page wide;
    the old name beside the field for the new one.
    """
    recordings: dict[str, str] = {}
    for name in ("rig-b.bag", "rig-a.bag", "zebra.bag", "middle.bag", LONG):
        (tmp_path / name).write_text("not a bag\n")
        recordings[name] = api.upload(tmp_path / name)
    until(lambda: all(api.ask("GET", f"/api/recordings/{one}")["state"] == "failed" for one in recordings.values()))

    page.goto(f"/r/{recordings['rig-b.bag']}/recording")
    note = page.get_by_role("textbox", name="Note")
    note.fill("after the new bracket")
    with page.expect_response(lambda answer: answer.request.method == "PATCH"):
        note.blur()
    page.reload()
    expect(note).to_have_value("after the new bracket")

    page.goto("/")
    rows = page.get_by_role("complementary", name="Recordings").get_by_role("listitem")
    search = page.get_by_role("searchbox", name="Search recordings")
    search.fill("bracket read")
    expect(rows).to_have_count(1)
    expect(rows.first).to_contain_text("rig-b.bag")
    expect(rows.first).to_contain_text("after the new bracket")
    search.fill("rig-")
    page.get_by_role("combobox", name="Order of the recordings").select_option("name")
    expect(rows.locator("strong")).to_have_text(["rig-a.bag", "rig-b.bag"])
    rows.first.get_by_role("button", name="More for rig-a.bag").click()
    page.get_by_role("menuitem", name="Rename").click()
    field = page.get_by_role("textbox", name="New name of the recording")
    expect(rows.first.get_by_role("link")).to_be_hidden()
    field.fill("rig-z.bag")
    page.keyboard.press("Enter")
    expect(rows.locator("strong")).to_have_text(["rig-b.bag", "rig-z.bag"])

    search.fill("as-long-as")
    name = rows.first.locator("strong")
    expect(name).to_have_attribute("title", LONG)
    assert name.evaluate("one => one.scrollWidth > one.clientWidth")
    assert faults_in_all_sizes(page) == []
    page.goto(f"/r/{recordings[LONG]}/recording")
    expect(page.get_by_role("alert")).to_be_visible()
    assert faults_in_all_sizes(page) == []
