"""How a forecast changes with the choice of planes: the forecast's own problem with the points of the chosen ones alone.

    growth = std(some of the planes) / std(all of them)

A plane of which only a part is left keeps a part of each of its factors. Points spread evenly over an outline have its centre and
its covariance; taken for normal laws, whole and left, their ratio is a weight of a place q along the plane,

    exp(-q' L q / 2 + h' q),     L = C_left^-1 - C_whole^-1,     h = C_left^-1 c_left - C_whole^-1 c_whole,

times what makes it the ratio of their areas over the whole. A factor's moments are those of its points' law, and under such a
weight they stay those of one: no point is needed.

The lasers' own parameters stay at their priors in it, which changes these ratios by a few per cent and makes a click's answer
a matter of a tenth of a second.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from calib_core.factors.laser_features import LaserFactors
from calib_core.full.assess.observability import assess
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.state import CALIBRATION, Estimate
from calib_core.geometry import plane_axes
from calib_core.record_files import as_read, as_written, keep, kept
from calib_core.solver.arrow import NotPositiveDefinite, solve_arrow
from calib_core.threads import one_blas_thread
from calib_core.types import FloatArray, IntArray, Narrowed

_FILE = "foresight.npz"


@dataclass(frozen=True)
class Foresight:
    """The problem of a forecast, about the estimate that it was judged at.

    proposed: how many planes were proposed.   of_proposal: (P,) which of them each plane of the problem is, -1 for one that came
    into view.   share: of the recording that the problem is of; the rest is taken to say as much a second.
    """

    problem: JointProblem
    estimate: Estimate
    proposed: int
    of_proposal: IntArray
    share: float

    def growth(self, places: Collection[int], narrowed: Mapping[int, Narrowed] | None = None) -> FloatArray:
        """(7,) factors, at least 1, by which the calibration's standard deviations grow where these planes alone count.

        places: of the planes among the proposals; what comes into view counts in any case. A direction that stays open grows to
        the standing prior's size; all are infinite where no point is left.   narrowed: by place, those of which only a part is
        left.
        """
        narrowed = narrowed or {}
        chosen = set(places) & set(range(self.proposed))
        if len(chosen) == self.proposed and not narrowed:
            return np.ones(CALIBRATION)
        counts = np.flatnonzero(np.isin(self.of_proposal, [-1, *chosen]))
        parts = {int(j): narrowed[place] for j in counts if (place := int(self.of_proposal[j])) in narrowed}
        return np.maximum(self._stds(counts.tolist(), parts) / self._of_all, 1.0)

    @cached_property
    def _of_all(self) -> FloatArray:
        return self._stds(range(len(self.estimate.normals)))

    def _stds(self, chosen: Collection[int], parts: Mapping[int, Narrowed] | None = None) -> FloatArray:
        """(7,) of the data alone, SI; infinite where they fix nothing. parts: of the problem's planes, by number."""
        bins = self.problem.bins
        some = np.isin(bins.plane, list(chosen))
        if not some.any():
            return np.full(CALIBRATION, np.inf)
        fewer = replace(
            bins,
            knot=bins.knot[some],
            plane=bins.plane[some],
            scatter=self._scatter(parts or {})[some],
            count=bins.count[some],
        )
        try:
            with one_blas_thread():
                information = solve_arrow(replace(self.problem, bins=fewer).linearise(self.estimate)).information
        except NotPositiveDefinite:
            return np.full(CALIBRATION, np.inf)
        return assess(information, self.problem.priors, inflation=float(np.sqrt(self.share))).data_std

    def _scatter(self, parts: Mapping[int, Narrowed]) -> FloatArray:
        """(B, 5, 5) of the bins, with a part of those whose planes are narrowed."""
        bins, estimate = self.problem.bins, self.estimate
        if not parts:
            return bins.scatter
        motion = self.problem.motion(estimate)
        knots = motion.lidar_at(motion.readings.knots_s, estimate.R_imu_lidar, estimate.p_imu_lidar)
        scatter = bins.scatter.copy()
        for plane, part in parts.items():
            of = bins.plane == plane
            along = plane_axes(estimate.normals[plane])
            poses = knots.R[bins.knot[of]], knots.p[bins.knot[of]]
            scatter[of] = narrowed_scatter(scatter[of], along, poses, part)
        return scatter


def narrowed_scatter(
    scatter: FloatArray, along: FloatArray, poses: tuple[FloatArray, FloatArray], part: Narrowed
) -> FloatArray:
    """(B, 5, 5) of one plane's bins, of what is left of it.

    along: (2, 3) two directions in the plane.   poses: R (B, 3, 3), p (B, 3) of the lidar at the bins' knots, in that frame.
    """
    (c_whole, C_whole, area_whole), (c_left, C_left, area_left) = (
        _moments(each @ along.T) for each in (part.whole, part.left)
    )
    L = np.linalg.inv(C_left) - np.linalg.inv(C_whole)
    values, vectors = np.linalg.eigh(L)
    kept = vectors * (values > 0.0)  # along what was not cut nothing is weighed
    L = kept * np.maximum(values, 0.0) @ kept.T
    h = kept @ kept.T @ (np.linalg.solve(C_left, c_left) - np.linalg.solve(C_whole, c_whole))
    # The moments' law is of x, y, z and the distance d: all but the 1 of y = [x, 1, d].
    x_and_d = np.delete(np.arange(scatter.shape[-1]), 3)
    weight = scatter[:, 3, 3]
    mean = scatter[:, x_and_d, 3] / weight[:, None]
    spread = scatter[:, x_and_d[:, None], x_and_d] / weight[:, None, None] - mean[:, :, None] * mean[:, None, :]
    R, p = poses
    H = np.concatenate([along @ R, np.zeros((len(R), 2, 1))], axis=2)
    H_t = np.swapaxes(H, 1, 2)
    q = (H @ mean[..., None])[..., 0] + p @ along.T
    Q = H @ spread @ H_t
    narrower = spread - spread @ H_t @ L @ np.linalg.inv(np.eye(2) + Q @ L) @ H @ spread
    moved = mean + (narrower @ H_t @ (h - q @ L)[..., None])[..., 0]
    log_share = _log_share(q, Q, L, h) - _log_share(c_whole[None], C_whole[None], L, h) + np.log(area_left / area_whole)
    out = np.empty_like(scatter)
    out[:, x_and_d[:, None], x_and_d] = narrower + moved[:, :, None] * moved[:, None, :]
    out[:, x_and_d, 3] = out[:, 3, x_and_d] = moved
    out[:, 3, 3] = 1.0
    return out * (weight * np.exp(np.minimum(log_share, 0.0)))[:, None, None]


def _log_share(q: FloatArray, Q: FloatArray, L: FloatArray, h: FloatArray) -> FloatArray:
    """(B,) logarithm of the mean of exp(-x' L x / 2 + h' x) over normal laws of means q (B, 2) and covariances Q (B, 2, 2)."""
    pull = h - q @ L
    wider = np.eye(2) + Q @ L
    gained = np.einsum("bi,bij,bj->b", pull, np.linalg.solve(wider, Q), pull)
    return np.asarray(
        q @ h - 0.5 * np.einsum("bi,ij,bj->b", q, L, q) + 0.5 * gained - 0.5 * np.log(np.linalg.det(wider))
    )


def _moments(corners: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Centre (2,), covariance (2, 2) and area of an even spread over a convex polygon (K, 2), triangle by triangle."""
    first, second, third = corners[:1], corners[1:-1], corners[2:]
    (ax, ay), (bx, by) = (second - first).T, (third - first).T
    areas = 0.5 * np.abs(ax * by - ay * bx)
    area = float(areas.sum())
    centres = (first + second + third) / 3.0
    centre = areas @ centres / area
    # An even spread over a simplex of n corners has one in n (n + 1) of their squares about its own centre.
    arms = [np.broadcast_to(each, centres.shape) - centres for each in (first, second, third)]
    own = sum(np.einsum("t,ti,tj->ij", areas, arm, arm) for arm in arms) / (len(arms) * (len(arms) + 1))
    away = centres - centre
    return centre, (own + np.einsum("t,ti,tj->ij", areas, away, away)) / area, area


def foresight(
    problem: JointProblem, estimate: Estimate, proposed: int, of_proposal: Sequence[int], share: float
) -> Foresight:
    """Of a forecast's problem, at the estimate that it was judged about. The others: as in the record."""
    bins = replace(problem.bins, lasers=LaserFactors.empty())
    return Foresight(replace(problem, bins=bins), estimate, proposed, np.array(of_proposal, dtype=np.int64), share)


def keep_foresight(folder: Path, foresight: Foresight | None) -> None:
    """Put into the folder for `kept_foresight`, whole or not at all; what is there goes where there is none.

    Where the folder takes nothing, as on a full disk, nothing is kept: a report must not be lost for it.
    """
    path = folder / _FILE
    if foresight is not None:
        keep(path, *as_written(foresight))
        return
    with suppress(OSError):
        path.unlink(missing_ok=True)


def kept_foresight(folder: Path) -> Foresight | None:
    """What was put there; None where there is nothing, or nothing of this version."""
    found = kept(folder / _FILE)
    try:
        return None if found is None else as_read(Foresight, *found)
    except (ValueError, KeyError, TypeError):
        return None
