"""The sensors' own parameters as they are thought to be: the blocks in play, and their values beside them.

Blocks come and go while a recording is solved: tones that are heard, sensors that are let go, materials, walls that turn out to
be bent, what of an IMU shows only at the end. Here values know what they are of: `onto` is the only place where they go from one
set of blocks to another, and what points were laid out with (`Bins`, `Micro`) stays as it was, whatever has come since.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from calib_core.factors.laser_features import LaserErrors
from calib_core.full.prepare.nuisance import LASER_BLOCKS, MATERIAL, TONE, AnyBlock, Nuisance
from calib_core.imu.intrinsics import ImuIntrinsics
from calib_core.imu.tones import PARAMETERS, in_other_room
from calib_core.types import FloatArray


@dataclass(frozen=True)
class SensorState:
    """values: (N,) of the blocks' parameters, in their order and units. Nothing in play: sensors that are taken for ideal.

    Raises ValueError where there are not as many values as parameters.
    """

    blocks: Nuisance = Nuisance()  # noqa: RUF009  frozen
    values: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if self.values.shape != (self.blocks.size,):
            raise ValueError(
                f"expected {self.blocks.size} values of the sensors' parameters, found {self.values.shape}"
            )

    def onto(self, blocks: Nuisance) -> SensorState:
        """The same values among other blocks: what is in both keeps its own by name, what is new begins at its prior's mean.

        That is zero, an ideal sensor's. A parameter that is in these alone is forgotten.
        """
        if blocks is self.blocks:
            return self
        before, beyond = self.blocks.index, len(self.values)
        places = np.array([before.get(name, beyond) for name in blocks.index], np.int64)
        return SensorState(blocks, np.append(self.values, 0.0)[places])

    def moved(self, step: FloatArray) -> SensorState:
        """After a step (N,)."""
        return SensorState(self.blocks, self.values + step)

    def since(self, before: SensorState) -> FloatArray:
        """(N,) by how much each has changed since; all of it where it was not in play."""
        return self.values - before.onto(self.blocks).values

    def of(self, block: AnyBlock) -> FloatArray:
        """A block's values; zeros where it is not in play (of lasers and of what is no sensor's: none)."""
        return self.blocks.values(self.values, block)

    def imu(self) -> ImuIntrinsics:
        """The IMU's."""
        return ImuIntrinsics(
            gyro_scale=self.of("gyroscope_scale"),
            gyro_axes=self.of("gyroscope_axes"),
            gyro_rotation=self.of("gyroscope_rotation"),
            accel_scale=self.of("accelerometer_scale"),
            accel_axes=self.of("accelerometer_axes"),
            accel_delay_s=float(self.of("accelerometer_delay")[0]),
            accel_quadratic=self.of("accelerometer_quadratic"),
            g_sensitivity=self.of("g_sensitivity"),
            size_effect=self.of("size_effect"),
            low_pass_spread=self.of("low_pass_spread"),
            low_pass_skew=self.of("low_pass_skew"),
        )

    def lasers(self, planes: int) -> LaserErrors:
        """The lidar's, laser by laser; where lasers are not told apart, of one that stands for all.

        planes: how many take points.
        """
        materials = self.of(MATERIAL) if self.blocks.materials else 0.0
        lasers = max(self.blocks.lasers, 1)
        offset, elevation, azimuth, scale = (
            np.zeros(lasers) + (self.of(block) if self.blocks.start(block) >= 0 else 0.0) for block in LASER_BLOCKS
        )
        every = float(self.of("range_offset")[0])
        return LaserErrors(
            offset + every,
            scale,
            elevation,
            azimuth,
            np.zeros(planes) + self.of("incidence") + materials,
            self.of("eccentricity"),
            float(self.of("grazing")[0]),
        )

    def tones(self) -> FloatArray:
        """(T, 25) of each tone in play (imu/tones.py)."""
        return self.of(TONE).reshape(-1, PARAMETERS)

    def clock_rate_ppm(self) -> float:
        """By how much the lidar's clock runs faster than the IMU's."""
        return float(self.of("clock_rate")[0])

    def seen_from(self, R: FloatArray) -> SensorState:
        """Where the map frame is turned by R (3, 3): what shakes the IMU from the room has its axes there."""
        if not self.blocks.tones_hz:
            return self
        turned = self.values.copy()
        turned[self.blocks.places[TONE]] = np.concatenate([in_other_room(own, R) for own in self.tones()])
        return SensorState(self.blocks, turned)
