"""From one message's points to a Scan: masked once, timed once; and a sequence of scans that may live on disk."""

from __future__ import annotations

import math
import mmap
import tempfile
import threading
import weakref
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import IO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib_core.readers.clouds.cloud import RawCloud, StructArray, points_mark
from calib_core.readers.timing.point_time import PointTiming
from calib_core.readers.timing.split_time import is_split
from calib_core.readers.timing.time_fields import raw_times
from calib_core.types import POINT_DTYPE, BoolArray, Float32Array, FloatArray, KeptScans, PointArray, Scan

#: Scans are kept in memory up to here, then all of them go to a file.
MEMORY_BYTES = 96 * (1 << 20)
#: So much of the file is read before its pages are given back: they stay in the system's cache, but count as nobody's.
_MAPPED_BYTES = 96 * (1 << 20)
_INTENSITY_NAMES = ("intensity", "i", "reflectivity", "signal")
RING_NAMES = ("ring", "channel", "line", "laser_id", "layer", "line_index")


@dataclass(frozen=True, slots=True)
class ScanCounts:
    """Why points were left out of one scan."""

    sent: int
    no_return: int
    out_of_time: int


class _Scratch(threading.local):
    """One thread's columns, used again for every scan: fresh memory of this size costs more than what is done in it."""

    def __init__(self) -> None:
        self._size = -1  # a thread's first cloud may be one without a point

    def columns(self, n_points: int) -> _Columns:
        """Columns of n_points; what they hold is of an earlier scan."""
        if n_points > self._size:
            self._size = n_points
            self._floats = np.empty((4, n_points), np.float32)
            self._times_ns = np.empty(n_points, np.float64)
            self._ring = np.empty(n_points, np.uint16)
        x, y, z, intensity = self._floats[:, :n_points]
        return _Columns(x, y, z, intensity, self._ring[:n_points], self._times_ns[:n_points])


class _Columns(NamedTuple):
    x: Float32Array
    y: Float32Array
    z: Float32Array
    intensity: Float32Array
    ring: NDArray[np.uint16]
    times_ns: FloatArray


_scratch = _Scratch()

#: After so long clocks of points begin anew, beside those that count in 32 bits: that of nanoseconds does so every 4.3 s.
#: A header is so near to its points.
_ROUNDS_NS = (3_600_000_000_000, 86_400_000_000_000, 604_800_000_000_000)
_LEAST_ROUND_NS, _AT_HEADER_NS = 3_000_000_000, 1_000_000_000


def _relative_ns(points: StructArray, timing: PointTiming, header_ns: int, out_ns: FloatArray) -> int:
    """Fills out_ns (N,) with times from a base, exact to the field's own resolution; that base as integer ns."""
    scale = timing.ns_per_unit
    if timing.reference != "absolute":
        values = raw_times(points, timing.field) if is_split(timing.field, points) else points[timing.field]
        np.multiply(values, scale, out=out_ns, dtype=np.float64)
        return header_ns
    values = raw_times(points, timing.field)
    sparse = values[:: max(1, values.size // 256)]
    sparse = np.sort(sparse[np.isfinite(sparse) & (sparse != 0)])
    # The window is around the scan's own middle. Subtract before changing the unit: near numbers differ exactly.
    middle = sparse[sparse.size // 2] if sparse.size else values.dtype.type(0)
    whole = math.floor(middle)
    np.multiply(values - middle, scale, out=out_ns, dtype=np.float64)
    return whole * int(scale) + round(float(middle - whole) * scale)


@dataclass(frozen=True, slots=True)
class Selection:
    """The points of a cloud that count. keep: (N,) which of the cloud's points.   points: (K,) POINT_DTYPE, those kept.

    stamp_ns: the first kept point's time, lidar clock; 0 where none is kept.
    """

    keep: BoolArray
    points: PointArray
    stamp_ns: int
    counts: ScanCounts

    def scan(self, index: int) -> Scan | None:
        """The kept points as a scan; None where there are none."""
        return Scan(index, self.stamp_ns, self.points) if self.points.size else None


@np.errstate(invalid="ignore", over="ignore")  # damaged floats are masked, not warned of
def select_points(cloud: RawCloud, timing: PointTiming, range_min_m: float, range_max_m: float) -> Selection:
    """The returns inside the range whose time lies inside the sweep: the one place where points are masked."""
    # Here and not above: a recording is opened, and looked at first, while numba is imported.
    from calib_core.readers.clouds.kernels import mark_valid, pack_points

    points = cloud.points
    columns = _scratch.columns(points.size)
    for column, axis in zip((columns.x, columns.y, columns.z), "xyz", strict=True):
        np.copyto(column, points[axis], casting="unsafe")
    base_ns = _relative_ns(points, timing, cloud.header_ns, columns.times_ns)
    nearest_m2 = max(np.float32(range_min_m) ** 2, np.finfo(np.float32).tiny)
    keep = np.empty(points.size, bool)
    n_returned, n_kept, first_ns = mark_valid(
        columns.x,
        columns.y,
        columns.z,
        columns.times_ns,
        (np.float32(nearest_m2), np.float32(range_max_m) ** 2),
        (timing.low_ns, timing.high_ns),
        keep,
    )
    counts = ScanCounts(points.size, points.size - n_returned, n_returned - n_kept)
    out = np.empty(n_kept, POINT_DTYPE)
    if n_kept == 0:
        return Selection(keep, out, 0, counts)
    np.copyto(columns.intensity, _optional(points, _INTENSITY_NAMES), casting="unsafe")
    laser = _optional(points, RING_NAMES) if cloud.laser is None else cloud.laser
    np.copyto(columns.ring, laser, casting="unsafe")
    words = (out.view(np.float32), out.view(np.int32))
    pack_points(
        columns.x, columns.y, columns.z, columns.intensity, columns.ring, columns.times_ns, first_ns, keep, *words
    )
    stamp_ns = unwound_ns(base_ns + timing.shift_ns + int(first_ns), cloud.header_ns, timing)
    return Selection(keep, out, stamp_ns, counts)


def unwound_ns(stamp_ns: int, header_ns: int, timing: PointTiming) -> int:
    """A scan's time where its points' clock, which one constant has brought into the headers' epoch, has begun anew meanwhile:
    as counters of 32 bits do, and those of an hour, a day, a GPS week.
    """
    if timing.reference != "absolute" or not timing.shift_ns or abs(stamp_ns - header_ns) < _LEAST_ROUND_NS:
        return stamp_ns
    away_ns = stamp_ns - header_ns
    for round_ns in ((1 << 32) * int(timing.ns_per_unit), *_ROUNDS_NS):
        rounds = round(away_ns / round_ns)
        if rounds and abs(away_ns - rounds * round_ns) < _AT_HEADER_NS:
            return stamp_ns - rounds * round_ns
    return stamp_ns


def make_scan(
    cloud: RawCloud, index: int, timing: PointTiming, range_min_m: float, range_max_m: float
) -> tuple[Scan | None, ScanCounts]:
    """The scan's valid points with their own times, None where no point is left; and what was left out."""
    selection = select_points(cloud, timing, range_min_m, range_max_m)
    return selection.scan(index), selection.counts


def load_loops() -> None:
    """Load what `select_points` has compiled: its first call takes a quarter of a second longer than any other."""
    point = np.zeros(1, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("time", "f4")])
    point["x"] = 1.0
    timing = PointTiming("time", "s", "header-first", 0.0, 1.0)
    make_scan(RawCloud(0, 0, "", point, 1, 1), 0, timing, 0.0, 2.0)


def _optional(points: StructArray, names: Sequence[str]) -> NDArray[np.generic] | int:
    known = points.dtype.names or ()
    name = next((name for name in names if name in known and points.dtype[name].shape == ()), None)
    return 0 if name is None else points[name]


def _octets(points: PointArray) -> memoryview:
    """The records' own bytes, not copied."""
    return np.ascontiguousarray(points).view(np.uint8).data


class _Entry(NamedTuple):
    """A scan of StoredScans. span_ns: from its first point to its last.   first: of its points among all, in the order they were
    written in.   mark: of its points.
    """

    message: int
    stamp_ns: int
    span_ns: int
    first: int
    n_points: int
    mark: int


class Written(NamedTuple):
    """A scan whose points are kept already. points: of one in memory."""

    entry: _Entry
    points: PointArray | None = None


class OrderCounts(NamedTuple):
    """Clouds that came after later ones; that were sent twice; that bear the stamp of another one with other points."""

    moved: int
    twice: int
    unlike: int


def once_a_stamp(stamps_ns: Sequence[int], marks: Sequence[int]) -> tuple[list[int], list[int], list[int]]:
    """Places in the order of their stamps, of one stamp the first; of the rest, those with its points, and those with others."""
    kept: list[int] = []
    twice: list[int] = []
    unlike: list[int] = []
    for k in sorted(range(len(stamps_ns)), key=stamps_ns.__getitem__):
        if not kept or stamps_ns[k] != stamps_ns[kept[-1]]:
            kept.append(k)
        elif marks[k] == marks[kept[-1]]:
            twice.append(k)
        else:
            unlike.append(k)
    return kept, twice, unlike


class StoredScans(KeptScans):
    """Scans in order, in memory while they are few, in an unnamed temporary file beyond MEMORY_BYTES.

    Items lie in the file's own pages, mapped and not copied, and are not to be written to; few of these pages are held
    at once, so that memory stays flat however long the recording is. The file vanishes with the object and the last of its scans.
    Threads may read at once.
    """

    def __init__(self, memory_bytes: int = MEMORY_BYTES) -> None:
        self._memory_bytes = memory_bytes
        self._index: list[_Entry] = []
        self._arrays: list[PointArray] = []
        self._writing = threading.Lock()
        self._file: IO[bytes] | None = None
        self._map: mmap.mmap | None = None
        self._read_bytes = 0
        self._n_points = 0

    @staticmethod
    def sized(n_points: int) -> StoredScans:
        """For about so many points: those that will go to the file do so from the first on, and are never in memory."""
        return StoredScans(0 if n_points * POINT_DTYPE.itemsize > MEMORY_BYTES else MEMORY_BYTES)

    def append(self, scan: Scan) -> None:
        """Add a scan at the end."""
        self.add(self.write(scan))

    def write(self, scan: Scan) -> Written:
        """Put a scan's points where they will stay, whatever its place among the scans; any thread may."""
        mark, span_ns = points_mark(scan.points), int(scan.points["offset_ns"].max())
        with self._writing:
            entry = _Entry(scan.index, scan.stamp_ns, span_ns, self._n_points, scan.points.size, mark)
            self._n_points += scan.points.size
            if self._file is None and self._n_points * POINT_DTYPE.itemsize <= self._memory_bytes:
                return Written(entry, scan.points)
            self._write_at(entry.first, scan.points)
        return Written(entry)

    def add(self, written: Written) -> None:
        """Add a scan, written before, at the end."""
        if self._file is None and written.points is not None:
            self._arrays.append(written.points)
        else:
            self._empty_memory()
            if written.points is not None:  # another one, later in order, was the first for which there was no room
                with self._writing:
                    self._write_at(written.entry.first, written.points)
        self._index.append(written.entry)

    def _empty_memory(self) -> None:
        with self._writing:
            for entry, points in zip(self._index, self._arrays, strict=False):  # the first scans of all, or none
                self._write_at(entry.first, points)
        self._arrays.clear()

    def _write_at(self, first: int, points: PointArray) -> None:
        if self._file is None:
            self._file = tempfile.TemporaryFile(prefix="unsweep-scans-")  # noqa: SIM115 - lives as long as the scans
            weakref.finalize(self, self._file.close)
        self._file.seek(first * POINT_DTYPE.itemsize)
        self._file.write(_octets(points))

    def without(self, positions: Collection[int]) -> None:
        """Drop the scans at these positions."""
        dropped = set(positions)
        self._arrays = [a for k, a in enumerate(self._arrays) if k not in dropped]
        self._index = [e for k, e in enumerate(self._index) if k not in dropped]

    def put_in_order(self) -> OrderCounts:
        """Sort by stamp, of one stamp keep the first. Returns how many came after later ones, and how many were dropped."""
        stamps_ns = self.stamps_ns
        n_moved = sum(stamp < latest for stamp, latest in zip(stamps_ns, accumulate(stamps_ns, max), strict=True))
        kept, twice, unlike = once_a_stamp(stamps_ns, [entry.mark for entry in self._index])
        self._index = [self._index[k] for k in kept]
        if self._arrays:
            self._arrays = [self._arrays[k] for k in kept]
        return OrderCounts(n_moved, len(twice), len(unlike))

    def finish(self) -> StoredScans:
        """Itself, ready to be read."""
        if self._file is not None:
            self._empty_memory()
            self._file.flush()
            self._map = mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ)
        return self

    @property
    def n_points(self) -> int:
        """Points of all scans."""
        return self._n_points

    @property
    def stamps_ns(self) -> list[int]:
        """Each scan's stamp, without reading its points."""
        return [entry.stamp_ns for entry in self._index]

    @property
    def ends_ns(self) -> list[int]:
        """When each scan's last point was, lidar clock."""
        return [entry.stamp_ns + entry.span_ns for entry in self._index]

    @property
    def message_indices(self) -> list[int]:
        """Which message of its topic each scan is."""
        return [entry.message for entry in self._index]

    def __len__(self) -> int:
        return len(self._index)

    def scan_at(self, place: int) -> Scan:
        """The scan at a place from 0 on."""
        entry = self._index[place]
        index, stamp_ns, first, count = entry.message, entry.stamp_ns, entry.first, entry.n_points
        if self._map is None:
            return Scan(index, stamp_ns, self._arrays[place])
        self._heed_pages(count * POINT_DTYPE.itemsize)
        return Scan(index, stamp_ns, np.frombuffer(self._map, POINT_DTYPE, count, first * POINT_DTYPE.itemsize))

    def _heed_pages(self, n_bytes: int) -> None:
        """Give back what was read long ago: whoever still reads there gets it from the system's cache."""
        self._read_bytes += n_bytes
        if self._read_bytes > _MAPPED_BYTES:
            self._read_bytes = 0
            if self._map is not None and hasattr(mmap, "MADV_DONTNEED"):  # not on Windows
                self._map.madvise(mmap.MADV_DONTNEED)

    def __iter__(self) -> Iterator[Scan]:
        return (self[i] for i in range(len(self)))
