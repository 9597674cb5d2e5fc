"""An upload from a browser that outlives its server, and one whose page was closed."""

from __future__ import annotations

import hashlib
import json
import random
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, Route, expect

from bench.victim import Victim, running, until
from tests.app.support.live import FAKE_JOBS
from tests.e2e.support import Api, opened

#: More than one of the client's parts, so that a kill finds it under way on any machine.
SIZE_BYTES = 150 * 2**20


def only(victim: Victim) -> dict[str, object]:
    """The one recording, as far as there is one."""
    listed = json.loads(victim.ask("GET", "/api/recordings").body)
    return listed[0] if listed else {"received_bytes": 0, "state": "none"}


def test_an_upload_goes_on_by_itself_after_its_server_was_killed(page: Page, tmp_path: Path) -> None:
    """Oracle: SHA-256 of the file. Mutation: an offset that is not that of the bytes, or a client that gives up."""
    bag = tmp_path / "any.bag"
    content = random.Random(1).randbytes(SIZE_BYTES)
    bag.write_bytes(content)
    with running(tmp_path / "data", entry=FAKE_JOBS) as victim:
        page.goto(f"http://127.0.0.1:{victim.port}/")
        page.get_by_test_id("file-input").set_input_files(bag)
        until(lambda: int(str(only(victim)["received_bytes"])) > 0)
        victim.kill()
        port = victim.port
    with running(tmp_path / "data", entry=FAKE_JOBS, port=port) as victim:
        assert only(victim)["state"] == "receiving"
        until(lambda: only(victim)["state"] not in {"none", "receiving"})
        stored = tmp_path / "data" / "recordings" / str(only(victim)["id"]) / "source.bag"
        assert hashlib.sha256(stored.read_bytes()).digest() == hashlib.sha256(content).digest()


@pytest.mark.usefixtures("server")  # which builds the page that the victim serves
def test_an_upload_outlives_a_lost_network(browser: Browser, tmp_path: Path) -> None:
    """A minute of Wi-Fi gone would use up all tries. Oracle: SHA-256 of the file. Mutation: the upload ended where the browser is
    off line, or begun anew.
    """
    bag = tmp_path / "any.bag"
    content = random.Random(3).randbytes(SIZE_BYTES)
    bag.write_bytes(content)
    with (
        running(tmp_path / "data", entry=FAKE_JOBS) as victim,
        opened(browser, f"http://127.0.0.1:{victim.port}") as context,
    ):
        page = context.new_page()  # whose console tells of the network, too
        page.goto("/")
        page.get_by_test_id("file-input").set_input_files(bag)
        until(lambda: int(str(only(victim)["received_bytes"])) > 0)
        context.set_offline(True)
        expect(page.get_by_text("This machine is on no network")).to_be_visible()
        began = only(victim)
        assert began["state"] == "receiving"
        context.set_offline(False)
        until(lambda: only(victim)["state"] not in {"none", "receiving"})
        assert only(victim)["id"] == began["id"]
        stored = tmp_path / "data" / "recordings" / str(began["id"]) / "source.bag"
        assert hashlib.sha256(stored.read_bytes()).digest() == hashlib.sha256(content).digest()


@pytest.fixture
def interrupted(browser: Browser, address: str, tmp_path: Path) -> Iterator[tuple[Page, Path]]:
    """A page on an upload that an earlier page began, and its file: not a byte of it has come through."""
    bag = tmp_path / f"{tmp_path.name}.bag"
    bag.write_bytes(random.Random(2).randbytes(100_000))
    with opened(browser, address) as context:
        page = context.new_page()

        def no_bytes(route: Route) -> None:
            route.abort() if route.request.method == "PATCH" else route.continue_()

        page.route("**/api/uploads/*", no_bytes)
        page.goto("/")
        page.get_by_test_id("file-input").set_input_files(bag)
        expect(page).to_have_url(re.compile("/r/[0-9a-f]{32}/recording"))
        expect(page.get_by_role("heading", name="Uploading")).to_be_visible()
        page.reload()
        expect(page.get_by_role("heading", name="This upload was interrupted")).to_be_visible()
        page.unroute_all()  # not before: the page that began it tries again by itself
        yield page, bag


def test_an_interrupted_upload_goes_on_with_its_file(interrupted: tuple[Page, Path], api: Api) -> None:
    """The button asks for the file, and the same recording gets it.

    Mutations: a button that asks for nothing; what was begun before not looked up, so that there are two recordings of one file.
    """
    page, bag = interrupted
    recording = page.url.split("/")[-2]
    with page.expect_file_chooser() as asked:
        page.get_by_role("button", name="Choose the file").click()
    asked.value.set_files(bag)
    until(lambda: api.ask("GET", f"/api/recordings/{recording}")["state"] != "receiving")
    assert api.ask("GET", f"/api/recordings/{recording}")["received_bytes"] == 100_000
    assert sum(one["name"] == bag.name for one in api.ask("GET", "/api/recordings")) == 1


def test_an_interrupted_upload_is_discarded(interrupted: tuple[Page, Path], api: Api) -> None:
    """One is where one began, and nothing is left of it. Mutation: the page left and the recording kept."""
    page, bag = interrupted
    page.get_by_role("button", name="Discard it").click()
    expect(page.get_by_role("button", name="Try the sample")).to_be_visible()
    until(lambda: all(one["name"] != bag.name for one in api.ask("GET", "/api/recordings")))
