"""How the lidar moves by something other than its points: what the tracker may lean on where they say too little."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from calib_core.full.odometry.register import ScanMotion
from calib_core.geometry import log
from calib_core.types import FloatArray, Scan


class Turning(Protocol):
    """The lidar's turns between instants of its own clock."""

    def between(self, start_ns: int, end_ns: int) -> FloatArray | None:
        """R (3, 3) from the lidar's axes at the end to those at the start; None where nothing is known of that span."""

    def step(self, motions: Sequence[ScanMotion], to: int, /) -> FloatArray | None:
        """(3,) map [m], the lidar's way from the start of the last of these scans, in the order in which they were followed,
        to another's; None where nothing is known of it.
        """


class Guide(Protocol):
    """Who looks whether a track goes as it was felt to, while it is followed by its planes alone."""

    @property
    def led(self) -> bool:
        """Whether it has led the track anywhere."""

    def lead(self, motions: Sequence[ScanMotion], newest: ScanMotion | None) -> Turning | None:
        """What leads it from its newest motion on, once that was not felt; None as long as each was, or nobody knows.

        motions: before that, in the order in which they were followed.   newest: None for a scan that was lost.
        Raises Misled where what lies behind was not felt, either.
        """


class Misled(Exception):
    """A track that is to be followed anew, from its reference on. turning: what leads it."""

    def __init__(self, turning: Turning) -> None:
        super().__init__("the track went as nothing has felt it")
        self.turning = turning


def rate_within(scan: Scan, turning: Turning | None) -> FloatArray | None:
    """The rate (3,) [rad/s] at which the lidar turns during a scan, None where nothing but its points tells."""
    sweep_ns = int(scan.points["offset_ns"].max()) if len(scan.points) else 0
    if turning is None or sweep_ns == 0:
        return None
    turn = turning.between(scan.stamp_ns, scan.stamp_ns + sweep_ns)
    return None if turn is None else log(turn) / (sweep_ns * 1e-9)
