"""Whether the parts of a recording agree: the test of everything that the noise model leaves out.

A scale factor of the IMU, a ring's own range error, a wall that is not flat: none is a state, each shows as parts of the
recording that would each have the calibration somewhere else. The knots are cut into blocks at the joint estimate. With
H the information of the shared unknowns and g_b the gradient of block b's own factors, its chain eliminated, the pull of
a block on the calibration, all else shared (planes, gravity, biases) following, is

    s_b = g_b[c] - H[c, o] H[o, o]^-1 g_b[o],      sum of s_b = 0 at the optimum,      cov(s_b) about C^-1 / B

for C the stated covariance and B equal blocks. Their spread J = B / (B - 1) sum (s_b - mean)(s_b - mean)' is then C^-1, and
trace(C J) / 7 is 1. The sum over blocks follows chi-square with 7 (B - 1) degrees of freedom; beyond its 99.9 % quantile
the covariance is multiplied by the ratio, below it by nothing. Directions that the data do not determine are left out, of
C and of the 7.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import pairwise

import numpy as np
from scipy.special import chdtri

from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.state import CALIBRATION, Estimate
from calib_core.full.joint.undetermined import UNITS, undetermined
from calib_core.imu.preintegration import Links
from calib_core.solver.arrow import NotPositiveDefinite, solve_arrow
from calib_core.solver.information import covariance as invert
from calib_core.types import FloatArray

BLOCKS = 5
_CONFIDENCE = 0.999


@dataclass(frozen=True)
class Repeatability:
    """ratio: of the blocks' spread to what the stated covariance allows, 1 on average. limit: its 99.9 % quantile."""

    ratio: float
    limit: float

    @property
    def inflation(self) -> float:
        """Factor on every standard deviation."""
        return float(np.sqrt(self.ratio)) if self.ratio > self.limit else 1.0


def repeatability(
    problem: JointProblem, estimate: Estimate, information: FloatArray, covariance: FloatArray, *, blocks: int = BLOCKS
) -> Repeatability:
    """The blocks' spread against the stated covariance (7, 7) at the joint estimate. information: (S, S) of the shared."""
    known, rank = determined_part(covariance)
    if rank == 0:
        return Repeatability(1.0, 1.0)
    limit = float(chdtri(rank * (blocks - 1), 1.0 - _CONFIDENCE) / (rank * (blocks - 1)))
    others = invert(information[CALIBRATION:, CALIBRATION:]).matrix
    follow = np.hstack([np.eye(CALIBRATION), -information[:CALIBRATION, CALIBRATION:] @ others])
    edges = np.linspace(0, len(problem.readings.knots_s), blocks + 1).astype(int)
    try:
        pulls = np.array([follow @ _gradient(problem, estimate, a, b) for a, b in pairwise(edges)])
    except NotPositiveDefinite:
        return Repeatability(1.0, limit)
    away = pulls - pulls.mean(axis=0)
    spread = away.T @ away * blocks / (blocks - 1)
    return Repeatability(float(np.trace(known @ spread)) / rank, limit)


def determined_part(covariance: FloatArray) -> tuple[FloatArray, int]:
    """The covariance along the directions that the data determine (7, 7), and how many they are.

    Along the others it is a prior's, metres wide: the blocks' pulls there are noise, and times metres would be called a
    disagreement.
    """
    data = np.linalg.inv(covariance) * UNITS[:, None] * UNITS
    open_directions = undetermined(0.5 * (data + data.T))
    # In a basis of the rest: projected in all seven, round-off along what was taken out could come back as metres.
    every = np.linalg.svd(open_directions, full_matrices=True)[0] if open_directions.shape[1] else np.eye(CALIBRATION)
    rest = every[:, open_directions.shape[1] :]
    known = rest @ np.linalg.inv(rest.T @ data @ rest) @ rest.T if rest.shape[1] else np.zeros_like(data)
    return known * UNITS[:, None] * UNITS, rest.shape[1]


def _gradient(problem: JointProblem, estimate: Estimate, first: int, last: int) -> FloatArray:
    """Of the shared unknowns (S,), from the factors within knots first..last (exclusive) alone, these knots eliminated."""
    bins = problem.bins
    mine = (bins.knot >= first) & (bins.knot < last)
    part = replace(
        problem,
        readings=problem.readings.part(first, last),
        nodes=problem.nodes.part(first, last),
        links=_links(problem.links, first, last - 1),
        links_gyro_bias=problem.links_gyro_bias[first : last - 1],
        links_accel_bias=problem.links_accel_bias[first : last - 1],
        bins=replace(
            bins,
            knot=bins.knot[mine] - first,
            plane=bins.plane[mine],
            scatter=bins.scatter[mine],
            count=bins.count[mine],
        ),
        gauge_knot=0,
        planes_hold_frame=True,
    )
    own = replace(estimate, states=estimate.states.part(first, last))
    return solve_arrow(part.linearise(own)).gradient_shared


def _links(links: Links, first: int, last: int) -> Links:
    """The links first..last (exclusive)."""
    return Links(**{f.name: v if np.ndim(v := getattr(links, f.name)) == 0 else v[first:last] for f in fields(Links)})
