"""`python -m bench.frames`: how many frames a browser draws of a room that is turned, and what each costs.

    python -m bench.frames [--tree NAME=DIR ...] [--turns 3] [--seconds 6] [--points N]

Each tree is a checkout of this program with its client built; the one at hand is `now`. The same recording is opened by the
server of each; then the pages take turns at being turned round, so that what else the machine does hits all of them. Graphics
are drawn in software, as in the tests. Counted are animation frames of the scene's own document, and seconds of CPU of the
process that draws: of a machine with other work only the latter, for a frame, can be compared.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

from calib_core.simulate import simulate

ROOT = Path(__file__).resolve().parents[1]
CHROMIUM = os.environ.get("UNSWEEP_CHROMIUM", "/usr/bin/chromium")
GRAPHICS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
#: A frame in which nothing moves costs next to nothing; the mouse goes on at this pace.
MOVE_MS = 20.0
#: A scene is drawn by then, and machines with other work are waited for.
SETTLED_MS, PATIENCE_MS = 12_000.0, 180_000.0
_COUNT = "() => { window.drawn = 0; const on = () => { window.drawn += 1; requestAnimationFrame(on) }; on() }"


@dataclass
class Room:
    """A tree's scene, and what was counted: frames, seconds, seconds of CPU of whoever draws."""

    name: str
    url: str
    frames: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    drawing_s: list[float] = field(default_factory=list)

    def turn(self, browser: Browser, seconds: float, painter: int) -> None:
        """Open it, turn it for so long, and close it: pages in the background draw, too."""
        page = browser.new_page(viewport={"width": 1280, "height": 720}, color_scheme="dark")
        page.set_default_timeout(PATIENCE_MS)
        page.goto(self.url)
        box = page.locator("iframe[title^='3D scene']").bounding_box()
        assert box is not None, "the scene is not on the page"
        page.wait_for_timeout(SETTLED_MS)
        inside, mouse = page.frames[-1], page.mouse
        inside.evaluate(_COUNT)
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        mouse.move(x, y)
        mouse.down()
        before, cpu_s, started, step = int(inside.evaluate("drawn")), cpu_of(painter), time.monotonic(), 0
        while (took := time.monotonic() - started) < seconds:
            step += 1
            mouse.move(x + 160 * (step % 40 - 20) / 20 * (-1) ** (step // 40), y + 20 * ((step // 10) % 3 - 1))
            page.wait_for_timeout(MOVE_MS)
        self.frames.append(int(inside.evaluate("drawn")) - before)
        self.seconds.append(took)
        self.drawing_s.append(cpu_of(painter) - cpu_s)
        mouse.up()
        page.close()


def cpu_of(pid: int) -> float:
    """Seconds of CPU that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def serve(tree: Path, data: Path, points: int) -> tuple[subprocess.Popen[str], str]:
    """A server of that tree, and its address."""
    words = [sys.executable, "-m", "app.cli", "serve", "--port", "0", "--data-dir", str(data)]
    # What an earlier version needs and this one does not may be on the path behind this one.
    beside = os.environ.get("PYTHONPATH", "").split(os.pathsep)[1:]
    path = os.pathsep.join([str(tree), *beside])
    environment = {**os.environ, "PYTHONPATH": path, "UNSWEEP_DISPLAYED_POINTS": str(points)}
    process = subprocess.Popen(words, cwd=tree, env=environment, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    line = process.stderr.readline()
    found = re.search(r"http://\S+?(?=/? |/?$)", line)
    if found is None:
        raise RuntimeError(f"the server of {tree} did not say where it is: {line!r}")
    return process, found.group()


def ask(url: str, *, method: str = "GET", body: bytes | None = None) -> dict[str, object]:
    """The decoded answer."""
    request = urllib.request.Request(url, data=body, method=method)  # noqa: S310 - a server of our own
    with urllib.request.urlopen(request, timeout=60) as answer:  # noqa: S310
        found: dict[str, object] = json.load(answer)
    return found


def room_of(name: str, address: str, bag: Path) -> Room:
    """The recording's planes, proposed."""
    url = f"{address}/api/recordings/upload?name={bag.name}"
    recording = ask(url, method="PUT", body=bag.read_bytes())["id"]
    while not ask(f"{address}/api/recordings/{recording}")["has_planes"]:
        time.sleep(0.5)
    return Room(name, f"{address}/r/{recording}/planes")


def main() -> int:
    """Open all, turn all, say what was counted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tree", action="append", default=[], metavar="NAME=DIR", help="another checkout")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--points", type=int, default=60_000)
    given = parser.parse_args()
    trees = {"now": ROOT, **{name: Path(folder) for name, _, folder in (each.partition("=") for each in given.tree)}}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="unsweep-frames-")))
        bag = folder / "room.bag"
        simulate("paper-normal", bag, seed=3, duration_s=6.0)
        chromium = stack.enter_context(sync_playwright()).chromium
        before = set(Path("/proc").iterdir())
        browser = chromium.launch(executable_path=CHROMIUM, args=GRAPHICS)
        stack.callback(browser.close)
        rooms = []
        for name, tree in trees.items():
            process, address = serve(tree, folder / name, given.points)
            stack.callback(process.wait)
            stack.callback(process.terminate)
            rooms.append(room_of(name, address, bag))
        painter = painter_of(before)
        for _ in range(given.turns):
            for each in rooms:
                each.turn(browser, given.seconds, painter)
        tell(rooms)
    return 0


def painter_of(before: set[Path]) -> int:
    """The process that draws, of the browser that was not among those processes."""
    for found in Path("/proc").glob("[0-9]*/cmdline"):
        if found.parent not in before and b"--type=gpu-process" in found.read_bytes():
            return int(found.parent.name)
    raise RuntimeError("the browser has no process that draws")


def tell(rooms: Sequence[Room]) -> None:
    """A row for each."""
    for each in rooms:
        frames, seconds = sum(each.frames), sum(each.seconds)
        cost_ms = 1e3 * sum(each.drawing_s) / max(frames, 1)
        sys.stdout.write(f"{each.name}: {frames} frames in {seconds:.1f} s, {cost_ms:.1f} ms of drawing each\n")


if __name__ == "__main__":
    sys.exit(main())
