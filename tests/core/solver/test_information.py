"""The one inverse of an information matrix: exact where all is known, and never certain of what is not."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.solver.arrow import FROZEN
from calib_core.solver.information import (
    ROUND_OFF,
    above_round_off,
    covariance,
    covariance_of,
    factor,
    marginal,
    solved,
)
from calib_core.types import FloatArray

#: Standard deviations of unknowns in very different units: 1 urad, 1 mm, 0.1 s, 10 m.
SPREAD = np.array([1e-6, 1e-3, 0.1, 10.0])


def known(seed: int = 0) -> FloatArray:
    """Information whose covariance has these standard deviations, all unknowns coupled."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(4, 4)) + 2.0 * np.eye(4)
    unit = root @ root.T
    scale = np.sqrt(np.diag(np.linalg.inv(unit))) / SPREAD
    return unit * scale[:, None] * scale[None, :]


def test_where_all_is_known_it_is_the_inverse() -> None:
    """Oracle: I cov = 1, whatever the units. Mutation: leave the unit diagonal out of either side."""
    information = known()
    found = covariance(information)
    assert found.undetermined.shape == (4, 0)
    np.testing.assert_allclose(np.sqrt(np.diag(found.matrix)), SPREAD, rtol=1e-9)
    np.testing.assert_allclose(found.of([1, 3]), np.linalg.inv(information)[np.ix_([1, 3], [1, 3])], rtol=1e-8)


@pytest.mark.parametrize("beside", [1.0, 1e4, FROZEN])
def test_what_is_unknown_is_never_certain(beside: float) -> None:
    """A sum of two unknowns is measured, their difference is not; beside them one that is held fixed.

    Oracle: the sum's variance is 1 / (information along it); the difference's is beyond anything. A pseudo-inverse gives
    the difference variance zero; one with a cut-off beside FROZEN columns, the sum too.
    Mutations: `np.linalg.pinv(information, rcond=1e-15, hermitian=True)` for the whole; cut off instead of clamping.
    """
    J = np.array([[1.0, 1.0, 0.0]])
    information = 1e-4 * J.T @ J
    information[2, 2] = beside
    found = covariance(information)
    along = np.array([1.0, 1.0, 0.0])
    away = np.array([1.0, -1.0, 0.0])
    assert along @ found.matrix @ along == pytest.approx(1e4, rel=1e-6)
    assert away @ found.matrix @ away > 0.1 / ROUND_OFF
    assert found.matrix[2, 2] == pytest.approx(1.0 / beside)
    (direction,) = (found.undetermined / np.linalg.norm(found.undetermined, axis=0)).T
    np.testing.assert_allclose(np.abs(direction @ away) / np.sqrt(2.0), 1.0, rtol=1e-9)


def test_an_unknown_without_any_information_is_undetermined() -> None:
    """Mutation: divide by the root of a diagonal of zero: NaN everywhere."""
    found = covariance(np.diag([4.0, 0.0]))
    assert found.matrix[0, 0] == pytest.approx(0.25)
    assert found.matrix[1, 1] > 1e100
    assert found.undetermined.shape == (2, 1)


@pytest.mark.parametrize("some", [slice(0, 2), slice(1, 4)])
@pytest.mark.parametrize("beside", [1.0, 0.0])
def test_a_part_of_it_is_that_part(some: slice, beside: float) -> None:
    """Where all is known and where one unknown is not. Mutations: the others known; the units of the first; a part of the
    inverse by Cholesky where that does not exist.
    """
    information = known(2)
    information[3] *= beside
    information[:, 3] *= beside
    whole = covariance(information).of(some)
    np.testing.assert_allclose(covariance_of(information, some), whole, rtol=1e-9, atol=1e-12 * np.abs(whole).max())


def test_the_marginal_is_what_is_left_when_the_others_are_unknown() -> None:
    """Oracle: the inverse of the block of the inverse. With an unknown more of which nothing is known, the same.

    Mutations: the block of the information itself; the others' own units left out; only what is all known has a marginal.
    """
    information = known(3)
    expected = np.linalg.inv(np.linalg.inv(information)[:2, :2])
    np.testing.assert_allclose(marginal(information, 2), expected, rtol=1e-8)
    assert marginal(information, 2)[0, 0] < 0.9 * information[0, 0]
    open_one = np.pad(information, (0, 1))
    np.testing.assert_allclose(marginal(open_one, 2), expected, rtol=1e-8)


@pytest.mark.parametrize("smallest", [1e-1, 1e-6, 1e-8, 1e-10, 1e-12, 0.0])
def test_the_quick_way_is_taken_where_all_is_surely_known(smallest: float) -> None:
    """Against the eigenvectors, for unknowns of units millions apart. Mutations: the factor trusted whatever is left open; the
    bound by the norm instead of its reciprocal; the inverse of the lower triangle alone.
    """
    rng = np.random.default_rng(11)
    size = 40
    vectors = np.linalg.qr(rng.normal(size=(size, size)))[0]
    values = np.append(smallest, np.linspace(0.5, 2.0, size - 1))
    unit = (vectors * values) @ vectors.T
    scale = 10.0 ** rng.uniform(-4, 4, size)
    information = unit * scale[:, None] * scale[None, :]
    found = covariance(information)
    own = 1.0 / np.sqrt(np.diag(unit))
    normalised = unit * own[:, None] * own[None, :]
    lower = factor(0.5 * (normalised + normalised.T))
    assert (lower is None) == (smallest < 2e-9)
    assert found.undetermined.shape[1] == (smallest < 1e-11)
    if lower is not None:
        expected = (vectors / values) @ vectors.T / scale[:, None] / scale[None, :]
        std = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(found.matrix / std / std[:, None], expected / std / std[:, None], atol=1e-6)
        right = rng.normal(size=size)
        np.testing.assert_allclose(normalised @ solved(lower, right), right, atol=1e-6)


def test_what_came_out_below_nothing_says_how_large_round_off_is() -> None:
    """Mutations: only its own row's; as small and positive taken; nothing but the constant asked."""
    values = np.array([[-2e-7, 1.9e-6, 2.1e-6, 1.0], [1e-9, 1e-6, 3e-6, 2.0]])
    assert above_round_off(values).tolist() == [[False, False, True, True], [False, False, True, True]]
    assert above_round_off(np.array([1e-12, 0.5 * ROUND_OFF, 2.0 * ROUND_OFF])).tolist() == [False, False, True]
    assert above_round_off(np.array([-0.5, 4.9, 5.1])).tolist() == [False, False, True]
    assert above_round_off(np.zeros((0, 25))).shape == (0, 25)
