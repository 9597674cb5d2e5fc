"""Whether the IMU's biases wander as they are said to: a part that warms up drifts ten times as fast as it walks when it is warm.

Biases are states at nodes, each a step of a random walk from the one before (priors.py). Of steps whose prior covariance is 1,
and of which the data leave a posterior covariance V, the estimate is a draw of covariance

    k^2 A^2 + A - A^2,      A = 1 - V

where the walk is truly k times as fast: A where it is not. Where the data are off by m times what noise allows, as of walls that
are not flat, the last two terms are m^2 times as large. Held to a walk that is too slow, a drift is laid upon scales and axes of
the accelerometer, and through gravity upon the rotation, and upon what forces do to a gyroscope.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.residuals import misfit
from calib_core.full.joint.round import gathered
from calib_core.full.joint.settings import WANDERING
from calib_core.full.joint.state_views import layout_of
from calib_core.full.run import Run
from calib_core.presets import random_walks
from calib_core.solver.information import covariance
from calib_core.types import FloatArray


def with_walks_told(data: JointData, state: Estimation, problem: JointProblem | None = None) -> Estimation:
    """With walks as fast as the biases' own steps tell; the same state where these are no greater than chance makes them.

    problem: that the state is the answer of, where somebody has it: of all points, a second one would be the most memory.
    """
    information, layout = state.information, layout_of(data, state)
    # What comes and goes once, as a lift that starts, is no drift.
    if information is None or layout.nodes < 2 or state.untuned:
        return state
    spread = covariance(information).matrix
    times_s, e, before = data.nodes.times_s, state.estimate, state.priors
    walks = (
        (e.gyro_bias, layout.gyro_bias(), before.gyro_walk),
        (e.accel_bias, layout.accel_bias(), before.accel_walk),
    )

    def faster(off: float) -> list[float]:
        return [
            times_faster(values, spread[columns, columns], walk * np.sqrt(np.diff(times_s)), off=off)
            for values, columns, walk in walks
        ]

    told = faster(1.0)
    if max(told) > 1.0:  # which it hardly ever is; what misfits is asked only then
        told = faster(max(misfit(problem or gathered(data, state), e), 1.0))
    if max(told) <= 1.0:
        return state
    priors = replace(before, gyro_walk=before.gyro_walk * told[0], accel_walk=before.accel_walk * told[1])
    return replace(state, priors=priors)


def with_usual_walks(run: Run, state: Estimation) -> Estimation:
    """With walks as such sensors have them: something is unknown now that may have made the biases wander."""
    gyro, accel = random_walks(run.settings.imu_noise)
    return replace(state, priors=replace(state.priors, gyro_walk=gyro, accel_walk=accel))


def wanders(run: Run, state: Estimation) -> bool:
    """Whether a bias was found to wander faster than such sensors' do."""
    return any(now > was > 0.0 for _, was, now in _walks(run, state))


def _walks(run: Run, state: Estimation) -> tuple[tuple[str, float, float], ...]:
    """Of each sensor its name, how such sensors' biases walk, and how these do."""
    gyro, accel = random_walks(run.settings.imu_noise)
    return ("gyroscope", gyro, state.priors.gyro_walk), ("accelerometer", accel, state.priors.accel_walk)


def times_faster(values: FloatArray, spread: FloatArray, step_std: FloatArray, *, off: float) -> float:
    """k; 1 where the steps are within chance. values: (N, 3) at the nodes.   spread: (3 N, 3 N) covariance, node by node.
    step_std: (N - 1,) what the walk makes of a step.   off: m^2, by how much more the data are off than noise allows.
    """
    if not (step_std > 0.0).all():
        return 1.0
    nodes = len(values)
    step = (np.eye(nodes)[1:] - np.eye(nodes)[:-1]) / step_std[:, None]
    square = float(np.sum((step @ values) ** 2))
    known = [np.eye(nodes - 1) - step @ spread[axis::3, axis::3] @ step.T for axis in range(3)]
    mean, by_square = sum(float(np.trace(A)) for A in known), sum(float(np.sum(A**2)) for A in known)
    if mean <= 0.0 or by_square <= 0.0:
        return 1.0
    # Of variance 2 tr A^2: a gamma law.
    shape, scale = 0.5 * mean**2 / by_square, 2.0 * by_square / mean
    if square <= off * scale * float(scipy.special.gammainccinv(shape, WANDERING.chance)):
        return 1.0
    k = float(np.sqrt(max(off + (square - off * mean) / by_square, 1.0)))
    return k if WANDERING.least < k < WANDERING.most else 1.0


def say_walks(data: JointData, state: Estimation) -> None:
    """That biases wander faster than they are said to, for a person. Instead of what an earlier end had."""
    data.run.retract("imu.bias_walk")
    for kind, was, now in _walks(data.run, state):
        if now > was > 0.0:
            data.run.say(
                "warning",
                "imu.bias_walk",
                f"the {kind}'s bias seems to drift {now / was:.0f} times as fast as that of such sensors once they are warm; a "
                "sensor that warms up does this, and bent walls or a loose mount look the same; the error bars allow for it; let "
                "the IMU run for some minutes before you record",
            )
