"""Which laser took a point, where a cloud does not say: the lasers of a rotor look up by an angle each.

A driver or a converter may leave the ring out, or send it as zero. The points of one laser then still lie on a cone of their own,
and between two cones lies next to nothing: rows of elevation, counted from the lowest, are the lasers. Where points were moved
(straightened clouds, another frame), and where a beam is steered in other ways, there are no such rows, and nothing is told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib_core.readers.clouds.cloud import RawCloud, StructArray
from calib_core.readers.clouds.decoders import CloudDecoder
from calib_core.readers.container.storage import RawMessage
from calib_core.readers.scans import RING_NAMES
from calib_core.types import Clue, Finding, FloatArray

#: Clouds of the sample that are looked at, all over it.
_LOOKED_AT = 12
#: Nearer returns say little of an angle: beams begin a centimetre or two beside the middle.
_NEAREST_M = 2.0
#: Rows beyond the lowest and the highest that are seen at first: as far apart as these mostly are, so many on either side.
_BEYOND = 4
#: Elevations are counted by so much: a thirtieth of the closest rows of any rotor, the rounding of a millimetre at 5 m.
_BIN_DEG = 0.01
#: Of what the fullest bin holds: one with less is not filled. Strays by damaged points are so few.
_FILLED = 0.002
#: Rows that are no farther apart than this are one.
_JOINED_BINS = 3
#: Rotors have 4 lasers and more, and up to 128.
_FEWEST, _MOST = 4, 128
#: Rows take up so much of what lies between the lowest and the highest at most, and hold so many of all points at least.
_FULLEST, _HELD = 0.4, 0.97
#: A row holds so many of a fair share of the points at least: a stray heap is none.
_LEAST_SHARE = 0.001


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of elevation. middles_deg: (L,) ascending, of the rows that were seen.   between: (K - 1,) slopes (z by way) between
    neighbours, of more rows than were seen.   number: (K,) of each: 0 to L - 1 of those seen, ascending, then the others.
    """

    middles_deg: FloatArray
    between: FloatArray
    number: NDArray[np.uint16]

    @staticmethod
    def made(middles_deg: FloatArray, edges_deg: FloatArray) -> Rows:
        """With rows beyond them, which somebody may see later. edges_deg: (L - 1,) between them."""
        apart_deg = float(np.median(np.diff(middles_deg)))
        beyond = apart_deg * (np.arange(_BEYOND) + 0.5)
        edges_deg = np.concatenate([middles_deg[0] - beyond[::-1], edges_deg, middles_deg[-1] + beyond])
        seen = len(middles_deg)
        outside = seen + np.arange(2 * _BEYOND)
        number = np.concatenate([outside[:_BEYOND][::-1], np.arange(seen), outside[_BEYOND:]])
        return Rows(middles_deg, np.tan(np.radians(np.clip(edges_deg, -90.0, 90.0))), number.astype(np.uint16))

    def of(self, points: StructArray) -> NDArray[np.uint16]:
        """(N,) the row of each point; of one without coordinates any."""
        return self.number[np.searchsorted(self.between, _slopes(points))]


@dataclass(frozen=True, slots=True)
class ByRows:
    """A decoder whose clouds say which laser took a point."""

    decoder: CloudDecoder
    rows: Rows

    def __call__(self, message: RawMessage) -> RawCloud:
        """The cloud of one stored message."""
        cloud = self.decoder(message)
        return replace(cloud, laser=self.rows.of(cloud.points))


def by_rows(sample: Sequence[RawCloud], decoder: CloudDecoder, topic: str) -> tuple[CloudDecoder, tuple[Finding, ...]]:
    """The decoder, by rows where the sample's points name no lasers and lie in rows; and what is said of it."""
    if not sample or any(_names_lasers(cloud) for cloud in _spread(sample)):
        return decoder, ()
    rows = find_rows(sample)
    if rows is None:
        return decoder, ()
    low, high = float(rows.middles_deg[0]), float(rows.middles_deg[-1])
    finding = Finding(
        code="points.rows",
        level="info",
        text=f"the points on {topic} do not say which laser measured them: the lasers are told apart by {len(rows.middles_deg)} "
        f"rows of elevation from {low:.1f} to {high:.1f} deg; the lowest is laser 0",
        evidence=(Clue("rows of elevation", len(rows.middles_deg)),),
        override="--intrinsics",
    )
    return ByRows(decoder, rows), (finding,)


def find_rows(sample: Sequence[RawCloud]) -> Rows | None:
    """The rows in which the points of some clouds lie; None where they lie in none."""
    points = np.concatenate([cloud.points for cloud in _spread(sample)])
    elevation_deg = np.degrees(np.arctan(_slopes(points[_distances_m(points) > _NEAREST_M])))
    if elevation_deg.size == 0:
        return None
    counts, _ = np.histogram(elevation_deg, round(180.0 / _BIN_DEG), (-90.0, 90.0))
    filled = counts > max(1.0, _FILLED * float(counts.max()))
    at = np.flatnonzero(filled)
    first_of = np.flatnonzero(np.diff(at, prepend=-1000) > _JOINED_BINS)
    begins, ends = at[first_of], at[np.append(first_of[1:], at.size) - 1] + 1
    below = np.concatenate([[0], np.cumsum(counts)])
    held = below[ends] - below[begins]
    some = held > _LEAST_SHARE * elevation_deg.size / len(held)
    begins, ends, held = begins[some], ends[some], held[some]
    is_sharp = int(np.sum(ends - begins)) <= _FULLEST * (ends[-1] - begins[0])
    if not _FEWEST <= len(held) <= _MOST or held.sum() < _HELD * elevation_deg.size or not is_sharp:
        return None
    middles_deg, edges_deg = 0.5 * _BIN_DEG * (begins + ends) - 90.0, 0.5 * _BIN_DEG * (ends[:-1] + begins[1:]) - 90.0
    return Rows.made(middles_deg, edges_deg)


def _spread(sample: Sequence[RawCloud]) -> list[RawCloud]:
    """Some clouds all over the sample."""
    return [sample[int(k)] for k in np.unique(np.linspace(0, len(sample) - 1, _LOOKED_AT).astype(np.int64))]


def _names_lasers(cloud: RawCloud) -> bool:
    """Whether a field tells its lasers apart."""
    name = next((each for each in RING_NAMES if each in cloud.names and cloud.points.dtype[each].shape == ()), None)
    return name is not None and bool(np.ptp(cloud.points[name]) > 0 if cloud.points.size else False)


@np.errstate(invalid="ignore", over="ignore", divide="ignore")  # damaged floats are masked, not warned of
def _slopes(points: StructArray) -> FloatArray:
    """(N,) height by way of each point; 0 of one without coordinates."""
    x, y, z = (points[axis].astype(np.float64) for axis in "xyz")
    return np.nan_to_num(z / np.hypot(x, y))


@np.errstate(invalid="ignore", over="ignore")
def _distances_m(points: StructArray) -> FloatArray:
    """(N,) how far away each point is; 0 of one without coordinates."""
    x, y, z = (points[axis].astype(np.float64) for axis in "xyz")
    return np.nan_to_num(np.sqrt(x * x + y * y + z * z), posinf=0.0)
