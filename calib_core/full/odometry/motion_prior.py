"""How the lidar moves by something other than its points: what the tracker may lean on where they say too little.

These are protocols: the tracker knows no IMU. Three records of the next stage are a `Turning`, from the least that is known to
the most: `GyroTurning`, turns alone; `GyroAndSteps`, steps of one track's scans too (`initialise/inertial_motion.py`);
`ImuMotion`, steps from wherever the track is (`initialise/inertial_guide.py`). The only `Guide` is there as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from calib_core.full.odometry.register import ScanMotion, sample_points
from calib_core.full.odometry.settings import FOLLOWING
from calib_core.geometry import exp, log
from calib_core.types import FloatArray, Scan


class Turning(Protocol):
    """The lidar's turns between instants of its own clock, and its steps from scan to scan as far as they are known."""

    @property
    def coasts(self) -> bool:
        """Whether a track may go on without end while its planes leave one direction of its place open, as between two walls and
        on a floor: how far along it is, the solve knows from the IMU.
        """

    def between(self, start_ns: int, end_ns: int) -> FloatArray | None:
        """R (3, 3) from the lidar's axes at the end to those at the start; None where nothing is known of that span."""

    def turn_std_rad(self, turn_rad: float, over_s: float, /) -> float:
        """1 sigma of such a turn of so much over so long, by what it was made with; infinite where nothing tells that."""

    def step(self, motions: Sequence[ScanMotion], to: int, /) -> FloatArray | None:
        """(3,) [m], map frame: from the lidar's place at the start of the last of these scans to that at another's; None where
        nothing is known of it.

        motions: in the order in which they were followed, which may be backwards in time.   to: position of the other scan.
        """


class Guide(Protocol):
    """Compares a track with the IMU while it is followed by its planes alone, and leads it where they differ."""

    @property
    def led(self) -> bool:
        """Whether it has led the track for any scan."""

    @property
    def leading(self) -> Turning | None:
        """What it leads the track by now; None where the track still follows its planes alone."""

    def lead(self, motions: Sequence[ScanMotion], newest: ScanMotion | None) -> Turning | None:
        """What leads the track from its newest motion on, once the IMU has not felt that one; None as long as it has felt each,
        or nothing is known of it.

        motions: before the newest, in the order in which they were followed.   newest: None for a scan that was lost.
        Raises Misled where motions before the newest were not felt, either.
        """


class Misled(Exception):
    """The track went astray earlier than its newest scan, and has to be followed anew from its reference. turning: what leads it
    then.
    """

    def __init__(self, turning: Turning) -> None:
        super().__init__("the track went as nothing has felt it")
        self.turning = turning


def rate_within(scan: Scan, turning: Turning | None) -> FloatArray | None:
    """The rate (3,) [rad/s] at which the lidar turns during a scan, at its stamp where all its points are of one instant; None
    where nothing but its points tells.
    """
    if turning is None or not len(scan.points):
        return None
    span_ns = int(scan.points["offset_ns"].max()) or round(FOLLOWING.turning_s * 1e9)
    turn = turning.between(scan.stamp_ns, scan.stamp_ns + span_ns)
    return None if turn is None else log(turn) / (span_ns * 1e-9)


def steadied(points_m: FloatArray, tau_s: FloatArray, scan: Scan, turning: Turning | None) -> FloatArray:
    """Points (K, 3) of a scan as they would be had it turned at the rate of `rate_within` throughout; as they are where nothing
    tells how it turned. tau_s: (K,) after its first point.

    A rig that is shaken turns to and fro within a sweep: by no rate are its walls flat.
    """
    rate = rate_within(scan, turning)
    if turning is None or rate is None or not tau_s.any():
        return points_m
    sweep_s = float(scan.points["offset_ns"].max()) * 1e-9
    t_s = np.linspace(0.0, sweep_s, 1 + max(1, round(sweep_s / FOLLOWING.turning_s)))
    turns = [turning.between(scan.stamp_ns, scan.stamp_ns + round(t * 1e9)) for t in t_s.tolist()]
    if any(turn is None for turn in turns):
        return points_m
    beside = log(exp(-rate * t_s[:, None]) @ np.array(turns))
    own = np.stack([np.interp(tau_s, t_s, beside[:, i]) for i in range(3)], axis=1)
    return np.asarray((exp(own) @ points_m[..., None])[..., 0])


def steady_sample(scan: Scan, count: int, turning: Turning | None) -> tuple[FloatArray, FloatArray]:
    """Some points (K, 3) [m] of a scan and their times (K,) [s], as `sample_points` takes them, steadied."""
    points, tau = sample_points(scan, count)
    return steadied(points, tau, scan, turning), tau
