"""How much each factor of the joint problem moved the calibration, and how much noise alone would have let it.

With H the information at the optimum and X = H^-1 E its columns for the seven, a factor of whitened Jacobian J and residual r
has moved the seven by -(J X)' r; noise alone makes that a draw of covariance (J X)' (J X). Summed over all factors, priors
included, the first is zero and the second is the stated covariance: both are tested.

A cluster of points on a plane has the residual a . y + f . v per point (factors/laser_features.py); with Q = (d a / d state) X
and F = (d v / d state) X its part is the same in its moments: u = -(Q' M a + F' cross a), P = Q' M Q + Q' cross' F + ... .

The sensors' own parameters are moved in the same way, by other columns of H^-1. They are many, and of them only what noise allows
each by itself is asked.

Laser by laser not all of M is kept, but its points' sums are: c + (1 - c) = 1 are two of the features. What a laser says on a
plane within ten milliseconds is then the mean of it, one residual a . m + f . v of weight W with m and f the means: noise
lets it pull by W (Q' m + F' f)(..)', exactly. What is off in a laser is off in the mean.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calib_core.factors.imu import link_factors
from calib_core.factors.planes_seen import OF_CALIBRATION, OF_CLOCK, OF_KNOT, OF_PLANE
from calib_core.full.assess.kernels import (
    add_influences_kernel,
    add_own_influences_kernel,
    laser_influences_kernel,
    sum_by_kernel,
)
from calib_core.full.assess.settings import PARTS
from calib_core.full.joint.by_laser import ByLaser
from calib_core.full.joint.equations import link_biases
from calib_core.full.joint.lidar_factors import LidarFactors
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.settings import CHAIN
from calib_core.full.joint.state import CALIBRATION, GRAVITY, Estimate, Layout
from calib_core.full.joint.undetermined import UNITS
from calib_core.imu.preintegration import Links
from calib_core.solver.arrow import Eliminated, NotPositiveDefinite
from calib_core.threads import workers
from calib_core.types import FloatArray, IntArray


@dataclass(frozen=True)
class Influences:
    """Of F factors on N unknowns: moved (F, N), and what noise allows, allowed (F, N, N), or (F, N) each by itself.

    The seven are in units of 1 deg, 10 mm, 1 ms.
    """

    moved: FloatArray
    allowed: FloatArray

    @staticmethod
    def none(factors: int, unknowns: int, *, alone: bool) -> Influences:
        """To be added to. alone: each unknown by itself."""
        of_each = (unknowns,) if alone else (unknowns, unknowns)
        return Influences(np.zeros((factors, unknowns)), np.zeros((factors, *of_each)))

    def add_by(self, cluster: IntArray, part: Influences) -> None:
        """Adds those of a part's factors (F,) to these, by their numbers among them: negative for none."""
        for own, total in ((part.moved, self.moved), (part.allowed, self.allowed)):
            sum_by_kernel(own.reshape(len(cluster), -1), cluster, total.reshape(len(total), -1))


class Clustering(NamedTuple):
    """Which of so many clusters each of F factors is of: (F,) numbers below `size`, negative for none."""

    of: IntArray
    size: int


@dataclass(frozen=True)
class _Responses:
    """What one unit of N unknowns' columns of H^-1 does to all of a problem. along: (K, 9, N).   border: (S, N).

    links, changes: the problem's links, as far as some plane sees them, and their biases' changes.   alone: what noise allows is
    asked of each unknown by itself.
    """

    problem: JointProblem
    estimate: Estimate
    layout: Layout
    along: FloatArray
    border: FloatArray
    links: Links
    changes: tuple[FloatArray, FloatArray]
    alone: bool

    @property
    def unknowns(self) -> int:
        """N."""
        return self.border.shape[1]

    def allowed(self, response: FloatArray) -> FloatArray:
        """By whitened residuals (F, m) that follow by `response` (F, m, N)."""
        if self.alone:
            return np.asarray(np.einsum("fmn,fmn->fn", response, response))
        return np.asarray(np.swapaxes(response, 1, 2) @ response)


@dataclass(frozen=True)
class FactorInfluences:
    """Of every factor, summed as it is asked for: of ten minutes those of single ones would be the most memory of an assessment.

    lasers: one a laser, none where they are not told apart.   covariance: (N, N) of the unknowns, in their units.
    """

    responses: _Responses
    lasers: Influences
    covariance: FloatArray

    def of_links(self, ways: Sequence[Clustering]) -> list[Influences]:
        """Summed by each way of clustering the links. Raises NotPositiveDefinite."""
        return self._summed(
            ways, len(self.responses.links.Dv), lambda first, last: _of_links(self.responses, first, last)
        )

    def of_bins(self, ways: Sequence[Clustering]) -> list[Influences]:
        """Summed by each way of clustering the bins, whose lasers' part is included. Raises NotPositiveDefinite."""
        of = self.responses
        rates, seen = of.problem.lidar.rates(of.estimate), _features(of.problem.lidar, of)
        return self._summed(ways, len(of.along), lambda first, last: _of_bins(of, first, last, rates, seen))

    def _summed(
        self, ways: Sequence[Clustering], count: int, part: Callable[[int, int], Influences]
    ) -> list[Influences]:
        """part: the influences of factors at knots first..last (exclusive) of so many."""
        of = self.responses
        totals = [Influences.none(way.size, of.unknowns, alone=of.alone) for way in ways]
        edges = [*range(0, count, CHAIN.knots_at_once), count]
        at = 0
        for some in workers().map(part, edges[:-1], edges[1:]):
            end = at + len(some.moved)
            for total, way in zip(totals, ways, strict=True):
                if end > at:
                    total.add_by(way.of[at:end], some)
            at = end
        for total in totals:
            _require_numbers(total)
        return totals


def factor_influences(
    problem: JointProblem,
    estimate: Estimate,
    told_apart: Iterable[ByLaser] = (),
    *,
    eliminated: Eliminated | None = None,
) -> FactorInfluences:
    """Of every factor on the seven, at the optimum. told_apart: the lidar's, laser by laser.   eliminated: the problem's
    equations near by, where they are at hand.

    Raises NotPositiveDefinite.
    """
    equations = problem.linearise(estimate)
    if eliminated is None or not eliminated.is_of_kind(equations):
        eliminated = Eliminated.of(equations)
    along, border = eliminated.unit_responses(equations, np.arange(CALIBRATION))
    of = _responses(problem, estimate, along / UNITS, border / UNITS, alone=False)
    return _influences(of, told_apart, of.border[:CALIBRATION] / UNITS[:, None])


def parameter_influences(
    problem: JointProblem, estimate: Estimate, columns: IntArray, told_apart: Iterable[ByLaser] = ()
) -> Iterator[tuple[IntArray, FactorInfluences]]:
    """The same on shared unknowns of these columns (N,), some at a time, each by itself: which of the N.

    Raises NotPositiveDefinite.
    """
    equations, parts = problem.linearise(estimate), list(told_apart)
    eliminated = Eliminated.of(equations)
    every = np.arange(len(columns))
    for first in range(0, len(every), PARTS.parameters_at_once):
        which = every[first : first + PARTS.parameters_at_once]
        some = columns[which]
        along, border = eliminated.unit_responses(equations, some)
        of = _responses(problem, estimate, along, border, alone=True)
        yield which, _influences(of, parts, border[some])


def _responses(
    problem: JointProblem, estimate: Estimate, along: FloatArray, border: FloatArray, *, alone: bool
) -> _Responses:
    links, changes = problem.seen_links(estimate), problem.bias_changes(estimate)
    return _Responses(problem, estimate, problem.layout(estimate), along, border, links, changes, alone)


def _influences(of: _Responses, told_apart: Iterable[ByLaser], covariance: FloatArray) -> FactorInfluences:
    lasers = _of_lasers(of, told_apart)
    _require_numbers(lasers)
    return FactorInfluences(of, lasers, covariance)


def _require_numbers(found: Influences) -> None:
    with np.errstate(over="ignore"):  # what is squared later
        if not np.isfinite(np.sum(found.allowed**2)):
            raise NotPositiveDefinite("states follow the calibration beyond all numbers")


def _of_links(of: _Responses, first: int, last: int) -> Influences:
    """Of links first..last (exclusive)."""
    problem, along, border = of.problem, of.along, of.border
    gyro, accel = link_biases(border, of.layout, problem.nodes, problem.sensors, (first, last))
    states, changes = of.estimate.states.part(first, last + 1), (each[first:last] for each in of.changes)
    f = link_factors(of.links.part(first, last), states, of.estimate.gravity, *changes)
    response = (
        f.r_D_first @ along[first:last]
        + f.r_D_second @ along[first + 1 : last + 1]
        + f.r_D_gravity @ border[GRAVITY]
        + f.r_D_gyro_bias @ gyro
        + f.r_D_accel_bias @ accel
    )
    moved = -(np.swapaxes(response, 1, 2) @ f.residual[..., None])[..., 0]
    return Influences(moved, of.allowed(response))


def _of_bins(
    of: _Responses, first: int, last: int, rates: FloatArray, seen: tuple[FloatArray, FloatArray]
) -> Influences:
    """Of the bins at knots first..last (exclusive). rates: of all knots.   seen: what features follow, and have changed by."""
    # The parameters have moved since the points were laid out with them, and the residuals with the parameters.
    F, change = seen
    lidar = of.problem.lidar.between(first, last)
    own, clusters = lidar.bins, lidar.bins.lasers
    a, J = lidar.bins_seen(of.estimate, rates)
    Q = _response(J, own.knot, own.plane, of)
    moved = -(np.swapaxes(Q, 1, 2) @ (own.scatter[:, :4] @ a[..., None]))[..., 0]
    by_scatter = own.scatter[:, :4, :4] @ Q
    allowed = np.einsum("fmn,fmn->fn", Q, by_scatter) if of.alone else np.swapaxes(Q, 1, 2) @ by_scatter
    if len(clusters.laser):
        add_influences_kernel(clusters.clusters(), a, Q, F, change, moved, allowed)
        add_own_influences_kernel(clusters.bin, clusters.laser, clusters.gram, F, change, moved, allowed)
    return Influences(moved, np.asarray(allowed))


def _of_lasers(of: _Responses, told_apart: Iterable[ByLaser]) -> Influences:
    out = Influences.none(0, of.unknowns, alone=of.alone)
    for part in told_apart:
        if len(out.moved) == 0:
            out = Influences.none(part.lasers, of.unknowns, alone=of.alone)
        lidar, knots = part.factors, len(of.along)
        rates, (F, change) = lidar.rates(of.estimate), _features(lidar, of)
        for first in range(0, knots, CHAIN.knots_at_once):
            own = lidar.between(first, min(first + CHAIN.knots_at_once, knots))
            a, J = own.bins_seen(of.estimate, rates)
            Q = _response(J, own.bins.knot, own.bins.plane, of)
            laser_influences_kernel(own.bins.lasers.clusters(), a, Q, F, change, out.moved, out.allowed)
    return out


def _response(J: FloatArray, knot: IntArray, plane: IntArray, of: _Responses) -> FloatArray:
    """(B, 4, N) what [n_lidar, w_lidar] follow of the unknowns' columns."""
    layout, along, border, sensors = of.layout, of.along, of.border, of.problem.sensors
    planes = border[layout.every_plane()].reshape(-1, 3, of.unknowns)
    out = (
        J[:, :, OF_KNOT] @ along[knot]
        + J[:, :, OF_CALIBRATION] @ border[:CALIBRATION]
        + J[:, :, OF_PLANE] @ planes[plane]
    )
    if sensors.clock_place >= 0:
        out = out + J[:, :, OF_CLOCK] * border[layout.nuisance().start + sensors.clock_place]
    return np.asarray(out)


def _features(lidar: LidarFactors, of: _Responses) -> tuple[FloatArray, FloatArray]:
    """What the coefficients of each laser's features follow of the unknowns' columns, (lasers, F, N), and by how much they have
    changed since the points were laid out, (lasers, F).
    """
    return lidar.features_following(of.border[of.layout.nuisance()]), lidar.features_changed(of.estimate)
