"""Whether parts of a recording agree beyond what noise explains, and along which direction they do not.

The model's covariance takes residuals for independent. What is left of a real recording is not: a wall is bent at the same
place in every sweep, a mount gives in one half of the minute, a laser reads short in all of it. The factors are put together by
what such an error would be common to (a stretch of time, a metre of a wall, a plane, near or far, a laser), and each cluster's
pull on the seven (influence.py) is held against what noise allows it:

    T = sum |C^-1/2 u_k|^2,     under noise alone  E T = sum tr P_k,   var T = 2 sum tr P_k^2     (P_k in C's own units)

matched by a gamma law. Beyond its 99.9 % quantile the clustered covariance counts: the part of sum (u_k u_k' - P_k) that is
positive is added to C, along the directions in which the clusters disagree and along no other. The sensors' own parameters are
bent by the same walls, each by its own pulls.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from calib_core.full.assess.influence import (
    Clustering,
    FactorInfluences,
    Influences,
    factor_influences,
    parameter_influences,
)
from calib_core.full.assess.settings import PARTS
from calib_core.full.joint.by_laser import ByLaser
from calib_core.full.joint.estimation import MapPlane
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.state import CALIBRATION, TIME_OFFSET, Estimate
from calib_core.full.joint.undetermined import UNDETERMINED
from calib_core.solver.arrow import Eliminated
from calib_core.solver.information import covariance as inverse_of
from calib_core.types import BoolArray, FloatArray, IntArray

#: Each plane in each stretch of time: what `planes_at_once` asks, and no way of taking a recording apart.
_AT_ONCE = "at once"


@dataclass(frozen=True)
class Disagreement:
    """One way of taking the recording apart. name: of it.   ratio: of the pulls to what noise allows, in standard deviations.

    excess: (7, 7) that the covariance lacks, scaled units; zero where the pulls are within what noise allows.
    """

    name: str
    ratio: float
    excess: FloatArray

    @property
    def is_beyond_noise(self) -> bool:
        """Whether anything is lacking."""
        return bool(np.any(self.excess))


@dataclass(frozen=True)
class Apart:
    """A solved recording in its parts. clusters: by the way of taking it apart, "time", "surfaces", "planes", "range" and, where
    points name them, "lasers".

    covariance: (7, 7) of the joint answer, the priors' share included, in units of 1 deg, 10 mm, 1 ms.   edges_s: (B + 1,)
    ends of the stretches of time, the IMU's clock.   ranges_m: (3,) nearest, middle and farthest.   at_once: as `planes_at_once`.
    """

    clusters: dict[str, Influences]
    covariance: FloatArray
    edges_s: FloatArray
    ranges_m: FloatArray
    at_once: float = 1.0


@dataclass(frozen=True)
class _Ways:
    """Which cluster each factor belongs to. block: (K,) stretch of time of each knot.   knot, plane: (B,) of each bin.

    planes: how many.   space: by name, a key for each bin.
    """

    block: IntArray
    knot: IntArray
    plane: IntArray
    planes: int
    space: dict[str, IntArray]

    def clusters(self, of: FactorInfluences) -> dict[str, Influences]:
        """Each way of it, and "at once": of each plane in each stretch of time, by stretch and plane."""
        block = self.block[self.knot]
        ways = {"time": Clustering(block, PARTS.time_blocks)}
        ways |= {name: numbered(key) for name, key in self.space.items()}
        ways["planes"] = Clustering(self.plane, self.planes)
        ways[_AT_ONCE] = Clustering(block * self.planes + self.plane, PARTS.time_blocks * self.planes)
        clusters = dict(zip(ways, of.of_bins(list(ways.values())), strict=True))
        (links,) = of.of_links([Clustering(self.block[:-1], PARTS.time_blocks)])
        bins = clusters["time"]
        clusters["time"] = Influences(links.moved + bins.moved, links.allowed + bins.allowed)
        if len(of.lasers.moved):
            clusters["lasers"] = of.lasers
        return clusters


def take_apart(
    problem: JointProblem,
    estimate: Estimate,
    told_apart: Iterable[ByLaser] = (),
    *,
    eliminated: Eliminated | None = None,
) -> Apart:
    """Every way of it. told_apart: the lidar's factors, laser by laser.   eliminated: as `factor_influences` has it.

    Raises NotPositiveDefinite.
    """
    of = factor_influences(problem, estimate, told_apart, eliminated=eliminated)
    ways, ranges_m = _ways(problem, estimate)
    knots_s = problem.readings.knots_s
    starts_s = knots_s[np.minimum(np.searchsorted(ways.block, np.arange(PARTS.time_blocks)), len(knots_s) - 1)]
    clusters = ways.clusters(of)
    stretch = np.arange(PARTS.time_blocks).repeat(ways.planes)
    at_once = planes_at_once(clusters.pop(_AT_ONCE), stretch, of.covariance)
    return Apart(clusters, of.covariance, np.append(starts_s, knots_s[-1]), ranges_m, at_once)


def planes_at_once(clusters: Influences, block: IntArray, joint: FloatArray) -> float:
    """By how much planes that are seen at the same time contradict each other about the time offset: mean square, 1 by chance.

    No clock does that, whatever it does to stretches of time; walls that are not flat do it to both alike. A stretch b that
    asks for the shift s_b of the time offset pulls it by g_k s_b through the plane k, g = (P_k C^-1) of the time offset:

        chi^2 = sum_bk (u_k - g_k s_b)^2 / P_k,      one less to each stretch than it has planes

    clusters: of each plane in each stretch.   block: (K,) which stretch that is.   joint: (7, 7) as in `Apart`.
    """
    allowed, moved = clusters.allowed[:, TIME_OFFSET], clusters.moved[:, TIME_OFFSET]
    free = np.flatnonzero(np.diag(joint) > 0.0)
    seen = allowed[:, TIME_OFFSET] > 0.0
    if TIME_OFFSET not in free or not seen.any():
        return 1.0
    told = inverse_of(joint[np.ix_(free, free)]).matrix[:, np.flatnonzero(free == TIME_OFFSET)[0]]
    _, stretch = np.unique(block[seen], return_inverse=True)
    weight, felt, pull = 1.0 / allowed[seen, TIME_OFFSET], (allowed[:, free] @ told)[seen], moved[seen]
    asked = np.bincount(stretch, weight * felt * pull) / np.bincount(stretch, weight * felt**2)
    left = float(np.sum(weight * (pull - felt * asked[stretch]) ** 2))
    return left / max(len(stretch) - len(asked), 1)


def unexplained_variance(
    problem: JointProblem,
    estimate: Estimate,
    columns: IntArray,
    found: Iterable[Disagreement],
    told_apart: Iterable[ByLaser] = (),
) -> FloatArray:
    """(N,) that the variances of the sensors' parameters lack, which are the shared unknowns of these columns (N,).

    found: what the seven disagree about. There each parameter takes its own part of it; and where it alone disagrees beyond what
    noise allows so many of them. What one way of taking the recording apart accounts for, no other adds again.
    Raises NotPositiveDefinite.
    """
    ways, _ = _ways(problem, estimate)
    beyond = {each.name for each in found if each.is_beyond_noise}
    lacking = np.zeros(len(columns))
    for some, of in parameter_influences(problem, estimate, columns, told_apart):
        by_way = ways.clusters(of)
        by_way.pop(_AT_ONCE, None)
        for name, clusters in by_way.items():
            excess = np.sum(clusters.moved**2 - clusters.allowed, axis=0)
            if name not in beyond:
                excess = np.where(_is_beyond_noise(clusters, len(lacking)), excess, 0.0)
            lacking[some] = np.maximum(lacking[some], excess)
    return lacking


def _is_beyond_noise(clusters: Influences, of_so_many: int) -> BoolArray:
    """(N,) whether each unknown's pulls are, where as many are asked: by the gamma law of `judge`."""
    mean, variance = clusters.allowed.sum(axis=0), 2.0 * np.sum(clusters.allowed**2, axis=0)
    known = (mean > 0.0) & (variance > 0.0)
    mean, variance = np.where(known, mean, 1.0), np.where(known, variance, 1.0)
    confidence = 1.0 - (1.0 - PARTS.confidence) / of_so_many
    limit = variance / mean * scipy.special.gammaincinv(mean**2 / variance, confidence)
    return np.asarray(known & (np.sum(clusters.moved**2, axis=0) > limit))


def disagreements(apart: Apart, covariance: FloatArray) -> list[Disagreement]:
    """Of all ways to take a solved recording apart. covariance: (7, 7), scaled units."""
    whiten, root = roots(covariance)
    if whiten.shape[1] == 0:
        return []
    return [judge(name, each, whiten, root) for name, each in apart.clusters.items()]


def is_torn(found: Sequence[Disagreement], planes: Sequence[MapPlane], *, wanders: bool) -> bool:
    """Whether stretches of time contradict each other. Walls that are not flat have their places disagree, not time.

    Where a chosen plane did not stand still in the motion that all structure has told, any disagreement is its doing. So is a
    drift of the biases, which takes upon itself what such a plane makes of a slow push. wanders: one was allowed for.
    """
    strayed = any(plane.chosen and plane.strayed for plane in planes)
    least = 1.0 if strayed else PARTS.torn
    return (strayed and wanders) or any(
        each.name == "time" and each.is_beyond_noise and each.ratio > least for each in found
    )


def roots(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """C^-1/2 from the right and C^1/2 from the left, (7, r) each, over the r directions that the data determine.

    Along the others a prior decides, metres wide: pulls there are noise, and times metres would be called a disagreement.
    """
    values, vectors = np.linalg.eigh(covariance)
    known = ~(np.abs(vectors) * np.sqrt(np.maximum(values, 0.0)) > UNDETERMINED[:, None]).any(axis=0) & (values > 0.0)
    std = np.sqrt(values[known])
    return vectors[:, known] / std, vectors[:, known] * std


def numbered(key: IntArray) -> Clustering:
    """Any keys (F,) as numbers from 0, and how many there are."""
    _, number = np.unique(key, return_inverse=True)
    return Clustering(number, int(number.max(initial=-1)) + 1)


def _ways(problem: JointProblem, estimate: Estimate) -> tuple[_Ways, FloatArray]:
    """How factors are put together: by time, and by every bin's metre of its plane, plane, and the nearer or farther half; and
    where the halves end, (3,) [m].
    """
    knots = len(problem.readings.knots_s)
    block = np.arange(knots) * PARTS.time_blocks // knots
    space, ranges_m = _in_space(problem, estimate)
    return _Ways(block, problem.bins.knot, problem.bins.plane, len(estimate.normals), space), ranges_m


def _in_space(problem: JointProblem, estimate: Estimate) -> tuple[dict[str, IntArray], FloatArray]:
    bins = problem.bins
    weight = np.maximum(bins.scatter[:, 3, 3], 1e-30)
    centre = bins.scatter[:, 3, :3] / weight[:, None]
    range_m = np.linalg.norm(centre, axis=1)
    motion = problem.motion(estimate)
    poses = motion.lidar_at(motion.readings.knots_s, estimate.R_imu_lidar, estimate.p_imu_lidar)
    there = (poses.R[bins.knot] @ centre[..., None])[..., 0] + poses.p[bins.knot]
    cell = np.floor(there / PARTS.cell_m).astype(np.int64) + 2**15
    surfaces = ((bins.plane * 2**16 + cell[:, 0]) * 2**16 + cell[:, 1]) * 2**16 + cell[:, 2]
    order = np.argsort(range_m)
    far = np.zeros(len(range_m), np.int64)
    total = np.cumsum(weight[order])
    half = int(np.searchsorted(total, 0.5 * total[-1]))
    far[order[half:]] = 1
    ends_m = range_m[order[[0, half, -1]]]
    return {"surfaces": surfaces, "planes": bins.plane, "range": far}, ends_m


def judge(name: str, clusters: Influences, whiten: FloatArray, root: FloatArray) -> Disagreement:
    """One way of taking apart. whiten, root: (7, r) of `roots`."""
    pulls = clusters.moved @ whiten
    allowed = np.swapaxes(whiten, 0, 1) @ clusters.allowed @ whiten
    mean = float(np.einsum("kii->", allowed))
    variance = 2.0 * float(np.sum(allowed**2))
    statistic = float(np.sum(pulls**2))
    nothing = np.zeros((CALIBRATION, CALIBRATION))
    if mean <= 0.0 or variance <= 0.0:
        return Disagreement(name, 1.0, nothing)
    limit = variance / mean * float(scipy.special.gammaincinv(mean**2 / variance, PARTS.confidence))
    ratio = float(np.sqrt(statistic / mean))
    if statistic <= limit:
        return Disagreement(name, ratio, nothing)
    values, vectors = np.linalg.eigh(pulls.T @ pulls - allowed.sum(axis=0))
    beyond = root @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    return Disagreement(name, ratio, beyond @ beyond.T)


def together(found: list[Disagreement], covariance: FloatArray) -> FloatArray:
    """(7, 7) that all of them add to a covariance: what one has already accounted for, no other adds again."""
    whiten, root = roots(covariance)
    total = np.zeros((whiten.shape[1], whiten.shape[1]))
    for each in sorted(found, key=lambda d: -float(np.trace(whiten.T @ d.excess @ whiten))):
        lacking, directions = np.linalg.eigh(whiten.T @ each.excess @ whiten - total)
        total += (directions * np.maximum(lacking, 0.0)) @ directions.T
    return np.asarray(root @ total @ root.T)
