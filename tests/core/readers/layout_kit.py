"""What a layout under test is made of: a message packed here, and the exact points and instants it stands for.

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
    """make(k, cdr): the k-th message.   reference: what the detector must find.   name: the layout's.

    cdr_only: ROS 1 has no such bytes.
    """

    make: Callable[[int, bool], Truth]
    field: str
    unit: str
    reference: str
    name: str
    tolerance_ns: int
    type: str = POINTCLOUD2
    topic: str = "/points"
    period_ns: int = PERIOD_NS
    cdr_only: bool = False


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
