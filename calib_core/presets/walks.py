"""Random walks of biases, from what data sheets give of them.

A data sheet has no random walk. It has the in-run bias stability B, the lowest point of the Allan deviation, which MEMS
sensors reach after some 100 s. A walk of K per root of a second has the Allan deviation K sqrt(t / 3); it is no larger than
what was measured if K <= B sqrt(3 / 100 s). That largest walk is taken.
"""

from __future__ import annotations

import math

from calib_core.intrinsics import STANDARD_GRAVITY_M_S2

_DEG = math.pi / 180.0
_MICRO_G = 1e-6 * STANDARD_GRAVITY_M_S2
#: Where MEMS sensors reach the bottom of their Allan deviation; published curves have it between 30 and 300 s.
_BOTTOM_S = 100.0


def gyroscope_walk(in_run_deg_h: float) -> float:
    """[rad/s/sqrt(s)] of an in-run bias stability in degrees an hour."""
    return in_run_deg_h * _DEG / 3600.0 * math.sqrt(3.0 / _BOTTOM_S)


def accelerometer_walk(in_run_ug: float) -> float:
    """[m/s2/sqrt(s)] of an in-run bias stability in micro-g."""
    return in_run_ug * _MICRO_G * math.sqrt(3.0 / _BOTTOM_S)


#: Gyroscope and accelerometer of an IMU that nobody has named: the largest figures among the parts in `imu.py` whose data
#: sheets give any (MTi-10 series, 18 deg/h; ADIS16448, 250 ug). Twice that of the gyroscope: parts without a figure are not
#: compensated for temperature and drift while they warm up (ICM-20948: 0.05 deg/s a kelvin). A walk taken for too small
#: bends the trajectory where planes are out of sight, one taken for too large costs next to nothing.
USUAL_WALK = (2.0 * gyroscope_walk(18.0), accelerometer_walk(250.0))
