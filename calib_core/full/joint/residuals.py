"""How far the points lie from the planes under an estimate: by plane, on average, against their noise and their gates."""

from __future__ import annotations

import numpy as np

from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.settings import DOUBTING
from calib_core.full.joint.state import Estimate
from calib_core.types import FloatArray


def plane_residuals(problem: JointProblem, estimate: Estimate) -> list[tuple[float, int]]:
    """Per plane: root mean square of the range-noise-weighted distances in metres, and points."""
    bins = problem.bins
    chi2 = problem.lidar.squares(estimate)
    weight = bins.scatter[:, 3, 3]
    out = []
    for j in range(len(estimate.normals)):
        mine = bins.plane == j
        total = float(weight[mine].sum())
        out.append(
            (float(np.sqrt(max(float(chi2[j]), 0.0) / total)) if total > 0 else 0.0, int(bins.count[mine].sum()))
        )
    return out


def plane_chi2(problem: JointProblem, estimate: Estimate) -> tuple[FloatArray, FloatArray]:
    """Per plane: mean squared distance in standard deviations (1 for pure noise), and points. (P,), (P,)."""
    bins = problem.bins
    chi2 = problem.lidar.squares(estimate)
    planes = len(estimate.normals)
    points = np.bincount(bins.plane, bins.count, planes).astype(np.float64)
    return chi2 / np.maximum(points, 1), points


def moved_in_gate(problem: JointProblem, before: Estimate, after: Estimate) -> float:
    """How far a solve has moved points across the gates they passed: 95th percentile over the bins.

    Of the change of a bin's mean distance, in standard deviations of a single point.
    """
    scatter = problem.bins.scatter
    if len(scatter) == 0:
        return 0.0
    weight = np.maximum(scatter[:, 3, 3], 1e-30)
    moved = (problem.lidar.sums(after) - problem.lidar.sums(before)) / weight
    point_std = np.sqrt(problem.bins.count / weight)
    return float(np.percentile(np.abs(moved) / point_std, DOUBTING.moved_percent))


def misfit(problem: JointProblem, estimate: Estimate) -> float:
    """Mean square, in standard deviations, of the bins' mean distances: about 1 or less where the model explains the data.

    A bin averages hundreds of points, so that what its mean has left is not range noise but motion, timing or geometry.
    """
    bins = problem.bins
    mean = problem.lidar.sums(estimate)
    return float(np.mean(mean**2 / np.maximum(bins.scatter[:, 3, 3], 1e-30))) if len(mean) else 0.0


def plane_misfit(problem: JointProblem, estimate: Estimate) -> FloatArray:
    """The misfit plane by plane, (P,)."""
    bins = problem.bins
    mean = problem.lidar.sums(estimate)
    square = mean**2 / np.maximum(bins.scatter[:, 3, 3], 1e-30)
    planes = len(estimate.normals)
    return np.bincount(bins.plane, square, planes) / np.maximum(np.bincount(bins.plane, minlength=planes), 1)


def wandering_m(problem: JointProblem, estimate: Estimate) -> FloatArray:
    """How far the bins' mean distances are off beyond noise, plane by plane: (P,) root mean square, each bin by its points."""
    bins = problem.bins
    weight = np.maximum(bins.scatter[:, 3, 3], 1e-30)
    square_m2 = (problem.lidar.sums(estimate) / weight) ** 2 - 1.0 / weight
    planes = len(estimate.normals)
    points = np.maximum(np.bincount(bins.plane, bins.count, planes), 1)
    return np.sqrt(np.maximum(np.bincount(bins.plane, square_m2 * bins.count, planes) / points, 0.0))


def away_m(problem: JointProblem, estimate: Estimate) -> float:
    """Root mean square of the bins' mean distances in metres, each bin by its points."""
    bins = problem.bins
    mean = problem.lidar.sums(estimate) / np.maximum(bins.scatter[:, 3, 3], 1e-30)
    return float(np.sqrt(np.average(mean**2, weights=bins.count))) if len(mean) else 0.0
