"""Point times made up where a cloud carries none: degraded, asked for explicitly, and labelled so.

A spinning lidar sweeps its azimuth evenly, so the azimuth since the sweep's first point is the time; which way it
turns is seen from the order of the points. Drivers cut sweeps at an azimuth, which stays, or after so many packets: then
each begins a little farther round than the one before, is a little more or less than a turn, and says so itself. Any
other lidar is taken to send its points in the order it took them. A flash lidar takes all of them at once: where that is
said, all times are that of the header.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calib_core.errors import PointTimeError
from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.clouds.decoders import CloudDecoder, restamped
from calib_core.readers.container.storage import RawMessage
from calib_core.readers.timing.point_time import PointTiming, detect_point_time, scan_period_s
from calib_core.readers.timing.stamps import never_set, unset_finding
from calib_core.settings import ReadSettings
from calib_core.types import Clue, Finding, FloatArray

#: A sweep that covers this much of the circle is a spinning lidar's.
_SPINNING_RAD = np.deg2rad(300.0)
#: Sweeps that are cut at an azimuth begin there to a column; so far over those looked at, and their beginning moves.
_MOVING_RAD = np.deg2rad(1.5)
#: A message's order tells how far through the sweep a point was taken if that many points lie within a quarter of a turn of
#: where their azimuth has them; a senseless order has half of them there.
_TOLD_SHARE = 0.9
FIELD = "time"

Order = Literal["taken", "rows", "rings", "none"]


@dataclass(frozen=True, slots=True)
class Synthesis:
    """How times are made: direction +1 for growing azimuth, -1 for falling; turned_rad by the head in a period.

    start_rad: where every sweep begins, None where each begins at its own first point.   order: what of a message's order
    goes with the time: the whole, that within each row of an organised cloud, that within each ring, or nothing.
    """

    kind: Literal["azimuth", "order", "at once"]
    period_s: float
    direction: int = 1
    start_rad: float | None = 0.0
    turned_rad: float = 2 * np.pi
    order: Order = "none"


@np.errstate(invalid="ignore")
def plan_synthesis(clouds: Sequence[RawCloud]) -> Synthesis:
    """The rule for the clouds of one topic, from the first of them, in their order."""
    period_s = scan_period_s(clouds)
    turns: list[float] = []
    starts: list[float] = []
    covered: list[float] = []
    seen: list[RawCloud] = []
    for cloud in clouds[1:] if len(clouds) > 3 else clouds:
        azimuth = _azimuth(cloud)
        azimuth = azimuth[np.isfinite(azimuth)]
        if azimuth.size < 10:
            continue
        steps = _wrapped(np.diff(azimuth))
        small = steps[(steps != 0) & (np.abs(steps) < np.deg2rad(20))]
        turns.append(float(np.median(np.sign(small))) if small.size else 0.0)
        starts.append(float(azimuth[0]))
        covered.append(float(np.count_nonzero(np.histogram(azimuth, 72, (-np.pi, np.pi))[0]) / 72 * 2 * np.pi))
        seen.append(cloud)
    if not covered or np.median(covered) < _SPINNING_RAD:
        return Synthesis("order", period_s)
    # Clockwise seen from above is what most spinning lidars do; it is the answer where the order says nothing.
    direction = 1 if np.median(turns) > 0 else -1
    start = float(np.angle(np.mean(np.exp(1j * np.array(starts)))))
    a_scan = _start_moves(np.array(starts))
    moving = abs(a_scan) * len(starts) > _MOVING_RAD
    plan = Synthesis(
        "azimuth",
        period_s,
        direction,
        None if moving else start,
        2 * np.pi + direction * a_scan if moving else 2 * np.pi,
    )
    return replace(plan, order=_telling_order(seen, plan))


def _start_moves(starts_rad: FloatArray) -> float:
    """How much farther round, by azimuth, each sweep begins than the one before [rad]; starts_rad: (N,) one after another."""
    if starts_rad.size < 8:
        return 0.0
    followed = np.unwrap(starts_rad)
    quarter = followed.size // 4
    return float((np.median(followed[-quarter:]) - np.median(followed[:quarter])) / (followed.size - quarter))


def _telling_order(clouds: Sequence[RawCloud], plan: Synthesis) -> Order:
    """What of the messages' order goes with the azimuth that the head has turned through."""
    orders: tuple[Order, ...] = ("taken", "rows", "rings")
    for order in orders:
        shares = []
        for cloud in clouds:
            through = _through(cloud, order)
            if through is not None:
                off = _wrapped(_progress(cloud, plan) - through * plan.turned_rad)
                shares.append(float(np.mean(np.abs(off[np.isfinite(off)]) < np.pi / 2)))
        if shares and np.median(shares) > _TOLD_SHARE:
            return order
    return "none"


def _through(cloud: RawCloud, order: Order) -> FloatArray | None:
    """(N,) from 0 to 1, how far through the sweep each point stands by its place in the message; None where it has no such."""
    place = np.arange(cloud.points.size, dtype=np.float64)
    if order == "taken":
        return place / max(cloud.points.size, 1)
    if order == "rows":
        return (place % cloud.width) / cloud.width if cloud.height > 1 and cloud.width > 1 else None
    if order == "rings" and "ring" in cloud.names:
        _, ring, count = np.unique(cloud.points["ring"], return_inverse=True, return_counts=True)
        sorted_by_ring = np.argsort(ring, kind="stable")
        within = np.empty(place.size)
        within[sorted_by_ring] = place - np.repeat(np.cumsum(count) - count, count)
        return np.asarray(within / count[ring], np.float64)
    return None


def _progress(cloud: RawCloud, synthesis: Synthesis) -> FloatArray:
    """(N,) azimuth [rad] since the sweep's beginning, in the direction of turning, from -pi to pi."""
    azimuth = _azimuth(cloud)
    start = synthesis.start_rad
    if start is None:
        seen = azimuth[np.isfinite(azimuth)]
        start = float(seen[0]) if seen.size else 0.0
    return _wrapped(synthesis.direction * (azimuth - start))


def _wrapped(angle_rad: FloatArray) -> FloatArray:
    return np.asarray((angle_rad + np.pi) % (2 * np.pi) - np.pi, np.float64)


@np.errstate(invalid="ignore")
def synthesised_times_s(cloud: RawCloud, synthesis: Synthesis) -> FloatArray:
    """(N,) seconds from the sweep's start; NaN for points without a bearing."""
    if synthesis.kind == "at once":
        return np.zeros(cloud.points.size)
    if synthesis.kind == "order":
        return np.asarray(np.arange(cloud.points.size) / max(cloud.points.size, 1) * synthesis.period_s, np.float64)
    progress = _progress(cloud, synthesis)
    through = _through(cloud, synthesis.order)
    if through is None:
        # A hair before the start is the first column's own scatter, not the end of the sweep.
        slack = np.deg2rad(1.0)
        turned = (progress + slack) % (2 * np.pi) - slack
    else:
        turned = progress + 2 * np.pi * np.round((through * synthesis.turned_rad - progress) / (2 * np.pi))
    return np.asarray(np.maximum(turned, 0.0) / synthesis.turned_rad * synthesis.period_s, np.float64)


def _azimuth(cloud: RawCloud) -> FloatArray:
    x, y = cloud.points["x"].astype(np.float64), cloud.points["y"].astype(np.float64)
    return np.where((x == 0) & (y == 0), np.nan, np.arctan2(y, x))


@dataclass(frozen=True, slots=True)
class SynthesisingDecoder:
    """Another decoder's clouds with a time field put in."""

    inner: CloudDecoder
    synthesis: Synthesis

    def __call__(self, message: RawMessage) -> RawCloud:
        """The cloud of one stored message, with a `time` field in seconds from its header."""
        cloud = self.inner(message)
        kept = [n for n in cloud.names if n != FIELD]
        dtype = np.dtype([*((n, cloud.points.dtype[n]) for n in kept), (FIELD, np.float64)])
        points = np.empty(cloud.points.size, dtype)
        for name in kept:
            points[name] = cloud.points[name]
        points[FIELD] = synthesised_times_s(cloud, self.synthesis)
        return replace(cloud, points=points)


def _start_evidence(synthesis: Synthesis) -> Clue:
    if synthesis.start_rad is None:
        return Clue("turned in a scan", round(float(np.rad2deg(synthesis.turned_rad)), 2), "deg")
    return Clue("start azimuth", round(float(np.rad2deg(synthesis.start_rad)), 2), "deg")


def _at_once(
    sample: Sequence[RawCloud], decoder: CloudDecoder, topic: str
) -> tuple[CloudDecoder, PointTiming, tuple[Finding, ...]]:
    """Clouds whose points are all of the header's instant, as asked."""
    finding = Finding(
        code="points.at_once",
        level="info",
        text=f"All points of a cloud on {topic} are taken to be measured at its stamp, as asked.",
        consequence="if the lidar does sweep, motion distorts its clouds, and the answer is wrong",
    )
    timing = PointTiming(FIELD, "s", "header-first", -1.0, 1.0)
    return SynthesisingDecoder(decoder, Synthesis("at once", scan_period_s(sample))), timing, (finding,)


def point_timing(
    sample: Sequence[RawCloud], decoder: CloudDecoder, settings: ReadSettings, *, topic: str, help_text: str
) -> tuple[CloudDecoder, PointTiming, tuple[Finding, ...]]:
    """The clouds' own times, or, where they carry none and it is asked for, made-up ones; counted from receive times
    where nobody set the headers.

    Raises PointTimeError where the clouds carry none and nobody asked.
    """
    unset: tuple[Finding, ...] = ()
    if never_set(np.array([cloud.header_ns for cloud in sample], np.int64)):
        sample = [replace(cloud, header_ns=cloud.receive_ns) for cloud in sample]
        decoder, unset = restamped(decoder), (unset_finding(topic),)
    if settings.points_at_once:
        decoder, timing, findings = _at_once(sample, decoder, topic)
        return decoder, timing, (*unset, *findings)
    try:
        timing, findings = detect_point_time(sample, settings, topic=topic, help_text=help_text)
    except PointTimeError:
        if not settings.synthesise_point_time:
            raise
    else:
        return decoder, timing, (*unset, *findings)
    synthesis = plan_synthesis(sample)
    timing = PointTiming(FIELD, "s", "header-first", -1.0, 1.02e9 * synthesis.period_s)
    how = "from the azimuth" if synthesis.kind == "azimuth" else "from the points' order"
    finding = Finding(
        code="points.time_synthesised",
        level="warning",
        text=f"The clouds on {topic} carry no per-point time; times were made up {how}, over"
        f" {synthesis.period_s * 1e3:.1f} ms.",
        evidence=(
            Clue("scan period", synthesis.period_s, "s"),
            Clue("direction", synthesis.direction),
            _start_evidence(synthesis),
        ),
        confidence=0.3,
        consequence="the result is degraded: the sweep's true timing is unknown",
        override="record with a driver setting that keeps the point times",
    )
    return SynthesisingDecoder(decoder, synthesis), timing, (*unset, finding)
