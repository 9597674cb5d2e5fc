"""The windowed posterior against a dense one written from the textbook, and what a posterior has to satisfy."""

import numpy as np
import pytest

from calib_core.gp import Hyper, posterior_of_windows, windowed_posterior
from calib_core.gp.kernels import matern_32, matern_52


def dense(t, y, query, length, signal, noise, rho=matern_52):
    """One channel, no windows: generalised least squares for the mean, plain solves for the rest."""
    K = signal**2 * rho(np.abs(t[:, None] - t) / length) + noise**2 * np.eye(t.size)
    k = signal**2 * rho(np.abs(t[:, None] - query) / length)
    inverse = np.linalg.inv(K)
    mu = (np.ones(t.size) @ inverse @ y) / np.sum(inverse)
    return mu + k.T @ inverse @ (y - mu), signal**2 - np.einsum("qn,qr,rn->n", k, inverse, k)


def irregular(n, rate, seed):
    """Stamps with a jitter of a third of their interval."""
    rng = np.random.default_rng(seed)
    return (np.arange(n) + rng.uniform(-0.33, 0.33, n)) / rate


def test_one_window_is_the_dense_posterior():
    """Equal to rounding where one window holds everything. Mutation: the plain mean instead of the weighted one."""
    t = irregular(37, 100.0, seed=1)
    rng = np.random.default_rng(2)
    y = np.stack([np.sin(9.0 * t) + 3.0, rng.normal(size=t.size)], axis=1)
    query = rng.uniform(-0.05, 0.45, 90)
    hyper = Hyper(np.array([0.1, 0.03]), np.array([0.8, 1.5]), np.array([0.02, 0.3]), "3/2")
    mean, var = windowed_posterior(t, y, query, hyper, margin=40)
    for c in range(2):
        expected = dense(t, y[:, c], query, hyper.length_scale_s[c], hyper.signal_std[c], hyper.noise_std[c], matern_32)
        np.testing.assert_allclose(mean[:, c], expected[0], atol=1e-10)
        np.testing.assert_allclose(var[:, c], expected[1], atol=1e-10)


def test_windows_agree_with_the_dense_posterior():
    """A dozen samples of margin are enough: 1e-5 of the signal. Mutation: margin 0."""
    t = irregular(400, 200.0, seed=4)
    y = np.sin(2.0 * np.pi * 0.8 * t)[:, None] + 0.01 * np.random.default_rng(5).normal(size=(t.size, 1))
    query = np.linspace(0.03, 1.96, 777)
    hyper = Hyper(np.array(0.08), np.array(0.7), np.array(0.002))
    mean, var = windowed_posterior(t, y, query, hyper)
    expected = dense(t, y[:, 0], query, 0.08, 0.7, 0.002)
    np.testing.assert_allclose(mean[:, 0], expected[0], atol=1e-5)
    np.testing.assert_allclose(var[:, 0], expected[1], rtol=1e-3, atol=1e-9)


def test_smooth_signal_between_its_samples():
    """A 1.5 Hz sine from 100 Hz samples to 1e-5. Mutation: Matern 1/2 in place of 5/2."""
    t = np.arange(300) / 100.0
    query = np.linspace(0.1, 2.88, 5000)
    hyper = Hyper(np.array(0.3), np.array(1.0), np.array(1e-6))
    mean, var = windowed_posterior(t, np.sin(2.0 * np.pi * 1.5 * t)[:, None], query, hyper)
    assert np.abs(mean[:, 0] - np.sin(2.0 * np.pi * 1.5 * query)).max() < 1e-5
    assert var.min() >= 0.0


def test_error_has_the_variance_it_claims():
    """Signals drawn from the prior: squared error over variance is chi-square. Mutation: var without signal_std^2."""
    rng = np.random.default_rng(6)
    t, query = irregular(60, 100.0, seed=7), np.sort(rng.uniform(0.05, 0.55, 20))
    everything = np.concatenate([t, query])
    prior = 2.0**2 * matern_52(np.abs(everything[:, None] - everything) / 0.05)
    draws = np.linalg.cholesky(prior + 1e-9 * np.eye(80)) @ rng.normal(size=(80, 800))
    readings = draws[:60] + 0.3 * rng.normal(size=(60, 800))
    hyper = Hyper(np.array(0.05), np.array(2.0), np.array(0.3))
    mean, var = windowed_posterior(t, readings, query, hyper, margin=60)
    ratio = np.mean((draws[60:] - mean) ** 2 / var, axis=1)
    # 800 draws: the mean of chi-square(1) has a standard deviation of 0.05; the unknown mean adds a little.
    assert np.all(np.abs(ratio - 1.0) < 0.22)


def test_order_of_queries_and_far_samples_do_not_matter():
    """Any order of queries; a NaN a hundred samples away is not looked at. Mutation: windows of the whole recording."""
    t = irregular(300, 100.0, seed=8)
    y = np.cos(5.0 * t)[:, None]
    query = np.linspace(0.2, 1.0, 50)
    hyper = Hyper(np.array(0.2), np.array(1.0), np.array(0.01))
    mean, _ = windowed_posterior(t, y, query, hyper)
    y[250] = np.nan
    order = np.random.default_rng(9).permutation(50)
    again, _ = windowed_posterior(t, y, query[order], hyper)
    np.testing.assert_allclose(mean[order], again, atol=1e-12)


def test_each_window_keeps_its_own_hyper_parameters():
    """Stacked windows equal each one alone, also with unequal numbers of queries.

    Mutation: reading back the padding.
    """
    rng = np.random.default_rng(10)
    stamps = np.sort(rng.uniform(0.0, 0.2, (3, 20)), axis=1) + np.array([[0.0], [1.0], [2.0]])
    values = rng.normal(size=(3, 20, 2))
    window = np.array([2, 0, 0, 2, 2, 0, 0])
    query = stamps[window, 5] + 0.003
    hyper = Hyper(rng.uniform(0.02, 0.1, (3, 2)), rng.uniform(0.5, 2.0, (3, 2)), rng.uniform(0.01, 0.1, (3, 2)))
    mean, var = posterior_of_windows(stamps, values, query, window, hyper)
    for n, w in enumerate(window):
        for c in range(2):
            scales = (each[w, c] for each in (hyper.length_scale_s, hyper.signal_std, hyper.noise_std))
            expected = dense(stamps[w], values[w, :, c], query[n : n + 1], *scales)
            np.testing.assert_allclose((mean[n, c], var[n, c]), np.concatenate(expected), atol=1e-9)


@pytest.mark.parametrize("n_samples", [1, 3])
def test_few_samples(n_samples: int):
    """Fewer samples than a window: they are all used. Mutation: a window that always has block + 2 margin samples."""
    t = np.arange(n_samples) * 0.01
    hyper = Hyper(np.array(0.1), np.array(1.0), np.array(0.01))
    mean, var = windowed_posterior(t, np.full((n_samples, 1), 5.0), np.array([0.004]), hyper)
    assert mean[0, 0] == pytest.approx(5.0)
    assert 0.0 < var[0, 0] < 0.1
