"""From one message's points to a Scan: masked once, timed once; and a sequence of scans that may live on disk."""

from __future__ import annotations

import math
import os
import tempfile
import weakref
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import IO, overload

import numpy as np
from numpy.typing import NDArray

from calib_core.readers.cloud import RawCloud, StructArray
from calib_core.readers.point_time import PointTiming, raw_times
from calib_core.types import POINT_DTYPE, BoolArray, Float32Array, FloatArray, PointArray, Scan

#: Scans are kept in memory up to here, then all of them go to a file.
MEMORY_BYTES = 256 * (1 << 20)
_INTENSITY_NAMES = ("intensity", "i", "reflectivity", "signal")
_RING_NAMES = ("ring", "channel", "line", "laser_id", "layer", "line_index")


@dataclass(frozen=True, slots=True)
class ScanCounts:
    """Why points were left out of one scan."""

    sent: int
    no_return: int
    out_of_time: int


def _relative_ns(points: StructArray, timing: PointTiming, header_ns: int) -> tuple[FloatArray, int]:
    """Times as (N,) float64 ns from a base, and that base as integer ns; exact to the field's own resolution."""
    values = raw_times(points, timing.field)
    scale = timing.ns_per_unit
    if timing.reference != "absolute":
        return np.multiply(values, scale, dtype=np.float64), header_ns
    sparse = values[:: max(1, values.size // 256)]
    sparse = np.sort(sparse[np.isfinite(sparse) & (sparse != 0)])
    # The window is around the scan's own middle. Subtract before changing the unit: near numbers differ exactly.
    middle = sparse[sparse.size // 2] if sparse.size else values.dtype.type(0)
    whole = math.floor(middle)
    base_ns = whole * int(scale) + round(float(middle - whole) * scale)
    return np.multiply(values - middle, scale, dtype=np.float64), base_ns


@dataclass(frozen=True, slots=True)
class Selection:
    """The points of a cloud that count. keep: (N,) over the cloud's points.   axes: x, y, z, (N,) each, and times_ns:
    (N,) of all of them, the times counted from base_ns.   n_kept: how many count.
    """

    keep: BoolArray
    n_kept: int
    axes: tuple[Float32Array, Float32Array, Float32Array]
    times_ns: FloatArray
    base_ns: int
    counts: ScanCounts


@np.errstate(invalid="ignore", over="ignore")  # damaged floats are masked, not warned of
def select_points(cloud: RawCloud, timing: PointTiming, range_min_m: float, range_max_m: float) -> Selection:
    """The returns inside the range whose time lies inside the sweep: the one place where points are masked."""
    points = cloud.points
    x, y, z = (points[axis].astype(np.float32) for axis in "xyz")
    squared = x * x
    squared += y * y
    squared += z * z
    keep: BoolArray = squared >= max(np.float32(range_min_m) ** 2, np.finfo(np.float32).tiny)
    keep &= squared <= np.float32(range_max_m) ** 2
    n_returned = int(np.count_nonzero(keep))
    times_ns, base_ns = _relative_ns(points, timing, cloud.header_ns)
    keep &= times_ns >= timing.low_ns
    keep &= times_ns <= timing.high_ns
    n_kept = int(np.count_nonzero(keep))
    counts = ScanCounts(points.size, points.size - n_returned, n_returned - n_kept)
    return Selection(keep, n_kept, (x, y, z), times_ns, base_ns + timing.shift_ns, counts)


@np.errstate(invalid="ignore", over="ignore")
def scan_of(cloud: RawCloud, index: int, selection: Selection) -> Scan | None:
    """The scan of the selected points; None where there are none."""
    if selection.n_kept == 0:
        return None
    keep = slice(None) if selection.n_kept == cloud.points.size else selection.keep
    times_ns, points = selection.times_ns[keep], cloud.points[keep]
    first_ns = float(np.rint(times_ns.min()))
    out = np.empty(selection.n_kept, POINT_DTYPE)
    for column, axis in enumerate(selection.axes):
        out["xyz"][:, column] = axis[keep]
    out["offset_ns"] = np.rint(times_ns) - first_ns
    out["intensity"] = _optional(points, _INTENSITY_NAMES)
    out["ring"] = _optional(points, _RING_NAMES)
    out["reserved"] = 0
    return Scan(index, selection.base_ns + int(first_ns), out)


def make_scan(
    cloud: RawCloud, index: int, timing: PointTiming, range_min_m: float, range_max_m: float
) -> tuple[Scan | None, ScanCounts]:
    """The scan's valid points with their own times, None where no point is left; and what was left out."""
    selection = select_points(cloud, timing, range_min_m, range_max_m)
    return scan_of(cloud, index, selection), selection.counts


def _optional(points: StructArray, names: Sequence[str]) -> NDArray[np.generic] | int:
    known = points.dtype.names or ()
    name = next((name for name in names if name in known and points.dtype[name].shape == ()), None)
    return 0 if name is None else points[name]


class StoredScans(Sequence[Scan]):
    """Scans in order, in memory while they are few, in an unnamed temporary file beyond MEMORY_BYTES.

    Items read from the file are copies: memory stays flat however long the recording is. The file vanishes with the
    object. Threads may read at once.
    """

    def __init__(self, memory_bytes: int = MEMORY_BYTES) -> None:
        self._memory_bytes = memory_bytes
        self._index: list[tuple[int, int, int, int]] = []  # message index, stamp_ns, first point, number of points
        self._arrays: list[PointArray] = []
        self._file: IO[bytes] | None = None
        self._n_points = 0

    def append(self, scan: Scan) -> None:
        """Add a scan at the end."""
        self._index.append((scan.index, scan.stamp_ns, self._n_points, scan.points.size))
        self._n_points += scan.points.size
        if self._file is not None:
            self._file.write(scan.points.tobytes())
            return
        self._arrays.append(scan.points)
        if self._n_points * POINT_DTYPE.itemsize > self._memory_bytes:
            self._file = tempfile.TemporaryFile(prefix="unsweep-scans-")  # noqa: SIM115 - lives as long as the scans
            weakref.finalize(self, self._file.close)
            for array in self._arrays:
                self._file.write(array.tobytes())
            self._arrays.clear()

    def without(self, positions: Collection[int]) -> None:
        """Drop the scans at these positions."""
        dropped = set(positions)
        self._arrays = [a for k, a in enumerate(self._arrays) if k not in dropped]
        self._index = [e for k, e in enumerate(self._index) if k not in dropped]

    def finish(self) -> StoredScans:
        """Itself, ready to be read."""
        if self._file is not None:
            self._file.flush()
        return self

    @property
    def n_points(self) -> int:
        """Points of all scans."""
        return self._n_points

    @property
    def stamps_ns(self) -> list[int]:
        """Each scan's stamp, without reading its points."""
        return [entry[1] for entry in self._index]

    def __len__(self) -> int:
        return len(self._index)

    @overload
    def __getitem__(self, item: int) -> Scan: ...
    @overload
    def __getitem__(self, item: slice) -> list[Scan]: ...
    def __getitem__(self, item: int | slice) -> Scan | list[Scan]:
        if isinstance(item, slice):
            return [self[i] for i in range(*item.indices(len(self)))]
        position = item + len(self) if item < 0 else item
        if not 0 <= position < len(self):
            raise IndexError(f"scan {item} of {len(self)}")
        index, stamp_ns, first, count = self._index[position]
        if self._file is None:
            return Scan(index, stamp_ns, self._arrays[position])
        size = POINT_DTYPE.itemsize
        stored = os.pread(self._file.fileno(), count * size, first * size)
        return Scan(index, stamp_ns, np.frombuffer(stored, POINT_DTYPE))

    def __iter__(self) -> Iterator[Scan]:
        return (self[i] for i in range(len(self)))
