"""The browser of every test that needs one: a process of tests has one Playwright at a time, and so one of these."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser

CHROMIUM = os.environ.get("UNSWEEP_CHROMIUM", "/usr/bin/chromium")
#: WebGL in software, named outright so that it is the same on every machine. Smooth edges cost it 20 times the work of the
#: rest: seconds of a processor for each picture, which the solve that a test waits for would have.
GRAPHICS = [
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--webgl-antialiasing-mode=none",
    # Nor is the rest of a page put together by what stands in for a graphics card: that is half of its work.
    "--disable-gpu-compositing",
]
LONGEST_WAIT_MS = 30_000


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Debian's Chromium, headless."""
    if not Path(CHROMIUM).exists():
        pytest.skip(f"no Chromium at {CHROMIUM}; `make test` installs it, UNSWEEP_CHROMIUM names another")
    from playwright.sync_api import expect, sync_playwright

    expect.set_options(timeout=LONGEST_WAIT_MS)
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=GRAPHICS)
        yield chromium
        chromium.close()
