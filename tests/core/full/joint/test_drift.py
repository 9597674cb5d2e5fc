"""How far a propagated motion strays, against errors drawn at random and integrated step by step."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.full.joint.drift import Drift
from calib_core.full.joint.settings import STRAYING

ACCELERATION_COV = np.array([[4e-4, 1e-4, 0.0], [1e-4, 9e-4, 0.0], [0.0, 0.0, 1e-4]])
DENSITY = 0.05


def test_straying_is_that_of_errors_integrated_step_by_step() -> None:
    """And in one step as in ten.

    Fails when the constant error of the acceleration is left out of the position, or noise grows with t instead of t^3.
    """
    rng = np.random.default_rng(1)
    runs, h, steps = 4000, 0.02, 150
    p, v = 0.02 * rng.normal(size=(runs, 3)), 0.05 * rng.normal(size=(runs, 3))
    a = rng.multivariate_normal(np.zeros(3), ACCELERATION_COV, size=runs)
    for _ in range(steps):
        now = a + DENSITY / np.sqrt(h) * rng.normal(size=(runs, 3))
        p += v * h + 0.5 * now * h**2
        v += now * h
    drift = Drift.begun(ACCELERATION_COV, DENSITY)
    for _ in range(10):
        drift = drift.after(0.3)
    normals = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.6, -0.8, 0.0]])
    expected = np.sqrt(np.mean((p @ normals.T) ** 2, axis=0))
    np.testing.assert_allclose(drift.along(normals), expected, rtol=0.05)
    at_once = Drift.begun(ACCELERATION_COV, DENSITY).after(3.0)
    np.testing.assert_allclose(at_once.covariance, drift.covariance, rtol=1e-9, atol=1e-15)


def test_a_plane_in_view_holds_its_own_direction_and_no_other() -> None:
    """Fails when the gain is applied to all directions alike."""
    drift = Drift.begun(np.diag([1e-2, 1e-2, 1e-2]), DENSITY).after(3.0)
    free = drift.along(np.eye(3))
    wall = np.array([[0.6, 0.8, 0.0]])
    drift = drift.corrected(wall)
    known = 1.0 / (1.0 / (wall[0] @ np.diag(free**2) @ wall[0]) + 1.0 / STRAYING.seen_std_m**2)
    assert drift.along(wall)[0] == pytest.approx(np.sqrt(known))
    np.testing.assert_allclose(
        drift.along(np.array([[-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])), [free[0], free[2]], rtol=1e-9
    )
    assert drift.farthest_m() > 0.9 * free[2]
