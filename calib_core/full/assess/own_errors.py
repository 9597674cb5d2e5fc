"""What a result's solve took out of its recording's readings, taken out of them once more: for those who compare the two.

What was only considered was not taken out and stays. Signs: calib_core/intrinsics.py. Ticks and vibrations of the IMU stay, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calib_core.factors.laser_features import LaserErrors
from calib_core.imu.intrinsics import ImuIntrinsics, felt_beside, unsmeared
from calib_core.imu.preintegration import knot_spacing_s
from calib_core.intrinsics import KINDS, NAMES, Block
from calib_core.result import CalibrationResult
from calib_core.types import FloatArray, ImuData, Recording, Scan


def estimated(result: CalibrationResult) -> dict[tuple[str, str], float]:
    """The values that the solve worked with, by block and name."""
    return {(each.block, each.name): each.value for each in result.intrinsics if each.state == "estimated"}


@dataclass(frozen=True, slots=True)
class Lasers:
    """Errors of a lidar's points. told_apart: whether by the points' rings, else one laser stands for all."""

    errors: LaserErrors
    told_apart: bool

    def corrected(self, scan: Scan) -> Scan:
        """The scan as lasers without errors give it, but for what depends on the surfaces."""
        points = scan.points.copy()
        laser = points["ring"] if self.told_apart else np.zeros_like(points["ring"])
        points["xyz"] = self.errors.corrected(np.ascontiguousarray(points["xyz"]), np.ascontiguousarray(laser))
        return replace(scan, points=points)

    def straightened(self, beyond_m: FloatArray, cosine: FloatArray, xyz_m: FloatArray) -> FloatArray:
        """Distances beyond planes (N,) without what a slant makes. cosine: (N,), of either sign.   xyz_m: (N, 3) lidar."""
        return -self.errors.straightened(-beyond_m, -np.abs(cosine), xyz_m)


def lasers_of(found: Mapping[tuple[str, str], float]) -> Lasers | None:
    """Ranges and angles laser by laser, of values by block and name; None where there are none."""
    blocks = ("laser_range_offset", "laser_range_scale", "laser_elevation", "laser_azimuth")
    rings = [int(name) for block, name in found if block in blocks and name.isdecimal()]
    every = found.get(("range_offset", "all"), 0.0)
    if not rings and not every:
        return None
    # Where lasers are not told apart, one stands for all.
    lasers = max(rings, default=0) + 1
    offset, scale, elevation, azimuth = (
        np.array([found.get((block, str(laser)), 0.0) for laser in range(lasers)]) for block in blocks
    )
    return Lasers(LaserErrors(offset + every, scale, elevation, azimuth, np.zeros(1)), bool(rings))


def ideal_lasers(result: CalibrationResult) -> Lasers | None:
    """All that the solve took out of the lidar's points; None where it took nothing."""
    found = estimated(result)
    rest = [("eccentricity", "sine"), ("eccentricity", "cosine"), ("incidence", "all"), ("grazing", "all")]
    sine, cosine, incidence_m, grazing_rad = (found.get(each, 0.0) for each in rest)
    lasers = lasers_of(found)
    if lasers is None and not any((sine, cosine, incidence_m, grazing_rad)):
        return None
    nothing = np.zeros(1)
    lasers = lasers or Lasers(LaserErrors(nothing, nothing, nothing, nothing, nothing), told_apart=False)
    errors = replace(
        lasers.errors,
        eccentricity_rad=np.array([sine, cosine]),
        incidence_m=np.array([incidence_m]),
        grazing_rad=grazing_rad,
    )
    return replace(lasers, errors=errors)


def ideal_readings(recording: Recording, result: CalibrationResult) -> ImuData:
    """The IMU's readings as an ideal one's, biases left in, and its stamps at one offset from the lidar's clock all through."""
    imu, found = recording.imu, estimated(result)
    if not any(
        KINDS[block].owner in {"imu", "clock"} and (block, name) in found for block in NAMES for name in NAMES[block]
    ):
        return imu
    stamps_ns = imu.stamps_ns
    if result.clock_rate_ppm and ("clock_rate", "rate") in found:
        first_ns = recording.scans[0].stamp_ns if len(recording.scans) else int(stamps_ns[0])
        holds_at_s = (result.time_offset_at_s or 0.0) - recording.skipped_s
        since_s = (stamps_ns - first_ns + (result.time_offset_ns or 0)) * 1e-9 - holds_at_s
        stamps_ns = stamps_ns + np.rint(1e3 * result.clock_rate_ppm * since_s).astype(np.int64)

    def values(block: Block) -> FloatArray:
        return np.array([found.get((block, name), 0.0) for name in NAMES[block]])

    own = ImuIntrinsics(
        gyro_scale=values("gyroscope_scale"),
        gyro_axes=values("gyroscope_axes"),
        gyro_rotation=values("gyroscope_rotation"),
        accel_scale=values("accelerometer_scale"),
        accel_axes=values("accelerometer_axes"),
        accel_delay_s=float(values("accelerometer_delay")[0]),
        accel_quadratic=values("accelerometer_quadratic"),
        g_sensitivity=values("g_sensitivity"),
        size_effect=values("size_effect"),
        low_pass_spread=values("low_pass_spread"),
        low_pass_skew=values("low_pass_skew"),
    )
    at_s = (imu.stamps_ns - imu.stamps_ns[0]) * 1e-9
    # Late by the delay: what happened at an instant is read so much after it.
    read = np.stack([np.interp(at_s + own.accel_delay_s, at_s, axis) for axis in imu.accel_m_s2.T], axis=1)
    accel = read @ np.linalg.inv(own.accel).T
    accel = accel - own.accel_quadratic * accel**2
    G, F = np.linalg.inv(own.gyro), own.g_sensitivity.reshape(3, 3)
    if own.size_effect.any():
        rate = (imu.gyro_rad_s - accel @ F.T) @ G.T
        accel = accel - felt_beside(rate, np.gradient(rate, at_s, axis=0)) @ own.size_effect
    gyro = (imu.gyro_rad_s - accel @ F.T) @ G.T
    gyro, accel = (
        _sharp(at_s, *each) for each in zip((gyro, accel), own.low_pass_spread, own.low_pass_skew, strict=True)
    )
    return replace(imu, stamps_ns=stamps_ns, gyro_rad_s=gyro, accel_m_s2=accel)


def _sharp(at_s: FloatArray, readings: FloatArray, spread_s2: float, skew_s3: float) -> FloatArray:
    """Readings (N, 3) at instants (N,) as they were before a filter of this spread and skew."""
    if not (spread_s2 or skew_s3):
        return readings
    spacing_s = knot_spacing_s(at_s)
    every_s = np.arange(at_s[0], at_s[-1] + spacing_s, spacing_s)
    evenly = np.stack([np.interp(every_s, at_s, axis) for axis in readings.T], axis=1)
    more = unsmeared(evenly, spacing_s, spread_s2, skew_s3)
    return readings + np.stack([np.interp(at_s, every_s, axis) for axis in more.T], axis=1)
