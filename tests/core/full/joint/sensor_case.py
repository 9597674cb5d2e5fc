"""The problem in which nothing fits with the sensors' own parameters in it, its points kept one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.factors.imu import link_residuals
from calib_core.factors.laser_features import LaserFactors
from calib_core.factors.patches import SurfacePatches
from calib_core.full.joint.priors import prior_rows
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.sensor_state import SensorState
from calib_core.full.joint.sensors import laser_places, sensor_columns
from calib_core.full.joint.state import Bins, Estimate
from calib_core.full.prepare.nuisance import IMU_BLOCKS, MATERIAL, SURFACE, Nuisance, choose_nuisance
from calib_core.geometry import exp
from calib_core.intrinsics import UNKNOWN_IMU, UNKNOWN_LIDAR
from calib_core.solver.arrow import ArrowSolution
from calib_core.solver.system import ArrowSystem
from calib_core.types import FloatArray
from tests.core.factors.triangles import triangle
from tests.core.full.joint import misfit_problem as plain

LASERS, POINTS, IMU = 3, 11, 25
#: Of every point [1/m]: a decimetre for each, and all together see every direction.
ROOT_WEIGHT = 10.0
NUISANCE = choose_nuisance(UNKNOWN_IMU, UNKNOWN_LIDAR, lasers=LASERS, clock_rate_std_ppm=40.0)
#: Columns of a laser -> features of a point: offset, elevation, azimuth, scale; of all: offset, incidence, eccentricity, grazing.
FEATURE = (0, 1, 2, 3, 0, 4, 5, 6, 7)
MIDDLE_S = 0.11
#: The same in a room of two patches, each of its own height.
BENT = NUISANCE.with_surface(
    SurfacePatches(np.eye(3)[:1], np.where(np.arange(9).reshape(1, 3, 3) < 2, np.arange(9).reshape(1, 3, 3), -1), 4),
    0.003,
    2.0,
)
#: And where what each plane is made of has its own range.
MADE, BENT_MADE = (each.with_materials(plain.PLANES) for each in (NUISANCE, BENT))


def wide(nuisance: Nuisance) -> Nuisance:
    """The same where what is not the IMU's may be thirty times as large; heights, which are correlated, as they may be."""
    blocks = [
        each
        if each.block in IMU_BLOCKS or each.whitener is not None
        else replace(each, prior_std=30.0 * each.prior_std)
        for each in nuisance.blocks
    ]
    return replace(nuisance, blocks=tuple(blocks))


class Case:
    """A problem in which nothing fits, its points kept one by one."""

    def __init__(self, seed: int, nuisance: Nuisance = NUISANCE) -> None:
        rng = np.random.default_rng(seed)
        base, estimate = plain.problem_of(seed)
        # Large for the lidar's; for the IMU's, a link's turn by its bias is the first order's.
        nuisance = wide(nuisance)
        scale = nuisance.prior_std
        self.nuisance = nuisance
        laid_out = scale * rng.normal(size=nuisance.size)
        values = laid_out + scale * rng.normal(size=nuisance.size)
        # A gyroscope's bias turns the pose that a later bin asks for: left out of its columns, and so is a later bin here.
        values[nuisance.start("clock_rate")] = laid_out[nuisance.start("clock_rate")]
        self.estimate = replace(estimate, sensors=SensorState(nuisance, values))
        pairs = list(zip(base.bins.knot, base.bins.plane, strict=True))
        self.pair = np.repeat(np.arange(len(pairs)), POINTS)
        self.laser = rng.integers(0, LASERS, len(self.pair))
        n = len(self.pair)
        self.y = ROOT_WEIGHT * np.concatenate(
            [rng.normal(size=(n, 3)), np.ones((n, 1)), 0.1 * rng.normal(size=(n, 1))], axis=1
        )
        self.f = ROOT_WEIGHT * rng.normal(size=(n, 8))
        self.f[:, 4] = self.y[:, 3] - self.f[:, 0]  # cosine and incidence are one together
        self.squares = 0 if nuisance.surface is None else len(nuisance.surface.corners)
        self.square = rng.integers(0, self.squares + 1, n)
        self.plane = base.bins.plane[self.pair]
        if nuisance.materials:  # the patches are the first plane's
            self.square = np.where(self.plane == 0, self.square, self.squares)
        if nuisance.surface is not None:
            self.corners = np.vstack([nuisance.surface.corners, np.full((1, 4), -1)])[self.square]
            share = np.where(self.corners >= 0, rng.uniform(size=(n, 4)), 0.0)
            self.f = np.hstack([self.f, ROOT_WEIGHT * share / np.maximum(share.sum(axis=1, keepdims=True), 1e-12)])
        unit = self.square * LASERS + self.laser
        if nuisance.materials:
            unit = np.where(self.square == self.squares, unit + LASERS * self.plane, unit)
        scatter = np.array([self.y[self.pair == q].T @ self.y[self.pair == q] for q in range(len(pairs))])
        clusters = [
            (q, j)
            for q in range(len(pairs))
            for j in range(int(unit.max()) + 1)
            if ((self.pair == q) & (unit == j)).any()
        ]
        mine = [(self.pair == q) & (unit == j) for q, j in clusters]
        lasers = LaserFactors.unmoved(
            np.array([q for q, _ in clusters]),
            np.array([j for _, j in clusters]),
            np.array([self.f[m].T @ self.y[m] for m in mine]),
            triangle(np.array([self.f[m].T @ self.f[m] for m in mine])),
            base.bins.plane,
        )
        self.laid_out = laid_out
        bins = Bins(
            base.bins.knot, base.bins.plane, scatter, np.full(len(pairs), POINTS), plain.OFFSET_S, lasers,
            SensorState(nuisance, laid_out),
        )  # fmt: skip
        links_at = SensorState(nuisance, scale * rng.normal(size=nuisance.size))
        self.problem: JointProblem = replace(
            base,
            bins=bins,
            sensors=sensor_columns(links_at, base.readings, estimate.states.R, MIDDLE_S),
        )

    def stacked(self, e: Estimate) -> FloatArray:
        """All residuals: links, points one by one, priors."""
        p = self.problem
        links = link_residuals(p.links, e.states, e.gravity, *p.bias_changes(e))
        b = p.bins
        rate = self.nuisance.start("clock_rate")
        places = laser_places(NUISANCE)
        change = e.sensors.values - self.laid_out
        heights = np.append(self.nuisance.values(change, SURFACE), 0.0)
        out = []
        for i in range(len(self.pair)):
            k, j = b.knot[self.pair[i]], b.plane[self.pair[i]]
            late_s = 1e-6 * change[rate] * (p.readings.knots_s[k] + e.time_offset_s - MIDDLE_S)
            delta = e.time_offset_s - b.time_offset_s + late_s
            omega = p.readings.knot_gyro[k] - p.nodes.at_knots(e.gyro_bias)[k]
            R, origin = e.states.R[k] @ exp(-omega * delta), e.states.p[k] - e.states.v[k] * delta
            n = e.normals[j]
            seen = np.append(e.R_imu_lidar.T @ R.T @ n, n @ (R @ e.p_imu_lidar + origin) + e.offsets_m[j])
            own = sum(change[places[self.laser[i], c]] * self.f[i, FEATURE[c]] for c in range(9))
            if self.nuisance.materials:
                own += self.nuisance.values(change, MATERIAL)[j] * self.f[i, 4]
            if self.squares:
                own -= heights[self.corners[i]] @ self.f[i, 8:]
            out.append(seen @ self.y[i, :4] + self.y[i, 4] + own)
        prior, _ = prior_rows(p.priors, p.nodes, e, p.layout(e))
        return np.concatenate([links.ravel(), out, prior])

    def numerical_jacobian(self) -> FloatArray:
        """Central differences, each parameter of the sensors in steps of its own size."""
        p, e = self.problem, self.estimate
        shared = p.layout(e).size
        size = plain.KNOTS * 9 + shared
        unit = np.full(size, 1e-5)
        unit[size - self.nuisance.size :] = 1e-3 * self.nuisance.prior_std
        columns = []
        for i in range(size):
            step = np.zeros(size)
            step[i] = unit[i]
            forth, back = (
                self.stacked(
                    p.moved(
                        e,
                        ArrowSolution(
                            (s * step[: plain.KNOTS * 9]).reshape(-1, 9),
                            s * step[plain.KNOTS * 9 :],
                            np.zeros((0, 0)),
                            0.0,
                        ),
                    )
                )
                for s in (1, -1)
            )
            columns.append((forth - back) / (2 * unit[i]))
        return np.array(columns).T


def written_out(case: Case) -> tuple[FloatArray, FloatArray]:
    """The normal equations over all unknowns at once, as the problem linearises them: (N, N) and (N,)."""
    system = ArrowSystem.of(case.problem.linearise(case.estimate))
    n, size = 9, plain.KNOTS * 9 + system.corner.shape[0]
    H = np.zeros((size, size))
    for k in range(plain.KNOTS):
        at, border = slice(k * n, k * n + n), slice(plain.KNOTS * n, size)
        H[at, at], H[at, border], H[border, at] = (
            system.diagonal[k],
            system.border[k],
            system.border[k].T,
        )
        if k + 1 < plain.KNOTS:
            H[at.stop : at.stop + n, at], H[at, at.stop : at.stop + n] = system.lower[k], system.lower[k].T
    H[plain.KNOTS * n :, plain.KNOTS * n :] = system.corner
    return H, np.concatenate([system.gradient.ravel(), system.gradient_shared])
