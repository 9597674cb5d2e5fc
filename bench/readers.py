"""How fast recordings are read, against rosbags on the same files in the same run.

    python -m bench.readers [--output bench/results/readers.md]

Four things are timed, each on one core, the best of several turns taken in rotation, so that a busy machine slows all
of them alike:

* `bare`: rosbags hands out every message's bytes and does nothing with them.
* `deserialise`: rosbags hands out every message and makes Python objects and arrays of it.
* `decode`: this package reads every message, checks it and makes a structured view of every cloud's points, and
  readings of every IMU message: what `deserialise` gives, and what must stay within 1.5 times `bare`.
* `scans`: `decode`, and beyond: invalid points masked, every point with its own time, packed for the estimator.

CPU seconds count, not the clock on the wall.
"""

from __future__ import annotations

import argparse
import math
import os
import platform
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from calib_core import api
from calib_core.readers.clouds import livox
from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.clouds.decoders import cloud_decoder
from calib_core.readers.container.opening import open_recording
from calib_core.readers.container.storage import RawMessage, TopicSummary
from calib_core.readers.imu.messages import TYPE as IMU
from calib_core.readers.imu.messages import ImuCollector
from calib_core.readers.scans import make_scan
from calib_core.readers.timing.point_time import detect_point_time
from calib_core.settings import ReadSettings
from calib_core.simulate import simulate

TURNS = 7
#: scenario, suffix, seconds
FILES = (("handheld", ".bag", 20.0), ("handheld", ".mcap", 20.0), ("ouster", ".bag", 8.0), ("outdoor", "", 8.0))
LIVOX = ("livox", ".bag", 10.0)
LIMIT_OF_BARE = 1.5
LIMIT_MS_PER_20K = 5.0


@dataclass(frozen=True)
class Timing:
    """CPU seconds of one file, by what was done with it."""

    name: str
    n_bytes: int
    n_clouds: int
    seconds: dict[str, float]


def typestore() -> Typestore:
    """The types that rosbags knows, and Livox's own."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    point = "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line\n"
    cloud = "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\nCustomPoint[] points\n"
    store.register(get_types_from_msg(point, "livox_ros_driver2/msg/CustomPoint"))
    store.register(get_types_from_msg(cloud, livox.TYPES[1]))
    return store


def bare(path: Path) -> None:
    """Every message's bytes by rosbags."""
    with AnyReader([path], default_typestore=typestore()) as reader:
        for _ in reader.messages():
            pass


def deserialise(path: Path) -> None:
    """Every message as rosbags' object."""
    with AnyReader([path], default_typestore=typestore()) as reader:
        for connection, _, payload in reader.messages():
            reader.deserialize(payload, connection.msgtype)


def decoded(path: Path) -> Iterator[RawCloud]:
    """Every cloud by this package; IMU messages are decoded on the way."""
    with open_recording(path) as recording:
        handlers: dict[str, Callable[[RawMessage], RawCloud | None]] = {t.name: handler(t) for t in recording.topics}
        for message in recording.messages(list(handlers)):
            cloud = handlers[message.topic](message)
            if cloud is not None:
                yield cloud


def handler(topic: TopicSummary) -> Callable[[RawMessage], RawCloud | None]:
    """What decodes the topic's messages."""
    return ImuCollector(topic.encoding).add if topic.type == IMU else cloud_decoder(topic)


def decode(path: Path) -> None:
    """Every message checked and viewed."""
    for _ in decoded(path):
        pass


def scans(path: Path) -> None:
    """Every cloud masked, timed and packed."""
    settings = ReadSettings()
    first = [cloud for cloud, _ in zip(decoded(path), range(5), strict=False)]
    timing, _ = detect_point_time(first, settings, topic="/points")
    for index, cloud in enumerate(decoded(path)):
        make_scan(cloud, index, timing, settings.range_min_m, settings.range_max_m)


def measure(path: Path, name: str) -> Timing:
    """The best of TURNS for each of the four."""
    jobs = (bare, deserialise, decode, scans)
    best = dict.fromkeys((job.__name__ for job in jobs), math.inf)
    for _ in range(TURNS):
        for job in jobs:
            started = time.process_time()
            job(path)
            best[job.__name__] = min(best[job.__name__], time.process_time() - started)
    size = sum(f.stat().st_size for f in path.rglob("*")) if path.is_dir() else path.stat().st_size
    return Timing(name, size, sum(1 for _ in decoded(path)), best)


def custom_msg_ms(path: Path) -> tuple[float, float]:
    """Milliseconds for 20,000 points of a CustomMsg: its structured view, and as a scan of the estimator."""
    settings = ReadSettings()
    with open_recording(path) as recording:
        topic = next(t for t in recording.topics if t.type in livox.TYPES)
        messages = list(recording.messages((topic.name,)))
    decoder = cloud_decoder(topic)
    timing, _ = detect_point_time([decoder(m) for m in messages[:20]], settings, topic=topic.name)
    view = scan = math.inf
    for message in messages * 3:
        started = time.process_time()
        cloud = decoder(message)
        middle = time.process_time()
        make_scan(cloud, 0, timing, settings.range_min_m, settings.range_max_m)
        per_ms = 1e3 * 20_000 / cloud.points.size
        view = min(view, (middle - started) * per_ms)
        scan = min(scan, (time.process_time() - started) * per_ms)
    return view, scan


def load_s(path: Path) -> tuple[float, float, int]:
    """Wall and CPU seconds of a whole `load`, and the points it gave."""
    best = (math.inf, math.inf, 0)
    for _ in range(3):
        wall, cpu = time.perf_counter(), time.process_time()
        recording = api.load(path)
        n_points = sum(scan.points.size for scan in recording.scans)
        best = min(best, (time.perf_counter() - wall, time.process_time() - cpu, n_points))
    return best


def report(timings: list[Timing], custom: tuple[float, float], loaded: tuple[float, float, int]) -> str:
    """The table, and whether the limits hold."""
    lines = [
        "# Reading speed",
        "",
        (__doc__ or "").split("\n\n", 2)[2].strip(),
        "",
        (
            "| recording | clouds | MB | bare | deserialise | decode | scans | decode / bare | decode / deserialise |"
            " scans / bare |"
        ),
        "| --- " * 10 + "|",
    ]
    for t in timings:
        s = t.seconds
        lines.append(
            f"| {t.name} | {t.n_clouds} | {t.n_bytes / 1e6:.0f} | {s['bare']:.3f} s | {s['deserialise']:.3f} s"
            f" | {s['decode']:.3f} s | {s['scans']:.3f} s | {s['decode'] / s['bare']:.2f}"
            f" | {s['decode'] / s['deserialise']:.2f} | {s['scans'] / s['bare']:.2f} |"
        )
    worst = max(t.seconds["decode"] / t.seconds["bare"] for t in timings)
    lines += [
        "",
        f"- decode within {LIMIT_OF_BARE} of bare: worst {worst:.2f}, {'holds' if worst <= LIMIT_OF_BARE else 'FAILS'}.",
        (
            f"- CustomMsg, 20,000 points: {custom[0]:.3f} ms to a view, {custom[1]:.3f} ms to a scan; limit"
            f" {LIMIT_MS_PER_20K} ms, {'holds' if custom[1] <= LIMIT_MS_PER_20K else 'FAILS'}."
        ),
        (
            f"- `load` of 60 s of a VLP-16 (handheld, {loaded[2] / 1e6:.1f} million points), detection, hash and scans"
            f" included: {loaded[0]:.2f} s on the wall, {loaded[1]:.2f} s of CPU."
        ),
        f"- Python {platform.python_version()}, {os.cpu_count()} cores.",
        "",
    ]
    return "\n".join(lines)


def main() -> None:
    """Simulate, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        timings = []
        for slug, suffix, duration_s in FILES:
            path = Path(folder) / f"{slug}{suffix}"
            simulate(slug, path, duration_s=duration_s)
            kind = {".bag": "ROS 1", ".mcap": "mcap", "": "sqlite3"}[suffix]
            timings.append(measure(path, f"{slug}, {kind}"))
        solid = Path(folder) / "livox.bag"
        simulate(LIVOX[0], solid, duration_s=LIVOX[2])
        custom = custom_msg_ms(solid)
        minute = Path(folder) / "minute.bag"
        simulate("handheld", minute)
        text = report(timings, custom, load_s(minute))
    print(text)
    if given.output is not None:
        given.output.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
