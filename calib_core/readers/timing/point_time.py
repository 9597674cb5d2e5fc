"""Which field is the per-point time, in which unit, counted from what: scored hypotheses over a sample of scans.

Every numeric field that is not known to mean something else is a candidate. A candidate's spread within a scan (1 to
99 % quantiles of valid points) must be close to the scan period in one of four units; the units are a factor of 1000
apart, so the nearest wins clearly. Its change from scan to scan says what it counts from: a period per scan is
absolute, none is relative to the header; then values from zero up mean that the header is the first point's time,
values up to zero the last point's. Nothing is taken from a name alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib_core.errors import PointTimeError
from calib_core.readers.clouds.cloud import RawCloud, StructArray
from calib_core.readers.timing.point_window import reference_shift, sweep_edges
from calib_core.readers.timing.split_time import is_split, joined_ns, parts, split_times
from calib_core.settings import ReadSettings
from calib_core.threads import workers
from calib_core.types import Clue, Finding, FloatArray, IntArray

Unit = Literal["s", "ms", "us", "ns"]
Reference = Literal["header-first", "header-last", "absolute"]
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
#: Less sure than this, a reading is a warning.
_SURE = 0.5
#: Below this share of forward steps a field is no clock but some quantity that merely has a fitting spread.
_MIN_ORDER = 0.6
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
class PointTiming:
    """How a scan's point times are computed.

    low_ns, high_ns: allowed times relative to the header (relative) or to the scan's own median (absolute); points
    outside are garbage.   shift_ns: added to every time.
    """

    field: str
    unit: Unit
    reference: Reference
    low_ns: float
    high_ns: float
    shift_ns: int = 0

    @property
    def ns_per_unit(self) -> float:
        """Nanoseconds of one unit of the field."""
        return NS_PER_UNIT[self.unit]


@dataclass(frozen=True, slots=True)
class _FieldSample:
    """A candidate over the sampled scans. q01, q99: (K,) quantiles per scan.   order: share of forward steps."""

    name: str
    q01: FloatArray
    q99: FloatArray
    order: float
    named: bool


@dataclass(frozen=True, slots=True)
class _Hypothesis:
    """ratio: span within a scan over the time between scans.   drift: change from scan to scan over that time.   fit, order,
    clock: 0 to 1, how well span, order of the points and drift are those of a time."""

    sample: _FieldSample
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


def _candidates(clouds: Sequence[RawCloud], settings: ReadSettings) -> list[str]:
    dtype = clouds[0].points.dtype
    scalars = [n for n in clouds[0].names if dtype[n].kind in "iuf" and dtype[n].shape == ()]
    split = split_times(clouds[0].points)
    if settings.point_time_field is not None:
        return [n for n in (*scalars, *split) if n == settings.point_time_field]
    half = {part for field in split for part in parts(field)}
    names = [n for n in scalars if n.lower() not in _OTHER_NAMES and n not in half and dtype[n].itemsize >= 2]
    return names + split


def _returns(points: StructArray) -> IntArray:
    """Points with a return: finite and not at the origin."""
    with np.errstate(
        invalid="ignore", over="ignore"
    ):  # damaged floats are masked, not warned of; a thread has its own state
        x, y, z = (points[axis].astype(np.float64) for axis in "xyz")
        return np.flatnonzero(np.isfinite(x + y + z) & ((x != 0) | (y != 0) | (z != 0)))


def _sample_field(clouds: Sequence[RawCloud], returns: Sequence[IntArray], name: str) -> _FieldSample:
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
    return _FieldSample(name, q01, q99, int(forward.sum()) / int(steps.sum()) if steps.any() else 0.0, named)


def _says_time(name: str) -> bool:
    """Whether a field is called a time, in whatever words beside."""
    return any(word in name.lower() for word in ("time", "stamp"))


def _part_of_a_turn(clouds: Sequence[RawCloud], returns: Sequence[IntArray]) -> float:
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


def _hypotheses(
    sample: _FieldSample,
    period_s: float,
    header_ns: IntArray,
    units: Sequence[Unit],
    *,
    covered: float,
    asked: bool,
) -> list[_Hypothesis]:
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
        found.append(_Hypothesis(sample, unit, ratio, drift, fit, order, clock))
    return sorted(found, key=lambda h: -h.score)


def scan_period_s(clouds: Sequence[RawCloud]) -> float:
    """Median time between scans by their headers, by receive times where those stand still; 0.1 s for one scan."""
    for stamps in ([c.header_ns for c in clouds], [c.receive_ns for c in clouds]):
        steps = np.diff(np.array(stamps, np.int64))
        steps = steps[steps > 0]
        if steps.size:
            return float(np.median(steps)) * 1e-9
    return 0.1


@np.errstate(invalid="ignore", over="ignore")  # damaged floats are masked, not warned of
def detect_point_time(
    clouds: Sequence[RawCloud], settings: ReadSettings, *, topic: str, help_text: str = ""
) -> tuple[PointTiming, tuple[Finding, ...]]:
    """The timing of the clouds of `topic` and the evidence for it. Raises PointTimeError with one sentence."""
    usable = [cloud for cloud in clouds if cloud.points.size]
    if not usable:
        raise PointTimeError(
            f"The first clouds on {topic} are all empty; check the sensor, or start later with --start-s."
        )
    names = _candidates(usable, settings)
    listed = ", ".join(usable[0].names)
    if not names:
        wanted = f"no field {settings.point_time_field!r}" if settings.point_time_field else "no per-point time"
        raise PointTimeError(
            f"The clouds on {topic} carry {wanted} (fields: {listed});"
            f" {help_text or 'record with a driver setting that keeps it'},"
            " or pass --synthesise-point-time, or --points-at-once for a lidar that takes them all at once."
        )
    # The first scan of a recording may be cut or hold leftovers of the sensor's start.
    sampled = usable[1:] if len(usable) > 3 else usable
    returns = list(workers().map(_returns, [cloud.points for cloud in sampled]))
    samples = [_sample_field(sampled, returns, name) for name in names]
    period_s = scan_period_s(sampled)
    units: tuple[Unit, ...] = (
        ("s", "ms", "us", "ns") if settings.point_time_unit is None else (settings.point_time_unit,)
    )
    forced = settings.point_time_field is not None
    covered = _part_of_a_turn(sampled, returns)
    header_ns = np.array([cloud.header_ns for cloud in sampled], np.int64)
    found = [
        h
        for sample in samples
        if forced or sample.order >= _MIN_ORDER or (sample.named and sample.order > 0)
        for h in _hypotheses(sample, period_s, header_ns, units, covered=covered, asked=forced)
    ]
    found.sort(key=lambda h: -h.score)
    if not found:
        raise PointTimeError(_no_hypothesis_text(topic, samples, period_s, help_text, settings.point_time_unit))
    return _timing(found, sampled, returns, period_s, settings, topic)


def _no_hypothesis_text(
    topic: str, samples: Sequence[_FieldSample], period_s: float, help_text: str, unit: Unit | None
) -> str:
    """unit: the one that was asked for; None for any."""
    named = next((s for s in samples if s.named), samples[0])
    spread = float(np.nanmedian(named.q99 - named.q01)) if np.isfinite(named.q01).any() else 0.0
    if spread == 0.0:
        what = f"field {named.name!r} is the same for all points of a scan"
    else:
        asked = "s, ms, us or ns" if unit is None else f"{unit}, as asked"
        what = f"field {named.name!r} spreads over {spread:g}, which is no scan of {period_s:.3f} s in {asked}"
    if unit is None:
        advice = help_text or "name the right field with --point-time-field and --point-time-unit"
    else:
        advice = f"leave --point-time-unit {unit} out, or name another field with --point-time-field"
    instant = ", or --points-at-once for a lidar that takes them all at once" if spread == 0.0 else ""
    made = "or pass --synthesise-point-time"
    return f"The clouds on {topic} carry no usable per-point time: {what}; {advice}, {made}{instant}."


def _timing(
    found: Sequence[_Hypothesis],
    clouds: Sequence[RawCloud],
    returns: Sequence[IntArray],
    period_s: float,
    settings: ReadSettings,
    topic: str,
) -> tuple[PointTiming, tuple[Finding, ...]]:
    best = found[0]
    runner_up = found[1].score if len(found) > 1 else 0.0
    scale = NS_PER_UNIT[best.unit]
    low = best.sample.q01 * scale
    high = best.sample.q99 * scale
    absolute = abs(best.drift - 1.0) < abs(best.drift)
    if np.isfinite(low).sum() < 2:  # one scan shows no drift: judge by magnitude
        absolute = abs(float(np.nanmedian(low))) > 100e9 * max(period_s, 0.01)
    natural: Reference = "absolute"
    if not absolute:
        natural = "header-last" if abs(np.nanmedian(high)) < abs(np.nanmedian(low)) else "header-first"
    reference = settings.point_time_reference or natural
    if reference == "absolute" and not absolute:
        raise PointTimeError(
            f"The point times on {topic} (field {best.sample.name!r}) begin anew with every scan, so they cannot be"
            " absolute; leave --point-time-reference out, or give header-first or header-last."
        )
    values = [raw_times(cloud.points, best.sample.name)[rows] for cloud, rows in zip(clouds, returns, strict=True)]
    edges = sweep_edges(clouds, values, scale, (low, high), period_s=period_s, absolute=absolute)
    shift_ns, extra = reference_shift(edges, settings.point_time_reference, own_clock=settings.stamps == "header")
    timing = PointTiming(best.sample.name, best.unit, "absolute" if absolute else reference, *edges.window_ns, shift_ns)
    begin_ns, end_ns = (time_ns + shift_ns for time_ns in edges.after_header_ns())
    confidence = max(0.0, min(1.0, best.score - 0.5 * runner_up * (found[-1] is not best)))
    if len(clouds) < 49:
        confidence = min(confidence, 0.5 + len(clouds) / 100)
    evidence = (
        Clue("scans examined", len(clouds)),
        Clue("robust span over scan period", round(best.ratio, 3)),
        Clue("change per scan over scan period", round(best.drift, 3)),
        Clue("share of forward steps", round(best.sample.order, 3)),
        Clue("score", round(best.score, 3)),
        Clue("next best score", round(runner_up, 3)),
        Clue("first point after header", round(begin_ns * 1e-9, 6), "s"),
        Clue("last point after header", round(end_ns * 1e-9, 6), "s"),
    )
    amid = reference != "absolute" and min(-begin_ns, end_ns) > _AMID * period_s * 1e9
    counted = "counted from the header, which is amid the sweep" if amid else _REFERENCE_TEXT[reference]
    text = f"Point times on {topic} are field {best.sample.name!r} in {best.unit}, {counted}."
    if confidence < _SURE:
        text += f" It is not sure: {_doubt(best, runner_up, len(clouds))}."
    finding = Finding(
        code="points.time_field",
        level="info" if confidence >= _SURE else "warning",
        text=text,
        evidence=evidence,
        confidence=round(confidence, 3),
        consequence="every point is placed at its own instant of the sweep with these times",
        override=f"--point-time-field {best.sample.name} --point-time-unit {best.unit}"
        f" --point-time-reference {reference}",
    )
    return timing, (finding, *extra)


def _doubt(best: _Hypothesis, runner_up: float, scans: int) -> str:
    """What speaks against the best hypothesis the most."""
    doubts = [
        (best.fit, f"it spans {best.ratio:.2f} of the time from scan to scan"),
        (best.order, f"only {best.sample.order:.0%} of its steps go forward"),
        (best.clock, f"it gains {best.drift:.2f} periods a scan, where a clock gains 0 or 1"),
        (1.0 - 0.5 * runner_up, "another reading of the fields fits nearly as well"),
        (0.5 + scans / 100, f"{scans} scans tell little"),
    ]
    return min(doubts)[1]


def last_point_after_header_s(findings: Sequence[Finding]) -> float:
    """The sweep's end after the header, from the evidence of `detect_point_time`; 0 where times were made up."""
    for finding in findings:
        if finding.code == "points.time_field":
            return next((float(e.value) for e in finding.evidence if e.name == "last point after header"), 0.0)
    return 0.0


#: A header so much of a period after the first point and before the last is neither's.
_AMID = 0.2
_REFERENCE_TEXT: dict[Reference, str] = {
    "header-first": "counted from the header, which is the first point's time",
    "header-last": "counted from the header, which is the last point's time",
    "absolute": "absolute",
}
