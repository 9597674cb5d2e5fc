"""Normal equations shaped like an arrow: a chain of equal blocks, each coupled to the next, and a shared border.

        [ D0 E0'            B0 ]          D_k (n, n)   one knot
        [ E0 D1 E1'         B1 ]          E_k (n, n)   knot k + 1 with knot k
    H = [    E1 D2 ...      .. ]          B_k (n, S)   knot with the shared parameters
        [          ...         ]          C   (S, S)   shared parameters
        [ B0' B1' ...       C  ]

The chain is eliminated by a banded Cholesky factor; what remains on the border, C - B' A^-1 B, is the information of
the shared parameters with the chain marginalised: the calibration's own information matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

from calib_core.types import FloatArray


class NotPositiveDefinite(ArithmeticError):
    """The chain's block could not be factorised: more damping is needed, or a state is not constrained at all."""


@dataclass
class ArrowSystem:
    """H and gradient of a sum of squares, accumulated factor by factor.

    diagonal: (K, n, n).   lower: (K - 1, n, n), row block k + 1, column block k.   border: (K, n, S).   corner: (S, S).
    gradient: (K, n).   gradient_shared: (S,).   cost: half the sum of squares.
    """

    diagonal: FloatArray
    lower: FloatArray
    border: FloatArray
    corner: FloatArray
    gradient: FloatArray
    gradient_shared: FloatArray
    cost: float = 0.0

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
    """The step that solves H step = -gradient, and the border's information. step: (K, n), step_shared: (S,)."""

    step: FloatArray
    step_shared: FloatArray
    information: FloatArray
    predicted_decrease: float


#: Relative to unit diagonal: what the border's information cannot resolve after eliminating the chain in double precision.
ROUND_OFF = 1e-11


def _shared_step(schur: FloatArray, gradient: FloatArray) -> FloatArray:
    """The border's step, none along directions that the information does not resolve from round-off."""
    unit = 1.0 / np.sqrt(np.maximum(np.diag(schur), 1e-300))
    values, vectors = np.linalg.eigh(schur * unit[:, None] * unit[None, :])
    along = vectors.T @ (-unit * gradient)
    known = values > ROUND_OFF
    return unit * (vectors @ np.where(known, along / np.where(known, values, 1.0), 0.0))


def _band(diagonal: FloatArray, lower: FloatArray) -> FloatArray:
    """Lower banded storage of the chain: row d holds the d-th subdiagonal. Returns (2 n, K n)."""
    knots, n, _ = diagonal.shape
    band = np.zeros((2 * n, knots, n))
    for column in range(n):
        for row in range(column, n):
            band[row - column, :, column] = diagonal[:, row, column]
        for row in range(n):
            if knots > 1:
                band[n + row - column, :-1, column] = lower[:, row, column]
    return band.reshape(2 * n, knots * n)


def solve_arrow(system: ArrowSystem, *, damping: float = 0.0) -> ArrowSolution:
    """One Gauss-Newton (damping 0) or Levenberg-Marquardt step, damping relative to H's diagonal.

    Raises NotPositiveDefinite where the damped chain is not positive definite.
    """
    knots, n, _ = system.diagonal.shape
    shared = system.corner.shape[0]
    diagonal = system.diagonal
    corner = system.corner
    if damping > 0:
        diagonal = diagonal.copy()
        index = np.arange(n)
        diagonal[:, index, index] *= 1.0 + damping
        corner = corner + np.diag(damping * np.diag(corner))
    # Unit diagonal: positions, angles and velocities differ by many orders of magnitude.
    scale = 1.0 / np.sqrt(np.maximum(np.einsum("kii->ki", diagonal), 1e-300))
    scaled = diagonal * scale[:, :, None] * scale[:, None, :]
    scaled_lower = system.lower * scale[1:, :, None] * scale[:-1, None, :]
    rhs = np.concatenate([system.border, system.gradient[:, :, None]], axis=2) * scale[:, :, None]
    flat = rhs.reshape(knots * n, shared + 1)
    try:
        factor = cholesky_banded(_band(scaled, scaled_lower), lower=True, overwrite_ab=True, check_finite=False)
    except LinAlgError as error:
        raise NotPositiveDefinite("the chain of knots is not positive definite") from error
    solved = cho_solve_banded((factor, True), flat, check_finite=False)
    schur = corner - flat[:, :shared].T @ solved[:, :shared]
    reduced = system.gradient_shared - flat[:, :shared].T @ solved[:, shared]
    schur = 0.5 * (schur + schur.T)
    step_shared = _shared_step(schur, reduced)
    step = -(solved[:, shared] + solved[:, :shared] @ step_shared).reshape(knots, n) * scale
    slope = float(np.sum(step * system.gradient) + step_shared @ system.gradient_shared)
    return ArrowSolution(step, step_shared, schur, -0.5 * slope)
