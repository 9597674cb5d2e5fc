"""Each driver's cloud layout, packed as the driver packs it, with the exact points and instants it stands for.

An instant is an integer number of nanoseconds; `tolerance_ns` is the layout's own resolution, from its number type.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.core.readers import build

PERIOD_NS = 100_000_000
POINTCLOUD2 = "sensor_msgs/msg/PointCloud2"


@dataclass
class Truth:
    """What a message holds. valid: (N,) rows that are returns.   times_ns: (N,) absolute."""

    payload: bytes
    xyz: NDArray[np.float32]
    times_ns: NDArray[np.int64]
    valid: NDArray[np.bool_]
    ring: NDArray[np.int64] | None = None


@dataclass(frozen=True)
class Layout:
    """make(k, cdr): the k-th message.   reference: what the detector must find."""

    make: Callable[[int, bool], Truth]
    field: str
    unit: str
    reference: str
    name: str
    tolerance_ns: int
    type: str = POINTCLOUD2
    topic: str = "/points"


def packed(fields: list[tuple[str, str, int]], step: int) -> np.dtype[np.void]:
    """A dtype from (name, format, offset) and the point step."""
    names, formats, offsets = zip(*fields, strict=True)
    return np.dtype({"names": list(names), "formats": list(formats), "offsets": list(offsets), "itemsize": step})


def filled(
    dtype: np.dtype[np.void], scan: dict[str, NDArray[np.float64]], **more: NDArray[np.float64]
) -> NDArray[np.void]:
    """Points with coordinates, the ring where there is one, and further fields."""
    points = np.zeros(len(scan["ring"]), dtype)
    points["x"], points["y"], points["z"] = scan["xyz"].T
    for name, values in {"ring": scan["ring"], "intensity": scan["intensity"], **more}.items():
        if name in (dtype.names or ()):
            points[name] = values
    return points


def start_ns(k: int) -> int:
    return build.EPOCH_NS + k * PERIOD_NS


def seconds(k: int, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Absolute seconds as float64, rounded once: half a step at 1.7e9 s is 119 ns."""
    whole_ns = start_ns(k) + np.rint(time_s * 1e9).astype(np.int64)
    return whole_ns // 1_000_000_000 + (whole_ns % 1_000_000_000) / 1e9


def truth(k: int, cdr: bool, points: NDArray[np.void], time_s: NDArray[np.float64], **options: object) -> Truth:
    """The message whose header is at the first packet unless `header_ns` says otherwise."""
    header_ns = int(options.pop("header_ns", start_ns(k)))  # type: ignore[call-overload]
    payload = build.pointcloud2(points, cdr=cdr, stamp_ns=header_ns, **options)  # type: ignore[arg-type]
    xyz = np.stack([points[a] for a in "xyz"], 1).astype(np.float32)
    valid = np.isfinite(xyz).all(1) & (xyz != 0).any(1)
    times = start_ns(k) + np.rint(np.asarray(time_s) * 1e9).astype(np.int64)
    return Truth(payload, xyz, times, valid, points["ring"].astype(np.int64) if "ring" in points.dtype.names else None)


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
