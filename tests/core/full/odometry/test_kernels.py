"""The tracker's compiled loops against NumPy twins, finite differences and SciPy's rotations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.full.odometry.kernels import descend_kernel, register_kernel
from calib_core.geometry import plane_axes
from calib_core.types import FloatArray, IntArray


@dataclass
class Registration:
    """A scan, planes and a motion for `register_kernel`."""

    points: FloatArray
    tau: FloatArray
    normals: FloatArray
    offsets: FloatArray
    R: FloatArray
    p: FloatArray
    omega: FloatArray
    v: FloatArray

    def run(self, scale: float) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        hessian, gradient = np.zeros((12, 12)), np.zeros(12)
        d, plane = np.empty(len(self.points)), np.empty(len(self.points), np.int64)
        inside = np.empty(len(self.points), np.bool_)
        everywhere = np.ones((len(self.normals), 1, 1), np.bool_)
        register_kernel(
            self.points, self.tau, self.normals, self.offsets, plane_axes(self.normals), everywhere,
            np.ones(len(self.normals)), 1.0, 1.0, self.R, self.p, self.omega, self.v, scale,
            hessian, gradient, d, plane, inside,
        )  # fmt: skip
        assert inside[plane >= 0].all()
        return hessian, gradient, d, plane

    def swept(self) -> FloatArray:
        """The points turned to second order about the scan's start, lidar axes."""
        t = self.tau[:, None]
        once = np.cross(self.omega, self.points)
        return self.points + t * once + 0.5 * t**2 * np.cross(self.omega, once)

    def distances(self) -> FloatArray:
        """Of every point to every plane, infinite where it would be seen from behind, (N, P)."""
        x = self.swept() @ self.R.T
        along = x @ self.normals.T
        moved = (x + self.p + self.tau[:, None] * self.v) @ self.normals.T + self.offsets
        return np.where(along > 0, np.inf, moved)


def _registration(seed: int, rate: float) -> Registration:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(4, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Registration(
        rng.normal(size=(200, 3)) * 3, rng.uniform(0, 0.1, 200), normals, rng.uniform(1.0, 4.0, 4),
        Rotation.random(rng=rng).as_matrix(), rng.normal(size=3), rate * rng.normal(size=3), rng.normal(size=3),
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(3))
def test_registration_is_that_of_its_rows(seed: int) -> None:
    """Fails when a plane seen from behind is taken, or the robust weight loses its square."""
    case = _registration(seed, 2.0)
    hessian, gradient, d, plane = case.run(0.4)
    table = case.distances()
    best = np.argmin(np.abs(table), axis=1)
    nearest = table[np.arange(len(table)), best]
    seen = np.isfinite(nearest)
    np.testing.assert_array_equal(plane, np.where(seen, best, -1))
    np.testing.assert_allclose(d, nearest, atol=1e-12)
    n = case.normals[best]
    m = n @ case.R
    t = case.tau[:, None]
    turn = np.cross(case.swept(), m)
    rows = np.hstack([turn, n, t * turn, t * n])[seen]
    weight = 1.0 / (1.0 + (nearest[seen] / 0.4) ** 2) ** 2
    np.testing.assert_allclose(gradient, rows.T @ (weight * nearest[seen]), atol=1e-9)
    np.testing.assert_allclose(hessian, np.triu((rows * weight[:, None]).T @ rows), atol=1e-9)


@pytest.mark.parametrize("block", ["rotation", "position", "rate", "velocity"])
def test_registration_gradient_is_the_derivative_of_half_the_squares(block: str) -> None:
    """Fails when the rotation's row has its sign flipped, or the rate's row leaves out the time.

    Central differences of the cost with a weight that is one everywhere; the rate about zero, where its row is exact.
    """
    case = _registration(7, 0.0)
    _, gradient, _, plane = case.run(1e9)
    seen = plane >= 0

    def cost(step: FloatArray) -> float:
        moved = Registration(
            case.points, case.tau, case.normals, case.offsets, case.R @ Rotation.from_rotvec(step[:3]).as_matrix(),
            case.p + step[3:6], case.omega + step[6:9], case.v + step[9:],
        )  # fmt: skip
        x = (moved.swept() @ moved.R.T + moved.p + moved.tau[:, None] * moved.v)[seen]
        d = np.einsum("ni,ni->n", x, case.normals[plane[seen]]) + case.offsets[plane[seen]]
        return 0.5 * float(d @ d)

    start = 3 * ["rotation", "position", "rate", "velocity"].index(block)
    for i in range(start, start + 3):
        step = 1e-5 * np.eye(12)[i]
        assert gradient[i] == pytest.approx((cost(step) - cost(-step)) / 2e-5, rel=1e-6, abs=1e-6)


def test_the_descent_is_the_loop_of_damped_steps() -> None:
    """Fails when the tie pulls to the last step's pose and not to the prediction, or a plane's worth is not renewed.

    The twin: step by step, each from the kernel's normal equations, with SciPy's rotations.
    """
    case = _registration(4, 0.5)
    scales, most, least = (0.8, 0.4, 0.2), 15.0, 8
    tie = np.repeat([3.0, 4.0, 0.02, 0.1], 3)
    everywhere = np.ones((len(case.normals), 1, 1), np.bool_)
    axes, n = plane_axes(case.normals), len(case.points)
    R, p, omega, v = case.R.copy(), case.p.copy(), case.omega.copy(), case.v.copy()
    descend_kernel(
        case.points, case.tau, case.normals, case.offsets, axes, everywhere, 1.0, 1.0, np.array(scales), tie, most, least,
        R, p, omega, v,
    )  # fmt: skip
    at, worth = Rotation.from_matrix(case.R), np.ones(len(case.normals))
    rest = np.concatenate([case.p, case.omega, case.v])
    first = rest.copy()
    kinds = set()
    for scale in scales:
        hessian, gradient = np.zeros((12, 12)), np.zeros(12)
        d, plane, inside = np.empty(n), np.empty(n, np.int64), np.empty(n, np.bool_)
        register_kernel(
            case.points, case.tau, case.normals, case.offsets, axes, everywhere, worth, 1.0, 1.0, at.as_matrix(), rest[:3],
            rest[3:6], rest[6:], scale, hessian, gradient, d, plane, inside,
        )  # fmt: skip
        on = plane[(plane >= 0) & (np.abs(d) < 2 * scale)]
        count = np.bincount(on, minlength=len(case.normals))
        worth = np.where(count < least, 0.0, 1.0 / (1.0 + count / most))
        kinds |= set(np.sign(worth))
        away = np.concatenate([(Rotation.from_matrix(case.R).inv() * at).as_rotvec(), rest - first])
        full = np.triu(hessian) + np.triu(hessian, 1).T + np.diag(tie)
        step = -np.linalg.solve(full, gradient + tie * away)
        at, rest = at * Rotation.from_rotvec(step[:3]), rest + step[3:]
    assert kinds == {0.0, 1.0}  # some planes counted and some did not
    assert np.linalg.norm(rest - first) > 0.05
    np.testing.assert_allclose(R, at.as_matrix(), atol=1e-10)
    np.testing.assert_allclose(np.concatenate([p, omega, v]), rest, atol=1e-10)
