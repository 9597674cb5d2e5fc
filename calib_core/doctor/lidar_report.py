"""What the lidar sent: fields, point times, ranges, regularity."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_core.doctor.report import FieldReport, LidarPresetReport, LidarReport, PointTimeReport, RangeReport
from calib_core.doctor.stamps import stamp_report
from calib_core.presets import GENERIC_LIDAR, find_lidar_preset
from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.scans import ScanCounts
from calib_core.readers.timing.point_time import PointTiming
from calib_core.types import Finding, IntArray, Scan


def lidar_report(
    first: RawCloud,
    *,
    topic: str,
    layout: str,
    timing: PointTiming | None,
    findings: Sequence[Finding],
    header_ns: IntArray,
    receive_ns: IntArray,
    examined: Sequence[tuple[Scan | None, ScanCounts]],
) -> LidarReport:
    """The report of one lidar. examined: scans decoded for statistics, spread over the recording.

    Its noise is seen on the planes only, which are looked for later.
    """
    preset = find_lidar_preset(topic, first.frame_id, layout)
    shown = preset or GENERIC_LIDAR
    rings = [np.unique(scan.points["ring"]).size for scan, _ in examined if scan is not None]
    dtype = first.points.dtype
    return LidarReport(
        topic=topic,
        frame_id=first.frame_id,
        layout=layout,
        scans=int(header_ns.size),
        rings=max(rings, default=0),
        stamps=stamp_report(header_ns, receive_ns),
        fields=tuple(FieldReport(name=name, type=dtype[name].base.name) for name in first.names),
        point_time=_point_time(timing, findings),
        ranges=_ranges(examined),
        preset=LidarPresetReport(
            name=shown.name, range_std_m=shown.range_std_m, source=shown.source, identified=preset is not None
        ),
    )


def _point_time(timing: PointTiming | None, findings: Sequence[Finding]) -> PointTimeReport | None:
    finding = next((f for f in findings if f.code == "points.time_field"), None)
    if timing is None or finding is None:
        return None
    numbers = {e.name: e.value for e in finding.evidence}
    return PointTimeReport(
        field=timing.field,
        unit=timing.unit,
        reference=timing.reference,
        first_after_header_s=float(numbers.get("first point after header", 0.0)),
        last_after_header_s=float(numbers.get("last point after header", 0.0)),
        confidence=finding.confidence,
    )


def _ranges(examined: Sequence[tuple[Scan | None, ScanCounts]]) -> RangeReport | None:
    scans = [scan for scan, _ in examined if scan is not None]
    if not scans:
        return None
    distances = np.concatenate([np.linalg.norm(scan.points["xyz"][::7], axis=1) for scan in scans])
    p05, median, p95 = np.percentile(distances, (5, 50, 95))
    sent = sum(counts.sent for _, counts in examined)
    lost = sum(counts.no_return for _, counts in examined)
    return RangeReport(
        minimum_m=float(distances.min()),
        p05_m=float(p05),
        median_m=float(median),
        p95_m=float(p95),
        maximum_m=float(distances.max()),
        points_per_scan=int(
            np.median([c.sent - c.no_return - c.out_of_time for scan, c in examined if scan is not None])
        ),
        no_return_share=lost / max(sent, 1),
    )
