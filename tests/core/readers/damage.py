"""Recordings cut at every megabyte and with bytes flipped by a thousand fixed seeds, in every container.

    python -m tests.core.readers.damage [--seeds 1000] [--only NAME ...] [--output bench/results/damage.md]

A damaged recording is read, or refused in one sentence. Anything else counts as a defect: an exception of another
kind, a point that is not finite, out of range or out of its sweep, memory that grows with the damage, or a minute
without an end (the run then stops with the place where it hangs).
"""

from __future__ import annotations

import argparse
import faulthandler
import gc
import platform
import random
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from calib_core.errors import InputError
from calib_core.readers.load import load
from calib_core.settings import ReadSettings
from tests.core.readers import build

HANGS_AFTER_S = 120
MEBIBYTE = 1 << 20
CONTAINERS: dict[str, tuple[str, str | None]] = {
    "none.bag": ("bag", None),
    "lz4.bag": ("bag", "lz4"),
    "bz2.bag": ("bag", "bz2"),
    "none.mcap": ("mcap", None),
    "zstd.mcap": ("mcap", "storage"),
    "none.db3": ("sqlite3", None),
    "message.db3": ("sqlite3", "message"),
}


@dataclass
class Tally:
    """What became of the damaged copies of one file."""

    read: int = 0
    refused: int = 0
    defects: list[str] = field(default_factory=list)


def recording(folder: Path, name: str, *, n_scans: int, n_columns: int) -> Path:
    """An intact recording of n_scans sweeps of 16 n_columns points, and an IMU, as one file."""
    kind, compression = CONTAINERS[name]
    cdr = kind != "bag"
    clouds: list[build.Message] = []
    for k in range(n_scans):
        start_ns = build.EPOCH_NS + k * 100_000_000
        points = build.velodyne_points(build.sweep(n_columns=n_columns, seed=k))
        body = build.pointcloud2(points, cdr=cdr, stamp_ns=start_ns, frame_id="velodyne")
        clouds.append(("/points", "sensor_msgs/msg/PointCloud2", start_ns + 105_000_000, body))
    messages = build.in_order(clouds, build.still_imu(0.1 * n_scans + 0.2, cdr=cdr))
    if not cdr:
        return build.write_ros1(folder / name, messages, compression=compression, chunk=60_000)
    made = build.write_ros2(folder / f"{name}.folder", messages, plugin=kind, compress=compression)
    return next(file for file in made.iterdir() if file.suffix in {".mcap", ".db3"})


def flipped(whole: bytes, seed: int) -> bytes:
    """A copy with 1, 10 or 200 random bytes, half of them where headers and indexes are."""
    chooser = random.Random(seed)
    damaged = bytearray(whole)
    for _ in range(chooser.choice((1, 10, 200))):
        where = chooser.random()
        if chooser.random() < 0.5:
            where = where * 0.05 if chooser.random() < 0.5 else 1 - where * 0.05
        damaged[min(int(where * len(damaged)), len(damaged) - 1)] = chooser.randrange(256)
    return bytes(damaged)


def attempt(path: Path, label: str, tally: Tally) -> None:
    """Read one damaged file and judge what came."""
    settings = ReadSettings()
    try:
        got = load(path, settings)
        for scan in got.scans:
            ranges = np.linalg.norm(scan.points["xyz"].astype(np.float64), axis=1)
            inside = (ranges > 0.99 * settings.range_min_m) & (ranges < 1.01 * settings.range_max_m)
            if not inside.all():
                tally.defects.append(f"{label}: a point out of range in scan {scan.index}")
            if scan.points["offset_ns"].min() != 0 or scan.points["offset_ns"].max() > 250_000_000:
                tally.defects.append(f"{label}: a time out of the sweep in scan {scan.index}")
        if not np.isfinite(got.imu.gyro_rad_s).all() or not np.isfinite(got.imu.accel_m_s2).all():
            tally.defects.append(f"{label}: a reading that is not finite")
        if (np.diff(got.imu.stamps_ns) <= 0).any():
            tally.defects.append(f"{label}: readings out of order")
        tally.read += 1
    except InputError as error:
        text = str(error)
        tally.refused += 1
        if not text.endswith(".") or "\n" in text or "Traceback" in text or len(text) > 600:
            tally.defects.append(f"{label}: not one sentence: {text[:200]!r}")
    except Exception as error:  # noqa: BLE001 - whatever else comes is what is looked for
        tally.defects.append(f"{label}: {type(error).__name__}: {error}")


def run(name: str, damages: Iterator[tuple[str, bytes]], folder: Path) -> Tally:
    """Every damaged copy, one after the other, under the file's own name."""
    tally = Tally()
    path = folder / name
    for label, damaged in damages:
        path.write_bytes(damaged)
        faulthandler.dump_traceback_later(HANGS_AFTER_S, exit=True)
        attempt(path, label, tally)
        faulthandler.cancel_dump_traceback_later()
    return tally


def cuts(whole: bytes) -> Iterator[tuple[str, bytes]]:
    """The file truncated at every megabyte."""
    for at in range(0, len(whole), MEBIBYTE):
        yield f"cut at {at // MEBIBYTE} MiB", whole[:at]


def flips(whole: bytes, n_seeds: int) -> Iterator[tuple[str, bytes]]:
    """The file with bytes flipped, once per seed."""
    for seed in range(n_seeds):
        yield f"seed {seed}", flipped(whole, seed)


def main() -> int:
    """Run everything, write the table; 0 where nothing is a defect."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=1000)
    parser.add_argument("--only", nargs="*", choices=CONTAINERS, default=list(CONTAINERS))
    parser.add_argument("--output", type=Path)
    given = parser.parse_args()
    kinds: list[tuple[str, int, int, Callable[[bytes], Iterator[tuple[str, bytes]]]]] = [
        ("cut at every MiB", 120, 400, cuts),
        (f"bytes flipped, seeds 0 to {given.seeds - 1}", 24, 30, lambda whole: flips(whole, given.seeds)),
    ]
    lines = [
        "| damage | file | size | read | refused in a sentence | defects |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    defects: list[str] = []
    started = time.perf_counter()
    peaks = []
    with tempfile.TemporaryDirectory() as temporary:
        for what, n_scans, n_columns, damages in kinds:
            for name in given.only:
                folder = Path(tempfile.mkdtemp(dir=temporary))
                intact = recording(folder, name, n_scans=n_scans, n_columns=n_columns).read_bytes()
                (folder / name).unlink(missing_ok=True)
                tally = run(name, damages(intact), folder)
                size = f"{len(intact) / MEBIBYTE:.1f} MiB"
                lines.append(f"| {what} | {name} | {size} | {tally.read} | {tally.refused} | {len(tally.defects)} |")
                sys.stdout.write(lines[-1] + "\n" + "".join(f"    {d}\n" for d in tally.defects[:10]))
                sys.stdout.flush()
                defects += tally.defects
                gc.collect()
                peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    lines.append(
        f"\n`python -m tests.core.readers.damage --seeds {given.seeds}`: {len(defects)} defects; peak memory"
        f" {peaks[0]:.0f} MiB after the first file, {peaks[-1]:.0f} MiB after the last;"
        f" {time.perf_counter() - started:.0f} s with Python {platform.python_version()}."
    )
    if given.output is not None:
        given.output.write_text("# Damaged recordings\n\n" + "\n".join(lines) + "\n", encoding="utf-8")
    sys.stdout.write(lines[-1] + "\n")
    return 1 if defects else 0


if __name__ == "__main__":
    sys.exit(main())
