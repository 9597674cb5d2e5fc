"""Sweeps as drivers publish them: point records with every driver's own fields, rounding and stamps.

`Cloud` is the message before it becomes bytes; `scan_of` is what any faithful reader makes of it, so that a recording
made in memory and one read from a bag agree to the last bit (within 1 ns where a driver stamps in float64 seconds).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calib_core.simulate.lidar import Sweep
from calib_core.simulate.patterns import Spinning
from calib_core.simulate.sensors import Layout, Lidar
from calib_core.types import POINT_DTYPE, BoolArray, IntArray, Scan

StructArray = NDArray[np.void]

VELODYNE = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "ring", "time"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<u2", "<f4"],
        "offsets": [0, 4, 8, 12, 16, 18],
        "itemsize": 22,
    }
)
HESAI = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "ring", "timestamp"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<u2", "<f8"],
        "offsets": [0, 4, 8, 12, 16, 18],
        "itemsize": 26,
    }
)
OUSTER = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "t", "reflectivity", "ring", "ambient", "range"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<u4", "<u2", "<u2", "<u2", "<u4"],
        "offsets": [0, 4, 8, 16, 20, 24, 26, 28, 32],
        "itemsize": 48,
    }
)
LIVOX = np.dtype(
    [
        ("offset_time", "<u4"),
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("reflectivity", "u1"),
        ("tag", "u1"),
        ("line", "u1"),
    ]
)


@dataclass(frozen=True, slots=True)
class Cloud:
    """One message.

    kind: the message type.   stamp_ns: its header.   points: in the order sent; height x width of them.
    time_ns: (N,) each point's time as the record tells it, lidar clock.   valid: (N,).   intensity, ring: field names.
    end_ns: when the sweep was over.
    """

    kind: Literal["PointCloud2", "CustomMsg"]
    index: int
    stamp_ns: int
    points: StructArray
    height: int
    time_ns: IntArray
    valid: BoolArray
    is_dense: bool
    end_ns: int
    intensity: str = "intensity"
    ring: str = "ring"

    @property
    def width(self) -> int:
        """Points per row."""
        return int(self.points.shape[0] // max(self.height, 1))


def encode(sweep: Sweep, lidar: Lidar, epoch_ns: int) -> Cloud:
    """The sweep as this lidar's driver publishes it."""
    return _ENCODERS[lidar.layout](sweep, lidar, epoch_ns)


def first_of_cells(cloud: Cloud, cell_m: float) -> Cloud:
    """What a voxel filter leaves of a message: of its valid points, the first that was sent in each cube of space."""
    sent = np.flatnonzero(cloud.valid)
    cubes = [np.floor(cloud.points[axis][sent].astype(np.float64) / cell_m).astype(np.int64) for axis in "xyz"]
    # Kilometres either way: no two cubes have one number.
    _, first = np.unique((cubes[0] << 42) + (cubes[1] << 21) + cubes[2], return_index=True)
    kept = sent[np.sort(first)]
    return replace(
        cloud,
        points=cloud.points[kept],
        height=1,
        time_ns=cloud.time_ns[kept],
        valid=np.ones(len(kept), bool),
        is_dense=True,
    )


def scan_of(cloud: Cloud) -> Scan:
    """The scan a reader makes of the message: valid returns only, times after the first of them."""
    points, time_ns = cloud.points, cloud.time_ns
    if not cloud.valid.all():
        points, time_ns = points[cloud.valid], time_ns[cloud.valid]
    first = int(time_ns.min()) if time_ns.size else cloud.stamp_ns
    out = np.zeros(points.shape[0], POINT_DTYPE)
    for axis, name in enumerate("xyz"):
        out["xyz"][:, axis] = points[name]
    out["intensity"] = points[cloud.intensity]
    out["ring"] = points[cloud.ring]
    out["offset_ns"] = time_ns - first
    return Scan(cloud.index, first, out)


def _filled(dtype: np.dtype[np.void], sweep: Sweep, chosen: BoolArray | slice) -> StructArray:
    """Records with x, y, z of the chosen firings, column by column."""
    xyz = sweep.xyz_m.reshape(-1, 3)[chosen]
    points = np.zeros(xyz.shape[0], dtype)
    for axis, name in enumerate("xyz"):
        points[name] = xyz[:, axis]
    return points


def _rings(sweep: Sweep) -> NDArray[np.uint16]:
    return np.broadcast_to(sweep.ring, sweep.time_ns.shape).reshape(-1)


def _velodyne(sweep: Sweep, lidar: Lidar, epoch_ns: int) -> Cloud:
    """Unorganised, returns only; `time` in float32 seconds after the stamp of the first (or last) packet."""
    packet = lidar.pattern.columns_per_packet if isinstance(lidar.pattern, Spinning) else 1
    header_ns = int(sweep.time_ns[0 if lidar.header_at == "first" else -packet, 0])
    valid = sweep.valid.reshape(-1)
    points = _filled(VELODYNE, sweep, valid)
    points["intensity"] = sweep.intensity.reshape(-1)[valid]
    points["ring"] = _rings(sweep)[valid]
    points["time"] = (sweep.time_ns.reshape(-1)[valid] - header_ns) * 1e-9
    time_ns = epoch_ns + header_ns + np.rint(points["time"].astype(np.float64) * 1e9).astype(np.int64)
    everything = np.ones(points.shape[0], bool)
    return Cloud(
        "PointCloud2", sweep.index, epoch_ns + header_ns, points, 1, time_ns, everything, True, epoch_ns + _end(sweep)
    )


def _hesai(sweep: Sweep, lidar: Lidar, epoch_ns: int) -> Cloud:
    """Unorganised, returns only, called not dense all the same; `timestamp` in absolute float64 seconds."""
    del lidar
    valid = sweep.valid.reshape(-1)
    points = _filled(HESAI, sweep, valid)
    points["intensity"] = sweep.intensity.reshape(-1)[valid]
    points["ring"] = _rings(sweep)[valid]
    absolute_ns = epoch_ns + sweep.time_ns.reshape(-1)[valid]
    points["timestamp"] = absolute_ns // 1_000_000_000 + (absolute_ns % 1_000_000_000) * 1e-9
    whole = np.floor(points["timestamp"])
    time_ns = whole.astype(np.int64) * 1_000_000_000 + np.rint((points["timestamp"] - whole) * 1e9).astype(np.int64)
    header_ns = epoch_ns + int(sweep.time_ns[0, 0])
    everything = np.ones(points.shape[0], bool)
    return Cloud("PointCloud2", sweep.index, header_ns, points, 1, time_ns, everything, False, epoch_ns + _end(sweep))


def _ouster(sweep: Sweep, lidar: Lidar, epoch_ns: int) -> Cloud:
    """Organised, one row a beam from the top down; (0, 0, 0) where nothing answered; t = 0 in lost columns."""
    del lidar
    columns, channels = sweep.time_ns.shape
    # Not np.ascontiguousarray: a copy of records leaves what lies between their fields as the memory was.
    points = np.zeros((channels, columns), OUSTER)
    points[...] = _filled(OUSTER, sweep, slice(None)).reshape(columns, channels).T
    header_ns = int(sweep.time_ns[0, 0])
    t = np.where(sweep.lost[:, None], 0, sweep.time_ns - header_ns).T
    valid = sweep.valid.T
    signal = sweep.intensity.T
    points["t"], points["ring"] = t, np.arange(channels)[:, None]
    points["intensity"] = np.where(valid, 8.0 * signal, 0.0)
    points["reflectivity"] = np.where(valid, signal, 0.0)
    points["ambient"] = np.where(sweep.lost[None, :], 0, 90)
    points["range"] = np.rint(1000.0 * np.linalg.norm(sweep.xyz_m, axis=2).T)
    time_ns = epoch_ns + header_ns + t.reshape(-1)
    return Cloud(
        "PointCloud2",
        sweep.index,
        epoch_ns + header_ns,
        points.reshape(-1),
        channels,
        time_ns,
        valid.reshape(-1),
        True,
        epoch_ns + _end(sweep),
    )


def _livox(sweep: Sweep, lidar: Lidar, epoch_ns: int) -> Cloud:
    """The driver's own message: every shot, (0, 0, 0) where nothing answered, times in ns after the first."""
    del lidar
    header_ns = int(sweep.time_ns[0, 0])
    points = _filled(LIVOX, sweep, slice(None))
    valid = sweep.valid.reshape(-1)
    points["offset_time"] = sweep.time_ns.reshape(-1) - header_ns
    points["reflectivity"] = np.where(valid, np.minimum(sweep.intensity.reshape(-1), 255.0), 0.0)
    points["tag"] = np.where(valid, 0x10, 0)
    points["line"] = _rings(sweep)
    time_ns = epoch_ns + sweep.time_ns.reshape(-1)
    return Cloud(
        "CustomMsg",
        sweep.index,
        epoch_ns + header_ns,
        points,
        1,
        time_ns,
        valid,
        True,
        epoch_ns + _end(sweep),
        intensity="reflectivity",
        ring="line",
    )


def _end(sweep: Sweep) -> int:
    return int(sweep.time_ns[-1, -1])


_ENCODERS: dict[Layout, Callable[[Sweep, Lidar, int], Cloud]] = {
    "velodyne": _velodyne,
    "ouster": _ouster,
    "hesai": _hesai,
    "livox": _livox,
}
