"""The sensors' own parameters in the factors: which column of which factor each is, and readings without what they do."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from calib_core.factors.laser_kernels import COLUMNS, HEIGHT, MATERIALS, SHARES
from calib_core.full.joint.sensor_state import SensorState
from calib_core.full.prepare.nuisance import IMU_BLOCKS, LASER_BLOCKS, MATERIAL, SURFACE, TONE, Nuisance
from calib_core.imu.intrinsics import BiasEquivalents, bias_equivalents, corrected
from calib_core.imu.preintegration import UpsampledImu
from calib_core.imu.tones import ToneColumns, attitudes, without_tone
from calib_core.intrinsics import NAMES
from calib_core.types import FloatArray, IntArray


@dataclass(frozen=True)
class SensorColumns:
    """How the sensors' own parameters, a vector of N (nuisance.py), enter the factors. Places are in that vector, -1: none.

    imu_places: (n,) of those of the IMU, which act as biases of each link: `imu` and, behind them, `tones` have what a unit of
    each is.   links_at: the sensors as the links were integrated for.   clock_place, clock_middle_s: of the clocks' rate, and the
    lidar's time at which it adds nothing.   laser_places: (lasers, 14), columns as in factors/laser_kernels.py.
    """

    imu_places: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    imu: BiasEquivalents = field(default_factory=BiasEquivalents)
    tones: ToneColumns = field(default_factory=ToneColumns)
    links_at: SensorState = SensorState()  # noqa: RUF009  frozen
    clock_place: int = -1
    clock_middle_s: float = 0.0
    laser_places: IntArray = field(default_factory=lambda: np.full((1, COLUMNS), -1))

    def of_links(self, first: int, last: int) -> tuple[FloatArray, FloatArray]:
        """What a unit of each is as a bias of the links first..last (exclusive): gyroscope, accelerometer, (.., 3, n) each."""
        gyro, accel = self.imu.of_links(first, last)
        if not self.tones.hz:
            return gyro, accel
        tones = self.tones.of_links(first, last)
        return np.concatenate([gyro, tones[:, :3]], axis=2), np.concatenate([accel, tones[:, 3:]], axis=2)

    def biases(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What values (n,) of them are as biases of all links: gyroscope, accelerometer, (L, 3) each."""
        own = len(self.imu.own)
        gyro, accel = self.imu.times(values[:own])
        if not values[own:].any():
            return gyro, accel
        tones = self.tones.times(values[own:])
        return gyro + tones[:, :3], accel + tones[:, 3:]


def true_readings(readings: UpsampledImu, sensors: SensorState, R: FloatArray) -> UpsampledImu:
    """The readings of an ideal IMU in the same place, as the sensors are: without its scales and axes, and without what shook it
    faster than it samples. R: (K, 3, 3) its attitudes at the knots.   The delay is the upsampling's own."""
    ideal = corrected(readings, sensors.imu())
    at_times = attitudes(ideal, R, sensors.blocks.tones_zero_s)
    for hz, own in zip(sensors.blocks.tones_hz, sensors.tones(), strict=True):
        ideal = without_tone(ideal, hz, own, at_times)
    return ideal


def sensor_columns(
    sensors: SensorState,
    readings: UpsampledImu,
    R: FloatArray,
    clock_middle_s: float,
    imu: BiasEquivalents | None = None,
) -> SensorColumns:
    """The columns where the readings are corrected for these values. R: (K, 3, 3) the IMU's attitudes at the knots.

    imu: of the IMU's own parameters, where they are at hand.
    """
    nuisance = sensors.blocks
    if not nuisance.blocks:
        return SensorColumns()
    tones = sensors.tones()
    # Every block of the IMU has its place among the parameters of `bias_equivalents`, in play or not.
    places, picked, at = [], [], 0
    for block in IMU_BLOCKS:
        start = nuisance.start(block)
        for k in range(len(NAMES[block])):
            if start >= 0:
                places.append(start + k)
                picked.append(at + k)
        at += len(NAMES[block])
    if imu is None or not imu.own.size:
        imu = bias_equivalents(readings, sensors.imu(), np.array(picked, np.int64))
    first = nuisance.start(TONE)
    places.extend(range(first, first + tones.size))
    columns = ToneColumns()
    if nuisance.tones_hz:
        columns = ToneColumns(nuisance.tones_hz, tones, attitudes(readings, R, nuisance.tones_zero_s))
    links_at = sensors.values.copy()
    if (delay := nuisance.start("accelerometer_delay")) >= 0:
        links_at[delay] = readings.accel_delay_s
    return SensorColumns(
        imu_places=np.array(places, np.int64),
        imu=imu,
        tones=columns,
        links_at=SensorState(nuisance, links_at),
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
