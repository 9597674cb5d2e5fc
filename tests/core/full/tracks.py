"""The lidar followed through simulated scans, and how far its track is from the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.events import LogEvent, never_cancel
from calib_core.full.initialise.lidar_motion import begin
from calib_core.full.odometry.reference import Followed
from calib_core.full.planes.propose import find_reference, named_planes
from calib_core.full.prepare.prepare import prepare
from calib_core.geometry import log
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import FloatArray, Recording, Scan


class TrueTurning:
    """The true turns. coasts: whether a direction may stay open."""

    def __init__(self, truth: Truth, *, coasts: bool) -> None:
        self._truth = truth
        self.coasts = coasts

    def between(self, start_ns: int, end_ns: int) -> FloatArray:
        R, _ = self._truth.map_lidar((np.array([start_ns, end_ns]) - self._truth.epoch_ns) * 1e-9)
        return R[0].T @ R[1]

    def turn_std_rad(self, _turn_rad: float, _over_s: float, /) -> float:
        return np.inf

    def step(self, *_: object) -> None:
        return None


def track_errors(recording: Recording, truth: Truth, found: Followed) -> tuple[float, float]:
    """Worst turn [deg] and shift [m] between the track and the truth, in the frame of its reference."""
    start = np.array([(recording.scans[m.position].stamp_ns - truth.epoch_ns) * 1e-9 for m in found.motions])
    at = [m.position for m in found.motions].index(found.reference)
    R, p = truth.map_lidar(start)
    R, p = R[at].T @ R, (p - p[at]) @ R[at]
    turned = log(np.swapaxes(R, 1, 2) @ np.array([m.R for m in found.motions]))
    moved = np.array([m.p for m in found.motions]) - p
    return float(np.degrees(np.linalg.norm(turned, axis=1).max())), float(np.linalg.norm(moved, axis=1).max())


def straightened(scan: Scan, truth: Truth, seen_at: float = 0.0) -> Scan:
    """As another program would: every point where the lidar would have seen it from where it was at one instant.

    seen_at: that of the sweep, 0 for its beginning to 1 for its end.
    """
    offset_s: FloatArray = scan.points["offset_ns"].astype(np.float64) * 1e-9
    start_s = (scan.stamp_ns - truth.epoch_ns) * 1e-9
    at, once = truth.lidar(start_s + offset_s), truth.lidar(np.array([start_s + seen_at * offset_s.max()]))
    world: FloatArray = np.einsum("nij,nj->ni", at.R_world, scan.points["xyz"].astype(np.float64)) + at.p_m
    points = scan.points.copy()
    points["xyz"] = (world - once.p_m[0]) @ once.R_world[0]
    return replace(scan, points=points)


def backwards(scan: Scan) -> Scan:
    """With times that run backwards."""
    points = scan.points.copy()
    points["offset_ns"] = points["offset_ns"].max(initial=0) - points["offset_ns"]
    return replace(scan, points=points)


def begun(recording: Recording, *, given: bool, at_fault: float = 0.0) -> tuple[Followed, dict[str, str]]:
    """Followed from the start, and what was said, by its code. given: three planes of the reference scan are a person's."""
    said: dict[str, str] = {}

    def listen(event: object) -> None:
        if isinstance(event, LogEvent):
            said[event.code] = event.text

    settings = CalibrateSettings()
    run = prepare(recording, settings, listen, never_cancel)
    _, fits = find_reference(recording.scans, settings)
    return begin(run, named_planes(fits)[:3] if given else None, at_fault=at_fault), said
