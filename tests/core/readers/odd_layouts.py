"""Layouts of fewer users, of converters, and of the specification's corners: what a driver may legally send."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tests.core.readers import build
from tests.core.readers.layout_kit import Layout, Truth, filled, packed, seconds, start_ns, truth


def sick(*time_fields: tuple[str, str]) -> Callable[[int, bool], Truth]:
    """MultiScan's user-defined clouds with one of its three time fields; `i` is the intensity."""

    def make(k: int, cdr: bool) -> Truth:
        fields = [("x", "<f4", 0), ("y", "<f4", 4), ("z", "<f4", 8), ("i", "<f4", 12)]
        offset = 16
        for name, kind in time_fields:
            fields.append((name, kind, offset))
            offset += np.dtype(kind).itemsize
        fields += [
            ("ring", "i1", offset),
            ("layer", "<i4", offset + 1),
            ("echo", "<i4", offset + 5),
            ("reflector", "u1", offset + 9),
        ]
        scan = build.sweep(seed=k)
        relative_ns = np.rint(scan["time_s"] * 1e9).astype(np.int64)
        absolute_ns = start_ns(k) + relative_ns
        more = {
            "t": relative_ns,
            "ts": scan["time_s"],
            "lidar_sec": absolute_ns // 1_000_000_000,
            "lidar_nsec": absolute_ns % 1_000_000_000,
        }
        return truth(k, cdr, filled(packed(fields, offset + 10), scan, layer=scan["ring"], **more), scan["time_s"])

    return make


def split_microseconds(k: int, cdr: bool) -> Truth:
    """A stamp as of C's timeval, under somebody's own names, microseconds first."""
    dtype = packed(
        [("x", "<f4", 0), ("y", "<f4", 4), ("z", "<f4", 8), ("timeMicrosecond", "<i4", 12), ("timeSecond", "<i4", 16)],
        20,
    )
    scan = build.sweep(seed=k)
    absolute_us = (start_ns(k) + np.rint(scan["time_s"] * 1e9).astype(np.int64)) // 1000
    parts = {"timeSecond": absolute_us // 1_000_000, "timeMicrosecond": absolute_us % 1_000_000}
    return truth(k, cdr, filled(dtype, scan, **parts), scan["time_s"])


AEVA = packed(
    [
        ("x", "<f4", 0),
        ("y", "<f4", 4),
        ("z", "<f4", 8),
        ("reflectivity", "<f4", 12),
        ("velocity", "<f4", 16),
        ("time_offset_ns", "<i4", 20),
        ("line_index", "u1", 24),
        ("intensity", "<f4", 25),
    ],
    29,
)


def aeva(k: int, cdr: bool) -> Truth:
    scan = build.sweep(seed=k)
    return truth(k, cdr, filled(AEVA, scan, time_offset_ns=np.rint(scan["time_s"] * 1e9)), scan["time_s"])


def unnamed(field: str, kind: str, scale: float, *, bigendian: bool = False) -> Callable[[int, bool], Truth]:
    """A cloud of a converter's own: a time field under any name, in any unit, beside a field that is no time."""
    order = ">" if bigendian else "<"
    dtype = packed(
        [
            ("x", f"{order}f4", 0),
            ("y", f"{order}f4", 4),
            ("z", f"{order}f4", 8),
            ("brightness", f"{order}f4", 12),
            (field, order + kind, 16),
        ],
        16 + np.dtype(kind).itemsize,
    )

    def make(k: int, cdr: bool) -> Truth:
        scan = build.sweep(seed=k)
        brightness = np.random.default_rng(k).uniform(0, 100, scan["ring"].size)  # spans 100, as milliseconds would
        points = filled(dtype, scan, brightness=brightness, **{field: scan["time_s"] * scale})
        return truth(k, cdr, points, scan["time_s"], bigendian=bigendian)

    return make


def named(
    field: str,
    kind: str,
    values: Callable[[int, NDArray[np.float64]], NDArray[np.float64]],
    *,
    xyz: str = "<f4",
    dense: bool = True,
    header_after_ns: int = 0,
) -> Callable[[int, bool], Truth]:
    """Coordinates, intensity, ring and one time field; a fifth of the points NaN whatever is_dense says.

    Between them lie a padding entry of count 3, a field of eight numbers, and bytes that no field speaks of.
    """
    size = np.dtype(xyz).itemsize
    end = 3 * size
    fields = [("x", xyz, 0), ("y", xyz, size), ("z", xyz, 2 * size), ("_", "(3,)u1", end)]
    fields += [("intensity", "<f4", end + 4), ("echoes", "(8,)<u2", end + 8), ("ring", "<u2", end + 31)]
    dtype = packed([*fields, (field, kind, end + 33)], end + 46)

    def make(k: int, cdr: bool) -> Truth:
        scan = build.sweep(seed=k)
        points = filled(dtype, scan, **{field: values(k, scan["time_s"])})
        lost = np.random.default_rng(k).random(points.size) < 0.2
        for axis in "xyz":
            points[axis][lost] = np.nan
        return truth(k, cdr, points, scan["time_s"], dense=dense, header_ns=start_ns(k) + header_after_ns)

    return make


NEBULA_OLD = packed(
    [
        ("x", "<f4", 0),
        ("y", "<f4", 4),
        ("z", "<f4", 8),
        ("intensity", "<f4", 12),
        ("ring", "<u2", 16),
        ("azimuth", "<f4", 20),
        ("distance", "<f4", 24),
        ("return_type", "u1", 28),
        ("time_stamp", "<f8", 32),
    ],
    40,
)


def nebula_old(k: int, cdr: bool) -> Truth:
    """Nebula's XYZIRADT: nanoseconds in float64."""
    scan = build.sweep(seed=k)
    x, y, _ = scan["xyz"].T
    more = {"azimuth": np.arctan2(-y, x), "time_stamp": np.rint(scan["time_s"] * 1e9)}
    return truth(k, cdr, filled(NEBULA_OLD, scan, **more), scan["time_s"])


SEGMENT_NS = 100_000_000 // 12


def sick_segments(k: int, cdr: bool) -> Truth:
    """A twelfth of a turn a message, as segment clouds come."""
    scan = build.sweep(n_columns=96, seed=k // 12)
    part = slice(k % 12 * 128, k % 12 * 128 + 128)
    scan = {name: values[part] for name, values in scan.items()}
    start = build.EPOCH_NS + k * SEGMENT_NS
    elapsed_ns = np.rint(scan["time_s"] * 1e9).astype(np.int64) - k % 12 * SEGMENT_NS
    elapsed_ns -= elapsed_ns.min()
    fields = [
        ("x", "<f4", 0),
        ("y", "<f4", 4),
        ("z", "<f4", 8),
        ("i", "<f4", 12),
        ("t", "<u4", 16),
        ("layer", "<i4", 20),
    ]
    points = filled(packed(fields, 24), scan, t=elapsed_ns, layer=scan["ring"])
    made = truth(k, cdr, points, scan["time_s"], header_ns=start)
    made.times_ns = start + elapsed_ns
    return made


def ouster_first_scan(k: int, cdr: bool) -> Truth:
    """The recording's first scan still holds the buffer of the sensor's start: times up to 3.6 s on real returns."""
    fields = [("x", "<f4", 0), ("y", "<f4", 4), ("z", "<f4", 8), ("intensity", "<f4", 16), ("t", "<u4", 20)]
    fields += [("reflectivity", "<u2", 24), ("ring", "<u2", 26), ("range", "<u4", 32)]
    scan = build.sweep(seed=k)
    elapsed_ns = np.rint(scan["time_s"] * 1e9).astype(np.int64)
    made = truth(k, cdr, filled(packed(fields, 48), scan, t=elapsed_ns), scan["time_s"])
    if k == 0:
        stale = np.arange(elapsed_ns.size) < elapsed_ns.size // 3
        points = filled(packed(fields, 48), scan, t=np.where(stale, 3_600_000_000 - elapsed_ns, elapsed_ns))
        made = truth(k, cdr, points, scan["time_s"])
        made.valid &= ~stale
    return made


def custom_with_zeros(k: int, cdr: bool) -> Truth:
    """A Livox CustomMsg whose shots without a return are at the origin; its CDR a big-endian machine's."""
    dtype = packed(
        [
            ("offset_time", "<u4", 0),
            ("x", "<f4", 4),
            ("y", "<f4", 8),
            ("z", "<f4", 12),
            ("reflectivity", "u1", 16),
            ("tag", "u1", 17),
            ("line", "u1", 18),
        ],
        19,
    )
    scan = build.sweep(n_columns=40, seed=k)
    scan["xyz"][np.random.default_rng(k).random(640) < 0.3] = 0
    points = filled(dtype, scan, offset_time=np.rint(scan["time_s"] * 1e9), line=scan["ring"] % 4)
    made = truth(k, cdr, points, scan["time_s"])
    made.ring = scan["ring"].astype(np.int64) % 4
    made.payload = build.custom_msg(points, cdr=cdr, stamp_ns=start_ns(k), order=">" if cdr else "<")
    return made


def bigendian_cdr(k: int, cdr: bool) -> Truth:
    """A big-endian machine's message: members, field list and points in its own order."""
    scan = build.sweep(seed=k)
    dtype = packed([("x", ">f4", 0), ("y", ">f4", 4), ("z", ">f4", 8), ("t", ">u4", 12), ("ring", ">u2", 16)], 18)
    points = filled(dtype, scan, t=np.rint(scan["time_s"] * 1e9))
    return truth(k, cdr, points, scan["time_s"], bigendian=True, order=">")


ODD_LAYOUTS: dict[str, Layout] = {
    "sick-t": Layout(sick(("t", "<u4")), "t", "ns", "header-first", "sick-all-fields", 0),
    "sick-ts": Layout(sick(("ts", "<f4")), "ts", "s", "header-first", "sick-all-fields", 8),
    "sick-sec-nsec": Layout(
        sick(("lidar_sec", "<u4"), ("lidar_nsec", "<u4")),
        "lidar_sec+lidar_nsec",
        "ns",
        "absolute",
        "sick-all-fields",
        0,
    ),
    "seconds-and-microseconds": Layout(
        split_microseconds, "timeSecond+timeMicrosecond", "ns", "absolute", "generic", 1_000
    ),
    "aeva": Layout(aeva, "time_offset_ns", "ns", "header-first", "aeva", 0),
    "unnamed-ms": Layout(unnamed("phase", "f4", 1e3), "phase", "ms", "header-first", "generic", 8),
    "unnamed-us": Layout(unnamed("tick", "f4", 1e6), "tick", "us", "header-first", "generic", 8),
    "unnamed-bigendian": Layout(
        unnamed("clock", "f8", 1.0, bigendian=True), "clock", "s", "header-first", "generic", 1
    ),
    "nebula-xyziradt": Layout(nebula_old, "time_stamp", "ns", "header-first", "nebula", 0),
    "sick-segments": Layout(sick_segments, "t", "ns", "header-first", "sick-all-fields", 0, period_ns=SEGMENT_NS),
    "ouster-first-scan": Layout(ouster_first_scan, "t", "ns", "header-first", "ouster", 0),
    "livox-custom-zeros": Layout(
        custom_with_zeros,
        "offset_time",
        "ns",
        "header-first",
        "livox-custommsg",
        0,
        "livox_ros_driver2/msg/CustomMsg",
    ),
    "bigendian-cdr": Layout(bigendian_cdr, "t", "ns", "header-first", "generic", 0, cdr_only=True),
    "t-seconds": Layout(named("t", "<f4", lambda k, t: t), "t", "s", "header-first", "generic", 8),
    "offset_time": Layout(
        named("offset_time", "<u4", lambda k, t: np.rint(t * 1e9)), "offset_time", "ns", "header-first", "generic", 0
    ),
    "timestamps": Layout(named("timestamps", "<f8", seconds), "timestamps", "s", "absolute", "generic", 120),
    "float64-xyz": Layout(
        named("time", "<f8", lambda k, t: t * 1e6, xyz="<f8"), "time", "us", "header-first", "velodyne", 1
    ),
    "not-dense-after-all": Layout(
        named("time", "<i4", lambda k, t: np.rint((t - 0.1) * 1e6), dense=False, header_after_ns=100_000_000),
        "time",
        "us",
        "header-last",
        "velodyne",
        500,
    ),
}
