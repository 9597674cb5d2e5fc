"""What the browser tests share: the API as a script uses it, pixels of the scene, axe, screenshots."""

from __future__ import annotations

import io
import json
import os
import signal
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Error, Locator, Page, expect
from playwright.sync_api import TimeoutError as NeverHeld

from tests.browser import LONGEST_WAIT_MS

ROOT = Path(__file__).resolve().parents[2]
AXE = ROOT / "frontend" / "node_modules" / "axe-core" / "axe.min.js"
SCREENSHOTS = ROOT / "docs" / "screenshots"
#: Work in a child process on a busy machine; nothing is judged by it.
JOB_WAIT_S = 180.0
PICTURE_WAIT_MS = 120_000


#: A scene asks to be drawn again as soon as it was, by a graphics card that is not there: all that a processor has, and the solve
#: that a test waits for would have it. So many times a second do.
DRAWN_PER_S = 4
_SLOWLY = """
  const next = window.requestAnimationFrame.bind(window);
  window.requestAnimationFrame = draw => setTimeout(() => next(draw), 1000 / {per_s});
  window.cancelAnimationFrame = clearTimeout.bind(window);
"""


@contextmanager
def opened(
    browser: Browser, address: str, *, scheme: str = "dark", drawn_per_s: int | None = DRAWN_PER_S, phone: bool = False
) -> Iterator[BrowserContext]:
    """A browser of its own, as after a first installation. drawn_per_s: how often scenes are drawn, None as often as can be.

    phone: a telephone's, touched with fingers.
    """
    made = browser.new_context(
        base_url=address,
        viewport={"width": 390, "height": 844} if phone else {"width": 1280, "height": 720},
        has_touch=phone,
        is_mobile=phone,
        color_scheme="dark" if scheme == "dark" else "light",
        reduced_motion="reduce",
        # A quarter of the dots, which are drawn in software. Pictures for people have them all.
        device_scale_factor=1.0 if os.environ.get("UNSWEEP_SCREENSHOTS") == "1" else 0.5,
        accept_downloads=True,
    )
    made.set_default_timeout(LONGEST_WAIT_MS)
    if drawn_per_s is not None:
        made.add_init_script(_SLOWLY.replace("{per_s}", str(drawn_per_s)))
    try:
        yield made
    finally:
        made.close()


class Complaints:
    """Everything a page complains about on its console, and every exception nobody caught."""

    def __init__(self, page: Page) -> None:
        self.texts: list[str] = []
        page.on("console", self._console)
        page.on("pageerror", self._error)

    def _console(self, message: ConsoleMessage) -> None:
        if message.type == "error":
            self.texts.append(f"{message.text} {message.location.get('url', '')}")

    def _error(self, error: Error) -> None:
        self.texts.append(str(error))


class Api:
    """The few requests the tests make beside the browser."""

    def __init__(self, address: str) -> None:
        self.address = address

    def ask(self, method: str, path: str, *, body: bytes | None = None, kind: str = "application/json"):
        """The decoded JSON answer."""
        request = urllib.request.Request(
            f"{self.address}{path}", data=body, method=method, headers={"Content-Type": kind}
        )
        with urllib.request.urlopen(request, timeout=60) as answer:
            return json.load(answer)

    def upload(self, path: Path) -> str:
        """The id of a recording uploaded in one request."""
        url = f"/api/recordings/upload?name={path.name}"
        return str(self.ask("PUT", url, body=path.read_bytes(), kind="application/octet-stream")["id"])

    def planes(self, recording: str):
        """The recording's planes."""
        return self.ask("GET", f"/api/recordings/{recording}/planes")

    def as_detected(self, recording: str) -> None:
        """Have the planes as they were detected, by their own names."""
        self.ask("POST", f"/api/recordings/{recording}/planes/operations", body=b'{"op": "use-suggestion"}')

    def view(self, recording: str):
        """What the scene shows."""
        return self.ask("GET", f"/api/recordings/{recording}/view")

    def wait_for_planes(self, recording: str) -> None:
        """Wait until planes have been proposed."""
        path = f"/api/recordings/{recording}/jobs"
        until(lambda: any(job["kind"] == "planes" and job["state"] == "done" for job in self.ask("GET", path)))

    def wait_until_ready(self, recording: str) -> None:
        """Wait until the recording has been examined; fail where it could not be."""
        path = f"/api/recordings/{recording}"
        until(lambda: self.ask("GET", path)["state"] in {"ready", "failed"})
        assert self.ask("GET", path)["error"] is None

    def solve(self, recording: str) -> str:
        """The id of a finished solve with the planes confirmed now."""
        job = self.ask("POST", f"/api/recordings/{recording}/jobs", body=b'{"kind": "solve"}')["id"]
        until(lambda: self.ask("GET", f"/api/jobs/{job}")["state"] not in {"queued", "running"})
        assert self.ask("GET", f"/api/jobs/{job}")["state"] == "done"
        return str(job)

    def solved(self, path: Path) -> tuple[str, str]:
        """A recording uploaded, examined and solved with the planes that are suggested: its id and the job's."""
        recording = self.upload(path)
        self.wait_for_planes(recording)
        self.wait_until_ready(recording)
        return recording, self.solve(recording)


@dataclass(frozen=True)
class Server:
    """Where a server is, and its process."""

    address: str
    pid: int

    @contextmanager
    def workers_stand_still(self) -> Iterator[None]:
        """Nothing that runs gets any further: a browser that draws in software may take longer to look than a run does."""
        children = Path(f"/proc/{self.pid}/task").glob("*/children")
        workers = [int(pid) for each in children for pid in each.read_text(encoding="ascii").split()]
        for worker in workers:
            with suppress(ProcessLookupError):
                os.kill(worker, signal.SIGSTOP)
        try:
            yield
        finally:
            for worker in workers:
                with suppress(ProcessLookupError):
                    os.kill(worker, signal.SIGCONT)


def until(holds: Callable[[], bool], *, wait_s: float = JOB_WAIT_S) -> None:
    """Wait until it holds; fail where it never does."""
    end = time.monotonic() + wait_s
    while not holds():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.1)


def scene(page: Page) -> Locator:
    """The 3D canvas's frame in the page."""
    return page.locator("iframe[title^='3D scene']")


def coloured(page: Page) -> NDArray[np.bool_]:
    """Which pixels of the scene, as the page counts them, are coloured, (height, width); its background and the page's chrome are
    grey."""
    box = scene(page).bounding_box()
    assert box is not None, "the scene is not on the page"
    # A picture of the page, not of the element: the latter waits for frames that software rendering is slow to give.
    picture = page.screenshot(
        clip={"x": box["x"], "y": box["y"], "width": box["width"], "height": box["height"]}, timeout=PICTURE_WAIT_MS
    )
    image = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), dtype=np.int16)
    drawn = (image.max(axis=2) - image.min(axis=2)) > 60
    times = round(1.0 / float(page.evaluate("devicePixelRatio")))
    return drawn.repeat(times, axis=0).repeat(times, axis=1)


def wait_for_cloud(page: Page) -> NDArray[np.bool_]:
    """The coloured pixels, once a cloud is drawn: at least half a percent of the scene."""
    until(lambda: float(coloured(page).mean()) > 0.005, wait_s=120.0)
    return at_rest(page)


def at_rest(page: Page) -> NDArray[np.bool_]:
    """The coloured pixels, once two pictures in a row are one: a busy browser draws late, and piece by piece."""
    seen = [coloured(page)]

    def rests() -> bool:
        page.wait_for_timeout(500)
        seen.append(coloured(page))
        return float((seen[-1] != seen[-2]).mean()) < 1e-3

    until(rests, wait_s=60.0)
    return seen[-1]


def dense_spots(mask: NDArray[np.bool_], *, size: int = 24) -> list[tuple[float, float]]:
    """Centres (x, y) of square tiles that are mostly coloured, fullest first."""
    rows, columns = mask.shape[0] // size, mask.shape[1] // size
    fill = mask[: rows * size, : columns * size].reshape(rows, size, columns, size).mean(axis=(1, 3))
    order = np.argsort(-fill, axis=None, kind="stable")
    places = np.stack(np.unravel_index(order, fill.shape), axis=1)
    return [((column + 0.5) * size, (row + 0.5) * size) for row, column in places.tolist() if fill[row, column] > 0.3]


def serious_faults(page: Page) -> list[str]:
    """What axe calls serious or critical, one line each. The 3D canvas is viser's own document and is left out."""
    page.evaluate(AXE.read_text(encoding="utf-8"))
    found = page.evaluate("async () => (await axe.run({exclude: [['iframe']]})).violations")
    return [
        f"{fault['id']}: {node['html'][:160]} ({node['failureSummary'][:200]})"
        for fault in found
        if fault["impact"] in {"serious", "critical"}
        for node in fault["nodes"]
    ]


#: A desk, a tablet held upright, a telephone.
SIZES = ((1280, 720), (820, 1180), (390, 844))


#: Panes that have to be pushed sideways to be read.
PUSHED = """() => [document.querySelector('main'), ...document.querySelectorAll('main > *, main > * > *')]
  .filter(one => getComputedStyle(one).overflowX === 'auto' && one.scrollWidth > one.clientWidth + 1)
  .map(one => `${one.className}: ${one.scrollWidth - one.clientWidth} px too wide`)"""


def faults_in_all_sizes(page: Page) -> list[str]:
    """What axe finds serious, and what is wider than its place, at each size; the desk's size is left behind."""
    found: list[str] = []
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        with suppress(NeverHeld):  # plots follow the window's size a moment later; what stays too wide is told below
            page.wait_for_function(f"() => ({PUSHED})().length === 0", timeout=5000)
        found += [f"{width}: {fault}" for fault in serious_faults(page)]
        too_wide = int(page.evaluate("document.documentElement.scrollWidth - window.innerWidth"))
        found += [f"{width}: {too_wide} px stick out"] if too_wide > 0 else []
        found += [f"{width}: {pane}" for pane in page.evaluate(PUSHED)]
    page.set_viewport_size({"width": SIZES[0][0], "height": SIZES[0][1]})
    return found


def keep_screenshot(page: Page, name: str, scheme: str) -> None:
    """A picture for the documentation, where the environment asks for one."""
    if os.environ.get("UNSWEEP_SCREENSHOTS") != "1":
        return
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    page.wait_for_timeout(1000)  # plots follow the window's size a moment later
    picture = Image.open(io.BytesIO(page.screenshot(timeout=PICTURE_WAIT_MS)))
    # 256 colours: a fifth of the size, and no difference to the eye in an interface. Few pixels are of a plane's colour, and
    # the usual choice of colours would give it away to a grey.
    picture.convert("RGB").quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(
        SCREENSHOTS / f"{name}-{scheme}.png", optimize=True
    )


def go_on(page: Page, name: str) -> None:
    """Press the screen's main action once it can be pressed."""
    button = page.get_by_role("button", name=name)
    expect(button).to_be_enabled(timeout=JOB_WAIT_S * 1000)
    button.click()
