"""Fields of a cloud that may be its points' times, and how well each is one in each unit.

What a time does is told from its values: it spreads over about a sweep, runs forward, and from scan to scan stands or gains what
the headers do. Nothing is taken from a name alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib_core.readers.clouds.cloud import RawCloud, StructArray
from calib_core.readers.timing.split_time import is_split, joined_ns, parts, split_times
from calib_core.settings import ReadSettings
from calib_core.threads import workers
from calib_core.types import FloatArray, IntArray

Unit = Literal["s", "ms", "us", "ns"]
NS_PER_UNIT: dict[Unit, float] = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0}

TIME_NAMES = frozenset(
    {"t", "ts", "time", "timestamp", "time_stamp", "timestamps", "offset_time", "time_offset", "time_offset_ns"}
    | {"timeoffset", "point_time", "stamp"}
)
_OTHER_NAMES = frozenset(
    {"x", "y", "z", "i", "intensity", "ring", "line", "tag", "channel", "azimuth", "elevation", "distance", "range"}
    | {"reflectivity", "reflector", "ambient", "signal", "near_ir", "noise", "rgb", "rgba", "label", "return_type"}
    | {"flags", "normal_x", "normal_y", "normal_z", "layer", "echo", "velocity", "scan_id", "scan_idx"}
    | {"is_2nd_return", "row", "column", "col", "laser_id"}
)
#: Below this share of forward steps a field is no clock but some quantity that merely has a fitting spread.
MIN_ORDER = 0.6
_RATIO_GOOD = (0.5, 1.15)
_RATIO_POSSIBLE = (0.05, 1.4)
#: A rotor that looks to one side only is done with that part of its turn: by its azimuths, so many bins a turn, within so much.
_BINS, _COVERED = 72, 0.1
#: So many clouds tell which part it is.
_COVERED_BY = 3
#: A field that gains so nearly as much as the headers do, and is within so many periods of them, is of their clock.
_SAME_CLOCK, _NEAR = 0.1, 2.0
#: Of a field that no name says to be a time: a running number, or a bearing, fits some unit at a tenth of a sweep as well.
_LEAST_UNNAMED = 0.8


@dataclass(frozen=True, slots=True)
class FieldSample:
    """A candidate over the sampled scans. q01, q99: (K,) quantiles per scan.   order: share of forward steps."""

    name: str
    q01: FloatArray
    q99: FloatArray
    order: float
    named: bool


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """ratio: span within a scan over the time between scans.   drift: change from scan to scan over that time.   fit, order,
    clock: 0 to 1, how well span, order of the points and drift are those of a time."""

    sample: FieldSample
    unit: Unit
    ratio: float
    drift: float
    fit: float
    order: float
    clock: float

    @property
    def score(self) -> float:
        """1 for a clock that runs through the sweep, from scan to scan, and is named as one."""
        return self.fit * self.order * self.clock * (1.0 if self.sample.named else 0.7)


def raw_times(points: StructArray, field: str) -> IntArray | FloatArray:
    """The field's values, (N,): float64 for float fields, int64 for integer fields, nothing rounded."""
    if is_split(field, points):
        return joined_ns(points, field)
    if points.dtype[field].kind == "f":
        return np.asarray(points[field], np.float64)
    return np.asarray(points[field], np.int64)


def candidates(clouds: Sequence[RawCloud], settings: ReadSettings) -> list[str]:
    """The fields that may be times: the one asked for, else every number that is not known to mean something else."""
    dtype = clouds[0].points.dtype
    scalars = [n for n in clouds[0].names if dtype[n].kind in "iuf" and dtype[n].shape == ()]
    split = split_times(clouds[0].points)
    if settings.point_time_field is not None:
        return [n for n in (*scalars, *split) if n == settings.point_time_field]
    half = {part for field in split for part in parts(field)}
    names = [n for n in scalars if n.lower() not in _OTHER_NAMES and n not in half and dtype[n].itemsize >= 2]
    return names + split


def returns_of(points: StructArray) -> IntArray:
    """Points with a return: finite and not at the origin."""
    with np.errstate(
        invalid="ignore", over="ignore"
    ):  # damaged floats are masked, not warned of; a thread has its own state
        x, y, z = (points[axis].astype(np.float64) for axis in "xyz")
        return np.flatnonzero(np.isfinite(x + y + z) & ((x != 0) | (y != 0) | (z != 0)))


def sample_field(clouds: Sequence[RawCloud], returns: Sequence[IntArray], name: str) -> FieldSample:
    """What a field's values are in each cloud, of the points with a return."""

    def one(cloud: RawCloud, rows: IntArray) -> tuple[float, float, int, int]:
        with np.errstate(invalid="ignore", over="ignore"):
            values = raw_times(cloud.points, name)[rows].astype(np.float64)
            values = values[np.isfinite(values)]
            if values.size < 2:
                return math.nan, math.nan, 0, 0
            low, high = np.quantile(values, (0.01, 0.99))
            step = np.diff(values)
        return float(low), float(high), int(np.count_nonzero(step > 0)), int(np.count_nonzero(step))

    q01, q99, forward, steps = (np.array(each) for each in zip(*workers().map(one, clouds, returns), strict=True))
    named = name.lower() in TIME_NAMES or is_split(name, clouds[0].points)
    return FieldSample(name, q01, q99, int(forward.sum()) / int(steps.sum()) if steps.any() else 0.0, named)


def _says_time(name: str) -> bool:
    """Whether a field is called a time, in whatever words beside."""
    return any(word in name.lower() for word in ("time", "stamp"))


def part_of_a_turn(clouds: Sequence[RawCloud], returns: Sequence[IntArray]) -> float:
    """How much of a turn the returns cover."""
    parts = []
    for cloud, rows in zip(clouds[:_COVERED_BY], returns, strict=False):
        x, y = (cloud.points[axis][rows].astype(np.float64) for axis in "xy")
        bins = ((np.arctan2(y, x) / (2.0 * np.pi) + 0.5) * _BINS).astype(np.int64) % _BINS
        parts.append(np.unique(bins).size / _BINS)
    return float(np.median(parts))


def _gain(values: FloatArray, header_ns: IntArray) -> float:
    """What a field gains a second of the headers', in its own unit: of each scan beside the first as far on by half of them.

    From a scan to the next a view that is cut may begin anywhere in the sweep.
    """
    half = len(values) // 2
    if half == 0:
        return 0.0
    apart_s = (header_ns[half:] - header_ns[: len(values) - half]) * 1e-9
    later = apart_s > 0.0
    gained = values[half:] - values[: len(values) - half]
    return float(np.median(gained[later] / apart_s[later])) if later.any() else 0.0


def hypotheses(
    sample: FieldSample,
    period_s: float,
    header_ns: IntArray,
    units: Sequence[Unit],
    *,
    covered: float,
    asked: bool,
) -> list[Hypothesis]:
    """One per unit whose spread is possible; best first. header_ns: (K,).   covered: of a turn.   asked: somebody has named the
    field."""
    good = np.isfinite(sample.q01)
    if np.count_nonzero(good) == 0:
        return []
    span = float(np.median(sample.q99[good] - sample.q01[good])) / 0.98
    steps = np.diff(sample.q01[good])
    step = float(np.median(steps)) if steps.size else 0.0
    gain = _gain(sample.q01[good], header_ns[good])
    found = []
    for unit in units:
        ratio = span * NS_PER_UNIT[unit] * 1e-9 / period_s
        least = _RATIO_POSSIBLE[0] if asked or sample.named or _says_time(sample.name) else _LEAST_UNNAMED
        if not least <= ratio <= _RATIO_POSSIBLE[1]:
            continue
        order = min(1.0, sample.order / 0.9)
        # A clock either stands (relative) or gains one period per scan (absolute); anything between is no clock.
        drift = min(
            (step * NS_PER_UNIT[unit] * 1e-9 / period_s, gain * NS_PER_UNIT[unit] * 1e-9),
            key=lambda each: min(abs(each), abs(each - 1.0)),
        )
        clock = math.exp(-8.0 * min(abs(drift), abs(drift - 1.0)))
        inside = _RATIO_GOOD[0] <= ratio <= _RATIO_GOOD[1] or abs(ratio - covered) <= _COVERED
        # Nanoseconds since 1970 that are the header's are that, whatever part of a sweep they span.
        from_header_ns = np.median(np.abs(sample.q01[good] * NS_PER_UNIT[unit] - header_ns[good]))
        is_headers = abs(drift - 1.0) < _SAME_CLOCK and from_header_ns < _NEAR * period_s * 1e9
        fit = 1.0 if inside or is_headers else 0.4
        found.append(Hypothesis(sample, unit, ratio, drift, fit, order, clock))
    return sorted(found, key=lambda h: -h.score)
