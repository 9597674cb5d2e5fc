"""A real server on loopback, a real Chromium, and recordings made by the simulator."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Page

import hatch_build
from bench.rigs import cluttered
from calib_core.simulate import simulate
from tests.e2e.support import DRAWN_PER_S, Api, Complaints, Server, opened

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def folder() -> Iterator[Path]:
    """Where this run's files live."""
    with tempfile.TemporaryDirectory(prefix="unsweep-e2e-") as name:
        yield Path(name)


@pytest.fixture(scope="session")
def bag(folder: Path) -> Path:
    """Ten seconds of the paper's normal motion, the truth beside it."""
    path = folder / "room.bag"
    simulate("paper-normal", path, seed=3, duration_s=10.0)
    return path


@pytest.fixture(scope="session")
def server(folder: Path) -> Iterator[Server]:
    """A server started as a person starts it."""
    hatch_build.build_client()
    shared = folder / "shared"
    shared.mkdir()
    (shared / "notes.txt").write_text("not a recording\n")
    command = [sys.executable, "-m", "app.cli", "serve", "--port", "0", "--data-dir", str(folder / "data")]
    # Fewer points than a graphics card gets: they are drawn in software here.
    environment = {"UNSWEEP_DISPLAYED_POINTS": "20000", **os.environ}
    with subprocess.Popen(
        [*command, "--recordings", str(shared)],
        cwd=ROOT,
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stderr is not None
        line = process.stderr.readline()
        found = re.search(r"http://\S+?(?=/? |/?$)", line)
        assert found is not None, f"the server did not say where it is: {line!r}"
        yield Server(found.group(), process.pid)
        process.terminate()
        process.communicate(timeout=20)


@pytest.fixture(scope="session")
def address(server: Server) -> str:
    """Where the server is."""
    return server.address


@pytest.fixture(scope="session")
def api(address: str) -> Api:
    """The server's API."""
    return Api(address)


@pytest.fixture(scope="session")
def solved(api: Api, bag: Path) -> tuple[str, str]:
    """A recording that was uploaded, and a finished solve of it: (recording id, job id)."""
    return api.solved(bag)


@pytest.fixture(scope="session")
def one_axis(api: Api, folder: Path) -> tuple[str, str]:
    """A solve of turning about one axis only: weak."""
    path = folder / "turntable.bag"
    simulate("one-axis", path, seed=1, duration_s=8.0)
    return api.solved(path)


@pytest.fixture(scope="session")
def crowded(api: Api, folder: Path) -> tuple[str, str]:
    """A solve in a room with ten boxes and two persons who walk about, of what is suggested there."""
    path = folder / "crowded.bag"
    simulate(cluttered(duration_s=8.0), path, seed=6)  # each of its boxes is doubted, whatever is insisted on
    return api.solved(path)


@pytest.fixture(params=["dark"])
def scheme(request: pytest.FixtureRequest) -> str:
    """The colour scheme the person prefers; tests of screens ask for both."""
    return str(request.param)


@pytest.fixture
def drawn_per_s() -> int | None:
    """How often scenes are drawn."""
    return DRAWN_PER_S


@pytest.fixture
def context(browser: Browser, address: str, scheme: str, drawn_per_s: int | None) -> Iterator[BrowserContext]:
    """A browser of its own, as after a first installation."""
    with opened(browser, address, scheme=scheme, drawn_per_s=drawn_per_s) as made:
        yield made


@pytest.fixture
def page(context: BrowserContext) -> Iterator[Page]:
    """A page whose console must stay free of errors."""
    one = context.new_page()
    complaints = Complaints(one)
    yield one
    assert complaints.texts == []
