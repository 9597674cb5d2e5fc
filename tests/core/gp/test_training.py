"""Trained hyper-parameters against the likelihood written with SciPy, and against signals that have known ones."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from calib_core.gp import fit_hyper, train_windows
from calib_core.gp.kernels import matern_52


def log_likelihood(t, y, length, signal, noise):
    """Of one window and channel, the constant mean profiled out by a scan and not by algebra."""
    K = signal**2 * matern_52(np.abs(t[:, None] - t) / length) + noise**2 * np.eye(t.size)
    normal = multivariate_normal(mean=np.zeros(t.size), cov=K)
    means = np.linspace(y.min() - 1.0, y.max() + 1.0, 4001)
    return max(normal.logpdf(y - m) for m in means[::40]), normal


def draws(n_windows, size, length, signal, noise, seed):
    """Windows of readings from the prior."""
    rng = np.random.default_rng(seed)
    t = np.arange(size) / 100.0
    K = signal**2 * matern_52(np.abs(t[:, None] - t) / length) + noise**2 * np.eye(size)
    y = rng.multivariate_normal(np.zeros(size), K, size=n_windows)
    return np.tile(t, (n_windows, 1)) + np.arange(n_windows)[:, None], y


def test_window_is_trained_to_the_most_likely():
    """No other scales have a higher likelihood. Mutation: leaving log det out of the cost."""
    stamps, y = draws(2, 30, length=0.04, signal=1.0, noise=0.1, seed=11)
    hyper = train_windows(stamps, y[..., None])
    rng = np.random.default_rng(12)
    for w in range(2):
        scales = np.array([hyper.length_scale_s[w, 0], hyper.signal_std[w, 0], hyper.noise_std[w, 0]])
        best, _ = log_likelihood(stamps[w], y[w], *scales)
        for _ in range(60):
            other, _ = log_likelihood(stamps[w], y[w], *(scales * np.exp(rng.uniform(-1.5, 1.5, 3))))
            # The grid is coarse: what it misses by is a small part of what separates good from bad.
            assert other < best + 0.25


def test_pooled_fit_finds_the_scales_of_the_signal():
    """Noise to 5 %, length scale to 30 %. Mutation: counting n of one window in a pool of many."""
    stamps, y = draws(1, 1200, length=0.06, signal=0.5, noise=0.05, seed=13)
    hyper = fit_hyper(stamps[0], y[0][:, None])
    assert hyper.noise_std[0] == pytest.approx(0.05, rel=0.06)
    assert hyper.length_scale_s[0] == pytest.approx(0.06, rel=0.3)
    assert hyper.signal_std[0] == pytest.approx(0.5, rel=0.4)


def test_known_noise_is_kept():
    """The given noise comes back, and the signal's scales are still found. Mutation: ratio / noise^2 upside down."""
    stamps, y = draws(1, 1200, length=0.06, signal=0.5, noise=0.05, seed=14)
    hyper = fit_hyper(stamps[0], np.stack([y[0], 3.0 * y[0] + 7.0], axis=1), noise_std=np.array([0.05, 0.15]))
    np.testing.assert_allclose(hyper.noise_std, [0.05, 0.15], rtol=1e-12)
    np.testing.assert_allclose(hyper.signal_std, [0.5, 1.5], rtol=0.4)
    # The second channel is the first in another unit: the same length scale, three times the rest.
    assert hyper.length_scale_s[1] == pytest.approx(hyper.length_scale_s[0], rel=1e-9)


def test_a_channel_that_never_changes():
    """Finite scales and no warning for a constant. Mutation: dropping the floor under log(0)."""
    t = np.arange(40) / 100.0
    hyper = fit_hyper(t, np.stack([np.full(40, 9.81), np.sin(20.0 * t)], axis=1))
    for each in (hyper.length_scale_s, hyper.signal_std, hyper.noise_std):
        assert np.all(np.isfinite(each))
        assert np.all(each > 0.0)


def test_a_length_scale_is_taken_apart_once_for_all_channels(monkeypatch):
    """Oracle: eigendecompositions counted; three channels that are alike take as many as one. Mutation: without the cache."""
    stamps, y = draws(1, 200, length=0.1, signal=1.0, noise=0.1, seed=5)
    taken = []
    eigh = np.linalg.eigh
    monkeypatch.setattr(np.linalg, "eigh", lambda matrices: taken.append(1) or eigh(matrices))
    counts = []
    for channels in (1, 3):
        taken.clear()
        fit_hyper(stamps[0], np.repeat(y.T, channels, axis=1))
        counts.append(len(taken))
    assert counts[0] == counts[1] > 0
