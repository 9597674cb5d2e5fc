"""How a lidar's clouds are to be read, as a sample of them tells: the same for whoever loads a recording or inspects it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.clouds.decoders import CloudDecoder
from calib_core.readers.dual_returns import once_each
from calib_core.readers.ray_origin import where_rays_meet
from calib_core.readers.ring_by_elevation import by_rows
from calib_core.readers.timing.point_time import PointTiming
from calib_core.readers.timing.synthesise import point_timing
from calib_core.settings import ReadSettings
from calib_core.types import Finding


@dataclass(frozen=True, slots=True)
class CloudReading:
    """decoder: from messages to clouds, with what is mended of every cloud.   timing: of their points.   findings: what was
    detected for it.
    """

    decoder: CloudDecoder
    timing: PointTiming
    findings: tuple[Finding, ...]


def cloud_reading(
    sample: Sequence[RawCloud], decoder: CloudDecoder, settings: ReadSettings, *, topic: str, help_text: str
) -> CloudReading:
    """The points' times, then what else of the clouds has to be known or mended: returns that are there twice, points by rows
    without a laser's number, rays that do not meet in the lidar's frame.

    sample: the first clouds, as `decoder` gives them.   help_text: of their layout, for a person who lacks point times.
    Raises PointTimeError where the clouds have no time of their points, and none is to be made up.
    """
    decoder, timing, of_times = point_timing(sample, decoder, settings, topic=topic, help_text=help_text)
    decoder, twice = once_each(sample, decoder, timing, settings, topic)
    decoder, rows = by_rows(sample, decoder, topic)
    return CloudReading(decoder, timing, (*of_times, *twice, *rows, *where_rays_meet(sample, topic)))
