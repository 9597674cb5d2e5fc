"""Rotations of compiled loops against SciPy's and the batched ones, at every angle."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.geometry import right_jacobian, right_jacobian_inverse
from calib_core.geometry.compiled import exp_into, log_into, right_jacobian_into, right_jacobian_inverse_into
from calib_core.types import FloatArray

ANGLES = [0.0, 1e-12, 1e-9, 1e-4, 0.1, 0.2499, 0.2501, 1.0, 2.0, 2.5, 3.0, np.pi - 1e-6, np.pi - 1e-9]


def _axes() -> FloatArray:
    """Along each axis, either way, and askew: every component is the largest of some."""
    some = np.vstack([np.eye(3), -np.eye(3), np.random.default_rng(1).normal(size=(20, 3))])
    return some / np.linalg.norm(some, axis=1, keepdims=True)


@pytest.mark.parametrize("angle", [*ANGLES, 0.01, 0.0499999, 0.0500001])
def test_a_rotation_has_all_its_digits_at_every_angle(angle: float) -> None:
    """Mutations: the last term of either series left out; that of the cosine begun with 1 / 20; the series taken up to 1 rad."""
    R, turn = np.empty((3, 3)), np.empty((3, 3))
    for axis in _axes():
        exp_into(*(angle * axis), R)
        # I + sin hat + (1 - cos) hat^2, with 1 - cos as a square, which keeps the digits of small ones.
        hat = np.cross(axis, -np.eye(3))
        turn[:] = np.sin(angle) * hat + 2.0 * np.sin(0.5 * angle) ** 2 * hat @ hat
        np.testing.assert_allclose(R - np.eye(3), turn, atol=4e-16 if angle < 0.1 else 2e-15, rtol=0.0)


@pytest.mark.parametrize("angle", ANGLES)
def test_a_logarithm_has_all_its_digits_at_every_angle(angle: float) -> None:
    """Mutations: the scalar part always taken for the largest; its sign left out; the cosine of the half turn alone."""
    out = np.empty(3)
    for axis in _axes():
        log_into(Rotation.from_rotvec(angle * axis).as_matrix(), out)
        np.testing.assert_allclose(out, angle * axis, atol=2e-15 + 1e-15 * angle)


@pytest.mark.parametrize("angle", ANGLES)
def test_jacobians_are_the_batched_ones(angle: float) -> None:
    """Mutations: c with theta^2 for theta^3; d without its half; the series taken at any angle."""
    J = np.empty((3, 3))
    for axis in _axes():
        right_jacobian_into(*(angle * axis), J)
        np.testing.assert_allclose(J, right_jacobian(angle * axis), atol=2e-15)
        right_jacobian_inverse_into(*(angle * axis), J)
        np.testing.assert_allclose(J, right_jacobian_inverse(angle * axis), atol=4e-15)
