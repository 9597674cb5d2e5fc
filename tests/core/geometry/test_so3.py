"""Rotations against exact rational series, quadrature, SciPy's matrix exponential and the group's own laws."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from calib_core.geometry import (
    exp,
    hat,
    log,
    mean_rotation,
    nearest_rotation,
    right_jacobian,
    right_jacobian_inverse,
    so3,
)
from calib_core.types import FloatArray

#: Angles from where the series rules to past where the closed forms do, dense about the switch at 0.25.
SWEEP = np.concatenate(
    [np.logspace(-9, np.log10(3.14), 90), 0.25 + np.linspace(-1e-3, 1e-3, 21), np.nextafter(0.25, [0.0, 1.0])]
)


def _sine_and_cosine(theta: Fraction) -> tuple[Fraction, Fraction]:
    """Both to 60 digits for angles below 2 pi, in rational arithmetic: no cancellation can hurt."""
    sine, cosine, term = Fraction(0), Fraction(0), Fraction(1)
    for k in range(60):
        if k % 2 == 0:
            cosine += term if k % 4 == 0 else -term
        else:
            sine += term if k % 4 == 1 else -term
        # 70 digits of each term: exact fractions of a double's 53 bits would grow beyond use.
        term = Fraction(round(term * theta / (k + 1) * 10**70), 10**70)
    return sine, cosine


def _exact_a(theta: Fraction) -> Fraction:
    return _sine_and_cosine(theta)[0] / theta


def _exact_b(theta: Fraction) -> Fraction:
    return (1 - _sine_and_cosine(theta)[1]) / theta**2


def _exact_c(theta: Fraction) -> Fraction:
    return (theta - _sine_and_cosine(theta)[0]) / theta**3


def _exact_d(theta: Fraction) -> Fraction:
    sine, cosine = _sine_and_cosine(theta)
    return 1 / theta**2 - (1 + cosine) / (2 * theta * sine)


@pytest.mark.parametrize(
    ("coefficient", "exact"),
    [
        (so3._sinc, _exact_a),
        (so3._coefficient_b, _exact_b),
        (so3._coefficient_c, _exact_c),
        (so3._coefficient_d, _exact_d),
    ],
    ids=["a", "b", "c", "d"],
)
def test_coefficients_are_exact_across_their_switch(
    coefficient: Callable[[FloatArray], FloatArray], exact: Callable[[Fraction], Fraction]
) -> None:
    """Fails when a series coefficient is wrong (30240 to 30420), or a switch moves to 1e-3, where few digits are left.

    At the switch the closed forms subtract numbers that agree to theta^2 / 6 = 1 %: they lose two digits of sixteen.
    """
    values = coefficient(SWEEP)
    truth = np.array([float(exact(Fraction(float(theta)))) for theta in SWEEP])
    np.testing.assert_allclose(values, truth, rtol=3e-14, atol=0.0)


def test_zero_angle_is_the_identity() -> None:
    """Fails when `_coefficient_c` divides by the raw angle: a NaN, and a warning, at zero."""
    zero = np.zeros((2, 3))
    for function in (exp, right_jacobian, right_jacobian_inverse):
        np.testing.assert_array_equal(function(zero), np.broadcast_to(np.eye(3), (2, 3, 3)))
    np.testing.assert_array_equal(log(np.broadcast_to(np.eye(3), (2, 3, 3))), zero)


@pytest.mark.parametrize("shape", [(), (1,), (7,), (2, 3)])
def test_exp_is_the_matrix_exponential(shape: tuple[int, ...]) -> None:
    """Fails when hat has a sign swapped, or b is (1 - cos) / theta."""
    phi = np.random.default_rng(1).normal(size=(*shape, 3)) * 1.3
    expected = np.array([expm(_cross_matrix(p)) for p in phi.reshape(-1, 3)]).reshape(*shape, 3, 3)
    np.testing.assert_allclose(exp(phi), expected, atol=1e-14)


def _cross_matrix(a: FloatArray) -> FloatArray:
    return np.cross(a, np.eye(3)).T


def test_hat_is_the_cross_product() -> None:
    """Fails when hat is transposed."""
    a, b = np.random.default_rng(2).normal(size=(2, 5, 3))
    np.testing.assert_allclose((hat(a) @ b[..., None])[..., 0], np.cross(a, b), atol=1e-15)


@pytest.mark.parametrize("seed", range(3))
def test_log_undoes_exp_up_to_half_a_turn(seed: int) -> None:
    """Fails when log takes the angle from arccos of the trace: half of the digits are gone near 0 and pi."""
    rng = np.random.default_rng(seed)
    angle = np.concatenate([np.logspace(-12, 0, 25), np.pi - np.logspace(-12, -0.5, 25), [np.pi]])
    axis = rng.normal(size=(len(angle), 3))
    phi = axis / np.linalg.norm(axis, axis=1, keepdims=True) * angle[:, None]
    back = log(exp(phi))
    # At half a turn the axis has no sign, and within round-off of it neither.
    opposite = np.where(angle > np.pi - 1e-11, np.linalg.norm(back + phi, axis=1), np.inf)
    error = np.minimum(np.linalg.norm(back - phi, axis=1), opposite)
    np.testing.assert_array_less(error, 4e-15 + 1e-14 * angle)


def test_log_agrees_with_scipy_whichever_quaternion_component_is_largest() -> None:
    """Fails when one of the four branches of log mixes up its components (+ for - in the vector part)."""
    rotation = Rotation.random(400, rng=np.random.default_rng(3))
    np.testing.assert_allclose(log(rotation.as_matrix()), rotation.as_rotvec(), atol=1e-13)
    for axis in np.eye(3):
        half_turn = 2 * np.outer(axis, axis) - np.eye(3)
        np.testing.assert_allclose(np.abs(log(half_turn)), np.pi * axis, atol=1e-15)


def test_group_laws() -> None:
    """Fails when exp loses its quadratic term: no longer a rotation, no inverse."""
    phi = np.random.default_rng(4).normal(size=(50, 3)) * 1.5
    R = exp(phi)
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-14)
    np.testing.assert_allclose(exp(-phi), np.swapaxes(R, 1, 2), atol=1e-15)
    np.testing.assert_allclose(exp(0.3 * phi) @ exp(0.7 * phi), R, atol=1e-14)
    turned = (R @ phi[:, :, None])[..., 0]
    np.testing.assert_allclose(turned, phi, atol=1e-14)
    conjugated = R[:1] @ exp(phi) @ np.swapaxes(R[:1], 1, 2)
    np.testing.assert_allclose(exp(phi @ R[0].T), conjugated, atol=1e-14)


def test_right_jacobian_is_the_mean_of_the_rotations_on_the_way_back() -> None:
    """Fails when Jr has + b (the left Jacobian).

    Jr(phi) = integral over s in 0..1 of Exp(-s phi), by Gauss-Legendre with 24 points: exact to round-off below 2 pi.
    """
    node, weight = np.polynomial.legendre.leggauss(24)
    phi = np.random.default_rng(5).normal(size=(40, 3)) * 1.2
    expected = sum(
        0.5 * w * Rotation.from_rotvec(-0.5 * (s + 1) * phi).as_matrix() for s, w in zip(node, weight, strict=True)
    )
    np.testing.assert_allclose(right_jacobian(phi), expected, atol=2e-14)


def test_right_jacobian_inverse_is_its_inverse() -> None:
    """Fails when the inverse has - hat / 2."""
    axis = np.random.default_rng(6).normal(size=(60, 3))
    phi = axis / np.linalg.norm(axis, axis=1, keepdims=True) * np.linspace(1e-6, 5.5, 60)[:, None]
    product = right_jacobian(phi) @ right_jacobian_inverse(phi)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(3), product.shape), atol=3e-13)


def test_jacobians_are_first_order_in_the_step() -> None:
    """Fails when Jr and its inverse are swapped: the remainder then falls with the step, not with its square."""
    rng = np.random.default_rng(7)
    phi, step = rng.normal(size=(2, 30, 3))
    remainders, inverse_remainders = [], []
    for size in (1e-2, 5e-3):
        delta = size * step
        turn = log(np.swapaxes(exp(phi), 1, 2) @ exp(phi + delta))
        remainders.append(np.linalg.norm(turn - (right_jacobian(phi) @ delta[..., None])[..., 0]))
        moved = log(exp(phi) @ exp(delta)) - phi
        inside = np.linalg.norm(phi, axis=1) < 3.0
        linear = (right_jacobian_inverse(phi) @ delta[..., None])[..., 0]
        inverse_remainders.append(np.linalg.norm((moved - linear)[inside]))
    for pair in (remainders, inverse_remainders):
        assert 1.8 < np.log2(pair[0] / pair[1]) < 2.3


def test_nearest_rotation_beats_every_other() -> None:
    """Fails when a reflection is let through (no determinant in the middle of the product).

    The oracle: no small turn of the answer, and none of 200 random rotations, is nearer to the matrix.
    """
    rng = np.random.default_rng(8)
    others = Rotation.random(200, rng=rng).as_matrix()
    for _ in range(20):
        matrix = rng.normal(size=(3, 3))
        nearest = nearest_rotation(matrix)
        assert np.linalg.det(nearest) == pytest.approx(1.0)
        distance = np.linalg.norm(nearest - matrix)
        turned = nearest @ exp(1e-3 * np.vstack([np.eye(3), -np.eye(3)]))
        for other in (*others, *turned):
            assert distance <= np.linalg.norm(other - matrix) + 1e-12


def test_mean_rotation_is_the_middle_of_a_balanced_stack() -> None:
    """Fails when the stack's product is taken instead of its sum."""
    centre = Rotation.random(rng=np.random.default_rng(9)).as_matrix()
    turns = np.vstack([np.eye(3), -np.eye(3)]) * 0.4
    np.testing.assert_allclose(mean_rotation(centre @ exp(turns)), centre, atol=1e-14)
