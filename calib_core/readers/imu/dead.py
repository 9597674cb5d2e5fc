"""A sensor of an IMU that says nothing: zeros, or no numbers, from the first reading to the last."""

from __future__ import annotations

import numpy as np

from calib_core.errors import InputError
from calib_core.types import FloatArray


def require_both_sensors(gyro: FloatArray, accel: FloatArray, topic: str) -> None:
    """Raises InputError where one of the two says nothing and the other does: drivers fill in what a topic does not carry, and
    sensors die. gyro, accel: (Q, 3), all there are, as they were sent.
    """
    rates, accelerations = _says_something(gyro), _says_something(accel)
    if rates and not accelerations:
        raise InputError(
            f"The accelerations on {topic} are {_instead(accel)}, as from a gyroscope without an accelerometer; choose a topic "
            "that has both, or record the accelerometer too.",
            code="imu.no_accelerations",
        )
    if accelerations and not rates:
        raise InputError(
            f"The angular rates on {topic} are {_instead(gyro)}, as from an accelerometer without a gyroscope; choose a topic "
            "that has both, or record the gyroscope too.",
            code="imu.no_rates",
        )


def _says_something(values: FloatArray) -> bool:
    return bool((np.isfinite(values) & (values != 0.0)).any())


def _instead(values: FloatArray) -> str:
    return "zero" if np.isfinite(values).any() else "no numbers"
