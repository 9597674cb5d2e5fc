"""How the lidar moves by something other than its points: what the tracker may lean on where they say too little."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from calib_core.full.odometry.register import ScanMotion, sample_points
from calib_core.full.odometry.settings import FOLLOWING
from calib_core.geometry import exp, log
from calib_core.types import FloatArray, Scan


class Turning(Protocol):
    """The lidar's turns between instants of its own clock."""

    @property
    def coasts(self) -> bool:
        """Whether the lidar counts as followed for ever where its planes leave one direction open: between two walls and on a
        floor they never tell how far along it is, and whoever asks knows that from elsewhere.
        """

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

    @property
    def leading(self) -> Turning | None:
        """What it has led it by; None where it has not."""

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
    """As `sample_points`, steadied."""
    points, tau = sample_points(scan, count)
    return steadied(points, tau, scan, turning), tau
