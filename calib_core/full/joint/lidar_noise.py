"""The lidar's noise, along the beam and of the surface, from how far points lie off their planes.

std^2(d) = range^2 c^2 + surface^2,        c the cosine of incidence
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib_core.factors.kernels import tapered_sums_kernel
from calib_core.factors.lidar_plane import Gate, LidarNoise, cells_across, select
from calib_core.factors.support import PlaneExtents
from calib_core.full.joint.many_scans import over_scans
from calib_core.full.joint.settings import MEASURING
from calib_core.full.joint.view import View
from calib_core.gp.noise import MAD_TO_STD
from calib_core.types import FloatArray, IntArray


def measure_noise(
    view: View,
    positions: Sequence[int],
    start: LidarNoise,
    gate: Gate,
    extents: PlaneExtents | None,
    *,
    stride: int = 1,
    range_std_m: float | None = None,
) -> LidarNoise:
    """Range and surface noise from the spread of distances under different incidences. stride: of every so many-th point.

    range_std_m: along the beam where somebody gives it; what is left is the surface's then.

    std^2(d) = range^2 c^2 + surface^2, fitted to robust variances in bands of c^2; neither below 0.1 mm.
    """
    wide = Gate(sigmas=MEASURING.gate_sigmas, extra_m=gate.extra_m, margin_m=gate.margin_m, min_cosine=gate.min_cosine)
    edges = np.linspace(0.0, 1.0, MEASURING.bands + 1)

    def one(position: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        hits = view.hits([position], wide, stride)
        keep, _ = select(hits, start, wide, extents)
        # Each scan's own mean on each plane is taken out: what remains is noise, not the pose's error.
        off_m = _means(hits.d[keep], hits.plane[keep])
        if start.sieve_m <= 0.0:
            return hits.d[keep] - off_m, hits.cosine[keep] ** 2, np.zeros((0, 2))
        sign = np.sign(hits.cosine[keep])
        return (
            (hits.d[keep] - off_m) * sign,
            hits.cosine[keep] ** 2,
            cells_across(hits, start.sieve_m)[keep] - (off_m * sign)[:, None],
        )

    parts = over_scans(view, positions, one)
    d, c2, cells_m = (np.concatenate(each) for each in zip(*parts, strict=True))
    if len(d) < MEASURING.fewest_points:
        return start
    rows, variances, weights = [], [], []
    band = np.digitize(c2, edges)
    for b in np.unique(band):
        mine = d[band == b]
        if len(mine) > MEASURING.fewest_in_band:
            variance = tapered_variance(mine, cells_m[band == b] if len(cells_m) else None)
            rows.append([float(c2[band == b].mean()), 1.0])
            variances.append(variance)
            weights.append(np.sqrt(len(mine)) / max(variance, 1e-12))
    return _split_variance(np.array(rows), np.array(variances), np.array(weights), start, range_std_m)


#: E[w u^2] / E[w] of a standard normal u under w = (1 - u^2 / 16)^2 within four: by numerical integration.
_TAPERED = 0.7708825578050007


def tapered_variance(d: FloatArray, cells_m: FloatArray | None = None) -> float:
    """Variance of the normal law in the middle of a sample that has outliers, by weights that fall to zero at four sigma.

    The weights taper and agree with the variance that they give, so that it is a smooth function of every distance: one
    point more or less must not move the cost of the whole solve. The first guess is the median of the distances.

    cells_m: (N, 2) between which the cell of a thinned cloud keeps each of d (N,). A wall that grazes a face leaves the few that
    noise pushed through it as many points as those that stayed: taken as they are, they scatter by up to a third more than the
    lidar's noise. So each is held against what its cell keeps of the law.
    """
    square = d**2
    variance = MAD_TO_STD**2 * float(np.median(square))
    for _ in range(MEASURING.passes):
        before = variance
        if cells_m is None:
            weight = np.maximum(1.0 - square / max(MEASURING.taper_sigmas**2 * before, 1e-30), 0.0) ** 2
            variance = float(np.sum(weight * square)) / max(_TAPERED * float(np.sum(weight)), 1e-30)
        else:
            std_m = max(np.sqrt(before), 1e-15)
            total, kept = tapered_sums_kernel(d, cells_m, std_m, MEASURING.taper_sigmas, _WEIGHTS, _SQUARES)
            variance = before * total / max(kept, 1e-30)
        if abs(variance - before) <= (1e-12 if cells_m is None else MEASURING.agreeing) * before:
            break
    return variance


#: Integrals of w and of w u^2 under the normal law up to each of so many numbers.
_UNITS = np.linspace(-MEASURING.taper_sigmas, MEASURING.taper_sigmas, MEASURING.steps + 1)
_DENSITY = np.exp(-0.5 * _UNITS**2) * (1.0 - (_UNITS / MEASURING.taper_sigmas) ** 2) ** 2
_WEIGHTS, _SQUARES = np.cumsum(_DENSITY), np.cumsum(_DENSITY * _UNITS**2)


def _means(d: FloatArray, plane: IntArray) -> FloatArray:
    """(N,) the median of the distances of each one's plane, where it has enough points; else nothing."""
    out = np.zeros(len(d))
    for j in np.unique(plane):
        mine = plane == j
        if mine.sum() > MEASURING.fewest_on_plane:
            out[mine] = np.median(d[mine])
    return out


def _split_variance(
    rows: FloatArray, variances: FloatArray, weights: FloatArray, start: LidarNoise, range_std_m: float | None
) -> LidarNoise:
    """Non-negative weighted least squares of variance against [c^2, 1]."""
    if len(rows) == 0:
        return start
    if range_std_m is not None:
        left_m2 = float(np.average(variances - range_std_m**2 * rows[:, 0], weights=weights**2))
        return replace(start, range_std_m=range_std_m, surface_std_m=_told(max(left_m2, 0.0)))
    if len(rows) == 1:
        return replace(start, range_std_m=_told(variances[0] / rows[0, 0]), surface_std_m=MEASURING.least_std_m)
    range_m2, surface_m2 = least_squares_of_two(rows * weights[:, None], variances * weights)
    return replace(start, range_std_m=_told(range_m2), surface_std_m=_told(surface_m2))


def least_squares_of_two(rows: FloatArray, values: FloatArray) -> tuple[float, float]:
    """The two unknowns, neither below zero, with which rows (B, 2) come nearest to values (B,).

    Where the best two are not both above zero, the cost, which is convex, is lowest with one of them at it.
    """
    square, product = rows.T @ rows, rows.T @ values
    if np.linalg.matrix_rank(square) == len(product):
        both = np.linalg.solve(square, product)
        if np.all(both >= 0.0):
            return float(both[0]), float(both[1])
    alone = np.maximum(product / np.maximum(np.diag(square), 1e-300), 0.0)
    # By so much each alone lowers the cost: half of product times unknown.
    first = alone[0] * product[0] >= alone[1] * product[1]
    return (float(alone[0]), 0.0) if first else (0.0, float(alone[1]))


def _told(variance: float) -> float:
    """A standard deviation to three digits, no more than are known, and not below 0.1 mm.

    Further digits change with a single point that comes or goes, and the cost of the whole solve with them.
    """
    return max(float(f"{np.sqrt(variance):.{MEASURING.digits}g}"), MEASURING.least_std_m)
