"""A joint problem in which nothing fits, of a few knots and planes: residuals of every kind are large."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from calib_core.factors.imu import KnotStates
from calib_core.full.joint.priors import PriorRow, Priors
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.state import BiasNodes, Bins, Estimate, Layout
from calib_core.imu.preintegration import NoiseDensity, UpsampledImu, preintegrate
from calib_core.solver.arrow import ArrowSolution
from calib_core.types import FloatArray

KNOTS, PLANES, H_S = 7, 3, 0.05
#: More nodes than a knot touches: what follows them comes earlier in its border.
LAYOUT = Layout(nodes=4, planes=PLANES)
OFFSET_S = 0.02
DENSITY = NoiseDensity(np.full(3, 0.5), np.full(3, 2.0))


def estimate_of(rng: np.random.Generator) -> Estimate:
    """Knots, a calibration, biases and planes at random."""
    R = [Rotation.random(rng=rng).as_matrix()]
    while len(R) < KNOTS:
        R.append(R[-1] @ Rotation.from_rotvec(0.05 * rng.normal(size=3)).as_matrix())
    normals = rng.normal(size=(PLANES, 3))
    return Estimate(
        states=KnotStates(np.array(R), rng.normal(size=(KNOTS, 3)), rng.normal(size=(KNOTS, 3))),
        R_imu_lidar=Rotation.random(rng=rng).as_matrix(),
        p_imu_lidar=0.3 * rng.normal(size=3),
        time_offset_s=OFFSET_S,
        gravity=np.array([3.0, -4.0, 8.5]),
        gyro_bias=0.05 * rng.normal(size=(LAYOUT.nodes, 3)),
        accel_bias=0.2 * rng.normal(size=(LAYOUT.nodes, 3)),
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        offsets_m=rng.uniform(1.0, 3.0, PLANES),
    )


def problem_of(seed: int, *, delta_s: float = 0.0, unseen: int = 0) -> tuple[JointProblem, Estimate]:
    """A problem in which nothing fits anything: residuals of every kind are large.

    delta_s: the estimate's time offset less that for which the bins were made.   unseen: directions that no plane sees.
    """
    rng = np.random.default_rng(seed)
    e = estimate_of(rng)
    if unseen:
        across = np.linalg.qr(rng.normal(size=(3, 3)))[0][:, unseen:]
        # Next to nothing, which counts where it is summed up.
        flat = e.normals @ across @ across.T + 3e-4 * rng.normal(size=e.normals.shape)
        e = replace(e, normals=flat / np.linalg.norm(flat, axis=1, keepdims=True))
    links = KNOTS - 1
    readings = UpsampledImu(
        H_S * np.arange(KNOTS), H_S, rng.normal(size=(links, 4, 3)), 9.0 + rng.normal(size=(links, 4, 3)),
        rng.normal(size=(KNOTS, 3)), rng.normal(size=(KNOTS, 3)), np.zeros((links, 6)), np.ones(links, bool),
    )  # fmt: skip
    times_s = np.linspace(readings.knots_s[0], readings.knots_s[-1], LAYOUT.nodes)
    nodes = BiasNodes(times_s, np.arange(links) // 2, (np.arange(links) % 2 + 0.5) / 2)
    bg, ba = nodes.at_links(e.gyro_bias), nodes.at_links(e.accel_bias)
    pairs = np.array([(k, j) for k in range(KNOTS) for j in range(PLANES) if rng.random() < 0.7])
    y = np.concatenate([rng.normal(size=(len(pairs), 9, 3)), np.ones((len(pairs), 9, 1))], axis=2)
    # A centimetre for each: what three planes see, no direction is hidden from.
    y = 100.0 * np.concatenate([y, 0.1 * rng.normal(size=(len(pairs), 9, 1))], axis=2)
    knot, plane = np.ascontiguousarray(pairs.T)
    bins = Bins(knot, plane, np.swapaxes(y, 1, 2) @ y, np.full(len(pairs), 9), OFFSET_S - delta_s)
    rows = (PriorRow(0, 0.3, 0.5), PriorRow(2, -0.1, 0.2), PriorRow(4, 1.0, 0.4), PriorRow(6, 0.5, 0.3))
    priors = Priors(e.R_imu_lidar, rows[:2], 9.8, 0.05, given=rows[2:], gyro_walk=0.3, accel_walk=0.7)
    return JointProblem(readings, nodes, preintegrate(readings, bg, ba, DENSITY), bg, ba, bins, priors, 0), e


def step_of(knots: FloatArray, shared: FloatArray) -> ArrowSolution:
    """A step by what all knots and the shared unknowns move."""
    return ArrowSolution(knots.reshape(KNOTS, 9), shared, np.zeros((0, 0)), 0.0)


def frame_held(problem: JointProblem, e: Estimate) -> FloatArray:
    """What keeps the map frame in place, written out: the pose of the lidar at knot 0, differenced over every unknown."""
    size = KNOTS * 9 + problem.layout(e).size
    R0, p0 = e.states.R[0] @ e.R_imu_lidar, e.states.p[0] + e.states.R[0] @ e.p_imu_lidar

    def pose(at: Estimate) -> FloatArray:
        R, p = at.states.R[0] @ at.R_imu_lidar, at.states.p[0] + at.states.R[0] @ at.p_imu_lidar
        return np.concatenate([Rotation.from_matrix(R0.T @ R).as_rotvec(), p - p0])

    def moved(i: int, by: float) -> FloatArray:
        step = by * np.eye(size)[i]
        return pose(problem.moved(e, step_of(step[: KNOTS * 9], step[KNOTS * 9 :])))

    # Of fourth order: 1e8 takes eight digits.
    h = 1e-3
    columns = [
        (8.0 * (moved(i, h) - moved(i, -h)) - (moved(i, 2.0 * h) - moved(i, -2.0 * h))) / (12.0 * h)
        for i in range(size)
    ]
    J = np.array(columns).T
    return np.asarray(1e8 * J.T @ J)
