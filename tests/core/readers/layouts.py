"""Each driver's cloud layout, packed as the driver packs it, with the exact points and instants it stands for."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.core.readers import build
from tests.core.readers.layout_kit import PERIOD_NS, Layout, Truth, filled, packed, seconds, start_ns, truth
from tests.core.readers.odd_layouts import ODD_LAYOUTS

__all__ = ["LAYOUTS", "PERIOD_NS", "start_ns"]


def velodyne(shift_s: float) -> Callable[[int, bool], Truth]:
    def make(k: int, cdr: bool) -> Truth:
        scan = build.sweep(seed=k)
        points = build.velodyne_points(scan, shift_s)
        return truth(k, cdr, points, scan["time_s"], header_ns=start_ns(k) - round(shift_s * 1e9))

    return make


def velodyne_organised(k: int, cdr: bool) -> Truth:
    """Rows are rings, columns firings; out of range is NaN, its time still there; rows padded by two bytes."""
    dtype = packed(
        [
            ("x", "<f4", 0),
            ("y", "<f4", 4),
            ("z", "<f4", 8),
            ("intensity", "<f4", 12),
            ("ring", "<u2", 16),
            ("time", "<f4", 18),
        ],
        22,
    )
    scan = build.sweep(seed=k)
    order = np.arange(scan["ring"].size).reshape(90, 16).T.ravel()
    scan = {name: values[order] for name, values in scan.items()}
    lost = np.random.default_rng(k).random(order.size) < 0.2
    scan["xyz"][lost] = np.nan
    return truth(
        k, cdr, filled(dtype, scan, time=scan["time_s"]), scan["time_s"], height=16, row_padding=2, dense=False
    )


OUSTER = packed(
    [
        ("x", "<f4", 0),
        ("y", "<f4", 4),
        ("z", "<f4", 8),
        ("intensity", "<f4", 16),
        ("t", "<u4", 20),
        ("reflectivity", "<u2", 24),
        ("ring", "<u2", 26),
        ("ambient", "<u2", 28),
        ("range", "<u4", 32),
    ],
    48,
)


def ouster(k: int, cdr: bool, *, ring_type: str = "<u2") -> Truth:
    """128 columns, 16 rows, destaggered row by row; a tenth of the columns missing: zero range and garbage times."""
    rng = np.random.default_rng(100 + k)
    scan = build.sweep(n_columns=128, seed=k)
    order = np.arange(scan["ring"].size).reshape(128, 16).T.ravel()
    column = order // 16
    scan = {name: values[order] for name, values in scan.items()}
    time_s = column * 0.1 / 128
    time_ns = np.rint(time_s * 1e9).astype(np.int64)
    missing = np.isin(column, rng.choice(np.arange(1, 127), 13, replace=False))
    time_ns[missing] = rng.integers(0, 3_600_000_000, np.count_nonzero(missing))
    scan["xyz"][missing] = 0
    dtype = OUSTER
    if ring_type == "u1":  # older drivers
        dtype = packed([(n, "u1" if n == "ring" else OUSTER[n].str, OUSTER.fields[n][1]) for n in OUSTER.names], 48)
    points = filled(dtype, scan, t=time_ns, range=np.linalg.norm(scan["xyz"], axis=1) * 1000)
    return truth(k, cdr, points, time_s, height=16, frame_id="os_lidar")


HESAI = packed(
    [
        ("x", "<f4", 0),
        ("y", "<f4", 4),
        ("z", "<f4", 8),
        ("intensity", "<f4", 12),
        ("ring", "<u2", 16),
        ("timestamp", "<f8", 18),
    ],
    26,
)


def hesai(k: int, cdr: bool) -> Truth:
    scan = build.sweep(seed=k)
    absolute = seconds(k, scan["time_s"])
    return truth(k, cdr, filled(HESAI, scan, timestamp=absolute), scan["time_s"], frame_id="hesai_lidar", dense=False)


def robosense(k: int, cdr: bool) -> Truth:
    """Shipped defaults of the code: header at the last point; NaN kept."""
    scan = build.sweep(seed=k)
    absolute = seconds(k, scan["time_s"])
    scan["xyz"][::7] = np.nan
    points = filled(HESAI, scan, timestamp=absolute)
    return truth(k, cdr, points, scan["time_s"], frame_id="rslidar", header_ns=start_ns(k) + PERIOD_NS, dense=False)


NEBULA = packed(
    [
        ("x", "<f4", 0),
        ("y", "<f4", 4),
        ("z", "<f4", 8),
        ("intensity", "u1", 12),
        ("return_type", "u1", 13),
        ("channel", "<u2", 14),
        ("azimuth", "<f4", 16),
        ("elevation", "<f4", 20),
        ("distance", "<f4", 24),
        ("time_stamp", "<u4", 28),
    ],
    32,
)


def nebula(k: int, cdr: bool) -> Truth:
    scan = build.sweep(seed=k)
    x, y, z = scan["xyz"].T
    points = filled(
        NEBULA,
        scan,
        channel=scan["ring"],
        azimuth=np.arctan2(-y, x) % (2 * np.pi),
        elevation=np.arctan2(z, np.hypot(x, y)),
        distance=np.linalg.norm(scan["xyz"], axis=1),
        time_stamp=np.rint(scan["time_s"] * 1e9),
    )
    return truth(k, cdr, points, scan["time_s"])


SEYOND = packed(
    [
        ("x", "<f4", 0),
        ("y", "<f4", 4),
        ("z", "<f4", 8),
        ("timestamp", "<f8", 16),
        ("intensity", "<f4", 24),
        ("flags", "u1", 28),
        ("elongation", "u1", 29),
        ("scan_id", "<u2", 30),
        ("scan_idx", "<u2", 32),
        ("is_2nd_return", "u1", 34),
    ],
    48,
)


def seyond(k: int, cdr: bool) -> Truth:
    """Times in steps of ten microseconds."""
    scan = build.sweep(seed=k)
    time_s = np.floor(scan["time_s"] * 1e5) * 1e-5
    points = filled(SEYOND, scan, timestamp=seconds(k, time_s), scan_id=np.arange(len(time_s)) % 65536)
    return truth(k, cdr, points, time_s, frame_id="seyond")


LIVOX2 = packed(
    [
        ("x", "<f4", 0),
        ("y", "<f4", 4),
        ("z", "<f4", 8),
        ("intensity", "<f4", 12),
        ("tag", "u1", 16),
        ("line", "u1", 17),
        ("timestamp", "<f8", 18),
    ],
    26,
)


def livox2(k: int, cdr: bool) -> Truth:
    """Absolute nanoseconds in float64, unaligned."""
    scan = build.sweep(seed=k)
    absolute = (start_ns(k) + np.rint(scan["time_s"] * 1e9)).astype(np.float64)
    return truth(
        k, cdr, filled(LIVOX2, scan, timestamp=absolute, line=scan["ring"] % 4), scan["time_s"], frame_id="livox_frame"
    )


CUSTOM = packed(
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


def custom(frame_id: str) -> Callable[[int, bool], Truth]:
    def make(k: int, cdr: bool) -> Truth:
        scan = build.sweep(n_columns=40, seed=k)
        points = filled(CUSTOM, scan, offset_time=np.rint(scan["time_s"] * 1e9), line=scan["ring"] % 4)
        made = truth(k, cdr, points, scan["time_s"])
        made.ring = scan["ring"].astype(np.int64) % 4
        made.payload = build.custom_msg(points, cdr=cdr, stamp_ns=start_ns(k), frame_id=frame_id)
        return made

    return make


LAYOUTS: dict[str, Layout] = {
    "velodyne": Layout(velodyne(0.0), "time", "s", "header-first", "velodyne", 8),
    "velodyne-header-last": Layout(velodyne(-0.1), "time", "s", "header-last", "velodyne", 8),
    "velodyne-organised": Layout(velodyne_organised, "time", "s", "header-first", "velodyne", 8),
    "ouster": Layout(ouster, "t", "ns", "header-first", "ouster", 0),
    "ouster-old-ring": Layout(lambda k, cdr: ouster(k, cdr, ring_type="u1"), "t", "ns", "header-first", "ouster", 0),
    "hesai": Layout(hesai, "timestamp", "s", "absolute", "hesai", 120),
    "robosense": Layout(robosense, "timestamp", "s", "absolute", "robosense", 120),
    "nebula": Layout(nebula, "time_stamp", "ns", "header-first", "nebula", 0),
    "seyond": Layout(seyond, "timestamp", "s", "absolute", "seyond", 120),
    "livox-driver2": Layout(livox2, "timestamp", "ns", "absolute", "livox-driver2-pointcloud2", 256),
    "livox-custom-1": Layout(
        custom("livox_frame"),
        "offset_time",
        "ns",
        "header-first",
        "livox-custommsg",
        0,
        "livox_ros_driver/msg/CustomMsg",
    ),
    "livox-custom-2": Layout(
        custom("f"), "offset_time", "ns", "header-first", "livox-custommsg", 0, "livox_ros_driver2/msg/CustomMsg"
    ),
    "livox-custom-frame-2": Layout(
        custom("ab"), "offset_time", "ns", "header-first", "livox-custommsg", 0, "livox_ros_driver2/msg/CustomMsg"
    ),
    "livox-custom-frame-3": Layout(
        custom("abc"), "offset_time", "ns", "header-first", "livox-custommsg", 0, "livox_ros_driver2/msg/CustomMsg"
    ),
    **ODD_LAYOUTS,
}
