"""A cloud whose points carry their times."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from calib_core.readers.clouds.cloud import RawCloud
from tests.core.readers import build

N = 55

FREE = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2")]


def cloud(
    k: int,
    field: str | None,
    kind: str,
    values: Callable[[NDArray[np.float64], int], NDArray[np.float64]],
    header_ns: int | None = None,
) -> RawCloud:
    """The k-th sweep with one time field made by `values(time_s, start_ns)`."""
    scan = build.sweep(seed=k)
    start = build.EPOCH_NS + k * 100_000_000
    points = np.zeros(scan["ring"].size, np.dtype(FREE + ([(field, kind)] if field else [])))
    points["x"], points["y"], points["z"] = scan["xyz"].T
    points["intensity"], points["ring"] = scan["intensity"], scan["ring"]
    if field:
        points[field] = values(scan["time_s"], start)
    header = start if header_ns is None else header_ns
    return RawCloud(header, start + 105_000_000, "lidar", points, points.size, 1)


def expected(k: int) -> NDArray[np.int64]:
    """The instants of the k-th sweep's points [ns]."""
    return build.EPOCH_NS + k * 100_000_000 + np.rint(build.sweep(seed=k)["time_s"] * 1e9).astype(np.int64)
