"""An upload from a browser that outlives its server."""

from __future__ import annotations

import hashlib
import json
import random
from pathlib import Path

from playwright.sync_api import Page

from bench.victim import Victim, running, until
from tests.app.support.live import FAKE_JOBS

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
