"""Link factors: zero on true motion, unchanged by the choice of frame, derivatives by remainder slope."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.factors.imu import KnotStates, LinkFactors, link_factors, link_residuals
from calib_core.geometry import log
from calib_core.imu.preintegration import Links
from calib_core.types import FloatArray

H_S = 0.25
GRAVITY = np.array([0.4, -0.3, -9.79])


def _states(seed: int, knots: int = 6) -> KnotStates:
    rng = np.random.default_rng(seed)
    return KnotStates(
        Rotation.random(knots, rng=rng).as_matrix(), rng.normal(size=(knots, 3)), 2.0 * rng.normal(size=(knots, 3))
    )


def _links(seed: int, links: int = 5) -> Links:
    """Measurements and weights that fit nothing: residuals of radians and metres."""
    rng = np.random.default_rng(seed)
    D = rng.normal(size=(5, links, 3, 3)) * 0.2
    sqrt_info = np.tril(rng.normal(size=(links, 9, 9))) + 3 * np.eye(9)
    return Links(
        H_S, Rotation.from_rotvec(0.6 * rng.normal(size=(links, 3))).as_matrix(), rng.normal(size=(links, 3)),
        rng.normal(size=(links, 3)), *D, sqrt_info,
    )  # fmt: skip


def _near(seed: int, scale: float) -> tuple[Links, KnotStates]:
    """Links, and states whose rotations disagree with them by about `scale` radians."""
    rng = np.random.default_rng(seed)
    links, states = _links(seed), _states(seed)
    R = [states.R[0]]
    for DR in links.DR:
        R.append(R[-1] @ DR @ Rotation.from_rotvec(scale * rng.normal(size=3)).as_matrix())
    return links, KnotStates(np.array(R), states.p, states.v)


ZERO = np.zeros((5, 3))
Residual = Callable[[FloatArray], FloatArray]


def _remainder_falls_with_the_square(
    residual: Residual, jacobian: Callable[[FloatArray], FloatArray], columns: int
) -> None:
    """The one check of all derivatives: r(step) - r(0) - J step, for random steps of three sizes."""
    rng = np.random.default_rng(99)
    way = rng.normal(size=columns)
    start = residual(np.zeros(columns))
    sizes = np.array([4e-3, 2e-3, 1e-3])
    left = [float(np.linalg.norm(residual(s * way) - start - s * jacobian(way))) for s in sizes]
    linear = float(np.linalg.norm(jacobian(way)))
    assert linear > 0.1
    # Zero remainder: the residual is linear in this block. Otherwise halving the step quarters it.
    assert left[2] < 1e-10 or (left[2] < 0.05 * sizes[2] * linear and 3.5 < left[1] / left[2] < 4.5)


def _block(factors: LinkFactors, name: str, way: FloatArray) -> FloatArray:
    """A block's first-order change of the residuals (L, 9) for a step of its parameter."""
    J: FloatArray = getattr(factors, name)
    if name == "r_D_gravity":
        return (J @ way[:, None])[..., 0]
    return (J @ way.reshape(len(J), -1, 1))[..., 0]


@pytest.mark.parametrize("scale", [1e-3, 0.4])
@pytest.mark.parametrize(("name", "columns"), [("r_D_first", 54), ("r_D_second", 54), ("r_D_gravity", 3)])
def test_derivatives_with_respect_to_states_and_gravity(name: str, columns: int, scale: float) -> None:
    """Fails when hat(dp) in r_D_first is replaced by hat(dv), or r_D_gravity has h^2 without its half.

    Small residuals and large ones: the inverse Jacobian of a residual of half a radian counts.
    """
    links, states = _near(1, scale)
    factors = link_factors(links, states, GRAVITY, ZERO, ZERO)

    def residual(step: FloatArray) -> FloatArray:
        moved = states if name == "r_D_gravity" else states.moved(step.reshape(6, 9))
        return link_residuals(links, moved, GRAVITY + step if name == "r_D_gravity" else GRAVITY, ZERO, ZERO)

    def jacobian(way: FloatArray) -> FloatArray:
        if name == "r_D_gravity":
            return _block(factors, name, way)
        steps = way.reshape(6, 9)
        return _block(factors, "r_D_first", steps[:-1]) + _block(factors, "r_D_second", steps[1:])

    _remainder_falls_with_the_square(residual, jacobian, columns)


@pytest.mark.parametrize("name", ["r_D_gyro_bias", "r_D_accel_bias"])
def test_derivatives_with_respect_to_the_biases(name: str) -> None:
    """Fails when r_D_gyro_bias leaves out Exp(-r), or r_D_accel_bias has its sign flipped.

    About the bias of the preintegration, where the solve starts and ends.
    """
    links, states = _near(2, 0.4)
    factors = link_factors(links, states, GRAVITY, ZERO, ZERO)

    def residual(step: FloatArray) -> FloatArray:
        change = step.reshape(5, 3)
        gyro, accel = (change, ZERO) if name == "r_D_gyro_bias" else (ZERO, change)
        return link_residuals(links, states, GRAVITY, gyro, accel)

    _remainder_falls_with_the_square(residual, lambda way: _block(factors, name, way), 15)


def test_bias_derivative_away_from_the_preintegration_is_off_by_no_more_than_the_turn_it_makes() -> None:
    """Fails when the gyro bias's change turns DR by twice its share.

    The Jacobian leaves out Jr of the correction, half its angle: 0.2 rad/s over 10 ms is 2e-3 rad, and 1e-3 of itself.
    """
    rng = np.random.default_rng(3)
    links, states = _near(3, 1e-3)
    small = Links(
        0.01, links.DR, links.Dv, links.Dp, -0.01 * np.broadcast_to(np.eye(3), (5, 3, 3)), *([np.zeros((5, 3, 3))] * 4),
        np.broadcast_to(np.eye(9), (5, 9, 9)),
    )  # fmt: skip
    change, way = 0.1 * rng.normal(size=(5, 3)), rng.normal(size=(5, 3))
    J = link_factors(small, states, GRAVITY, change, ZERO).r_D_gyro_bias
    forth = link_residuals(small, states, GRAVITY, change + 1e-4 * way, ZERO)
    back = link_residuals(small, states, GRAVITY, change - 1e-4 * way, ZERO)
    expected = (forth - back) / 2e-4
    np.testing.assert_allclose((J @ way[..., None])[..., 0], expected, atol=3e-3 * np.abs(expected).max())


def test_residuals_vanish_on_a_parabola_turning_steadily() -> None:
    """Fails when the position's residual has g h^2 without its half.

    v' = a, p'' = a with a constant a in the map frame, R = R0 Exp(w t): every difference in closed form.
    """
    a, w = np.array([0.7, -0.2, 1.1]), np.array([0.5, -1.5, 0.8])
    t = H_S * np.arange(6)
    R0 = Rotation.from_rotvec([0.3, 0.2, -1.0]).as_matrix()
    R = R0 @ Rotation.from_rotvec(t[:, None] * w).as_matrix()
    v0, p0 = np.array([0.4, 0.1, -0.6]), np.array([1.0, 2.0, 3.0])
    states = KnotStates(R, p0 + t[:, None] * v0 + 0.5 * t[:, None] ** 2 * a, v0 + t[:, None] * a)
    # What an IMU there integrates: R0' of the specific force's single and double integral, in the first knot's axes.
    force = a - GRAVITY
    Rt = np.swapaxes(R[:-1], 1, 2)
    links = Links(
        H_S, np.repeat(Rotation.from_rotvec(H_S * w).as_matrix()[None], 5, 0), H_S * (Rt @ force),
        0.5 * H_S**2 * (Rt @ force), *([np.zeros((5, 3, 3))] * 5), np.broadcast_to(np.eye(9), (5, 9, 9)),
    )  # fmt: skip
    np.testing.assert_allclose(link_residuals(links, states, GRAVITY, ZERO, ZERO), 0.0, atol=1e-14)


def test_residuals_do_not_know_the_map_frame() -> None:
    """Fails when gravity is taken in the IMU's axes.

    Laws: turning and shifting the map, and letting it drift at a constant velocity, change nothing.
    """
    links, states = _links(4), _states(4)
    before = link_residuals(links, states, GRAVITY, ZERO, ZERO)
    turn = Rotation.from_rotvec([1.0, -0.4, 0.3]).as_matrix()
    drift, shift = np.array([0.3, -0.8, 0.5]), np.array([5.0, 4.0, -2.0])
    t = H_S * np.arange(6)[:, None]
    moved = KnotStates(turn @ states.R, states.p @ turn.T + shift + t * drift, states.v @ turn.T + drift)
    np.testing.assert_allclose(link_residuals(links, moved, turn @ GRAVITY, ZERO, ZERO), before, atol=1e-12)


def test_bias_changes_move_the_measurement_by_their_own_derivatives() -> None:
    """Fails when the gyro bias's change is left out of the velocity.

    With unit weights the change of the residual is minus that of Dv and Dp, and turns DR by Exp(J b).
    """
    links, states = _near(5, 0.2)
    plain = Links(
        links.h_s, links.DR, links.Dv, links.Dp, links.DR_D_bg, links.Dv_D_bg, links.Dv_D_ba, links.Dp_D_bg,
        links.Dp_D_ba, np.broadcast_to(np.eye(9), (5, 9, 9)),
    )  # fmt: skip
    bg, ba = 0.1 * np.random.default_rng(6).normal(size=(2, 5, 3))
    before, after = (link_residuals(plain, states, GRAVITY, *b) for b in ((ZERO, ZERO), (bg, ba)))
    for i in range(5):
        Dv = links.Dv_D_bg[i] @ bg[i] + links.Dv_D_ba[i] @ ba[i]
        Dp = links.Dp_D_bg[i] @ bg[i] + links.Dp_D_ba[i] @ ba[i]
        np.testing.assert_allclose(after[i, 3:] - before[i, 3:], -np.concatenate([Dv, Dp]), atol=1e-12)
        DR = links.DR[i] @ Rotation.from_rotvec(links.DR_D_bg[i] @ bg[i]).as_matrix()
        np.testing.assert_allclose(after[i, :3], log(DR.T @ states.R[i].T @ states.R[i + 1]), atol=1e-12)


def test_a_step_of_the_states() -> None:
    """Fails when the rotation's step is applied on the left, or position and velocity change places."""
    states = _states(7)
    step = np.random.default_rng(8).normal(size=(6, 9))
    moved = states.moved(step)
    np.testing.assert_allclose(moved.R, states.R @ Rotation.from_rotvec(step[:, :3]).as_matrix(), atol=1e-13)
    np.testing.assert_array_equal(moved.p, states.p + step[:, 3:6])
    np.testing.assert_array_equal(moved.v, states.v + step[:, 6:])
