"""What is assumed unknown, and which column belongs to which unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from numpy import float64
from numpy.typing import NDArray

FloatArray = NDArray[float64]

#: Calibration unknowns: rotation 3, lever arm 3, time offset 1.
CALIBRATION = 7
Known = Literal["planes", "gravity", "biases"]


@dataclass(frozen=True, slots=True)
class Assumptions:
    """What the bound supposes; the defaults are the bound itself, the others show what an estimator's choices cost.

    step_s: between instants.   gyro_walk [rad/s/sqrt(s)], accel_walk [m/s2/sqrt(s)]: None: the scenario's own.
    gravity_m_s2, gravity_std_m_s2: the magnitude's prior.   gauge_std: of the first pose, which only defines the frame.
    known: not estimated.   margin_m: returns this near another plane are not used.   min_cosine: nor those under a
    lower cosine of incidence.   imu_noise_factor, range_noise_factor: on the true standard deviations.
    """

    step_s: float = 0.0025
    gyro_walk: float | None = None
    accel_walk: float | None = None
    gravity_m_s2: float = 9.807
    gravity_std_m_s2: float = 0.02
    gauge_std: float = 1e-3
    known: tuple[Known, ...] = ()
    margin_m: float = 0.0
    min_cosine: float = 0.0
    imu_noise_factor: float = 1.0
    range_noise_factor: float = 1.0
    every: int = 1


@dataclass(frozen=True, slots=True)
class Columns:
    """Columns by name: the moving unknowns first, the lasting ones after them, the calibration last.

    biases_walk: the biases move.   planes: how many.   parameters: how many of those of blocks.py.   scans_late: each scan is
    stamped late by as much as it happens.   Order: turn 3, velocity 3, position 3, [gyro bias 3, accelerometer bias 3 where
    they walk], [lateness of the scan] | planes 3 each, gravity 3, [biases 6 where they last], parameters of real sensors,
    rotation 3, lever arm 3, time offset.
    """

    biases_walk: bool
    planes: int
    parameters: int = 0
    scans_late: bool = False

    turn = slice(0, 3)
    velocity = slice(3, 6)
    position = slice(6, 9)

    @property
    def moving(self) -> int:
        """How many unknowns move."""
        return (15 if self.biases_walk else 9) + self.scans_late

    @property
    def noises(self) -> int:
        """Independent noises a step: turn 3, velocity 3, the biases' 6 where they walk, and the lateness of the scan before."""
        return (12 if self.biases_walk else 6) + self.scans_late

    def plane(self, number: int) -> slice:
        """Two turns of the normal and the offset."""
        return slice(self.moving + 3 * number, self.moving + 3 * number + 3)

    @property
    def gravity(self) -> slice:
        """World axes."""
        start = self.moving + 3 * self.planes
        return slice(start, start + 3)

    @property
    def lateness(self) -> int:
        """Of the scan that is being taken, seconds; only where scans are late."""
        return self.moving - 1

    @property
    def gyro_bias(self) -> slice:
        """IMU axes."""
        start = 9 if self.biases_walk else self.gravity.stop
        return slice(start, start + 3)

    @property
    def accel_bias(self) -> slice:
        """IMU axes."""
        return slice(self.gyro_bias.stop, self.gyro_bias.stop + 3)

    @property
    def extra(self) -> slice:
        """The parameters of real sensors."""
        return slice(self.size - CALIBRATION - self.parameters, self.size - CALIBRATION)

    @property
    def calibration(self) -> slice:
        """Rotation, lever arm, time offset: the contract's order."""
        return slice(self.size - CALIBRATION, self.size)

    @property
    def size(self) -> int:
        """All of them."""
        return 9 + self.scans_late + 3 * self.planes + 3 + 6 + self.parameters + CALIBRATION

    def held(self, known: Sequence[Known]) -> list[int]:
        """Columns of what is taken as known."""
        blocks = {
            "planes": [slice(self.moving, self.moving + 3 * self.planes)],
            "gravity": [self.gravity],
            "biases": [self.gyro_bias, self.accel_bias],
        }
        return [column for name in known for block in blocks[name] for column in range(block.start, block.stop)]
