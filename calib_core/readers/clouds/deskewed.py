"""Clouds from which the motion was already taken: a calibration by the sweep's motion finds nothing in them.

A spinning lidar fires at an azimuth that grows evenly with time, whatever the platform does. Taking the motion out
moves the points, and the azimuth of one ring no longer keeps step with the point times: by the rig's translation over
the range and its rotation during the sweep. So the misfit of a straight line, azimuth over time, is compared between
scans in which the gyroscope turns and scans in which it rests. Lasers of one column may aim degrees past one another: where
they are not told apart, only those at rest say how much of the misfit is theirs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_core.types import Clue, Finding, FloatArray, ImuData, Scan

_EXAMINED = 60
_MIN_POINTS = 60
_FEWEST = 5
_SPINNING_RAD = np.deg2rad(300.0)
_MOVING_RAD_S = np.deg2rad(10.0)
_STILL_RAD_S = np.deg2rad(2.0)
#: A motor keeps its pace to far better than this within one turn.
_SUSPICIOUS_RAD = np.deg2rad(0.15)
_TIMES_STILL = 4.0


def deskew_suspicion(scans: Sequence[Scan], imu: ImuData, coarse_offset_ns: int, topic: str) -> Finding | None:
    """A finding where azimuths lose step with the point times whenever the rig turns; None where they keep it."""
    moving: list[float] = []
    still: list[float] = []
    rates = np.linalg.norm(imu.gyro_rad_s - np.median(imu.gyro_rad_s, axis=0), axis=1)
    for k in np.unique(np.linspace(0, len(scans) - 1, _EXAMINED).astype(np.int64)):
        scan = scans[int(k)]
        misfit_rad = azimuth_misfit_rad(scan)
        start_ns = scan.stamp_ns - coarse_offset_ns
        end_ns = start_ns + int(scan.points["offset_ns"].max())
        first, last = np.searchsorted(imu.stamps_ns, (start_ns, end_ns))
        if misfit_rad is None or last - first < 3:
            continue
        turning = float(np.mean(rates[first:last]))
        if turning > _MOVING_RAD_S:
            moving.append(misfit_rad)
        elif turning < _STILL_RAD_S:
            still.append(misfit_rad)
    if len(moving) < _FEWEST or (not still and not any(scan.points["ring"].any() for scan in scans)):
        return None
    seen, rest = float(np.median(moving)), float(np.median(still)) if still else 0.0
    if seen < _SUSPICIOUS_RAD or seen < _TIMES_STILL * rest:
        return None
    return Finding(
        code="points.deskewed",
        level="warning",
        text=f"The clouds on {topic} look as if the motion was already taken out: while the rig turns, azimuths are"
        f" {np.rad2deg(seen):.2f} deg off an even rotation over the point times.",
        evidence=(
            Clue("misfit while turning", round(float(np.rad2deg(seen)), 4), "deg"),
            Clue("misfit at rest", round(float(np.rad2deg(rest)), 4), "deg"),
            Clue("turning scans", len(moving)),
            Clue("resting scans", len(still)),
        ),
        confidence=0.8 if still else 0.5,
        consequence="the translation and the time offset cannot be trusted; record the driver's raw cloud",
    )


def azimuth_misfit_rad(scan: Scan) -> float | None:
    """Root mean square distance of the fullest ring's azimuth from a straight line over time; None off a full turn."""
    points = scan.points
    ring = points[points["ring"] == int(np.argmax(np.bincount(points["ring"])))]
    if ring.size < _MIN_POINTS:
        return None
    ring = ring[np.argsort(ring["offset_ns"], kind="stable")]
    times: FloatArray = ring["offset_ns"].astype(np.float64)
    azimuth = np.unwrap(np.arctan2(ring["xyz"][:, 1], ring["xyz"][:, 0]).astype(np.float64))
    if abs(azimuth[-1] - azimuth[0]) < _SPINNING_RAD or times[-1] <= times[0]:
        return None
    line = np.polynomial.Polynomial.fit(times, azimuth, 1)
    return float(np.sqrt(np.mean((azimuth - line(times)) ** 2)))
