"""Small planes at odds with all others: least squares with and without them, solved by themselves."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.full.assess.influence import Influences
from calib_core.full.assess.odd_planes import odd_planes
from calib_core.full.joint.state import CALIBRATION
from calib_core.types import FloatArray

PLANES, ROWS = 6, 60
#: The last two hold a thirtieth of what the others hold.
SMALL = np.array([False] * 4 + [True] * 2)


def _pulls(seed: int, bent: dict[int, float]) -> tuple[Influences, FloatArray]:
    """What planes of unit noise have pulled the seven by, and the covariance. bent: by how many sigmas some are off."""
    rng = np.random.default_rng(seed)
    size = np.where(SMALL, 0.3, 2.0)
    A = size[:, None, None] * rng.normal(size=(PLANES, ROWS, CALIBRATION))
    b = rng.normal(size=(PLANES, ROWS))
    for k, sigmas in bent.items():
        b[k] += sigmas * np.sign(A[k, :, 0])
    every = A.reshape(-1, CALIBRATION)
    covariance = np.linalg.inv(every.T @ every)
    answer = covariance @ every.T @ b.reshape(-1)
    X = A @ covariance
    moved = -np.einsum("kri,kr->ki", X, A @ answer - b)
    return Influences(moved, np.swapaxes(X, 1, 2) @ X), covariance


@pytest.mark.parametrize("seed", range(5))
def test_a_small_plane_alone_at_odds_is_odd_and_walls_are_not(seed: int) -> None:
    """A table's top that is off by many sigmas of its points, among walls that are flat: it is named. A wall that is as far off
    is none to be left out, nor is a table among walls that contradict each other, as where a mount bends; nor anything by noise.

    Mutations: the plane that pulls the most, whether all others agree or not; small or not; others as they
    pull against it.
    """
    assert odd_planes(*_pulls(seed, {5: 15.0}), SMALL).tolist() == [False] * 5 + [True]
    assert odd_planes(*_pulls(seed, {4: -15.0, 5: 15.0}), SMALL).tolist() == [False] * 4 + [True] * 2
    assert not odd_planes(*_pulls(seed, {1: 3.0}), SMALL).any()
    assert not odd_planes(*_pulls(seed, {1: 3.0, 2: -3.0, 5: 15.0}), SMALL).any()
    assert not odd_planes(*_pulls(seed, {}), SMALL).any()
    assert not odd_planes(*_pulls(seed, {5: 15.0}), ~SMALL).any()
