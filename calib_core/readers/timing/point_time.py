"""Which field is the per-point time, in which unit, counted from what: scored hypotheses over a sample of scans.

Every numeric field that is not known to mean something else is a candidate. A candidate's spread within a scan (1 to
99 % quantiles of valid points) must be close to the scan period in one of four units; the units are a factor of 1000
apart, so the nearest wins clearly. Its change from scan to scan says what it counts from: a period per scan is
absolute, none is relative to the header; then values from zero up mean that the header is the first point's time,
values up to zero the last point's. Nothing is taken from a name alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib_core.errors import PointTimeError
from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.timing.point_window import reference_shift, sweep_edges
from calib_core.readers.timing.time_fields import (
    MIN_ORDER,
    NS_PER_UNIT,
    FieldSample,
    Hypothesis,
    Unit,
    candidates,
    hypotheses,
    part_of_a_turn,
    raw_times,
    returns_of,
    sample_field,
)
from calib_core.settings import ReadSettings
from calib_core.threads import workers
from calib_core.types import Clue, Finding, IntArray

Reference = Literal["header-first", "header-last", "absolute"]


#: Less sure than this, a reading is a warning.
_SURE = 0.5


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
    names = candidates(usable, settings)
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
    returns = list(workers().map(returns_of, [cloud.points for cloud in sampled]))
    samples = [sample_field(sampled, returns, name) for name in names]
    period_s = scan_period_s(sampled)
    units: tuple[Unit, ...] = (
        ("s", "ms", "us", "ns") if settings.point_time_unit is None else (settings.point_time_unit,)
    )
    forced = settings.point_time_field is not None
    covered = part_of_a_turn(sampled, returns)
    header_ns = np.array([cloud.header_ns for cloud in sampled], np.int64)
    found = [
        h
        for sample in samples
        if forced or sample.order >= MIN_ORDER or (sample.named and sample.order > 0)
        for h in hypotheses(sample, period_s, header_ns, units, covered=covered, asked=forced)
    ]
    found.sort(key=lambda h: -h.score)
    if not found:
        raise PointTimeError(_no_hypothesis_text(topic, samples, period_s, help_text, settings.point_time_unit))
    return _timing(found, sampled, returns, period_s, settings, topic)


def _no_hypothesis_text(
    topic: str, samples: Sequence[FieldSample], period_s: float, help_text: str, unit: Unit | None
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
    found: Sequence[Hypothesis],
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


def _doubt(best: Hypothesis, runner_up: float, scans: int) -> str:
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
