"""Gaussian-process regression of a few channels over time, in batched windows of equal size.

One channel: y_q = f(t_q) + noise_std * white,  f ~ GP(mu, signal_std^2 rho(|t - t'| / l)),  mu a constant. With
K = signal_std^2 rho(t, t) + noise_std^2 I and k the covariances of a query with the samples,

    mu    = 1' K^-1 y / 1' K^-1 1               the constant mean of maximum likelihood
    mean  = mu + k' K^-1 (y - mu 1)
    var   = signal_std^2 - k' K^-1 k            of f, not of a new reading; mu's own uncertainty is left out

A Matern process forgets: a sample a dozen samples away adds nothing that the nearer ones have not told. So queries are
split into blocks of `block` samples and each block is conditioned on its samples and `margin` more either side. At the
ends a window is moved inwards, not shortened: all windows have one size and LAPACK sees one stack.

symbol  code            shape
Q       n_samples       readings
N       n_queries       instants asked for
C       n_channels      independent signals sharing their stamps
B, W    windows         windows, samples in each
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.gp.kernels import Correlation, Smoothness, correlation
from calib_core.threads import workers
from calib_core.types import FloatArray, IntArray

#: Smallest noise variance, relative to the signal's, that a Cholesky factor of a window survives in double precision.
NOISE_FLOOR = 1e-12
#: Windows solved at once: bounds memory to a few megabytes.
_WINDOWS_AT_ONCE = 64


@dataclass(frozen=True, slots=True)
class Hyper:
    """What a GP assumes of each channel. Each (C,) or (): length scale [s], standard deviations."""

    length_scale_s: FloatArray
    signal_std: FloatArray
    noise_std: FloatArray
    smoothness: Smoothness = "5/2"


def windowed_posterior(
    stamps_s: FloatArray, values: FloatArray, query_s: FloatArray, hyper: Hyper, *, margin: int = 12, block: int = 16
) -> tuple[FloatArray, FloatArray]:
    """Posterior mean and variance of every channel at every query.

    stamps_s: (Q,) increasing.   values: (Q, C).   query_s: (N,) any order; far outside the samples: the mean.
    margin, block: samples; see the module's derivation.   Returns mean (N, C), var (N, C) of the noise-free signal.
    """
    size = min(block + 2 * margin, stamps_s.shape[0])
    n_blocks = max(1, -(-stamps_s.shape[0] // block))
    nearest_left = np.searchsorted(stamps_s, query_s, side="right") - 1
    of_query = np.clip(nearest_left // block, 0, n_blocks - 1)
    asked, of_query = np.unique(of_query, return_inverse=True)
    first = np.clip(asked * block - margin, 0, stamps_s.shape[0] - size)
    window = first[:, None] + np.arange(size)
    return posterior_of_windows(
        stamps_s[window], values[window], query_s, of_query, _per_window(hyper, values, len(asked))
    )


def _per_window(hyper: Hyper, values: FloatArray, n_windows: int) -> Hyper:
    """The same hyper-parameters for every window: arrays (B, C)."""
    shape = (n_windows, values.shape[1])
    length, signal, noise = (
        np.broadcast_to(each, shape) for each in (hyper.length_scale_s, hyper.signal_std, hyper.noise_std)
    )
    return Hyper(length, signal, noise, hyper.smoothness)


def posterior_of_windows(
    stamps_s: FloatArray, values: FloatArray, query_s: FloatArray, window_of_query: IntArray, hyper: Hyper
) -> tuple[FloatArray, FloatArray]:
    """Posterior mean and variance where each query belongs to one window and each window has its own hyper-parameters.

    stamps_s: (B, W).   values: (B, W, C).   query_s: (N,).   window_of_query: (N,) in 0..B-1.   hyper: arrays (B, C).
    Returns mean (N, C), var (N, C).
    """
    n_windows, n_channels = stamps_s.shape[0], values.shape[2]
    mean = np.empty((query_s.shape[0], n_channels))
    var = np.empty_like(mean)
    order = np.argsort(window_of_query, kind="stable")
    start = np.searchsorted(window_of_query[order], np.arange(n_windows + 1))
    rho = correlation(hyper.smoothness)

    def some_windows(low: int) -> None:
        high = min(low + _WINDOWS_AT_ONCE, n_windows)
        counts = np.diff(start[low : high + 1])
        column = np.arange(counts.max(initial=0))
        if column.size == 0:
            return
        # Short windows repeat their last query: a rectangular stack, the surplus is never read back.
        slot = start[low:high, None] + np.minimum(column, np.maximum(counts[:, None] - 1, 0))
        queries = order[np.minimum(slot, order.size - 1)]
        filled = column < counts[:, None]
        between = np.abs(stamps_s[low:high, :, None] - stamps_s[low:high, None, :])
        across = np.abs(stamps_s[low:high, :, None] - query_s[queries][:, None, :])
        for channel in range(n_channels):
            scales = (each[low:high, channel] for each in (hyper.length_scale_s, hyper.signal_std, hyper.noise_std))
            some = _solve_windows(between, across, values[low:high, :, channel], rho, *scales)
            mean[queries[filled], channel], var[queries[filled], channel] = some[0][filled], some[1][filled]

    lows = range(0, n_windows, _WINDOWS_AT_ONCE)
    list(workers().map(some_windows, lows) if len(lows) > 1 else map(some_windows, lows))
    return mean, var


def _solve_windows(
    between_s: FloatArray,
    across_s: FloatArray,
    values: FloatArray,
    rho: Correlation,
    length_scale_s: FloatArray,
    signal_std: FloatArray,
    noise_std: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Posterior of one channel of B windows. Returns mean (B, n), var (B, n).

    between_s: (B, W, W) distances of samples [s].   across_s: (B, W, n) of samples and queries.   values: (B, W).
    length_scale_s, signal_std, noise_std: (B,).
    """
    per_length = (1.0 / length_scale_s)[:, None, None]
    gram = rho(between_s * per_length)
    diagonal = np.arange(gram.shape[1])
    gram[:, diagonal, diagonal] += np.maximum((noise_std / signal_std) ** 2, NOISE_FLOOR)[:, None]
    # All columns (y, 1 and the queries' covariances) are whitened by one L^-1. The inverse of a Cholesky factor is
    # safe, its condition is the root of the matrix's; numpy has no stacked triangular solve.
    whitener = np.linalg.inv(np.linalg.cholesky(gram))
    cross = whitener @ rho(across_s * per_length)
    y, one = (whitener @ values[..., None])[..., 0], whitener.sum(axis=2)
    mu = np.sum(one * y, axis=1) / np.sum(one * one, axis=1)
    mean = mu[:, None] + ((y - mu[:, None] * one)[:, None, :] @ cross)[:, 0]
    np.square(cross, out=cross)
    return mean, (signal_std**2)[:, None] * np.maximum(1.0 - cross.sum(axis=1), 0.0)
