"""How the lidar turns by something other than its points: what the tracker may lean on where they say too little."""

from __future__ import annotations

from typing import Protocol

from calib_core.geometry import log
from calib_core.types import FloatArray, Scan


class Turning(Protocol):
    """The lidar's turns between instants of its own clock."""

    def between(self, start_ns: int, end_ns: int) -> FloatArray | None:
        """R (3, 3) from the lidar's axes at the end to those at the start; None where nothing is known of that span."""

    def step(self, position: int, to: int, /) -> FloatArray | None:
        """(3,) map [m], the lidar's way from one scan's start to another's; None where nothing is known of it."""


def rate_within(scan: Scan, turning: Turning | None) -> FloatArray | None:
    """The rate (3,) [rad/s] at which the lidar turns during a scan, None where nothing but its points tells."""
    sweep_ns = int(scan.points["offset_ns"].max()) if len(scan.points) else 0
    if turning is None or sweep_ns == 0:
        return None
    turn = turning.between(scan.stamp_ns, scan.stamp_ns + sweep_ns)
    return None if turn is None else log(turn) / (sweep_ns * 1e-9)
