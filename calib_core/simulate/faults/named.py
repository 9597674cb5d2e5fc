"""What was drawn under the names, units and signs of `calib_core.intrinsics`; blocks that it lacks have names of their own."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from calib_core.intrinsics import NAMES, UNITS, Block
from calib_core.simulate.faults.draw import Drawn
from calib_core.simulate.faults.imu import ImuDeviations
from calib_core.simulate.faults.lidar import LidarDeviations

#: Block, name, unit, value.
Parameter = tuple[str, str, str, float]


def parameters(drawn: Drawn, rings: Sequence[int]) -> Iterator[Parameter]:
    """All that is not 0. rings: published number of each channel."""
    yield from _of_imu(drawn.imu)
    if drawn.clock_rate_ppm:
        yield from _block("clock_rate", (drawn.clock_rate_ppm,))
    yield from _of_lidar(drawn.lidar, rings)
    if drawn.stamp_latency_s:
        yield "stamp_latency", "mean", "s", drawn.stamp_latency_s
    if drawn.stamp_bundles_s:
        yield "stamp_bundles", "all", "s", drawn.stamp_bundles_s
    if drawn.imu_repeats > 1:
        yield "imu_repeats", "all", "1", drawn.imu_repeats
    if drawn.scan_latency_s:
        yield "scan_latency", "mean", "s", drawn.scan_latency_s
    whole = (
        ("stamp_step", "s", drawn.stamp_step_s),
        ("gyro_step", "rad/s", drawn.gyro_step_rad_s),
        ("voxel_grid", "m", drawn.voxel_grid_m),
    )
    yield from ((name, "all", unit, value) for name, unit, value in whole if value)


def _block(block: Block, values: Sequence[float]) -> Iterator[Parameter]:
    if any(values):
        yield from ((block, name, UNITS[block], value) for name, value in zip(NAMES[block], values, strict=True))


def _of_imu(imu: ImuDeviations) -> Iterator[Parameter]:
    yield from _block("gyroscope_scale", imu.gyro_scale)
    yield from _block("gyroscope_axes", imu.gyro_axes_rad)
    yield from _block("gyroscope_rotation", imu.gyro_rotation_rad)
    yield from _block("accelerometer_scale", imu.accel_scale)
    yield from _block("accelerometer_axes", imu.accel_axes_rad)
    yield from _block("accelerometer_delay", (imu.accel_delay_s,))
    yield from _block("accelerometer_quadratic", imu.accel_quadratic_s2_m)
    yield from _block("g_sensitivity", imu.g_sensitivity)
    yield from _block("size_effect", imu.accel_places_m)
    if imu.low_pass_hz:
        yield "low_pass", "cutoff", "Hz", imu.low_pass_hz
    if imu.pole_s:
        yield "poles", "all", "s", imu.pole_s
    spread_s2, skew_s3 = imu.low_pass_moments
    yield from _block("low_pass_spread", (spread_s2, spread_s2))
    yield from _block("low_pass_skew", (skew_s3, skew_s3))


def _of_lidar(lidar: LidarDeviations, rings: Sequence[int]) -> Iterator[Parameter]:
    by_laser = (
        ("laser_range_offset", UNITS["laser_range_offset"], lidar.laser_range_offset_m),
        ("laser_elevation", UNITS["laser_elevation"], lidar.laser_elevation_rad),
        ("laser_azimuth", "rad", lidar.laser_azimuth_rad),
        ("laser_range_scale", UNITS["laser_range_scale"], lidar.laser_range_scale),
    )
    for block, unit, values in by_laser:
        for ring, value in sorted(zip(rings, values, strict=False)):
            yield block, str(ring), unit, value
    yield from _block("range_offset", (lidar.range_offset_m,))
    once = (
        ("eccentricity", "sine", lidar.eccentricity_rad * math.cos(lidar.eccentricity_phase_rad)),
        ("eccentricity", "cosine", lidar.eccentricity_rad * math.sin(lidar.eccentricity_phase_rad)),
        ("beam_divergence", "all", lidar.beam_divergence_rad),
        ("grazing", "all", lidar.grazing_rad),
    )
    yield from ((block, name, "rad", value) for block, name, value in once if value)
