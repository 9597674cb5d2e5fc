"""`python -m bench.desk`: how long people wait for the workspace, into bench/results/desk.json.

first cloud     from the end of an upload to the first points in the scene, 60 s of a VLP-16 (about 400 MB)
first planes    the same to the proposed planes, coloured
report          the same to the doctor's report
another scan    a moved slider: from the request to the answer, 30 000 points shown, the scene told

All over HTTP against a server of its own on loopback. The load of the machine is written beside the numbers: they are
seconds, which no gate judges.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import httpx2
import numpy as np
import viser
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from bench.store import RESULTS
from calib_core import api

POINTS = 30_000
SLIDER_MOVES = 60
PATIENCE_S = 300.0
POLL_S = 0.05
#: A server that has just started is still getting its spare process ready.
WARM_S = 10.0


@contextmanager
def served(data_dir: Path) -> Iterator[httpx2.Client]:
    """A client of a server of its own."""
    command = [sys.executable, "-m", "app.cli", "serve", "--port", "0", "--data-dir", str(data_dir)]
    environment = {**os.environ, "UNSWEEP_DISPLAYED_POINTS": str(POINTS)}
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as server:
        line = "" if server.stderr is None else server.stderr.readline()
        found = re.search(r"http://[0-9.:]+", line)
        if found is None:
            raise SystemExit(f"The server did not say where it is: {line!r}")
        time.sleep(WARM_S)
        with httpx2.Client(base_url=found.group(), timeout=60.0, trust_env=False) as client:
            yield client
        server.terminate()
        server.communicate(timeout=30)


def seconds_until(holds: Callable[[], bool], start_s: float) -> float:
    """Seconds from the start until it holds."""
    while not holds():
        if time.monotonic() - start_s > PATIENCE_S:
            raise SystemExit("The server did not get there in five minutes; see its log.")
        time.sleep(POLL_S)
    return time.monotonic() - start_s


def upload(client: httpx2.Client, bag: Path) -> str:
    """The id of the uploaded recording."""
    answer = client.put("/api/recordings/upload", params={"name": bag.name}, content=bag.read_bytes())
    return str(answer.json()["id"])


def first_views(client: httpx2.Client, home: str) -> dict[str, float]:
    """Seconds after the upload to the first cloud, the planes and the report."""
    start_s = time.monotonic()
    cloud_s = seconds_until(lambda: client.get(f"{home}/view").json()["points_shown"] > 0, start_s)
    waits = {"planes": 0.0, "report": 0.0}

    def found() -> bool:
        recording = client.get(home).json()
        for name, there in (("planes", recording["has_planes"]), ("report", recording["report"] is not None)):
            if there and waits[name] == 0.0:
                waits[name] = time.monotonic() - start_s
        return all(wait > 0.0 for wait in waits.values())

    seconds_until(found, start_s)
    return {"first_cloud_s": cloud_s, "first_planes_s": waits["planes"], "report_s": waits["report"]}


def slider_waits_ms(client: httpx2.Client, recording: str, n_scans: int) -> list[float]:
    """Milliseconds of each move of the slider, somebody looking on."""
    waits = []
    rng = np.random.default_rng(0)
    address = f"ws://{client.base_url.host}:{client.base_url.port}/scene/{recording}"
    origin = Origin(str(client.base_url).rstrip("/"))
    with connect(address, origin=origin, subprotocols=_protocols(), max_size=None, proxy=None) as scene:
        looking = threading.Thread(target=lambda: [None for _ in scene], daemon=True)
        looking.start()
        client.post(f"/api/recordings/{recording}/view", json={"mode": "inspect", "color_by": "intensity"})
        for scan in rng.choice(n_scans, SLIDER_MOVES, replace=False).tolist():
            start_s = time.monotonic()
            shown = client.post(f"/api/recordings/{recording}/view", json={"scan": scan}).json()
            waits.append((time.monotonic() - start_s) * 1e3)
            if shown["scan"] != scan:
                raise SystemExit(f"Asked for scan {scan}, shown {shown['scan']}.")
    return waits


def _protocols() -> list[Subprotocol]:
    return [Subprotocol(f"viser-v{viser.__version__}")]


def measure(bag: Path) -> dict[str, object]:
    """All numbers."""
    with tempfile.TemporaryDirectory(prefix="unsweep-desk-") as folder, served(Path(folder)) as client:
        recording = upload(client, bag)
        home = f"/api/recordings/{recording}"
        numbers: dict[str, object] = dict(first_views(client, home))
        seconds_until(lambda: client.get(f"{home}/view").json()["n_scans"] > 0, time.monotonic())
        view = client.get(f"{home}/view").json()
        waits = slider_waits_ms(client, recording, view["n_scans"])
        shown = client.get(f"{home}/view").json()["points_shown"]
    return {
        **{name: round(float(str(value)), 2) for name, value in numbers.items()},
        "slider_ms_median": round(float(np.median(waits)), 1),
        "slider_ms_p95": round(float(np.percentile(waits, 95)), 1),
        "slider_points": shown,
        "upload_bytes": bag.stat().st_size,
        "load_average": round(os.getloadavg()[0], 1),
        "cores": os.cpu_count() or 0,
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--bag", type=Path, help="a recording to use; default: 60 s of the scenario `handheld`, simulated"
    )
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="unsweep-desk-") as folder:
        bag = chosen.bag
        if bag is None:
            bag = Path(folder) / "handheld.bag"
            api.simulate("handheld", bag, seed=0)
        numbers = measure(bag)
    text = json.dumps(numbers, indent=2) + "\n"
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "desk.json").write_text(text, encoding="utf-8")
    sys.stdout.write(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
