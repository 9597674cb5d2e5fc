"""Directions that no plane sees, along which the motion has a freedom that no datum takes, and equations lose their digits.

Between two walls and on a floor, the way along them shows in no point. There the whole chain of knots may drift evenly and
nothing changes, and where it falls as gravity does, gravity alone tells:

    p(t) -> p(t) + u (a + b t + c t^2 / 2),    v(t) -> v(t) + u (b + c t),    g -> g + c u,    u . n_j = 0 of all planes j

What holds it otherwise, CHAIN.knot, is a ten-thousand-millionth of a millionth of what a link tells of a place. Round-off of the
elimination then takes from gravity and the biases what was never there: answers within a millimetre were said to be known to a
metre. So the drift is held at one knot, where nobody feels it, and the knots are counted from where gravity's own step along u
lets them fall (t from that knot on): links do not feel such a step at all then, and need not cancel out.

Of gravity's part along u its magnitude alone tells, and of a small one next to nothing: to be a thousandth of itself stronger
across, gravity would have to lean by 0.4 m/s2, and within twenty seconds all drifts by 90 m, where walls that are not quite
parallel are left behind. It stays as it is, then.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.factors.imu import KNOT, PLACE, VELOCITY
from calib_core.full.joint.settings import CHAIN
from calib_core.full.joint.state import GRAVITY, Bins, Estimate
from calib_core.imu.preintegration import UpsampledImu
from calib_core.solver.system import ArrowPart
from calib_core.types import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class Unseen:
    """Of one chain. runs: of linked knots, first and after the last, each with its unseen directions (3, r), map axes.
    everywhere: (3, r) those that no run sees.   since_s: (K,) after the gauge knot.
    """

    runs: tuple[tuple[int, int, FloatArray], ...]
    everywhere: FloatArray
    gauge_knot: int
    since_s: FloatArray

    @staticmethod
    def of(bins: Bins, estimate: Estimate, readings: UpsampledImu, gauge_knot: int) -> Unseen:
        """By how much the points of each plane tell of a place across it."""
        weight = bins.scatter[:, 3, 3]
        breaks = (np.flatnonzero(~readings.linked) + 1).tolist()
        edges = np.array([0, *breaks, len(readings.knots_s)])
        run = np.searchsorted(edges, bins.knot, side="right") - 1
        each = np.zeros((len(edges) - 1, len(estimate.normals)))
        np.add.at(each, (run, bins.plane), weight)
        runs = tuple(
            (int(first), int(last), _unseen(told, estimate.normals))
            for first, last, told in zip(edges, edges[1:], each, strict=False)
        )
        since_s = readings.knots_s - readings.knots_s[gauge_knot]
        return Unseen(runs, _unseen(each.sum(axis=0), estimate.normals), gauge_knot, since_s)

    def hold(self, part: ArrowPart, start: int) -> None:
        """Holds one knot of each run along what no plane sees in it; the gauge knot's place is held already.

        start: the part's first knot.
        """
        for first, last, free in self.runs:
            ours = first <= self.gauge_knot < last
            at = (self.gauge_knot if ours else first) - start
            if not 0 <= at < len(part.diagonal):
                continue
            held = CHAIN.unseen_held * free @ free.T
            part.diagonal[at, VELOCITY, VELOCITY] += held
            if not ours:
                part.diagonal[at, PLACE, PLACE] += held

    @property
    def seen(self) -> FloatArray:
        """(3, 3) takes from a vector what lies along the directions that are seen nowhere."""
        return np.asarray(np.eye(3) - self.everywhere @ self.everywhere.T)

    def falls(self, step: FloatArray, first: int = 0, last: int | None = None) -> FloatArray:
        """(K, 9, ...) by how much the knots first..last (exclusive) follow a step (3, ...) of gravity, beside what is solved of
        them."""
        along, since_s = np.tensordot(self.everywhere @ self.everywhere.T, step, 1), self.since_s[first:last]
        out = np.zeros((len(since_s), KNOT, *step.shape[1:]))
        out[:, PLACE] = np.multiply.outer(0.5 * since_s**2, along)
        out[:, VELOCITY] = np.multiply.outer(since_s, along)
        return out

    def hold_level(self, corner: FloatArray, gravity: FloatArray) -> None:
        """Holds gravity, (3,) map, along what is seen nowhere in the shared corner (S, S), where that is nearly level."""
        along = self.everywhere @ self.everywhere.T
        if np.linalg.norm(along @ gravity) < CHAIN.level_m_s2:
            corner[GRAVITY, GRAVITY] += CHAIN.gauge * along

    def let_fall(
        self, part: ArrowPart, start: int, diagonal: FloatArray, gradient: FloatArray, of_lidar: BoolArray
    ) -> None:
        """Has the knots of a part, from `start` on, counted from where gravity's step lets them fall.

        diagonal, gradient: (k, 9, 9), (k, 9) what the points told of the knots by themselves.   of_lidar: (C,) of the part's
        columns those that points alone see; links, which see the others, do not feel a fall.
        """
        if not self.everywhere.shape[1]:
            return
        T = self.falls(np.eye(3), start, start + len(diagonal))
        part.border[:, :, GRAVITY] += diagonal @ T
        across = np.einsum("kia,kic->ac", T, np.where(of_lidar, part.border, 0.0), optimize=True)
        part.corner[GRAVITY] += across
        part.corner[:, GRAVITY] += across.T
        part.corner[GRAVITY, GRAVITY] += np.einsum("kia,kij,kjb->ab", T, diagonal, T)
        part.gradient_shared[GRAVITY] += np.einsum("kia,ki->a", T, gradient)


def _unseen(told: FloatArray, normals: FloatArray) -> FloatArray:
    """(3, r) along which planes tell too little. told: (P,) [1/m2] of a place across each."""
    information, directions = np.linalg.eigh((normals.T * told) @ normals)
    return np.asarray(directions[:, information < CHAIN.unseen])
