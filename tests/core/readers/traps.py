"""Simulated recordings with one thing wrong with their units, stamps or times, beside their untrapped twin.

Every trap carries the twin's points and readings; only the way they are written differs. So what is read must be the
twin's points at the twin's instants, and the calibration the twin's answer.

    python -m tests.core.readers.traps [--detect SCENARIO ...] [--calibrate]   the whole table, as in traps.md
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from calib_core import api
from calib_core.errors import InputError
from calib_core.settings import CalibrateSettings, ReadSettings
from calib_core.simulate import SCENARIOS, Simulation, prepare
from calib_core.simulate.layouts import Cloud
from calib_core.types import Recording
from tests.core.readers import build

STANDARD_GRAVITY = 9.80665
PERIOD_NS = 100_000_000
BOOT_NS = 1_234_567_890_123  # what a sensor that was never set says of EPOCH: 20 minutes after it was switched on
CLOUD, IMU = "/points", "/imu/data"
Columns = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Trap:
    """One way of writing the recording.

    times: (absolute ns, header ns) -> {field: values}.   header_ns: of a cloud from its sweep's start and end.
    from_start: times count from the sweep's start wherever the header is.   ring: whether clouds say which laser took a point.
    missing: returns that are none, with garbage times, are strewn in.   twice: each block of 16 returns, but the last of them, is
    followed by itself, with other intensities.   gyro, accel: factors per axis.
    imu_stamp_ns: from the true stamp and the receive time.   codes: findings that must be there.   says: their words.
    settings: what the user then gives, if anything.   shift_ns: what the trap adds to the time offset, by contract; None
    where it is only known roughly.   lidar_epoch_ns: added to the lidar's stamps gives the twin's.
    tolerance_ns: of the points' instants, from the number type.
    """

    times: Callable[[NDArray[np.int64], int], Columns] = lambda t, h: {"time": ((t - h) * 1e-9).astype("f4")}
    header_ns: Callable[[int, int], int] = lambda first, last: first
    from_start: bool = False
    ring: Literal["sent", "zero", "none"] = "sent"
    missing: bool = False
    twice: bool = False
    gyro: tuple[float, float, float] = (1.0, 1.0, 1.0)
    accel: tuple[float, float, float] = (1.0, 1.0, 1.0)
    imu_stamp_ns: Callable[[int, int], int] = lambda stamp, received: stamp
    codes: tuple[str, ...] = ("points.time_field",)
    says: str = ""
    settings: ReadSettings = field(default_factory=ReadSettings)
    shift_ns: int | None = 0
    lidar_epoch_ns: int = 0
    tolerance_ns: int = 8
    same_answer: bool = True


def _seconds(t: NDArray[np.int64]) -> NDArray[np.float64]:
    return t // 1_000_000_000 + (t % 1_000_000_000) * 1e-9


_G = (1 / STANDARD_GRAVITY,) * 3
_DEG = (180 / np.pi,) * 3
TRAPS: dict[str, Trap] = {
    "twin": Trap(says="in s, counted from the header, which is the first point's time"),
    "IMU in g": Trap(accel=_G, codes=("imu.accelerometer_unit",), says="are in g"),
    "IMU in deg/s": Trap(gyro=_DEG, codes=("imu.gyroscope_unit",), says="are in deg/s"),
    "IMU in g and deg/s": Trap(accel=_G, gyro=_DEG, codes=("imu.gyroscope_unit",), says="are in deg/s"),
    "negative times": Trap(header_ns=lambda first, last: last, says="which is the last point's time"),
    "stamp at the end": Trap(
        from_start=True,
        header_ns=lambda first, last: first + PERIOD_NS,
        codes=("clock.stamp_at_end",),
        says="probably the sweep's end",
        shift_ns=PERIOD_NS,
        lidar_epoch_ns=-PERIOD_NS,
    ),
    "stamp at the end, said so": Trap(
        from_start=True,
        header_ns=lambda first, last: first + PERIOD_NS,
        says="the last point's time",
        settings=ReadSettings(point_time_reference="header-last"),
        shift_ns=None,
        tolerance_ns=300_000,  # a sweep's last point is a column before the next one's first
    ),
    "absolute ns in float64": Trap(
        times=lambda t, h: {"timestamp": t.astype("f8")}, says="in ns, absolute", tolerance_ns=257
    ),
    "absolute s in float64": Trap(
        times=lambda t, h: {"timestamp": _seconds(t)}, says="in s, absolute", tolerance_ns=130
    ),
    "seconds since the sensor's start": Trap(
        times=lambda t, h: {"timestamp": _seconds(t - build.EPOCH_NS + BOOT_NS)},
        codes=("points.time_field", "points.epoch"),
        says="different instants",
        tolerance_ns=150,
    ),
    "seconds since the recording's start": Trap(
        times=lambda t, h: {"timestamp": (t - build.EPOCH_NS) * 1e-9},
        codes=("points.time_field", "points.epoch"),
        says="different instants",
        tolerance_ns=20,
    ),
    "ms in float32": Trap(times=lambda t, h: {"time": ((t - h) * 1e-6).astype("f4")}, says="in ms"),
    "us in float32": Trap(times=lambda t, h: {"time": ((t - h) * 1e-3).astype("f4")}, says="in us"),
    "ns in uint32": Trap(times=lambda t, h: {"t": (t - h).astype("u4")}, says="in ns"),
    "garbage on missing columns": Trap(
        times=lambda t, h: {"t": (t - h).astype("u4")}, missing=True, codes=("points.no_return",), says="no return"
    ),
    "no ring": Trap(ring="none", codes=("points.rows",), says="16 rows of elevation from -15.0 to 15.0 deg"),
    "rings all zero": Trap(ring="zero", codes=("points.rows",), says="the lowest is laser 0"),
    "two returns of each beam": Trap(twice=True, codes=("points.twice",), says="in the clouds twice"),
    "IMU clock since its start": Trap(
        imu_stamp_ns=lambda stamp, received: stamp - build.EPOCH_NS + BOOT_NS,
        codes=("clock.epochs",),
        says="different instants",
        shift_ns=build.EPOCH_NS - BOOT_NS,
    ),
    "lidar clock since its start": Trap(
        header_ns=lambda first, last: first - build.EPOCH_NS + BOOT_NS,
        from_start=True,
        codes=("clock.epochs",),
        says="different instants",
        shift_ns=BOOT_NS - build.EPOCH_NS,
        lidar_epoch_ns=build.EPOCH_NS - BOOT_NS,
    ),
    "IMU stamps never set": Trap(
        imu_stamp_ns=lambda stamp, received: 0, codes=("clock.unset",), says="receive times", shift_ns=None
    ),
    "gyroscope's z mirrored": Trap(
        gyro=(1.0, 1.0, -1.0), codes=("imu.axis_signs",), says="flipped", same_answer=False
    ),
    "gyroscope negated": Trap(
        gyro=(-1.0, -1.0, -1.0), codes=("imu.axis_signs",), says="flipped", same_answer=False
    ),
    "accelerometer's y mirrored": Trap(
        accel=(1.0, -1.0, 1.0), codes=("imu.axis_signs",), says="flipped", same_answer=False
    ),
}  # fmt: skip


def cloud_message(cloud: Cloud, trap: Trap, rng: np.random.Generator) -> tuple[int, bytes]:
    """The sweep as the trap has it: (header, ROS 1 bytes)."""
    rows = np.flatnonzero(cloud.valid)
    rows = rows[np.argsort(cloud.time_ns[rows], kind="stable")]
    source, times_ns = cloud.points[rows], cloud.time_ns[rows]
    header_ns = trap.header_ns(cloud.stamp_ns, cloud.end_ns)
    columns: Columns = {axis: source[axis] for axis in "xyz"}
    columns["intensity"] = source[cloud.intensity].astype("f4")
    if trap.ring != "none":
        columns["ring"] = source[cloud.ring].astype("u2") * (trap.ring == "sent")
    columns |= trap.times(times_ns, cloud.stamp_ns if trap.from_start else header_ns)
    points = np.zeros(rows.size, [(name, values.dtype) for name, values in columns.items()])
    for name, values in columns.items():
        points[name] = values
    if trap.missing:
        lost = np.zeros(rows.size // 10, points.dtype)
        lost["t"] = rng.integers(0, 3_600_000_000, lost.size)
        lost["t"][::3] = 0
        points = np.insert(points, rng.integers(0, rows.size, lost.size), lost)
    if trap.twice:
        first = np.arange(rows.size // 16 * 16).reshape(-1, 16)
        order = np.append(np.repeat(first, 2, axis=0).ravel(), np.arange(first.size, rows.size))
        points = points[order]
        points["intensity"][1::2] += 1.0
    return header_ns, build.pointcloud2(points, cdr=False, stamp_ns=header_ns)


@lru_cache(maxsize=1)
def clouds(simulation: Simulation) -> list[tuple[Cloud, int]]:
    """All sweeps with their receive times; made once, written many times."""
    made = [simulation.cloud(index) for index in range(simulation.n_scans)]
    return [(cloud, simulation.received_ns(cloud)) for cloud in made]


def messages(simulation: Simulation, trap: Trap) -> Iterator[build.Message]:
    """Everything in receive order."""
    rng = np.random.default_rng(7)
    records = simulation.imu_records
    sent = 0
    in_g = simulation.scenario.imu.accelerometer_unit == "g"
    sweeps = clouds(simulation)
    for cloud, received_ns in sweeps:
        is_last = cloud is sweeps[-1][0]
        until = records.stamps_ns.size if is_last else int(np.searchsorted(records.received_ns, received_ns))
        for k in range(sent, until):
            stamp_ns = trap.imu_stamp_ns(int(records.stamps_ns[k]), int(records.received_ns[k]))
            gyro, accel = (
                records.gyro_rad_s[k] * trap.gyro,
                records.accel[k] * (STANDARD_GRAVITY if in_g else 1.0) * trap.accel,
            )
            yield (
                IMU,
                "sensor_msgs/msg/Imu",
                int(records.received_ns[k]),
                build.imu_message(stamp_ns, gyro, accel, cdr=False),
            )
            sent = k + 1
        yield CLOUD, "sensor_msgs/msg/PointCloud2", received_ns, cloud_message(cloud, trap, rng)[1]


def write(path: Path, simulation: Simulation, trap: Trap) -> Path:
    """A ROS 1 bag of the recording with the trap in it."""
    return build.write_ros1(path, messages(simulation, trap))


def missed(recording: Recording, trap: Trap) -> list[str]:
    """Findings that should be there and are not, or do not say what they should, or lack evidence or override."""
    found = {f.code: f for f in recording.findings}
    wrong = [f"no {code}" for code in trap.codes if code not in found]
    told = " ".join(found[code].text for code in trap.codes if code in found)
    if trap.says not in told:
        wrong.append(f"does not say {trap.says!r} but {told!r}")
    wrong += [f"{c} lacks evidence" for c in trap.codes if c in found and not found[c].evidence]
    return wrong


def difference(recording: Recording, twin: Recording, epoch_ns: int) -> tuple[int, int, float]:
    """Worst disagreement with the twin: points (number of scans that differ), instants [ns], readings (relative)."""
    moved, worst = 0, 0
    for scan, other in zip(recording.scans, twin.scans, strict=True):
        alike = scan.points.shape == other.points.shape
        if not alike or any((scan.points[name] != other.points[name]).any() for name in ("xyz", "ring")):
            moved += 1
            continue
        apart = scan.points["offset_ns"].astype(np.int64) - other.points["offset_ns"]
        apart += scan.stamp_ns + epoch_ns - other.stamp_ns
        worst = max(worst, int(np.abs(apart).max()))
    reading = 0.0
    for name in ("gyro_rad_s", "accel_m_s2"):
        mine, theirs = getattr(recording.imu, name), getattr(twin.imu, name)
        reading = max(
            reading, float(np.abs(mine - theirs).max() / np.abs(theirs).max()) if mine.shape == theirs.shape else 1
        )
    return moved, worst, reading


@dataclass(frozen=True)
class Answer:
    """status, T (4, 4), offset in ns, sigma of rotation [rad], translation [m], offset [s]."""

    status: str
    T: NDArray[np.float64] | None
    offset_ns: int
    sigma: NDArray[np.float64]


def answer(recording: Recording) -> Answer:
    """The calibration; nobody asks how crisp its room is."""
    result = api.calibrate(recording, CalibrateSettings(crispness=False)).result
    if result.T_imu_lidar is None or result.uncertainty is None:
        return Answer(result.status, None, 0, np.ones(7))
    sigma = np.sqrt(np.diag(np.array(result.uncertainty.covariance)))
    return Answer(result.status, np.array(result.T_imu_lidar.matrix), result.time_offset_ns or 0, sigma)


def in_sigmas(got: Answer, want: Answer, shift_ns: int | None) -> float:
    """The largest difference of a component over the twin's standard deviation; the offset's where shift_ns is known."""
    assert got.T is not None
    assert want.T is not None
    turn = want.T[:3, :3].T @ got.T[:3, :3]
    rotation = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    offset_s = 0.0 if shift_ns is None else (got.offset_ns - want.offset_ns - shift_ns) * 1e-9
    apart = np.concatenate([rotation, got.T[:3, 3] - want.T[:3, 3], [offset_s]])
    return float(np.abs(apart / want.sigma).max())


def small(slug: str = "paper-fast", duration_s: float = 7.0) -> Simulation:
    """A short recording; a quarter of the columns where the lidar spins, so that a calibration takes seconds."""
    scenario = SCENARIOS[slug]
    pattern = scenario.lidar.pattern
    if hasattr(pattern, "column_period_ns"):
        slower = replace(pattern, column_period_ns=4 * pattern.column_period_ns)
        scenario = replace(scenario, lidar=replace(scenario.lidar, pattern=slower))
    return prepare(scenario, seed=1, duration_s=duration_s)


def examine(slug: str, duration_s: float, *, solve: bool) -> bool:
    """Print the table of one scenario; True where every trap was detected and read, and solved, as its twin."""
    simulation = small(slug, duration_s)
    good = True
    with tempfile.TemporaryDirectory() as folder:
        twin: Recording | None = None
        truth: Answer | None = None
        for number, (name, trap) in enumerate(TRAPS.items()):
            started = time.perf_counter()
            try:
                recording = api.load(write(Path(folder) / f"{number}.bag", simulation, trap), trap.settings)
                wrong = missed(recording, trap)
            except InputError as error:
                sys.stdout.write(f"| {slug} | {name} | refused: {error} |\n")
                good = False
                continue
            twin = twin or recording
            moved, worst_ns, reading = difference(recording, twin, trap.lidar_epoch_ns)
            verdict = "detected" if not wrong else "; ".join(wrong)
            line = f"| {slug} | {name} | {verdict} | {moved} | {worst_ns} | {reading:.1e} |"
            good &= not wrong
            if solve:
                got = answer(recording)
                truth = truth or got
                line += f" {got.status} |"
                if got.T is not None:
                    late_ms = (got.offset_ns - truth.offset_ns - (trap.shift_ns or 0)) * 1e-6
                    line += f" {in_sigmas(got, truth, trap.shift_ns):.4f} | {late_ms:+.6f} |"
            sys.stdout.write(f"{line} {time.perf_counter() - started:.0f} s\n")
            sys.stdout.flush()
    return good


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--detect", nargs="*", default=[], help="scenarios, detection only")
    parser.add_argument("--calibrate", action="store_true", help="paper-fast, through to the answer")
    given = parser.parse_args()
    results = [examine("paper-fast", 7.0, solve=True)] if given.calibrate else []
    results += [examine(slug, 20.0 if slug == "handheld" else 12.0, solve=False) for slug in given.detect]
    sys.exit(0 if all(results) else 1)
