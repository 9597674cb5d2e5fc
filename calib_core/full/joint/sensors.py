"""The values of the sensors' own parameters, as each part of the joint problem wants them: one line here for each block."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from calib_core.factors.laser_features import LaserErrors
from calib_core.factors.laser_kernels import COLUMNS, HEIGHT, MATERIALS, SHARES
from calib_core.full.prepare.nuisance import IMU_BLOCKS, LASER_BLOCKS, MATERIAL, SURFACE, TONE, Nuisance
from calib_core.imu.intrinsics import ImuIntrinsics, bias_equivalents, corrected
from calib_core.imu.preintegration import UpsampledImu
from calib_core.imu.tones import PARAMETERS, attitudes, in_other_room, tone_columns, without_tone
from calib_core.intrinsics import NAMES
from calib_core.types import FloatArray, IntArray


@dataclass(frozen=True)
class SensorColumns:
    """How the sensors' own parameters, a vector of N (nuisance.py), enter the factors. Places are in that vector, -1: none.

    imu_places: (n,).   gyro, accel: (L, 3, n) what a unit of each is as a bias of each link (imu/intrinsics.py).
    links_at: (n,) their values when the links were integrated.   clock_place, clock_middle_s: of the clocks' rate, and the
    lidar's time at which it adds nothing.   laser_places: (lasers, 14), columns as in factors/laser_kernels.py.
    """

    imu_places: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    gyro: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 0)))
    accel: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 0)))
    links_at: FloatArray = field(default_factory=lambda: np.zeros(0))
    clock_place: int = -1
    clock_middle_s: float = 0.0
    laser_places: IntArray = field(default_factory=lambda: np.full((1, COLUMNS), -1))

    def part(self, first: int, last: int) -> SensorColumns:
        """As seen by the links first..last (exclusive)."""
        return replace(self, gyro=self.gyro[first:last], accel=self.accel[first:last])


def imu_intrinsics(nuisance: Nuisance, values: FloatArray) -> ImuIntrinsics:
    """The IMU's part of a vector (N,)."""
    return ImuIntrinsics(
        gyro_scale=nuisance.values(values, "gyroscope_scale"),
        gyro_axes=nuisance.values(values, "gyroscope_axes"),
        gyro_rotation=nuisance.values(values, "gyroscope_rotation"),
        accel_scale=nuisance.values(values, "accelerometer_scale"),
        accel_axes=nuisance.values(values, "accelerometer_axes"),
        accel_delay_s=float(nuisance.values(values, "accelerometer_delay")[0]),
        accel_quadratic=nuisance.values(values, "accelerometer_quadratic"),
        g_sensitivity=nuisance.values(values, "g_sensitivity"),
        size_effect=nuisance.values(values, "size_effect"),
        low_pass_spread=nuisance.values(values, "low_pass_spread"),
        low_pass_skew=nuisance.values(values, "low_pass_skew"),
    )


def tone_values(nuisance: Nuisance, values: FloatArray) -> FloatArray:
    """(T, 25) of each tone in play, of a vector (N,)."""
    return nuisance.values(values, TONE).reshape(-1, PARAMETERS)


def seen_from(nuisance: Nuisance, values: FloatArray, R: FloatArray) -> FloatArray:
    """The values (N,) where the map frame is turned by R (3, 3): what shakes the IMU from the room has its axes there."""
    if not nuisance.tones_hz:
        return values
    turned, place = values.copy(), nuisance.places[TONE]
    turned[place] = np.concatenate([in_other_room(own, R) for own in tone_values(nuisance, values)])
    return turned


def true_readings(readings: UpsampledImu, nuisance: Nuisance, values: FloatArray, R: FloatArray) -> UpsampledImu:
    """The readings of an ideal IMU in the same place, by the values (N,): without its scales and axes, and without what shook it
    faster than it samples. R: (K, 3, 3) its attitudes at the knots.   The delay is the upsampling's own."""
    ideal = corrected(readings, imu_intrinsics(nuisance, values))
    at_times = attitudes(ideal, R, nuisance.tones_zero_s)
    for hz, own in zip(nuisance.tones_hz, tone_values(nuisance, values), strict=True):
        ideal = without_tone(ideal, hz, own, at_times)
    return ideal


def laser_errors(nuisance: Nuisance, values: FloatArray, planes: int) -> LaserErrors:
    """The lidar's part of a vector (N,), laser by laser; where lasers are not told apart, of one that stands for all.

    planes: how many take points.
    """
    materials = nuisance.values(values, MATERIAL) if nuisance.materials else 0.0
    lasers = max(nuisance.lasers, 1)
    offset, elevation, azimuth, scale = (
        np.zeros(lasers) + (nuisance.values(values, block) if nuisance.start(block) >= 0 else 0.0)
        for block in LASER_BLOCKS
    )
    every = float(nuisance.values(values, "range_offset")[0])
    return LaserErrors(
        offset + every,
        scale,
        elevation,
        azimuth,
        np.zeros(planes) + nuisance.values(values, "incidence") + materials,
        nuisance.values(values, "eccentricity"),
        float(nuisance.values(values, "grazing")[0]),
    )


def clock_rate_ppm(nuisance: Nuisance, values: FloatArray) -> float:
    """By how much the lidar's clock runs faster than the IMU's."""
    return float(nuisance.values(values, "clock_rate")[0])


def sensor_columns(
    nuisance: Nuisance, values: FloatArray, readings: UpsampledImu, R: FloatArray, clock_middle_s: float
) -> SensorColumns:
    """The columns at the values (N,) about which the readings are corrected. R: (K, 3, 3) the IMU's attitudes at the knots."""
    if not nuisance.blocks:
        return SensorColumns()
    tones = tone_values(nuisance, values)
    # Every block of the IMU has its place among the columns of `bias_equivalents`, in play or not.
    places, picked, at = [], [], 0
    for block in IMU_BLOCKS:
        start = nuisance.start(block)
        for k in range(len(NAMES[block])):
            if start >= 0:
                places.append(start + k)
                picked.append(at + k)
        at += len(NAMES[block])
    gyro, accel = bias_equivalents(readings, imu_intrinsics(nuisance, values))
    first = nuisance.start(TONE)
    places.extend(range(first, first + tones.size))
    at_times = attitudes(readings, R, nuisance.tones_zero_s)
    of_tones = [tone_columns(hz, own, at_times) for hz, own in zip(nuisance.tones_hz, tones, strict=True)]
    gyro = np.concatenate([gyro[:, :, picked], *(columns[:, :3] for columns in of_tones)], axis=2)
    accel = np.concatenate([accel[:, :, picked], *(columns[:, 3:] for columns in of_tones)], axis=2)
    imu_places = np.array(places, np.int64)
    links_at = values[imu_places].copy()
    delay = nuisance.start("accelerometer_delay")
    links_at[imu_places == delay] = readings.accel_delay_s
    return SensorColumns(
        imu_places=imu_places,
        gyro=gyro,
        accel=accel,
        links_at=links_at,
        clock_place=nuisance.start("clock_rate"),
        clock_middle_s=clock_middle_s,
        laser_places=laser_places(nuisance),
    )


def laser_places(nuisance: Nuisance) -> IntArray:
    """(U, 14) of each laser's parameters, of everybody's, of heights about points, of materials; -1 for what is not in play.

    U: lasers, or each of these in each square between heights, and in none: square * lasers + laser. Where materials are in play
    what lies in no square is counted by planes: (squares + plane) * lasers + laser (`LaserSums.by_plane`).
    """
    lasers = max(nuisance.lasers, 1)
    places = np.full((lasers, COLUMNS), -1)
    for column, block in enumerate(LASER_BLOCKS):
        start = nuisance.start(block)
        if start >= 0:
            places[:, column] = start + np.arange(lasers)
    places[:, len(LASER_BLOCKS)] = nuisance.start("range_offset")
    places[:, len(LASER_BLOCKS) + 1] = nuisance.start("incidence")
    if nuisance.start("eccentricity") >= 0:
        places[:, len(LASER_BLOCKS) + 2 : HEIGHT - 1] = nuisance.start("eccentricity") + np.arange(2)
    places[:, HEIGHT - 1] = nuisance.start("grazing")
    if nuisance.surface is not None:
        corners = nuisance.surface.corners
        places = np.tile(places, (len(corners) + 1, 1))
        heights = np.where(corners >= 0, nuisance.start(SURFACE) + corners, -1)
        places[: len(corners) * lasers, HEIGHT : HEIGHT + SHARES] = heights.repeat(lasers, axis=0)
    if nuisance.materials:
        beyond, planes = places[-lasers:], np.arange(nuisance.materials)
        places = np.concatenate([places[:-lasers], np.tile(beyond, (len(planes), 1))])
        if nuisance.surface is not None:
            planes = np.concatenate([nuisance.surface.square_planes, planes])
        places[:, MATERIALS] = nuisance.start(MATERIAL) + planes.repeat(lasers)
    return places
