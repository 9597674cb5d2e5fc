"""How much each factor of the joint problem moved the calibration, and how much noise alone would have let it.

With H the information at the optimum and X = H^-1 E its columns for the seven, a factor of whitened Jacobian J and residual r
has moved the seven by -(J X)' r; noise alone makes that a draw of covariance (J X)' (J X). Summed over all factors, priors
included, the first is zero and the second is the stated covariance: both are tested.

A cluster of points on a plane has the residual a . y + f . v per point (factors/laser_features.py); with Q = (d a / d state) X
and F = (d v / d state) X its part is the same in its moments: u = -(Q' M a + F' cross a), P = Q' M Q + Q' cross' F + ... .

Laser by laser not all of M is kept, but its points' sums are: c + (1 - c) = 1 are two of the features. What a laser says on a
plane within ten milliseconds is then the mean of it, one residual a . m + f . v of weight W with m and f the means: noise
lets it pull by W (Q' m + F' f)(..)', exactly. What is off in a laser is off in the mean.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from calib_core.factors.imu import link_factors
from calib_core.factors.laser_features import feature_changes
from calib_core.factors.planes_seen import OF_CALIBRATION, OF_CLOCK, OF_KNOT, OF_PLANE
from calib_core.full.assess.kernels import (
    add_influences_kernel,
    add_own_influences_kernel,
    laser_influences_kernel,
)
from calib_core.full.joint.by_laser import ByLaser
from calib_core.full.joint.lidar_factors import LidarFactors
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.state import CALIBRATION, GRAVITY, Estimate, Layout
from calib_core.full.joint.undetermined import UNITS
from calib_core.solver.arrow import unit_responses
from calib_core.types import FloatArray, IntArray


@dataclass(frozen=True)
class Influences:
    """Of F factors on the seven, in units of 1 deg, 10 mm, 1 ms: moved (F, 7), and what noise allows, allowed (F, 7, 7)."""

    moved: FloatArray
    allowed: FloatArray

    def summed(self, cluster: IntArray, count: int) -> Influences:
        """By cluster: (F,) numbers below `count`, negative for none."""
        moved, allowed = np.zeros((count, CALIBRATION)), np.zeros((count, CALIBRATION, CALIBRATION))
        mine = cluster >= 0
        np.add.at(moved, cluster[mine], self.moved[mine])
        np.add.at(allowed, cluster[mine], self.allowed[mine])
        return Influences(moved, allowed)


@dataclass(frozen=True)
class FactorInfluences:
    """links: one a link.   bins: one a bin, its lasers' part included.   lasers: one a laser, none where they are not told
    apart.   covariance: (7, 7) of the seven, in their units.
    """

    links: Influences
    bins: Influences
    lasers: Influences
    covariance: FloatArray


def factor_influences(
    problem: JointProblem, estimate: Estimate, told_apart: Iterable[ByLaser] = ()
) -> FactorInfluences:
    """Of every factor at the optimum. told_apart: the lidar's, laser by laser. Raises NotPositiveDefinite."""
    along, border = unit_responses(problem.linearise(estimate), CALIBRATION)
    layout = problem.layout(estimate)
    along = along + problem.unseen(estimate).falls(border[GRAVITY])
    along, border = along / UNITS, border / UNITS
    return FactorInfluences(
        _of_links(problem, estimate, layout, along, border),
        _of_bins(problem, estimate, layout, along, border),
        _of_lasers(problem, estimate, layout, along, border, told_apart),
        border[:CALIBRATION] / UNITS[:, None],
    )


def _of_links(
    problem: JointProblem, estimate: Estimate, layout: Layout, along: FloatArray, border: FloatArray
) -> Influences:
    gyro, accel = (
        problem.nodes.at_links(border[columns].reshape(-1, 3 * CALIBRATION)).reshape(-1, 3, CALIBRATION)
        for columns in (layout.gyro_bias(), layout.accel_bias())
    )
    places = problem.sensors.imu_places
    if len(places):
        own = border[layout.nuisance()][places]
        gyro, accel = gyro + problem.sensors.gyro @ own, accel + problem.sensors.accel @ own
    changes = problem.bias_changes(estimate)
    moved, allowed = np.empty((len(gyro), CALIBRATION)), np.empty((len(gyro), CALIBRATION, CALIBRATION))
    for first, last in problem.links_at_once():
        some = slice(first, last)
        states = estimate.states.part(first, last + 1)
        f = link_factors(problem.links.part(first, last), states, estimate.gravity, *(each[some] for each in changes))
        response = (
            f.r_D_first @ along[first:last]
            + f.r_D_second @ along[first + 1 : last + 1]
            + f.r_D_gravity @ border[GRAVITY]
            + f.r_D_gyro_bias @ gyro[some]
            + f.r_D_accel_bias @ accel[some]
        )
        back = np.swapaxes(response, 1, 2)
        moved[some], allowed[some] = -(back @ f.residual[..., None])[..., 0], back @ response
    return Influences(moved, allowed)


def _of_bins(
    problem: JointProblem, estimate: Estimate, layout: Layout, along: FloatArray, border: FloatArray
) -> Influences:
    bins = problem.bins
    a, J = problem.lidar.bins_seen(estimate)
    Q = _response(J, bins.knot, bins.plane, problem, layout, along, border)
    back = np.swapaxes(Q, 1, 2)
    moved = -(back @ (bins.scatter[:, :4] @ a[..., None]))[..., 0]
    allowed = back @ bins.scatter[:, :4, :4] @ Q
    lasers = bins.lasers
    if len(lasers.laser) == 0:
        return Influences(moved, allowed)
    # The parameters have moved since the points were laid out with them, and the residuals with the parameters.
    F, change = _feature_response(problem.lidar, layout, border), feature_changes(problem.lidar.laser_changes(estimate))
    add_influences_kernel(
        lasers.bin, lasers.laser, lasers.cross, a, Q, F, change, moved, allowed,
    )  # fmt: skip
    add_own_influences_kernel(lasers.bin[lasers.of], lasers.laser[lasers.of], lasers.gram, F, change, moved, allowed)
    return Influences(moved, allowed)


def _of_lasers(
    problem: JointProblem,
    estimate: Estimate,
    layout: Layout,
    along: FloatArray,
    border: FloatArray,
    told_apart: Iterable[ByLaser],
) -> Influences:
    moved, allowed = np.zeros((0, CALIBRATION)), np.zeros((0, CALIBRATION, CALIBRATION))
    for part in told_apart:
        if len(moved) == 0:
            moved, allowed = np.zeros((part.lasers, CALIBRATION)), np.zeros((part.lasers, CALIBRATION, CALIBRATION))
        lidar, bins = part.factors, part.factors.bins
        a, J = lidar.bins_seen(estimate)
        Q = _response(J, bins.knot, bins.plane, problem, layout, along, border)
        F, change = _feature_response(lidar, layout, border), feature_changes(lidar.laser_changes(estimate))
        laser_influences_kernel(
            bins.lasers.bin, bins.lasers.laser, bins.lasers.cross, a, Q, F, change, moved, allowed,
        )  # fmt: skip
    return Influences(moved, allowed)


def _response(
    J: FloatArray,
    knot: IntArray,
    plane: IntArray,
    problem: JointProblem,
    layout: Layout,
    along: FloatArray,
    border: FloatArray,
) -> FloatArray:
    """(B, 4, 7) what [n_lidar, w_lidar] follow of the seven's columns."""
    planes = border[layout.every_plane()].reshape(-1, 3, CALIBRATION)
    out = (
        J[:, :, OF_KNOT] @ along[knot]
        + J[:, :, OF_CALIBRATION] @ border[:CALIBRATION]
        + J[:, :, OF_PLANE] @ planes[plane]
    )
    if problem.sensors.clock_place >= 0:
        out = out + J[:, :, OF_CLOCK] * border[layout.nuisance().start + problem.sensors.clock_place]
    return np.asarray(out)


def _feature_response(lidar: LidarFactors, layout: Layout, border: FloatArray) -> FloatArray:
    """(lasers, 8, 7) what each laser's features follow of them."""
    places = lidar.sensors.laser_places
    columns = np.vstack([border[layout.nuisance()], np.zeros(CALIBRATION)])  # the last is of what is not in play, -1
    return feature_changes(columns[places])
