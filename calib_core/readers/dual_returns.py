"""Returns that stand in a cloud twice. A lidar in dual mode reports the strongest return of a beam and the last one, and where
the beam met one surface alone that is one return, sent twice: counted as two it would make an answer surer than it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.clouds.decoders import CloudDecoder
from calib_core.readers.container.storage import RawMessage
from calib_core.readers.scans import RING_NAMES
from calib_core.readers.timing.point_time import PointTiming
from calib_core.readers.timing.split_time import is_split
from calib_core.readers.timing.time_fields import raw_times
from calib_core.settings import ReadSettings
from calib_core.threads import workers
from calib_core.types import BoolArray, Clue, Finding

#: Two beams never return to the bit alike, but damaged or made-up points may: fewer than these are not worth a look at all.
_SHARE = 0.02
#: Clouds of the sample that are looked at.
_LOOKED_AT = 10
#: An odd number whose bits are even: by it and a shift every bit of a word reaches all others.
_SPREADING = np.uint64(0x9E3779B97F4A7C15)


@dataclass(frozen=True, slots=True)
class OnceEach:
    """A decoder whose clouds hold each return once."""

    decoder: CloudDecoder
    timing: PointTiming

    def __call__(self, message: RawMessage) -> RawCloud:
        """The cloud of one stored message, in its order; no image any more where something was left out."""
        cloud = self.decoder(message)
        again = repeated(cloud, self.timing)
        points = cloud.points[~again]
        return replace(cloud, points=points, width=points.size, height=1) if again.any() else cloud


def once_each(
    sample: Sequence[RawCloud], decoder: CloudDecoder, timing: PointTiming, settings: ReadSettings, topic: str
) -> tuple[CloudDecoder, tuple[Finding, ...]]:
    """The decoder, without what its clouds hold twice where the sample shows such; and what is said of it.

    As they are where the settings want them as sent.
    """
    if settings.repeated_returns == "as-sent":
        return decoder, ()
    known = [
        cloud for cloud in sample[:_LOOKED_AT] if timing.field in cloud.names or is_split(timing.field, cloud.points)
    ]
    again = sum(workers().map(lambda cloud: int(np.count_nonzero(repeated(cloud, timing))), known))
    sent = sum(int(np.count_nonzero(_returned(cloud))) for cloud in known)
    if again <= _SHARE * sent:
        return decoder, ()
    share = again / sent
    finding = Finding(
        code="points.twice",
        level="info",
        text=f"{share:.0%} of the returns on {topic} are in the clouds twice, as from a lidar in dual mode that sends a single "
        "return twice; each counts once.",
        evidence=(Clue("returns that are there already", share),),
        override="--repeated-returns as-sent",
    )
    return OnceEach(decoder, timing), (finding,)


def repeated(cloud: RawCloud, timing: PointTiming) -> BoolArray:
    """(N,) whether a return has been there before in the cloud: the same place, instant and ring, to the bit."""
    points = cloud.points
    ring = next((name for name in RING_NAMES if name in cloud.names and points.dtype[name].shape == ()), None)
    columns = [points[axis] for axis in "xyz"]
    columns += [raw_times(points, timing.field), *([] if ring is None else [points[ring]])]
    key = np.zeros(points.size, np.uint64)
    for column in columns:
        key = (key ^ _bits(column)) * _SPREADING
        key ^= key >> np.uint64(32)
    ordered = np.sort(key)  # a fifth of what it takes to tell which they are
    if not (ordered[1:] == ordered[:-1]).any():
        return np.zeros(points.size, np.bool_)
    again = np.ones(points.size, np.bool_)
    again[np.unique(key, return_index=True)[1]] = False
    return again & _returned(cloud)


@np.errstate(invalid="ignore", over="ignore")  # damaged floats are masked, not warned of
def _returned(cloud: RawCloud) -> BoolArray:
    """(N,) which points are returns."""
    x, y, z = (cloud.points[axis].astype(np.float64) for axis in "xyz")
    return np.asarray((x * x + y * y + z * z > 0.0) & np.isfinite(x + y + z), dtype=np.bool_)


def _bits(values: NDArray[np.generic]) -> NDArray[np.uint64]:
    """A number's own bits."""
    flat = np.ascontiguousarray(values)
    return flat.view(f"u{flat.dtype.itemsize}").astype(np.uint64)
