"""Normal equations shaped like an arrow: a chain of equal blocks, each coupled to the next, and a shared border.

        [ D0 E0'            B0 ]          D_k (n, n)   one knot
        [ E0 D1 E1'         B1 ]          E_k (n, n)   knot k + 1 with knot k
    H = [    E1 D2 ...      .. ]          B_k (n, S)   knot with the shared parameters
        [          ...         ]          C   (S, S)   shared parameters
        [ B0' B1' ...       C  ]

The chain is eliminated block by block by Cholesky factors; what remains on the border, C - B' A^-1 B, is the information
of the shared parameters with the chain marginalised: the calibration's own information matrix. A long chain is cut: the
pieces between the cuts are eliminated first, each with those shared columns alone that it touches, then the cuts' knots,
which are a short chain of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calib_core.solver.information import ROUND_OFF, covariance, factor, solved
from calib_core.solver.kernels import (
    add_places_kernel,
    eliminate_kernel,
    fill_kernel,
    forward_kernel,
    substitute_kernel,
    touched_kernel,
)
from calib_core.threads import workers
from calib_core.types import FloatArray, IntArray


class NotPositiveDefinite(ArithmeticError):
    """The chain's block could not be factorised: more damping is needed, or a state is not constrained at all."""


@dataclass
class ArrowSystem:
    """H and gradient of a sum of squares, accumulated factor by factor.

    diagonal: (K, n, n).   lower: (K - 1, n, n), row block k + 1, column block k.   border: (K, n, C).   corner: (S, S).
    gradient: (K, n).   gradient_shared: (S,).   cost: half the sum of squares, where a problem tells it.   frozen: shared
    columns held fixed.   columns: (K, C) which of the shared each column of a knot's border is, each once; None where they are
    all there, in order.
    """

    diagonal: FloatArray
    lower: FloatArray
    border: FloatArray
    corner: FloatArray
    gradient: FloatArray
    gradient_shared: FloatArray
    cost: float = 0.0
    frozen: tuple[int, ...] = ()
    columns: IntArray | None = None

    @staticmethod
    def zeros(knots: int, block: int, shared: int, columns: IntArray | None = None) -> ArrowSystem:
        """An empty system of K knots with n unknowns each and S shared unknowns, of which each knot knows some or all."""
        return ArrowSystem(
            np.zeros((knots, block, block)),
            np.zeros((max(knots - 1, 0), block, block)),
            np.zeros((knots, block, shared if columns is None else columns.shape[1])),
            np.zeros((shared, shared)),
            np.zeros((knots, block)),
            np.zeros(shared),
            columns=columns,
        )

    def known(self) -> IntArray:
        """(K, C) the shared column of each of the border's."""
        if self.columns is not None:
            return self.columns
        return np.repeat(np.arange(self.corner.shape[0])[None], len(self.diagonal), axis=0)

    def whole_border(self) -> FloatArray:
        """(K, n, S) the border with every zero written out."""
        if self.columns is None:
            return self.border
        out = np.zeros((*self.gradient.shape, self.corner.shape[0]))
        np.put_along_axis(out, np.repeat(self.columns[:, None], out.shape[1], axis=1), self.border, axis=2)
        return out


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
    """A piece of the chain eliminated: knots first..last (exclusive), factors L, M, W of solver/kernels.py in scaled units.

    W: (k, n, ..) on the shared columns that these knots touch (`touched`, among the free ones), on the knot before the piece
    where there is one, and the gradient.   gram: W' W.   onward: (n, n) M of the knot after the piece.
    """

    first: int
    last: int
    L: FloatArray
    M: FloatArray
    W: FloatArray
    touched: IntArray
    gram: FloatArray
    onward: FloatArray

    @property
    def has_before(self) -> bool:
        """Whether the piece begins behind a cut."""
        return self.first > 0

    def without_inside(self) -> _Piece:
        """With its last knot alone of the factors: what the knots between pieces, and the border, ask of it."""
        return replace(self, L=self.L[-1:].copy(), M=self.M[:0].copy(), W=self.W[-1:].copy())


@dataclass(frozen=True)
class _Chain:
    """The chain eliminated, in units of `scale` (K, n): first the pieces, then the knots `cuts` between them.

    L, M, W: of the cuts, a chain of their own.   free: shared columns that are not frozen; schur, reduced: what is left of
    the information and the gradient there.
    """

    pieces: list[_Piece]
    cuts: IntArray
    L: FloatArray
    M: FloatArray
    W: FloatArray
    scale: FloatArray
    free: IntArray
    schur: FloatArray
    reduced: FloatArray


def _eliminated(system: ArrowSystem, damping: float, *, for_steps: bool = True) -> _Chain:
    """Piece by piece, which may go on at the same time: where they are cut does not depend on how many do.

    for_steps: with what a step of the chain is found by, as much memory as the system itself.
    """
    knots = len(system.diagonal)
    free = np.setdiff1d(np.arange(system.corner.shape[0]), system.frozen)
    shared = len(free)
    # Unit diagonal: positions, angles and velocities differ by many orders of magnitude.
    scale = 1.0 / np.sqrt(np.maximum((1.0 + damping) * np.einsum("kii->ki", system.diagonal), 1e-300))
    pieces = max(1, round(knots / _PIECE))
    cuts = (np.arange(1, pieces) * knots) // pieces
    known = system.known()
    edges = [-1, *(int(cut) for cut in cuts), knots]
    tasks = range(pieces)

    def one(k: int) -> _Piece | None:
        piece = _eliminated_piece(system, known, damping, scale, free, edges[k] + 1, edges[k + 1])
        return piece if for_steps or piece is None else piece.without_inside()

    done = [piece for piece in (workers().map(one, tasks) if pieces > 1 else map(one, tasks)) if piece is not None]
    if len(done) < pieces:
        raise NotPositiveDefinite("the chain of knots is not positive definite")
    L, E, W, inner = _between(system, known, damping, scale, free, done, cuts)
    if not eliminate_kernel(L, E, W):
        raise NotPositiveDefinite("the chain of knots is not positive definite")
    flat = W.reshape(-1, shared + 1)
    inner += flat.T @ flat
    corner = system.corner[np.ix_(free, free)]
    if damping > 0:
        corner = corner + np.diag(damping * np.diag(corner))
    schur = corner - inner[:shared, :shared]
    reduced = system.gradient_shared[free] - inner[:shared, shared]
    return _Chain(done, cuts, L, E, W, scale, free, 0.5 * (schur + schur.T), reduced)


def _between(
    system: ArrowSystem,
    known: IntArray,
    damping: float,
    scale: FloatArray,
    free: IntArray,
    pieces: Sequence[_Piece],
    cuts: IntArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """What the pieces leave of the knots between them, D, E, W of a chain, and what they take from the border: W' W."""
    n, shared = system.diagonal.shape[1], len(free)
    place = _places(free, system.corner.shape[0])
    D, E, W = np.empty((len(cuts), n, n)), np.zeros((max(len(cuts) - 1, 0), n, n)), np.empty((len(cuts), n, shared + 1))
    for j, cut in enumerate(cuts):
        fill_kernel(
            system.diagonal, system.lower, system.border, known, system.gradient, scale, place, damping, int(cut), False,
            D[j : j + 1], E[:0], W[j : j + 1],
        )  # fmt: skip
    inner = np.zeros((shared + 1, shared + 1))
    for j, piece in enumerate(pieces):
        theirs = np.append(piece.touched, shared)
        own = np.append(np.arange(len(piece.touched)), piece.W.shape[2] - 1)
        add_places_kernel(piece.gram, own, theirs, inner)
        before = slice(len(piece.touched), len(piece.touched) + n)
        if piece.has_before:
            D[j - 1] -= piece.gram[before, before]
            W[j - 1][:, theirs] -= piece.gram[before][:, own]
        if j < len(cuts):
            last = piece.W[-1]
            D[j] -= piece.onward @ piece.onward.T
            W[j][:, theirs] -= piece.onward @ last[:, own]
            if piece.has_before:
                E[j - 1] = -(piece.onward @ last[:, before])
    return D, E, W, inner


def _places(columns: IntArray, size: int) -> IntArray:
    """(S,) where each shared column is among these (F,); -1 for none."""
    out = np.full(size, -1)
    out[columns] = np.arange(len(columns))
    return out


def _eliminated_piece(
    system: ArrowSystem, known: IntArray, damping: float, scale: FloatArray, free: IntArray, first: int, last: int
) -> _Piece | None:
    """Knots first..last (exclusive); None where they are not positive definite."""
    knots, n, _ = system.diagonal.shape
    count, has_before = last - first, first > 0
    # Most shared unknowns are felt everywhere, a node of the biases or a plane by a part of the chain alone.
    size = system.corner.shape[0]
    touched = np.flatnonzero(touched_kernel(system.border, known, size, first, last)[free])
    L, M = np.empty((count, n, n)), np.empty((max(count - 1, 0), n, n))
    W = np.empty((count, n, len(touched) + (n if has_before else 0) + 1))
    fill_kernel(
        system.diagonal, system.lower, system.border, known, system.gradient, scale, _places(free[touched], size), damping,
        first, has_before, L, M, W,
    )  # fmt: skip
    if not eliminate_kernel(L, M, W):
        return None
    flat = W.reshape(count * n, -1)
    onward = np.zeros((n, n))
    if last < knots:
        after = system.lower[last - 1] * (scale[last][:, None] * scale[last - 1])
        onward = np.linalg.solve(np.tril(L[-1]), after.T).T
    return _Piece(first, last, L, M, W, touched, flat.T @ flat, onward)


def _chain_step(chain: _Chain, shared: FloatArray, gradient: float) -> FloatArray:
    """How the chain follows a step of the free shared columns (F,), and the gradient taken so many times: (K, n)."""
    at_cuts = -(chain.W @ np.append(shared, gradient))
    substitute_kernel(chain.L, chain.M, at_cuts)
    step = np.empty_like(chain.scale)
    step[chain.cuts] = at_cuts

    def one(k: int) -> None:
        piece = chain.pieces[k]
        before = at_cuts[k - 1] if piece.has_before else np.zeros(0)
        own = -(piece.W @ np.concatenate([shared[piece.touched], before, [gradient]]))
        if k < len(chain.cuts):
            own[-1] -= piece.onward.T @ at_cuts[k]
        substitute_kernel(piece.L, piece.M, own)
        step[piece.first : piece.last] = own

    tasks = range(len(chain.pieces))
    list(workers().map(one, tasks) if len(tasks) > 1 else map(one, tasks))
    return step * chain.scale


@dataclass(frozen=True)
class Eliminated:
    """A system with its chain eliminated, for its own gradient and for others: the gradient is a column like any other.

    Of a chain with 500 shared columns, one more gradient is a hundredth of the work.
    """

    _chain: _Chain
    _shared: int

    @staticmethod
    def of(system: ArrowSystem, *, damping: float = 0.0) -> Eliminated:
        """Raises NotPositiveDefinite where the damped chain is not positive definite."""
        return Eliminated(_eliminated(system, damping), system.corner.shape[0])

    def solution(self, system: ArrowSystem) -> ArrowSolution:
        """The step by the gradient last given. system: of that gradient."""
        return _solution(self._chain, system)

    def unit_responses(self, columns: IntArray) -> tuple[FloatArray, FloatArray]:
        """C columns of H^-1 E on the shared unknowns, each numbered below S: chain (K, n, C) and border (S, C).

        A factor with Jacobian J and residual r moves those unknowns by -(J X)' r, X these columns: its influence. Frozen
        columns respond to nothing. Raises NotPositiveDefinite.
        """
        chain = self._chain
        inverse = covariance(chain.schur).matrix
        border, along = np.zeros((self._shared, len(columns))), np.zeros((*chain.scale.shape, len(columns)))
        place = np.full(self._shared, -1)
        place[chain.free] = np.arange(len(chain.free))
        for c in np.flatnonzero(place[columns] >= 0):
            own = inverse[:, place[columns[c]]]
            border[chain.free, c] = own
            along[:, :, c] = _chain_step(chain, own, 0.0)
        return along, border

    def again(self, system: ArrowSystem) -> ArrowSolution:
        """The step by another system's gradient, as if its equations were these: true as far as the estimate has hardly moved.

        Its frozen columns have to be the same ones.
        """
        return _solution(_with_gradient(self._chain, system), system)


def _with_gradient(chain: _Chain, system: ArrowSystem) -> _Chain:
    """The same chain with this system's gradient, (K, n) and (S,), eliminated instead of the one before, whose place it takes."""
    scaled = system.gradient * chain.scale
    reduced = system.gradient_shared[chain.free]
    at_cuts = scaled[chain.cuts]
    for j, piece in enumerate(chain.pieces):
        own = scaled[piece.first : piece.last]
        forward_kernel(piece.L, piece.M, own)
        piece.W[:, :, -1] = own
        taken = _times(piece.W, own)
        count = len(piece.touched)
        reduced[piece.touched] -= taken[:count]
        if piece.has_before:
            at_cuts[j - 1] -= taken[count:]
        if j < len(chain.cuts):
            at_cuts[j] -= piece.onward @ own[-1]
    forward_kernel(chain.L, chain.M, at_cuts)
    chain.W[:, :, -1] = at_cuts
    reduced -= _times(chain.W, at_cuts)
    return replace(chain, reduced=reduced)


def _times(W: FloatArray, y: FloatArray) -> FloatArray:
    """W' y of all columns but the last, which is the gradient's. W: (k, n, C), y: (k, n)."""
    return np.asarray(W.reshape(-1, W.shape[2]).T @ y.reshape(-1))[:-1]


def solve_arrow(system: ArrowSystem, *, damping: float = 0.0) -> ArrowSolution:
    """One Gauss-Newton (damping 0) or Levenberg-Marquardt step, damping relative to H's diagonal.

    Raises NotPositiveDefinite where the damped chain is not positive definite.
    """
    return Eliminated.of(system, damping=damping).solution(system)


def _solution(chain: _Chain, system: ArrowSystem) -> ArrowSolution:
    free = chain.free
    moved = _shared_step(chain.schur, chain.reduced) if len(free) else np.zeros(0)
    step = _chain_step(chain, moved, 1.0)
    step_shared = np.zeros(system.corner.shape[0])
    step_shared[free] = moved
    slope = float(np.sum(step * system.gradient) + moved @ system.gradient_shared[free])
    information, remaining = _of_shared(chain, len(step_shared))
    return ArrowSolution(step, step_shared, information, -0.5 * slope, remaining)


def solve_shared(system: ArrowSystem) -> tuple[FloatArray, FloatArray]:
    """Information (S, S) and gradient (S,) of the shared unknowns with the chain eliminated, as an ArrowSolution has them.

    For who asks for no step: in half the memory. Raises NotPositiveDefinite.
    """
    return _of_shared(_eliminated(system, 0.0, for_steps=False), system.corner.shape[0])


def _of_shared(chain: _Chain, size: int) -> tuple[FloatArray, FloatArray]:
    information, remaining = np.eye(size) * FROZEN, np.zeros(size)
    information[np.ix_(chain.free, chain.free)] = chain.schur
    remaining[chain.free] = chain.reduced
    return information, remaining
