"""Information, priors and ends of a solve made by hand."""

from __future__ import annotations

import numpy as np

from calib_core.full.joint.priors import PriorRow, Priors
from calib_core.full.joint.undetermined import UNITS
from calib_core.solver.arrow import ArrowSolution
from calib_core.types import FloatArray

STANDING = tuple(PriorRow(i, 0.0, std) for i, std in enumerate([1.0] * 3 + [10.0] * 4))


def priors_of(*extra: PriorRow) -> Priors:
    """The weak ones that every solve has, gravity's, and what is given."""
    return Priors(np.eye(3), STANDING, 9.8, 0.02, given=extra)


def information_of(spread: FloatArray, directions: FloatArray, priors: Priors) -> FloatArray:
    """Shared information (15, 15) whose first seven, the rest eliminated, are known to `spread` along `directions`.

    spread: (7,) in the contract's units, inf for unknown.   directions: (7, 7) orthonormal columns.
    """
    scaled = directions @ np.diag(1.0 / np.asarray(spread) ** 2) @ directions.T
    marginal = scaled / UNITS[:, None] / UNITS[None, :]
    for row in priors.rows:
        marginal[row.column, row.column] += 1.0 / row.std**2
    rng = np.random.default_rng(0)
    root = rng.normal(size=(8, 8)) + 4 * np.eye(8)
    corner = root @ root.T
    # Coupled to biases and planes as strongly as can be told apart from nothing.
    border = 0.1 * rng.normal(size=(7, 8)) * np.sqrt(np.diag(marginal))[:, None]
    return np.block([[marginal + border @ np.linalg.solve(corner, border.T), border], [border.T, corner]])


def solution_of(information: FloatArray) -> ArrowSolution:
    """That asks for no step, of so much information (S, S) of the shared unknowns."""
    return ArrowSolution(np.zeros((0, 9)), np.zeros(len(information)), information, 0.0)
