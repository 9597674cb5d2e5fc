"""What is said of the points that were left out, to a person."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

from calib_core.readers.reading import Reading
from calib_core.readers.scans import ScanCounts
from calib_core.settings import ReadSettings


def test_points_left_out_are_counted_as_people_write_numbers() -> None:
    """Oracle: the sentences. Mutations: digits in one row; one scan's count; points that "are" no return."""
    nothing = cast(Any, SimpleNamespace())
    settings = ReadSettings(range_min_m=0.5, range_max_m=90.0)
    reading = Reading(nothing, settings, nothing, nothing, nothing, nothing)
    reading.counts = [ScanCounts(6_553_600, 1_277_000, 0), ScanCounts(6_553_600, 61, 1_024)]
    assert [finding.text for finding in reading.findings("/points")] == [
        "1,024 of 13,107,200 points on /points had a time outside of their sweep and were left out.",
        "1,277,061 of 13,107,200 points on /points had no return, or one outside of 0.5 to 90 m, and were left out.",
    ]
