"""Normal equations shaped like an arrow: a chain of equal blocks, each coupled to the next, and a shared border.

        [ D0 E0'            B0 ]          D_k (n, n)   one knot
        [ E0 D1 E1'         B1 ]          E_k (n, n)   knot k + 1 with knot k
    H = [    E1 D2 ...      .. ]          B_k (n, S)   knot with the shared parameters
        [          ...         ]          C   (S, S)   shared parameters
        [ B0' B1' ...       C  ]

The chain is eliminated block by block by Cholesky factors; what remains on the border, C - B' A^-1 B, is the information
of the shared parameters with the chain marginalised: the calibration's own information matrix.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from calib_core.solver.information import ROUND_OFF, covariance
from calib_core.solver.kernels import eliminate_kernel, substitute_kernel
from calib_core.threads import workers
from calib_core.types import FloatArray, IntArray


class NotPositiveDefinite(ArithmeticError):
    """The chain's block could not be factorised: more damping is needed, or a state is not constrained at all."""


@dataclass
class ArrowSystem:
    """H and gradient of a sum of squares, accumulated factor by factor.

    diagonal: (K, n, n).   lower: (K - 1, n, n), row block k + 1, column block k.   border: (K, n, S).   corner: (S, S).
    gradient: (K, n).   gradient_shared: (S,).   cost: half the sum of squares.   frozen: shared columns held fixed.
    """

    diagonal: FloatArray
    lower: FloatArray
    border: FloatArray
    corner: FloatArray
    gradient: FloatArray
    gradient_shared: FloatArray
    cost: float = 0.0
    frozen: tuple[int, ...] = ()

    @staticmethod
    def zeros(knots: int, block: int, shared: int) -> ArrowSystem:
        """An empty system of K knots with n unknowns each and S shared unknowns."""
        return ArrowSystem(
            np.zeros((knots, block, block)),
            np.zeros((max(knots - 1, 0), block, block)),
            np.zeros((knots, block, shared)),
            np.zeros((shared, shared)),
            np.zeros((knots, block)),
            np.zeros(shared),
        )


@dataclass(frozen=True)
class ArrowSolution:
    """The step that solves H step = -gradient, and the border's information. step: (K, n), step_shared: (S,).

    Frozen columns do not move; their information is FROZEN, apart from everything.   gradient_shared: (S,), the border's
    with the chain eliminated; 0 where frozen.
    """

    step: FloatArray
    step_shared: FloatArray
    information: FloatArray
    predicted_decrease: float
    gradient_shared: FloatArray = field(default_factory=lambda: np.zeros(0))


#: Of a long product, each of which a thread may take.
_PARTS = 4
#: Stands for the information of what is held fixed.
FROZEN = 1e12


def _shared_step(schur: FloatArray, gradient: FloatArray) -> FloatArray:
    """The border's step, none along directions that the information does not resolve from round-off."""
    unit = 1.0 / np.sqrt(np.maximum(np.diag(schur), 1e-300))
    values, vectors = np.linalg.eigh(schur * unit[:, None] * unit[None, :])
    along = vectors.T @ (-unit * gradient)
    known = values > ROUND_OFF
    return unit * (vectors @ np.where(known, along / np.where(known, values, 1.0), 0.0))


def _gram(W: FloatArray) -> FloatArray:
    """W' W, (S, S), in as many parts whatever the number of cores: the sum's rounding must not depend on it."""
    edges = np.linspace(0, len(W), _PARTS + 1).astype(int)
    parts = list(workers().map(lambda k: W[edges[k] : edges[k + 1]].T @ W[edges[k] : edges[k + 1]], range(_PARTS)))
    return np.asarray(sum(parts[1:], start=parts[0]))


@dataclass(frozen=True)
class _Chain:
    """The chain eliminated: factors L, M and W of solver/kernels.py in units of `scale`, and what is left on the free border."""

    L: FloatArray
    M: FloatArray
    W: FloatArray
    scale: FloatArray
    free: IntArray
    schur: FloatArray
    reduced: FloatArray


def _eliminated(system: ArrowSystem, damping: float) -> _Chain:
    knots, n, _ = system.diagonal.shape
    size = system.corner.shape[0]
    free = np.setdiff1d(np.arange(size), system.frozen)
    shared = len(free)
    every = shared == size
    diagonal = system.diagonal.copy()
    corner = system.corner.copy() if every else system.corner[np.ix_(free, free)]
    gradient_shared = system.gradient_shared if every else system.gradient_shared[free]
    if damping > 0:
        index = np.arange(n)
        diagonal[:, index, index] *= 1.0 + damping
        corner = corner + np.diag(damping * np.diag(corner))
    # Unit diagonal: positions, angles and velocities differ by many orders of magnitude.
    scale = 1.0 / np.sqrt(np.maximum(np.einsum("kii->ki", diagonal), 1e-300))
    diagonal *= scale[:, :, None] * scale[:, None, :]
    lower = system.lower * (scale[1:, :, None] * scale[:-1, None, :])
    W = np.empty((knots, n, shared + 1))
    np.multiply(system.border if every else system.border[:, :, free], scale[:, :, None], out=W[:, :, :shared])
    np.multiply(system.gradient, scale, out=W[:, :, shared])
    if not eliminate_kernel(diagonal, lower, W):
        raise NotPositiveDefinite("the chain of knots is not positive definite")
    product = _gram(W.reshape(knots * n, shared + 1))
    schur = corner - product[:shared, :shared]
    reduced = gradient_shared - product[:shared, shared]
    return _Chain(diagonal, lower, W, scale, free, 0.5 * (schur + schur.T), reduced)


def unit_responses(system: ArrowSystem, count: int) -> tuple[FloatArray, FloatArray]:
    """The first `count` columns of H^-1 E on the shared unknowns: chain (K, n, count) and border (S, count).

    A factor with Jacobian J and residual r moves the first unknowns by -(J X)' r, X these columns: its influence. Frozen
    columns respond to nothing. Raises NotPositiveDefinite.
    """
    chain = _eliminated(system, 0.0)
    shared = len(chain.free)
    inverse = covariance(chain.schur).matrix
    picked = np.searchsorted(chain.free, np.arange(count))
    asked = (picked < shared) & (chain.free[np.minimum(picked, shared - 1)] == np.arange(count))
    border, along = np.zeros((system.corner.shape[0], count)), np.zeros((*system.gradient.shape, count))
    for c in np.flatnonzero(asked):
        own = inverse[:, picked[c]]
        border[chain.free, c] = own
        step = -(chain.W[:, :, :shared] @ own)
        substitute_kernel(chain.L, chain.M, step)
        along[:, :, c] = step * chain.scale
    return along, border


def solve_arrow(system: ArrowSystem, *, damping: float = 0.0) -> ArrowSolution:
    """One Gauss-Newton (damping 0) or Levenberg-Marquardt step, damping relative to H's diagonal.

    Raises NotPositiveDefinite where the damped chain is not positive definite.
    """
    chain = _eliminated(system, damping)
    size, free, shared = system.corner.shape[0], chain.free, len(chain.free)
    W, schur, reduced = chain.W, chain.schur, chain.reduced
    gradient_shared = system.gradient_shared[free]
    moved = _shared_step(schur, reduced) if shared else np.zeros(0)
    step = -(W @ np.append(moved, 1.0))
    substitute_kernel(chain.L, chain.M, step)
    step *= chain.scale
    step_shared, information, remaining = np.zeros(size), np.eye(size) * FROZEN, np.zeros(size)
    step_shared[free] = moved
    remaining[free] = reduced
    information[np.ix_(free, free)] = schur
    slope = float(np.sum(step * system.gradient) + moved @ gradient_shared)
    return ArrowSolution(step, step_shared, information, -0.5 * slope, remaining)
