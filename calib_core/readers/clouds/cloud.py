"""One message's points as they were sent: a structured view, whatever the message type.

Every decoder ends here; masks, units and time are applied once, in scans.py, to this one form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

StructArray = NDArray[np.void]
#: Of two clouds so many points are compared, spread over both: no two returns are alike to the bit.
_MARKING_POINTS = 64


@dataclass(frozen=True, slots=True)
class RawCloud:
    """points: (N,) structured, at least x y z [m, lidar frame], invalid returns included, in the driver's order.

    header_ns: the header's stamp.   receive_ns: when the recorder got it.   width, height as sent (N = width * height).
    laser: (N,) which one took each point, where no field says it and the points tell (ring_by_elevation.py).
    lidar_id: which of several lidars' it is, where the message says so.
    """

    header_ns: int
    receive_ns: int
    frame_id: str
    points: StructArray
    width: int
    height: int
    laser: NDArray[np.uint16] | None = None
    lidar_id: int | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The fields' names in the message's order."""
        return self.points.dtype.names or ()


def points_mark(points: StructArray) -> int:
    """A number that is the same for the same points, and for others is not: of a few of them, in microseconds. points: (N,)."""
    few = points[:: max(1, points.size // _MARKING_POINTS)]
    return hash((points.size, few.tobytes()))
