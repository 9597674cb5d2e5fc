"""Matern correlations against their definition by a Bessel function, and the laws of a covariance."""

import numpy as np
import pytest
from scipy.special import gamma, kv

from calib_core.gp.kernels import Smoothness, correlation


@pytest.mark.parametrize(("smoothness", "nu"), [("1/2", 0.5), ("3/2", 1.5), ("5/2", 2.5)])
def test_closed_form_is_the_bessel_form(smoothness: Smoothness, nu: float):
    """2^(1-nu)/Gamma(nu) a^nu K_nu(a), a = sqrt(2 nu) u. Mutation: a / 2 instead of a / 3 in matern_52."""
    u = np.geomspace(1e-3, 30.0, 200)
    a = np.sqrt(2.0 * nu) * u
    expected = 2.0 ** (1.0 - nu) / gamma(nu) * a**nu * kv(nu, a)
    np.testing.assert_allclose(correlation(smoothness)(u), expected, rtol=1e-9, atol=1e-300)


@pytest.mark.parametrize("smoothness", ["1/2", "3/2", "5/2"])
def test_one_at_zero_and_positive_definite(smoothness: Smoothness):
    """A correlation matrix of any stamps has no negative eigenvalue. Mutation: sqrt(5) -> 5 in the polynomial only."""
    t = np.sort(np.random.default_rng(3).uniform(0.0, 4.0, 60))
    gram = correlation(smoothness)(np.abs(t[:, None] - t))
    np.testing.assert_array_equal(np.diag(gram), 1.0)
    assert np.linalg.eigvalsh(gram).min() > -1e-12


@pytest.mark.parametrize("smoothness", ["1/2", "3/2", "5/2"])
def test_argument_is_left_alone(smoothness: Smoothness):
    """The in-place arithmetic works on its own arrays. Mutation: `a = scaled_distance; a *= ...`."""
    u = np.array([0.0, 0.5, 1.0])
    correlation(smoothness)(u)
    np.testing.assert_array_equal(u, [0.0, 0.5, 1.0])
