"""Whether an answer can be true: residuals beyond noise, an IMU or a gravity that cannot be."""

from __future__ import annotations

import numpy as np

from calib_core.full.assess.disagreement import disagreements, take_apart
from calib_core.full.assess.settings import PLAUSIBLE
from calib_core.full.joint.estimation import Solved
from calib_core.full.joint.residuals import away_m, misfit
from calib_core.full.joint.state import CALIBRATION, GRAVITY
from calib_core.full.joint.undetermined import UNITS
from calib_core.full.run import Run
from calib_core.intrinsics import UNKNOWN_IMU
from calib_core.solver.information import covariance_of


def implausible(run: Run, solved: Solved) -> str | None:
    """Why an answer that the descent is content with cannot be true, or None."""
    hint = "the time stamps, the IMU's units or the planes are probably wrong: check them with `unsweep inspect`"
    gravity = run.settings.gravity
    magnitude = float(np.linalg.norm(solved.estimate.gravity))
    away = abs(magnitude - gravity.magnitude_m_s2)
    if gravity.std_m_s2 > 0 and _beyond_gravity(solved, away, gravity.std_m_s2):
        return f"the best answer needs gravity to be {magnitude:.2f} m/s², which is found nowhere on Earth; {hint}"
    gyro_bias = float(np.linalg.norm(solved.estimate.gyro_bias, axis=1).max())
    accel_bias = float(np.linalg.norm(solved.estimate.accel_bias, axis=1).max())
    if gyro_bias > PLAUSIBLE.worst_gyro_bias_rad_s or accel_bias > PLAUSIBLE.worst_accel_bias_m_s2:
        return (
            f"the best answer needs IMU biases of {np.degrees(gyro_bias):.1f} deg/s and {accel_bias:.2f} m/s², more than any "
            f"working IMU has; {hint}"
        )
    rest = misfit(solved.problem, solved.estimate)
    if rest > PLAUSIBLE.worst_misfit and away_m(solved.problem, solved.estimate) > PLAUSIBLE.worst_away_m:
        return (
            f"with the best answer the points' averaged distances from their planes are {np.sqrt(rest):.0f} times what range "
            f"noise allows, so the motion does not explain the points; {hint}"
        )
    return None


def _beyond_gravity(solved: Solved, away: float, prior_std_m_s2: float) -> bool:
    """Whether gravity's magnitude is further from its prior than the accelerometer's scale and the recording's own doubts allow.

    A cheap accelerometer reads half a per cent too much, which an IMU taken for ideal hands on to gravity; and where the parts
    of a recording disagree, its standard deviation is as much too small as theirs.
    """
    magnitude = float(np.linalg.norm(solved.estimate.gravity))
    allowed = max(float(np.hypot(prior_std_m_s2, UNKNOWN_IMU.accelerometer_scale_std * magnitude)), gravity_std(solved))
    if away <= PLAUSIBLE.gravity_sigmas * allowed:
        return False
    assert solved.minimum.solution is not None
    seven = covariance_of(solved.minimum.solution.information, slice(0, CALIBRATION)) / UNITS / UNITS[:, None]
    found = disagreements(take_apart(solved.problem, solved.estimate), seven)
    wider = max((each.ratio for each in found if each.is_beyond_noise), default=1.0)
    return away > PLAUSIBLE.gravity_sigmas * max(allowed, wider * gravity_std(solved))


def borne_out(unit_text: str) -> str:
    """What is said of the gyroscope's unit, where the lidar's own turning agrees: in the other unit it would be 57 times off."""
    return f"{unit_text.split(' (', maxsplit=1)[0].rstrip('.')}: the lidar turns at the same rate."


#: What is said of a sign that gravity's turning alone had seem flipped, where the lidar's motion, which tells all of them, fits.
SIGNS_BORNE_OUT = "imu.signs_borne_out"
SIGNS_RIGHT = (
    "Judged by the direction of gravity alone, the sign of an axis of the IMU seemed to be flipped; judged by the lidar's motion,"
    " none is."
)


def gravity_std(solved: Solved) -> float:
    """Standard deviation of gravity's magnitude, from its block of the shared covariance."""
    assert solved.minimum.solution is not None
    block = covariance_of(solved.minimum.solution.information, GRAVITY)
    up = solved.estimate.gravity / np.linalg.norm(solved.estimate.gravity)
    return float(np.sqrt(max(float(up @ block @ up), 0.0)))
