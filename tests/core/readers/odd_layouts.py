"""Layouts of fewer users, of converters, and of the specification's corners: what a driver may legally send."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.core.readers import build
from tests.core.readers.layout_kit import Layout, Truth, filled, packed, start_ns, truth


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
    "aeva": Layout(aeva, "time_offset_ns", "ns", "header-first", "aeva", 0),
    "unnamed-ms": Layout(unnamed("phase", "f4", 1e3), "phase", "ms", "header-first", "generic", 8),
    "unnamed-us": Layout(unnamed("tick", "f4", 1e6), "tick", "us", "header-first", "generic", 8),
    "unnamed-bigendian": Layout(
        unnamed("clock", "f8", 1.0, bigendian=True), "clock", "s", "header-first", "generic", 1
    ),
}
