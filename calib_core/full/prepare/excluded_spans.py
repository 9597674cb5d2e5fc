"""Spans of time that the user leaves out: somebody walked through, the lidar was covered, the rig was knocked.

A scan that begins or ends inside an excluded span is taken away before anything looks at it, so that nothing in it can
reach the answer: no plane, no start value, no distance. The IMU is kept, and carries the motion over the gap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from calib_core.errors import SettingsError
from calib_core.types import Recording, Scan

Spans = Sequence[tuple[float, float]]


def without_spans(recording: Recording, spans_s: Spans) -> Recording:
    """The recording without the scans that touch a span. spans_s: (start, end) in seconds after its first scan."""
    if not spans_s or len(recording.scans) == 0:
        return recording
    kept = [recording.scans[place] for place in kept_places(recording.scans, spans_s)]
    if not kept:
        raise SettingsError(
            "Expected excluded spans that leave some scans, but they cover all "
            f"{len(recording.scans)} scans of {recording.name}; exclude less."
        )
    total = recording.scans_total or len(recording.scans)
    later_s = (kept[0].stamp_ns - recording.scans[0].stamp_ns) * 1e-9
    return replace(recording, scans=kept, scans_total=total, skipped_s=recording.skipped_s + later_s)


def kept_places(scans: Sequence[Scan], spans_s: Spans) -> list[int]:
    """Positions of the scans that no span touches."""
    epoch_ns = scans[0].stamp_ns if len(scans) else 0
    return [place for place, scan in enumerate(scans) if not _touched(scan, epoch_ns, spans_s)]


def _touched(scan: Scan, epoch_ns: int, spans_s: Spans) -> bool:
    start_s = (scan.stamp_ns - epoch_ns) * 1e-9
    end_s = start_s + (float(scan.points["offset_ns"].max()) * 1e-9 if len(scan.points) else 0.0)
    return any(low <= end_s and start_s <= high for low, high in spans_s)
