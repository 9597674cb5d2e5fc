"""Elimination of normal equations shaped like an arrow (solver/system.py).

The chain is eliminated block by block by Cholesky factors; what remains on the border, C - B' A^-1 B, is the information
of the shared parameters with the chain marginalised: the calibration's own information matrix. A long chain is cut: the
pieces between the cuts are eliminated first, each with those shared columns alone that it touches, then the cuts' knots,
which are a short chain of their own. A part's border is gone once it is eliminated.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from calib_core.paged import Shelf, heed_pages
from calib_core.solver.information import ROUND_OFF, Covariance, covariance, factor, solved
from calib_core.solver.kernels import (
    add_places_kernel,
    eliminate_kernel,
    fill_kernel,
    forward_kernel,
    substitute_kernel,
    touched_kernel,
)
from calib_core.solver.system import ArrowEquations, ArrowPart
from calib_core.threads import workers
from calib_core.types import BoolArray, FloatArray, IntArray


class NotPositiveDefinite(ArithmeticError):
    """The chain's block could not be factorised: more damping is needed, or a state is not constrained at all."""


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

    @cached_property
    def covariance(self) -> Covariance:
        """Of the shared unknowns: many ask for it at the end of a solve, and that of 128 lasers takes its time."""
        return covariance(self.information)


#: Stands for the information of what is held fixed.
FROZEN = 1e12
#: A long chain is cut into pieces of about so many knots.
_PIECE = 256


def _shared_step(schur: FloatArray, gradient: FloatArray) -> FloatArray:
    """The border's step, none along directions that the information does not resolve from round-off."""
    unit = 1.0 / np.sqrt(np.maximum(np.diag(schur), 1e-300))
    scaled = schur * unit[:, None] * unit[None, :]
    lower = factor(scaled)
    if lower is not None:
        return unit * solved(lower, -unit * gradient)
    values, vectors = np.linalg.eigh(scaled)
    along = vectors.T @ (-unit * gradient)
    known = values > ROUND_OFF
    return unit * (vectors @ np.where(known, along / np.where(known, values, 1.0), 0.0))


@dataclass(frozen=True)
class _Piece:
    """A piece of the chain eliminated: knots first..last (exclusive), and the cut's knot after it, but for the last piece.

    L, M: factors of solver/kernels.py in units of `scale` (k, n), the cut's among them.   before: (n, n) the first knot with the
    one before it, in scaled rows; none for the first piece.   onward: (n, n) M of the cut's knot.   gradient: (k, n).
    """

    first: int
    last: int
    scale: FloatArray
    gradient: FloatArray
    L: FloatArray
    M: FloatArray
    before: FloatArray | None
    onward: FloatArray | None

    def leading(self, pull: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What a pull (K, n) on the chain does to the knots before and after the piece, (n,) each, through it: in the first's own
        units and the second's scaled ones."""
        own = pull[self.first : self.last] * self.scale[: self.last - self.first]
        heed_pages(self.L.nbytes + self.M.nbytes)
        forward_kernel(self.L, self.M, own)
        none = np.zeros(own.shape[1])
        after = none if self.onward is None else self.onward @ own[-1]
        if self.before is None:
            return none, after
        substitute_kernel(self.L, self.M, own)
        return self.before.T @ own[0], after

    def followed(self, pull: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
        """(k, n) how it gives way to a pull (K, n), with the knots before and after where they come to be: as in `leading`."""
        scale = self.scale[: self.last - self.first]
        own = -pull[self.first : self.last] * scale
        if self.before is not None:
            own[0] -= self.before @ before
        heed_pages(self.L.nbytes + self.M.nbytes)
        forward_kernel(self.L, self.M, own)
        if self.onward is not None:
            own[-1] -= self.onward.T @ after
        substitute_kernel(self.L, self.M, own)
        return np.asarray(own * scale)


@dataclass(frozen=True)
class _Left:
    """What a piece's elimination leaves of its part, of its own shared columns and for the cuts beside it.

    own: (F,) which of the part's columns are free and touched. W of solver/kernels.py is of these, of the knot before in its own
    units where there is one, and of the gradient.   gram: W' W.   last: (n, ..) W of the last knot.   cut: D (n, n), and the
    border (n, C) and gradient (n,) of the cut's knot, in scaled rows; None after the last.
    """

    part: ArrowPart
    own: IntArray
    gram: FloatArray
    last: FloatArray
    cut: tuple[FloatArray, FloatArray, FloatArray] | None


@dataclass(frozen=True)
class _Chain:
    """The chain eliminated: first the pieces, then the knots between them, which are a chain of their own of factors L, M in
    units of `scale` (cuts, n).

    free: shared columns that are not frozen; schur, reduced: what is left of the information and the gradient there.
    gradient_shared: (S,) before that.
    """

    pieces: list[_Piece]
    L: FloatArray
    M: FloatArray
    scale: FloatArray
    free: IntArray
    schur: FloatArray
    reduced: FloatArray
    gradient_shared: FloatArray

    def gradient(self) -> FloatArray:
        """(K, n)."""
        return np.concatenate([piece.gradient for piece in self.pieces])


def _eliminated(equations: ArrowEquations, damping: float, *, for_steps: bool = True) -> _Chain:
    """Piece by piece, which may go on at the same time: where they are cut does not depend on how many do.

    for_steps: with what a step of the chain is found by.
    """
    knots, size = equations.knots, equations.shared
    free = np.setdiff1d(np.arange(size), equations.frozen)
    is_free = np.zeros(size, np.bool_)
    is_free[free] = True
    pieces = max(1, round(knots / _PIECE))
    edges = [0, *((np.arange(1, pieces) * knots) // pieces + 1).tolist(), knots]

    shelf = Shelf() if for_steps else None

    def one(k: int) -> tuple[_Piece, _Left] | None:
        return _eliminated_piece(equations, damping, is_free, edges[k], edges[k + 1], shelf)

    tasks = range(pieces)
    done = workers().map(one, tasks) if pieces > 1 else map(one, tasks)
    return _between(equations, damping, free, pieces, done)


def _between(
    equations: ArrowEquations,
    damping: float,
    free: IntArray,
    count: int,
    done: Iterator[tuple[_Piece, _Left] | None],
) -> _Chain:
    """The knots between so many pieces as these leave them, in order, and then what they all leave of the border."""
    shared = len(free)
    place = _places(free, equations.shared)
    corner, gradient_shared = equations.common()
    pieces: list[_Piece] = []
    taken = np.zeros((shared + 1, shared + 1))
    D = E = W = scale = np.zeros((0, 0, 0))
    for j, each in enumerate(done):
        if each is None:
            raise NotPositiveDefinite("the chain of knots is not positive definite")
        piece, left = each
        n = piece.gradient.shape[1]
        if j == 0:
            D, E = np.zeros((count - 1, n, n)), np.zeros((max(count - 2, 0), n, n))
            W, scale = np.zeros((count - 1, n, shared + 1)), np.zeros((count - 1, n))
        part, width = left.part, len(left.own)
        add_places_kernel(part.corner, np.arange(len(part.columns)), part.columns, corner)
        gradient_shared[part.columns] += part.gradient_shared
        own, theirs = np.append(np.arange(width), len(left.gram) - 1), np.append(place[part.columns[left.own]], shared)
        add_places_kernel(left.gram, own, theirs, taken)
        before = slice(width, width + n)
        if j > 0:
            unit = scale[j - 1][:, None]
            D[j - 1] -= unit * left.gram[before, before] * scale[j - 1]
            W[j - 1][:, theirs] -= unit * left.gram[before][:, own]
        if left.cut is not None and piece.onward is not None:
            D[j], border, W[j, :, shared] = left.cut
            scale[j] = piece.scale[-1]
            W[j][:, theirs[:-1]] = border[:, left.own]
            D[j] -= piece.onward @ piece.onward.T
            W[j][:, theirs] -= piece.onward @ left.last[:, own]
            if j > 0:
                E[j - 1] = -(piece.onward @ left.last[:, before]) * scale[j - 1]
        pieces.append(piece)
    if not eliminate_kernel(D, E, W):
        raise NotPositiveDefinite("the chain of knots is not positive definite")
    flat = W.reshape(-1, shared + 1)
    taken += flat.T @ flat
    corner = corner[np.ix_(free, free)]
    if damping > 0:
        corner = corner + np.diag(damping * np.diag(corner))
    schur = corner - taken[:shared, :shared]
    reduced = gradient_shared[free] - taken[:shared, shared]
    return _Chain(pieces, D, E, scale, free, 0.5 * (schur + schur.T), reduced, gradient_shared)


def _places(columns: IntArray, size: int) -> IntArray:
    """(S,) where each shared column is among these (F,); -1 for none."""
    out = np.full(size, -1)
    out[columns] = np.arange(len(columns))
    return out


def _eliminated_piece(
    equations: ArrowEquations, damping: float, free: BoolArray, first: int, end: int, shelf: Shelf | None
) -> tuple[_Piece, _Left] | None:
    """The part of knots first..end (exclusive), whose last is a cut's but for the last part; None where its chain is not positive
    definite. free: (S,).   shelf: for what steps are found by; None where nobody asks for any."""
    part, is_last = equations.part(first, end), end == equations.knots
    count, n = part.gradient.shape
    count -= not is_last
    # Unit diagonal: positions, angles and velocities differ by many orders of magnitude.
    scale = 1.0 / np.sqrt(np.maximum((1.0 + damping) * np.einsum("kii->ki", part.diagonal), 1e-300))
    # Most shared unknowns are felt everywhere, a plane by a part of the chain alone.
    own = np.flatnonzero(free[part.columns] & touched_kernel(part.border))
    room = np.empty if shelf is None else shelf.room
    L, M = room((count, n, n)), room((max(count - 1, 0), n, n))
    W = np.empty((count, n, len(own) + (n if first else 0) + 1))
    fill_kernel(part.diagonal, part.lower, part.border, part.gradient, scale, own, damping, first > 0, L, M, W)
    if not eliminate_kernel(L, M, W):
        return None
    flat = W.reshape(count * n, -1)
    before = part.lower[0] * scale[0][:, None] if first else None
    onward = cut = None
    if not is_last:
        unit = scale[count][:, None]
        after = part.lower[count] * (unit * scale[count - 1])
        onward = np.linalg.solve(np.tril(L[-1]), after.T).T
        D = part.diagonal[count] * unit * scale[count]
        D[np.arange(n), np.arange(n)] *= 1.0 + damping
        cut = D, part.border[count] * unit, part.gradient[count] * scale[count]
    left = _Left(replace(part, diagonal=_NONE, lower=_NONE, border=_NONE), own, flat.T @ flat, W[-1].copy(), cut)
    if shelf is None:
        L = M = _NONE
    heed_pages(L.nbytes + M.nbytes)
    return _Piece(first, first + count, scale, part.gradient, L, M, before, onward), left


_NONE: FloatArray = np.zeros((0, 0, 0))


def _chain_step(chain: _Chain, pull: FloatArray) -> FloatArray:
    """How the chain gives way to a pull (K, n) on its knots: -A^-1 pull."""
    pieces, step = chain.pieces, np.empty_like(pull)
    several = len(pieces) > 1
    at_cuts = np.array([pull[piece.last] for piece in pieces[:-1]]).reshape(chain.scale.shape) * chain.scale
    if several:
        for j, (before, after) in enumerate(workers().map(lambda piece: piece.leading(pull), pieces)):
            if j > 0:
                at_cuts[j - 1] -= chain.scale[j - 1] * before
            if j < len(at_cuts):
                at_cuts[j] -= after
        at_cuts *= -1.0
        forward_kernel(chain.L, chain.M, at_cuts)
        substitute_kernel(chain.L, chain.M, at_cuts)
    moved = at_cuts * chain.scale
    none = np.zeros(pull.shape[1])

    def one(j: int) -> None:
        piece = pieces[j]
        before, after = moved[j - 1] if j > 0 else none, at_cuts[j] if j < len(at_cuts) else none
        step[piece.first : piece.last] = piece.followed(pull, before, after)
        if j < len(at_cuts):
            step[piece.last] = moved[j]

    tasks = range(len(pieces))
    list(workers().map(one, tasks) if several else map(one, tasks))
    return step


@dataclass(frozen=True)
class Eliminated:
    """Equations with their chain eliminated; the equations themselves it does not hold. frozen: of theirs."""

    _chain: _Chain
    frozen: tuple[int, ...]

    @staticmethod
    def of(equations: ArrowEquations, *, damping: float = 0.0) -> Eliminated:
        """Raises NotPositiveDefinite where the damped chain is not positive definite."""
        return Eliminated(_eliminated(equations, damping), tuple(equations.frozen))

    def is_of_kind(self, equations: ArrowEquations) -> bool:
        """Whether these are equations of as many unknowns, of which the same ones are frozen."""
        chain = self._chain
        knots, shared = chain.pieces[-1].last, len(chain.gradient_shared)
        return (knots, shared, self.frozen) == (equations.knots, equations.shared, tuple(equations.frozen))

    def solution(self, equations: ArrowEquations) -> ArrowSolution:
        """The step that they ask for: the equations it was made of."""
        return _solution(self._chain, equations, self._chain.gradient())

    def again(self, equations: ArrowEquations) -> ArrowSolution:
        """The step by the gradient of other equations, as if their curvature were that of these: true as far as the estimate has
        hardly moved.

        They have to be of their kind.
        """
        chain, free = self._chain, self._chain.free
        gradient, shared = equations.pulls()
        reduced = equations.pulls(_chain_step(chain, gradient))[1][free]
        return _solution(replace(chain, reduced=reduced, gradient_shared=shared), equations, gradient)

    def unit_responses(self, equations: ArrowEquations, columns: IntArray) -> tuple[FloatArray, FloatArray]:
        """C columns of H^-1 E on the shared unknowns, each numbered below S: chain (K, n, C) and border (S, C).

        A factor with Jacobian J and residual r moves those unknowns by -(J X)' r, X these columns: its influence. Frozen
        columns respond to nothing. Raises NotPositiveDefinite.
        """
        chain, shared = self._chain, equations.shared
        inverse = covariance(chain.schur).matrix
        border, place = np.zeros((shared, len(columns))), _places(chain.free, shared)[columns]
        known = np.flatnonzero(place >= 0)
        border[np.ix_(chain.free, known)] = inverse[:, place[known]]
        along = equations.border_times(border)
        for c in range(len(columns)):
            along[:, :, c] = _chain_step(chain, np.ascontiguousarray(along[:, :, c]))
        return along, border


def _solution(chain: _Chain, equations: ArrowEquations, gradient: FloatArray) -> ArrowSolution:
    """gradient: (K, n)."""
    step_shared = np.zeros(equations.shared)
    step_shared[chain.free] = _shared_step(chain.schur, chain.reduced) if len(chain.free) else 0.0
    step = _chain_step(chain, gradient + equations.border_times(step_shared[:, None])[:, :, 0])
    slope = float(np.sum(step * gradient) + step_shared[chain.free] @ chain.gradient_shared[chain.free])
    information, remaining = _of_shared(chain, len(step_shared))
    return ArrowSolution(step, step_shared, information, -0.5 * slope, remaining)


def solve_arrow(equations: ArrowEquations, *, damping: float = 0.0) -> ArrowSolution:
    """One Gauss-Newton (damping 0) or Levenberg-Marquardt step, damping relative to H's diagonal.

    Raises NotPositiveDefinite where the damped chain is not positive definite.
    """
    return Eliminated.of(equations, damping=damping).solution(equations)


def solve_shared(equations: ArrowEquations) -> tuple[FloatArray, FloatArray]:
    """Information (S, S) and gradient (S,) of the shared unknowns with the chain eliminated, as an ArrowSolution has them.

    For who asks for no step. Raises NotPositiveDefinite.
    """
    return _of_shared(_eliminated(equations, 0.0, for_steps=False), equations.shared)


def _of_shared(chain: _Chain, size: int) -> tuple[FloatArray, FloatArray]:
    information, remaining = np.eye(size) * FROZEN, np.zeros(size)
    information[np.ix_(chain.free, chain.free)] = chain.schur
    remaining[chain.free] = chain.reduced
    return information, remaining
