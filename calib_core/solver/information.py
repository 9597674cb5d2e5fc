"""What an information matrix says: one rule for its inverse, and for what it leaves open.

The unknowns differ by many orders of magnitude (metres, radians, seconds; columns held fixed have 1e12), so that "small"
means nothing before each has unit information of its own:

    I = D^-1 C D^-1,    diag C = 1,    C = V diag(l) V',    cov = D V diag(1 / max(l, eps)) V' D

Along eigenvectors with l <= eps, round-off is all there is: they are *undetermined*, and said to be. Their variance is
1 / eps, that is huge: a pseudo-inverse that cuts them off would call the unknown certain. Where all l are surely above it, a
Cholesky factor gives the same for a tenth of the work: of an information of 128 lasers, that is seconds of a solve.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from calib_core.types import BoolArray, FloatArray

#: Relative to unit diagonal: what double precision cannot resolve after eliminating a chain of knots.
ROUND_OFF = 1e-11
#: What one elimination leaves of nothing strays by so many times what came out below it. Judged.
_STRAYS = 10.0
#: Eigenvalues are surely above it where a bound is by so much, which is estimated and may be a few times too high.
_SURELY = 100.0
#: Information of an unknown that has none: far below any, and its inverse squared is still a number.
_NOTHING = 1e-200


@dataclass(frozen=True, slots=True)
class Covariance:
    """matrix: (S, S).   undetermined: (S, U), directions in the unknowns' own units that nothing is known of."""

    matrix: FloatArray
    undetermined: FloatArray

    def of(self, some: slice | list[int]) -> FloatArray:
        """The covariance of some of the unknowns, all others unknown too."""
        return np.asarray(self.matrix[some][:, some])


def factor(unit: FloatArray) -> FloatArray | None:
    """Lower Cholesky factor (S, S) of an information of unit diagonal that determines all unknowns; None where it may not."""
    if not len(unit):
        return None
    lapack = scipy.linalg.lapack
    lower, failed = lapack.dpotrf(unit, lower=1)
    if failed:
        return None
    norm = float(np.abs(unit).sum(axis=0).max())
    # The reciprocal of the inverse's norm, which no eigenvalue is below.
    reciprocal, _ = lapack.dpocon(lower, norm, uplo="L")
    return np.asarray(lower) if reciprocal * norm > _SURELY * ROUND_OFF else None


def solved(lower: FloatArray, right: FloatArray) -> FloatArray:
    """L L' x = right, (S,) or (S, m)."""
    return np.asarray(scipy.linalg.lapack.dpotrs(lower, right, lower=1)[0])


def covariance(information: FloatArray) -> Covariance:
    """The covariance that an information matrix (S, S) stands for. An unknown without any information is undetermined."""
    scale, unit = _of_unit_diagonal(information)
    lower = factor(unit)
    if lower is not None:
        half = np.tril(scipy.linalg.lapack.dpotri(lower, lower=1)[0])
        inverse = half + np.tril(half, -1).T
        return Covariance(scale[:, None] * inverse * scale[None, :], np.zeros((len(unit), 0)))
    values, vectors = np.linalg.eigh(unit)
    spread = scale[:, None] * vectors
    return Covariance(spread / np.maximum(values, ROUND_OFF) @ spread.T, spread[:, values <= ROUND_OFF])


def covariance_of(information: FloatArray, some: slice) -> FloatArray:
    """The same of some of the unknowns alone, all others unknown too: of a few of many for a third of the work."""
    scale, unit = _of_unit_diagonal(information)
    lower = factor(unit)
    if lower is None:
        return covariance(information).of(some)
    own = solved(lower, np.eye(len(unit))[:, some])[some]
    return np.asarray(scale[some, None] * (0.5 * (own + own.T)) * scale[None, some])


def _of_unit_diagonal(information: FloatArray) -> tuple[FloatArray, FloatArray]:
    """D (S,) and D I D, symmetric."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), _NOTHING))
    unit = information * scale[:, None] * scale[None, :]
    return scale, 0.5 * (unit + unit.T)


def above_round_off(values: FloatArray) -> BoolArray:
    """Which eigenvalues are information. values: all of what one elimination left, relative to what there was before.

    None is below zero in truth: how large round-off has grown, those say that came out so.
    """
    return np.asarray(values > max(ROUND_OFF, -_STRAYS * float(values.min(initial=0.0))))


def marginal(information: FloatArray, count: int) -> FloatArray:
    """The information (count, count) of the first unknowns when all others are unknown too.

    Directions of the others that nothing is known of take away whatever they are coupled to.
    """
    own, border, others = information[:count, :count], information[:count, count:], information[count:, count:]
    scale, unit = _of_unit_diagonal(others)
    lower, scaled = factor(unit), border * scale
    taken = border @ covariance(others).matrix @ border.T if lower is None else scaled @ solved(lower, scaled.T)
    left = own - taken
    return np.asarray(0.5 * (left + left.T))
