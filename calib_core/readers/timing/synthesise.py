"""Point times made up where a cloud carries none: degraded, asked for explicitly, and labelled so.

A spinning lidar sweeps its azimuth evenly, so the azimuth since the sweep's first point is the time; which way it
turns is seen from the order of the points. Any other lidar is taken to send its points in the order it took them.
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
from calib_core.types import Evidence, Finding, FloatArray

#: A sweep that covers this much of the circle is a spinning lidar's.
_SPINNING_RAD = np.deg2rad(300.0)
FIELD = "time"


@dataclass(frozen=True, slots=True)
class Synthesis:
    """How times are made: direction +1 for growing azimuth, -1 for falling; start_rad where a sweep begins."""

    kind: Literal["azimuth", "order"]
    period_s: float
    direction: int = 1
    start_rad: float = 0.0


@np.errstate(invalid="ignore")
def plan_synthesis(clouds: Sequence[RawCloud]) -> Synthesis:
    """The rule for the clouds of one topic, from a sample of them."""
    period_s = scan_period_s(clouds)
    turns: list[float] = []
    starts: list[float] = []
    covered: list[float] = []
    for cloud in clouds[1:] if len(clouds) > 3 else clouds:
        azimuth = _azimuth(cloud)
        azimuth = azimuth[np.isfinite(azimuth)]
        if azimuth.size < 10:
            continue
        steps = (np.diff(azimuth) + np.pi) % (2 * np.pi) - np.pi
        small = steps[(steps != 0) & (np.abs(steps) < np.deg2rad(20))]
        turns.append(float(np.median(np.sign(small))) if small.size else 0.0)
        starts.append(float(azimuth[0]))
        covered.append(float(np.count_nonzero(np.histogram(azimuth, 72, (-np.pi, np.pi))[0]) / 72 * 2 * np.pi))
    if not covered or np.median(covered) < _SPINNING_RAD:
        return Synthesis("order", period_s)
    # Clockwise seen from above is what most spinning lidars do; it is the answer where the order says nothing.
    direction = 1 if np.median(turns) > 0 else -1
    start = float(np.angle(np.mean(np.exp(1j * np.array(starts)))))
    return Synthesis("azimuth", period_s, direction, start)


@np.errstate(invalid="ignore")
def synthesised_times_s(cloud: RawCloud, synthesis: Synthesis) -> FloatArray:
    """(N,) seconds from the sweep's start; NaN for points without a bearing."""
    if synthesis.kind == "order":
        return np.asarray(np.arange(cloud.points.size) / max(cloud.points.size, 1) * synthesis.period_s, np.float64)
    progress = synthesis.direction * (_azimuth(cloud) - synthesis.start_rad)
    # A hair before the start is the first column's own scatter, not the end of the sweep.
    slack = np.deg2rad(1.0)
    return np.asarray(
        np.maximum((progress + slack) % (2 * np.pi) - slack, 0.0) / (2 * np.pi) * synthesis.period_s, np.float64
    )


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
        return RawCloud(cloud.header_ns, cloud.receive_ns, cloud.frame_id, points, cloud.width, cloud.height)


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
            Evidence("scan period", synthesis.period_s, "s"),
            Evidence("direction", synthesis.direction),
            Evidence("start azimuth", round(float(np.rad2deg(synthesis.start_rad)), 2), "deg"),
        ),
        confidence=0.3,
        consequence="the result is degraded: the sweep's true timing is unknown",
        override="record with a driver setting that keeps the point times",
    )
    return SynthesisingDecoder(decoder, synthesis), timing, (*unset, finding)
