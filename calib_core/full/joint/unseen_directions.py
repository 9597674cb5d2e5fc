"""Directions that no plane sees, along which the motion has a freedom that no datum takes.

Between two walls and on a floor, the way along them shows in no point. There links are free to be as they like: whatever they
have of places and velocities along it, places and velocities follow. So those rows of theirs say nothing of anything else, and
with them go all that would come of their round-off: a chain that hangs by nothing but its links, each of which knows a place
ten thousand million times as well as points do, has none of its digits left for gravity, biases and the sensors' parameters
after some thousand knots. Of links

    r_v = R0' (v1 - v0 - g h) - Dv,    r_p = R0' (p1 - p0 - v0 h - g h^2 / 2) - Dp

the parts along R0' u are left out, u . n_j = 0 of all planes j that the run sees, and what their noise has in common with the
others': the others' own covariance stays. The knots are held along u, and carried along by the readings after each step.

Of gravity's part along u its magnitude alone tells, and of a small one next to nothing: to be a thousandth of itself stronger
across, gravity would have to lean by 0.4 m/s2, and within twenty seconds all drifts by 90 m, where walls that are not quite
parallel are left behind. It stays as it is, then.

How many directions that are is asked once of the points that were gathered, and not of every step: one that walls tell to just
about so much by how they lean would come and go with it, and the links' whole cost.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_core.factors.imu import PLACE, VELOCITY, KnotStates
from calib_core.full.joint.settings import CHAIN
from calib_core.full.joint.state import GRAVITY, Bins, Estimate
from calib_core.imu.preintegration import Links, UpsampledImu
from calib_core.paged import paged
from calib_core.solver.system import ArrowPart
from calib_core.types import FloatArray, IntArray

#: Rows of a link's residual, before it is whitened.
_OF_VELOCITY, _OF_PLACE = slice(3, 6), slice(6, 9)


@dataclass(frozen=True, slots=True)
class Unseen:
    """Of one chain. runs: of linked knots, first and after the last, each with its unseen directions (3, r), map axes.
    everywhere: (3, r) those that no run sees.   gauge_knot: from which its own run is carried along, as others from their first.
    """

    runs: tuple[tuple[int, int, FloatArray], ...]
    everywhere: FloatArray
    gauge_knot: int

    @staticmethod
    def of(bins: Bins, estimate: Estimate, readings: UpsampledImu, gauge_knot: int) -> Unseen:
        """By how much the points of each plane tell of a place across it; nothing where there are no points at all."""
        if not len(bins.knot):
            return Unseen((), np.zeros((3, 0)), gauge_knot)
        edges, told = _told(bins, readings, len(estimate.normals))
        told_of = [_directions(each, estimate.normals) for each in told]
        counts = bins.unseen or tuple(_fewer(information, CHAIN.unseen) for information, _ in told_of)
        *runs, everywhere = [free[:, :count] for (_, free), count in zip(told_of, counts, strict=True)]
        return Unseen(tuple(zip(edges.tolist(), edges[1:].tolist(), runs, strict=False)), everywhere, gauge_knot)

    def hold(self, part: ArrowPart, start: int) -> None:
        """Holds all knots along what no plane sees in their run, but for the gauge knot's place: that moves with the lever arm,
        as the lidar's is held. start: the part's first knot."""
        for first, last, free in self.runs:
            some = np.arange(max(first - start, 0), min(last - start, len(part.diagonal)))
            held = CHAIN.unseen_held * free @ free.T
            part.diagonal[some, VELOCITY, VELOCITY] += held
            part.diagonal[some[some != self.gauge_knot - start], PLACE, PLACE] += held

    def without(self, links: Links, R: FloatArray) -> Links:
        """The links without what they have of places and velocities along what no plane sees. R: (K, 3, 3) of their knots."""
        open_runs = [(first, last, free) for first, last, free in self.runs if free.shape[1] and last - first > 1]
        if not open_runs:
            return links
        (sqrt_info,) = paged(links.sqrt_info.shape)
        sqrt_info[:] = links.sqrt_info
        for first, last, free in open_runs:
            some = slice(first, last - 1)
            own, along = sqrt_info[some], np.swapaxes(R[some], 1, 2) @ free
            rows = np.concatenate([own[:, :, _OF_VELOCITY] @ along, own[:, :, _OF_PLACE] @ along], axis=2)
            taken, _ = np.linalg.qr(rows)
            left = own - taken @ (np.swapaxes(taken, 1, 2) @ own)
            # Lower triangular again, as whitened residuals are made: any root of the information does.
            _, upper = np.linalg.qr(left[:, :, ::-1])
            sqrt_info[some] = upper[:, ::-1, ::-1]
        return replace(links, sqrt_info=sqrt_info)

    def carried(
        self, states: KnotStates, links: Links, gravity: FloatArray, gyro_change: FloatArray, accel_change: FloatArray
    ) -> KnotStates:
        """Knots where the readings have them along what no plane sees. gravity: (3,) map.   *_change: (L, 3) of the biases."""
        p, v = states.p.copy(), states.v.copy()
        for first, last, free in self.runs:
            if not free.shape[1] or last - first < 2:
                continue
            some, knots = slice(first, last - 1), slice(first, last)
            at = self.gauge_knot - first if first <= self.gauge_knot < last else 0
            dv, dp = (
                D[some]
                + (by_gyro[some] @ gyro_change[some, :, None] + by_accel[some] @ accel_change[some, :, None])[..., 0]
                for D, by_gyro, by_accel in (
                    (links.Dv, links.Dv_D_bg, links.Dv_D_ba),
                    (links.Dp, links.Dp_D_bg, links.Dp_D_ba),
                )
            )
            faster = _since(at, ((states.R[some] @ dv[..., None])[..., 0] + links.h_s * gravity) @ free)
            velocity = v[first + at] @ free + faster
            fallen = (states.R[some] @ dp[..., None])[..., 0] + 0.5 * links.h_s**2 * gravity
            place = p[first + at] @ free + _since(at, fallen @ free + links.h_s * velocity[:-1])
            p[knots] += (place - p[knots] @ free) @ free.T
            v[knots] += (velocity - v[knots] @ free) @ free.T
        return replace(states, p=p, v=v)

    def hold_level(self, corner: FloatArray, gravity: FloatArray) -> None:
        """Holds gravity, (3,) map, along what is seen nowhere in the shared corner (S, S), where that is nearly level."""
        along = self.everywhere @ self.everywhere.T
        if np.linalg.norm(along @ gravity) < CHAIN.level_m_s2:
            corner[GRAVITY, GRAVITY] += CHAIN.gauge * along


def _since(at: int, steps: FloatArray) -> FloatArray:
    """(K, r) of knots, by steps (K - 1, r) between them, since one of them."""
    gone = np.concatenate([np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)])
    return np.asarray(gone - gone[at])


def unseen_counts(bins: Bins, estimate: Estimate, readings: UpsampledImu, before: tuple[int, ...]) -> tuple[int, ...]:
    """As `Bins` has them. before: of the points gathered last: what was not seen then has to be seen well to be seen now."""
    if not len(bins.knot):
        return ()
    _, told = _told(bins, readings, len(estimate.normals))
    found = []
    for k, each in enumerate(told):
        information, _ = _directions(each, estimate.normals)
        least, most = _fewer(information, CHAIN.unseen), _fewer(information, CHAIN.seen_again)
        found.append(min(max(before[k], least), most) if len(before) == len(told) else least)
    return tuple(found)


def _told(bins: Bins, readings: UpsampledImu, planes: int) -> tuple[IntArray, FloatArray]:
    """Where runs of linked knots begin, and the last ends (R + 1,); (R + 1, P) [1/m2] of a place across each plane, by the points
    of each run, and of all.
    """
    breaks = (np.flatnonzero(~readings.linked) + 1).tolist()
    edges = np.array([0, *breaks, len(readings.knots_s)])
    run = np.searchsorted(edges, bins.knot, side="right") - 1
    each = np.zeros((len(edges) - 1, planes))
    np.add.at(each, (run, bins.plane), bins.scatter[:, 3, 3])
    return edges, np.vstack([each, each.sum(axis=0)])


def _directions(told: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Of a place along directions (3, 3), columns, the information [1/m2], least first. told: (P,) across each plane."""
    information, directions = np.linalg.eigh((normals.T * told) @ normals)
    return np.asarray(information), np.asarray(directions)


def _fewer(information: FloatArray, limit: float) -> int:
    """Along how many directions less is told."""
    return int(np.count_nonzero(information < limit))
