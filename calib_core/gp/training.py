"""Hyper-parameters by maximum marginal likelihood, on a grid shared by all windows and channels.

With rho(t, t) = U diag(d) U', noise^2 = r signal^2 and z = U'(y - mu 1), minus twice the log likelihood of n readings
is

    n log s^2 + sum_j log(d_j + r) + sum_j z_j^2 / (d_j + r) / s^2,          s = signal_std

so that one eigendecomposition per window and length scale serves every channel and every ratio r. Free noise: s^2 is
sum_j z_j^2 / (d_j + r) / n, in closed form. Noise known: s^2 = noise^2 / r. mu is the constant mean of maximum
likelihood for each r. Windows are pooled by adding their terms; the paper's form is one window to a pool. A grid and
not a descent: the likelihood of a short window has several optima, and the best of a grid is the same on every machine.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from calib_core.gp.kernels import Smoothness, correlation
from calib_core.gp.regression import NOISE_FLOOR, Hyper
from calib_core.memoised import memoised
from calib_core.types import FloatArray

#: Steps of the coarse grid, as ratios of neighbours. `fit_hyper` then refines them by this factor.
_LENGTH_STEP = 1.5
_RATIO_STEP = 2.0
_REFINEMENT = 3

#: Eigenvalues (B, W) and eigenvectors (B, W, W) of windows' correlations at a length scale [s].
_Spectra = Callable[[float], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, slots=True)
class _Evaluation:
    """Cost -2 log likelihood and signal variance, both (P, C, L, R): pools, channels, length scales, ratios."""

    cost: FloatArray
    signal_var: FloatArray


@memoised
def fit_hyper(
    stamps_s: FloatArray,
    values: FloatArray,
    *,
    noise_std: FloatArray | None = None,
    smoothness: Smoothness = "5/2",
    window: int = 40,
    max_windows: int = 32,
) -> Hyper:
    """Hyper-parameters of each channel, from windows spread evenly over the recording and pooled.

    stamps_s: (Q,) increasing [s].   values: (Q, C).   noise_std: (C,) where it is known, else fitted too.
    window: samples in each.   Returns arrays (C,). The same values and stamps give the same answer.
    """
    size = min(window, stamps_s.shape[0])
    n_windows = min(max_windows, max(1, stamps_s.shape[0] // size))
    first = np.linspace(0, stamps_s.shape[0] - size, n_windows).astype(np.int64)
    pick = first[:, None] + np.arange(size)
    stamps, readings = stamps_s[pick], values[pick]
    lengths, ratios = _coarse_grid(stamps)
    spectra = _spectra_of(stamps, smoothness)
    coarse = _evaluate(spectra, readings, lengths, ratios, noise_std, pooled=True)
    step = np.arange(-_REFINEMENT, _REFINEMENT + 1) / _REFINEMENT
    channels = []
    for c in range(values.shape[1]):
        at_length, at_ratio = np.unravel_index(np.argmin(coarse.cost[0, c]), coarse.cost.shape[2:])
        near_lengths = lengths[at_length] * _LENGTH_STEP**step
        near_ratios = np.maximum(ratios[at_ratio] * _RATIO_STEP**step, NOISE_FLOOR)
        known = None if noise_std is None else noise_std[c : c + 1]
        fine = _evaluate(spectra, readings[..., c : c + 1], near_lengths, near_ratios, known, pooled=True)
        channels.append(_best(fine, near_lengths, near_ratios, smoothness))
    pooled = _concatenate(channels, axis=1)
    return Hyper(pooled.length_scale_s[0], pooled.signal_std[0], pooled.noise_std[0], smoothness)


def train_windows(stamps_s: FloatArray, values: FloatArray, *, smoothness: Smoothness = "5/2") -> Hyper:
    """Hyper-parameters of each channel of each window on its own, as the paper trains them (II-C, III-C).

    stamps_s: (B, W) [s].   values: (B, W, C).   Returns arrays (B, C), resolved to the coarse grid.
    """
    lengths, ratios = _coarse_grid(stamps_s)
    parts = []
    for low in range(0, stamps_s.shape[0], 64):
        part = slice(low, low + 64)
        spectra = _spectra_of(stamps_s[part], smoothness)
        evaluated = _evaluate(spectra, values[part], lengths, ratios, None, pooled=False)
        parts.append(_best(evaluated, lengths, ratios, smoothness))
    return _concatenate(parts, axis=0)


def _concatenate(parts: Sequence[Hyper], axis: int) -> Hyper:
    """Hyper-parameters of several pools (axis 0) or channels (axis 1) as one record of arrays (P, C)."""
    return Hyper(
        np.concatenate([part.length_scale_s for part in parts], axis=axis),
        np.concatenate([part.signal_std for part in parts], axis=axis),
        np.concatenate([part.noise_std for part in parts], axis=axis),
        parts[0].smoothness,
    )


def _coarse_grid(stamps_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Length scales from one sample interval to five windows, and noise-to-signal variance ratios 1e-12 to 1e2."""
    interval = float(np.median(np.diff(stamps_s, axis=1)))
    longest = 5.0 * float(np.max(stamps_s[:, -1] - stamps_s[:, 0]))
    n_lengths = 1 + int(np.ceil(np.log(max(longest / interval, 1.0)) / np.log(_LENGTH_STEP)))
    n_ratios = 1 + int(np.ceil(np.log(1e2 / NOISE_FLOOR) / np.log(_RATIO_STEP)))
    lengths: FloatArray = interval * _LENGTH_STEP ** np.arange(n_lengths, dtype=np.float64)
    ratios: FloatArray = NOISE_FLOOR * _RATIO_STEP ** np.arange(n_ratios, dtype=np.float64)
    return lengths, ratios


def _spectra_of(stamps_s: FloatArray, smoothness: Smoothness) -> _Spectra:
    """Of windows stamped so, (B, W). Each length scale is taken apart once: channels mostly ask for the same few."""
    distance = np.abs(stamps_s[:, :, None] - stamps_s[:, None, :])
    rho = correlation(smoothness)

    @cache
    def at(length_s: float) -> tuple[FloatArray, FloatArray]:
        d, u = np.linalg.eigh(rho(distance / length_s))
        return d, u

    return at


def _evaluate(
    spectra: _Spectra,
    values: FloatArray,
    lengths_s: FloatArray,
    ratios: FloatArray,
    noise_std: FloatArray | None,
    *,
    pooled: bool,
) -> _Evaluation:
    """The likelihood on the grid. values: (B, W, C), noise_std: (C,). Pools: one, or each window."""
    n_windows, size, n_channels = values.shape
    n_pools = 1 if pooled else n_windows
    cost = np.empty((n_pools, n_channels, lengths_s.size, ratios.size))
    signal_var = np.empty_like(cost)
    for i, length in enumerate(lengths_s):
        d, u = spectra(length)
        spectrum = np.maximum(d, 0.0)[:, None, :] + ratios[:, None]  # (B, R, W)
        one = np.sum(u, axis=1)  # U' 1, (B, W)
        z = np.einsum("bwj,bwc->bcj", u, values)
        inverse = 1.0 / spectrum
        mu = np.einsum("brj,bj,bcj->bcr", inverse, one, z) / np.einsum("brj,bj->br", inverse, one**2)[:, None, :]
        square = np.einsum("brj,bcj->bcr", inverse, z**2) - mu**2 * np.einsum("brj,bj->br", inverse, one**2)[:, None, :]
        log_det = np.sum(np.log(spectrum), axis=2)[:, None, :]
        if pooled:
            square, log_det = square.sum(axis=0, keepdims=True), log_det.sum(axis=0, keepdims=True)
        n = size * (n_windows if pooled else 1)
        if noise_std is None:
            # The smallest normal number: a channel that never changes must not give log(0).
            variance = np.maximum(square / n, np.finfo(np.float64).tiny)
        else:
            variance = np.broadcast_to((noise_std**2)[:, None] / ratios, square.shape)
        signal_var[:, :, i] = variance
        cost[:, :, i] = n * np.log(variance) + log_det + square / variance
    return _Evaluation(cost, signal_var)


def _best(evaluation: _Evaluation, lengths_s: FloatArray, ratios: FloatArray, smoothness: Smoothness) -> Hyper:
    """The grid's minimum of each pool and channel, arrays (P, C)."""
    pools, channels = evaluation.cost.shape[:2]
    flat = np.argmin(evaluation.cost.reshape(pools, channels, -1), axis=2)
    at_length, at_ratio = np.unravel_index(flat, (lengths_s.size, ratios.size))
    variances = evaluation.signal_var.reshape(pools, channels, -1)
    signal = np.sqrt(np.take_along_axis(variances, flat[..., None], axis=2)[..., 0])
    return Hyper(lengths_s[at_length], signal, signal * np.sqrt(ratios[at_ratio]), smoothness)
