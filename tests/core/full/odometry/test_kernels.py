"""The tracker's compiled loops against NumPy twins, finite differences and SciPy's rotations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.full.odometry.kernels import (
    Counting,
    Motion,
    Seen,
    Surfaces,
    balanced_kernel,
    descend_kernel,
    equations_kernel,
    look_kernel,
    register_kernel,
    room,
    room_for,
    straighten_kernel,
)
from calib_core.geometry import plane_axes
from calib_core.types import BoolArray, FloatArray, IntArray


def _equations(
    points: FloatArray, tau: FloatArray, surfaces: Surfaces, at: Motion, worth: FloatArray, scale: float
) -> tuple[FloatArray, FloatArray, Seen]:
    """A look and what it tells: (12, 12), (12,)."""
    seen, sums, gradient = room_for(len(points)), np.empty((3, 24)), np.empty(12)
    look_kernel(points, tau, surfaces, at, seen)
    equations_kernel(tau, surfaces.normals, surfaces.normals @ at.R, worth, scale, seen, sums, gradient)
    blocks = np.zeros((3, 6, 6))
    for power in range(3):
        blocks[power][np.triu_indices(6)] = sums[power, :21]
        blocks[power] += np.triu(blocks[power], 1).T
    return np.block([[blocks[0], blocks[1]], [blocks[1], blocks[2]]]), gradient, seen


@dataclass
class Registration:
    """A scan, planes and a motion."""

    points: FloatArray
    tau: FloatArray
    normals: FloatArray
    offsets: FloatArray
    R: FloatArray
    p: FloatArray
    omega: FloatArray
    v: FloatArray

    @property
    def at(self) -> Motion:
        return Motion(self.R.copy(), self.p.copy(), self.omega.copy(), self.v.copy())

    def surfaces(self, reach: BoolArray | None = None, cell_m: float = 1.0, outside_m: float = 1.0) -> Surfaces:
        """Its planes, known everywhere unless told."""
        everywhere = np.ones((len(self.normals), 1, 1), np.bool_)
        axes = plane_axes(self.normals)
        return Surfaces(self.normals, self.offsets, axes, everywhere if reach is None else reach, cell_m, outside_m)

    def run(self, scale: float) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        worth = np.ones(len(self.normals))
        hessian, gradient, seen = _equations(self.points, self.tau, self.surfaces(), self.at, worth, scale)
        assert seen.inside[seen.plane >= 0].all()
        return hessian, gradient, seen.d, seen.plane

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
    np.testing.assert_allclose(hessian, (rows * weight[:, None]).T @ rows, atol=1e-9)


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


def _descended(
    case: Registration, which: IntArray, scales: tuple[float, ...], tie: FloatArray, most: float, least: int
) -> tuple[Rotation, FloatArray, set[float]]:
    """The twin: step by step, each from the kernels' normal equations, with SciPy's rotations. Also p, omega, v (9,), and whether
    planes counted, of all steps."""
    points, tau, surfaces = case.points[which], case.tau[which], case.surfaces()
    at, worth = Rotation.from_matrix(case.R), np.ones(len(case.normals))
    rest = np.concatenate([case.p, case.omega, case.v])
    first, kinds = rest.copy(), set()
    for scale in scales:
        now = Motion(at.as_matrix(), rest[:3].copy(), rest[3:6].copy(), rest[6:].copy())
        hessian, gradient, seen = _equations(points, tau, surfaces, now, worth, scale)
        on = seen.plane[(seen.plane >= 0) & (np.abs(seen.d) < 2 * scale)]
        count = np.bincount(on, minlength=len(case.normals))
        worth = np.where(count < least, 0.0, 1.0 / (1.0 + count / most))
        kinds |= set(np.sign(worth).tolist())
        away = np.concatenate([(Rotation.from_matrix(case.R).inv() * at).as_rotvec(), rest - first])
        step = -np.linalg.solve(hessian + np.diag(tie), gradient + tie * away)
        at, rest = at * Rotation.from_rotvec(step[:3]), rest + step[3:]
    return at, rest, kinds


def test_the_descent_is_the_loop_of_damped_steps() -> None:
    """Fails when the tie pulls to the last step's pose and not to the prediction, or a plane's worth is not renewed."""
    case = _registration(4, 0.5)
    scales, tie = (0.8, 0.4, 0.2), np.repeat([3.0, 4.0, 0.02, 0.1], 3)
    moved, seen = case.at, room_for(len(case.points))
    look_kernel(case.points, case.tau, case.surfaces(), moved, seen)
    counting = Counting(200, 15.0, 9.0, 8, 0.1)
    descend_kernel(case.points, case.tau, case.surfaces(), np.array(scales), tie, counting, moved, seen)
    at, rest, kinds = _descended(case, np.arange(len(case.points)), scales, tie, 15.0, 8)
    assert kinds == {0.0, 1.0}  # some planes counted and some did not
    assert np.linalg.norm(rest - np.concatenate([case.p, case.omega, case.v])) > 0.05
    np.testing.assert_allclose(moved.R, at.as_matrix(), atol=1e-10)
    np.testing.assert_allclose(np.concatenate(moved[1:]), rest, atol=1e-10)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_look_takes_the_first_of_the_least_far_planes(seed: int) -> None:
    """Fails when the nearest equation is taken where its plane is not known or is seen from behind, when being off a plane costs
    nothing, or when of two copies of a plane the second one is taken.

    The twin: a table of all points and planes, sorted out by NumPy. Half of the cells are unknown, every plane is there twice.
    """
    case = _registration(seed, 1.0)
    case.normals, case.offsets = np.tile(case.normals, (2, 1)), np.tile(case.offsets, 2)
    rng = np.random.default_rng(seed)
    reach = np.tile(rng.random((4, 12, 12)) < 0.5, (2, 1, 1))
    surfaces, seen = case.surfaces(reach, 1.5, 0.7), room_for(len(case.points))
    look_kernel(case.points, case.tau, surfaces, case.at, seen)
    table = case.distances()
    x_map = case.swept() @ case.R.T + case.p + case.tau[:, None] * case.v
    cell = np.clip(np.floor(np.einsum("pai,ni->npa", surfaces.axes, x_map) / 1.5).astype(int) + 6, 0, 11)
    known = reach[np.arange(8), cell[..., 0], cell[..., 1]]
    far = np.abs(table) + np.where(known, 0.0, 0.7)
    # Copies are alike to the last digit, what is not a copy is not.
    best = np.argmin(far[:, :4], axis=1)
    each, some = np.arange(len(far)), np.isfinite(far.min(axis=1))
    np.testing.assert_array_equal(seen.plane, np.where(some, best, -1))
    np.testing.assert_allclose(seen.d[some], table[each, best][some], atol=1e-12)
    np.testing.assert_allclose(seen.far[some], far[each, best][some], atol=1e-12)
    np.testing.assert_array_equal(seen.inside, some & known[each, best])
    np.testing.assert_allclose(seen.turned, case.swept(), atol=1e-12)
    np.testing.assert_allclose(seen.x_map, x_map, atol=1e-12)
    straight = np.empty_like(x_map)
    straighten_kernel(case.points, case.tau, case.at, straight)
    np.testing.assert_array_equal(straight, seen.x_map)
    assert 0.1 < np.mean(seen.inside) < 0.9
    assert not some.all()


def _balanced(group: IntArray, count: int) -> IntArray:
    """The twin: groups are filled up from the smallest, and of each every so many-th is taken."""
    order = np.argsort(group, kind="stable")
    sizes = np.unique(group, return_counts=True)[1]
    most, left = count, count
    for rank, size in enumerate(np.sort(sizes)):
        most = left // (len(sizes) - rank)
        if size > most:
            break
        left -= size
    taken = np.minimum(sizes, most)
    starts = np.cumsum(sizes) - sizes
    picks = [at + np.arange(n) * size // n for at, n, size in zip(starts, taken, sizes, strict=True)]
    return np.sort(order[np.concatenate(picks)])


@pytest.mark.parametrize("shares", [(0.9, 0.05, 0.03, 0.02), (0.25, 0.25, 0.25, 0.25), (0.5, 0.5, 0.0, 0.0)])
def test_few_points_are_of_all_planes_alike(shares: tuple[float, ...]) -> None:
    """Fails when a broad plane is not thinned, when its first points are taken, or when points off all planes are not a group."""
    rng = np.random.default_rng(0)
    seen = room_for(3000)
    seen.plane[:] = rng.choice(4, 3000, p=shares)
    seen.d[:] = rng.choice([0.1, 0.6], 3000, p=[0.95, 0.05])
    few = balanced_kernel(seen, 0.4, 4, 700)
    group = np.where(seen.d < 0.4, seen.plane, -1)
    np.testing.assert_array_equal(few, _balanced(group, 700))
    assert 680 <= len(few) <= 700
    np.testing.assert_array_equal(balanced_kernel(seen, 0.4, 4, 3000), np.arange(3000))


def test_a_registration_descends_among_some_points_and_sees_all() -> None:
    """Fails when points are balanced by another scale than the first, when the descent takes all of them, when what they tell is
    asked before the last step, or with the worth of the descent.
    """
    case = _registration(2, 0.5)
    scales, tie = (0.8, 0.4, 0.2), np.repeat([3.0, 4.0, 0.02, 0.1], 3)
    counting, moved = Counting(90, 15.0, 5.0, 4, 0.6), case.at
    seen = room(len(case.points))
    sure = register_kernel(case.points, case.tau, case.surfaces(), np.array(scales), tie, counting, moved, seen)
    first = room_for(len(case.points))
    look_kernel(case.points, case.tau, case.surfaces(), case.at, first)
    few = _balanced(np.where(np.abs(first.d) < scales[0], first.plane, -1), 90)
    assert len(few) < 95
    at, rest, _ = _descended(case, few, scales, tie, 15.0, 4)
    np.testing.assert_allclose(moved.R, at.as_matrix(), atol=1e-10)
    np.testing.assert_allclose(np.concatenate(moved[1:]), rest, atol=1e-10)
    case.R, (case.p, case.omega, case.v) = at.as_matrix(), rest.reshape(3, 3)
    table = case.distances()
    best = np.argmin(np.abs(table), axis=1)
    some = np.isfinite(table.min(axis=1))
    np.testing.assert_array_equal(seen.plane, np.where(some, best, -1))
    count = np.bincount(best[few][np.abs(table[few, best[few]]) < 0.6], minlength=4)
    worth = np.where(count < 8, 0.0, 1.0 / (1.0 + count / 5.0))
    assert 0 < np.count_nonzero(worth) < 4 or count.min() >= 8
    hessian, _, _ = _equations(case.points[few], case.tau[few], case.surfaces(), case.at, worth, scales[-1])
    np.testing.assert_allclose(sure, hessian[:6, :6], rtol=1e-6, atol=1e-9)
