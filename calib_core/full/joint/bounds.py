"""Where a solve has to end: what has left the start values behind, what never comes to rest, what takes too many rounds.

Each ends in a refusal that says which quantity moved, and by how much in its own standard deviations.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_core.errors import Refused
from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.state import CALIBRATION, TIME_OFFSET, TRANSLATION
from calib_core.full.joint.undetermined import NAMES
from calib_core.full.planes.plane_tests import WORDS
from calib_core.full.prepare.nuisance import sensor_block
from calib_core.intrinsics import Block
from calib_core.sigmas import std_text
from calib_core.solver.information import covariance_of
from calib_core.types import FloatArray

_CURE = "some planes are probably not flat or do not stand still: leave out what can move or bend"


def require_bounds(data: JointData, before: Estimation, after: Estimation) -> None:
    """Raises Refused where a round has left what the stages before have found, or was one too many."""
    _require_near_start(data, after)
    if after.rounds > data.most_rounds:
        _refuse(before, after, f"the solve did not converge in the {data.most_rounds} rounds that it may take")


def require_rest(before: Estimation, after: Estimation, unsettled_sigmas: float) -> None:
    """Raises Refused where the last round has moved the calibration by more than it claims to be known to.

    Planes that were chosen and are doubtful are the reason where there are any: what else there is to try would not help.
    """
    moved, std = last_move(before, after)
    if (np.abs(moved) / std).max() > unsettled_sigmas:
        said = [f"{plane.name} {WORDS[plane.fault]}" for plane in after.planes if plane.fault]
        if said:
            raise Refused(
                "planes.unsettled",
                f"the solve did not converge with the chosen planes: {', '.join(said)}; leave out what can move or bend, and "
                "solve again",
            )
        _refuse(before, after, f"the solve did not converge in {after.rounds} rounds")


def restless(state: Estimation, moved: float) -> Refused:
    """The refusal of a state that comes no nearer to rest. moved: by the last round, in standard deviations of a point."""
    return Refused(
        "solve.unsettled",
        f"the solve did not converge in {state.rounds} rounds: the last one still moved points by {moved:.2g} times their own "
        f"scatter; {_CURE}",
    )


def last_move(before: Estimation, after: Estimation) -> tuple[FloatArray, FloatArray]:
    """What the calibration moved by, and its standard deviations: (7,) each [rad, m, s]; infinite where unknown."""
    priors = after.priors
    moved = priors.calibration_vector(after.estimate) - priors.calibration_vector(before.estimate)
    return moved, _std(after)


def _std(state: Estimation) -> FloatArray:
    if state.information is None:
        return np.full(CALIBRATION, np.inf)
    return np.asarray(np.sqrt(np.diag(covariance_of(state.information, slice(0, CALIBRATION)))))


def require_solution(state: Estimation) -> None:
    """Raises Refused where the last descent has left no equations that can be solved."""
    if state.information is None:
        raise Refused("solve.diverged", f"the joint solve found no stable answer; {_CURE}")


def require_points(points: int, planes: Sequence[str]) -> None:
    """Raises Refused where a motion has left nothing of what the lidar saw on the planes. planes: their names."""
    if points == 0:
        raise Refused(
            "solve.diverged",
            f"with the motion that the solve found, no point lies on {' or '.join(planes)}: choose planes that the cloud shows, "
            "on surfaces that do not bend or move",
        )


class SensorsAstray(Refused):
    """A parameter of a sensor has left what sensors that work can have. block: which.   value: in its unit.   times: that over
    its prior's deviation.   needed: both in words.
    """

    def __init__(self, block: Block, value: float, times: float) -> None:
        self.needed = f"a {block.replace('_', ' ')} {times:.0f} times as large as is usual for such sensors"
        super().__init__("solve.sensors_astray", f"the solve needs {self.needed}; {_CURE}")
        self.block, self.value, self.times = block, value, times


def require_sensors(state: Estimation, most: float) -> None:
    """Raises SensorsAstray where a parameter is further from its prior than a sensor that works can be. For the end of a solve:
    on the way, with a door still among the planes, one may well go astray and come back."""
    for block in state.nuisance.sensors.blocks:
        values = state.estimate.sensors.of(block.block)
        away = np.abs(values) / block.prior_std
        if away.max(initial=0.0) > most:
            worst = int(np.argmax(away))
            raise SensorsAstray(sensor_block(block), float(values[worst]), float(away[worst]))


def _require_near_start(data: JointData, state: Estimation) -> None:
    e, limits = state.estimate, data.limits
    away_s = e.time_offset_s - data.start.time_offset_s
    clocks = data.run.clocks
    # A sweep of one instant is looked at from one to the next.
    sweep_s = float(np.median(clocks.sweep_s)) or float(np.median(np.diff(clocks.scan_s)))
    if abs(away_s) > limits.offset_sweeps * sweep_s:
        raise Refused(
            "solve.offset_ran_away",
            f"no motion of the rig explains what the lidar saw of the planes: the solve's best time offset is {abs(away_s):.2f} "
            f"s, more than a sweep of {sweep_s:.2f} s, from the one at which the rotations of lidar and IMU agree; {_CURE}",
        )
    arm_m = float(np.linalg.norm(e.p_imu_lidar))
    std_m = float(_std(state)[TRANSLATION].max())
    far_m = limits.lever_arm_m + float(np.linalg.norm(data.start.p_imu_lidar))
    if arm_m > far_m and std_m < limits.lever_arm_std_m:
        raise Refused(
            "solve.lever_arm_ran_away",
            f"the solve places the lidar {arm_m:.1f} m away from the IMU, to within {std_text(std_m, 'm')}, which is not "
            f"plausible; {_CURE}",
        )


def _refuse(before: Estimation, after: Estimation, what: str) -> None:
    moved, std = last_move(before, after)
    sigmas = np.abs(moved) / std
    worst = int(np.argmax(sigmas))
    raise Refused(
        "solve.unsettled",
        f"{what}: in the last one, the {NAMES[worst]} still moved by {amount(float(moved[worst]), worst)}, "
        f"{sigmas[worst]:.1f} times its standard deviation; {_CURE}",
    )


def amount(moved: float, which: int) -> str:
    """How far the calibration's parameter of that column is moved [rad, m, s], for a person."""
    if which < TRANSLATION.start:
        return f"{np.degrees(abs(moved)):.3g} deg"
    return f"{abs(moved) * 1e3:.3g} {'ms' if which == TIME_OFFSET else 'mm'}"
