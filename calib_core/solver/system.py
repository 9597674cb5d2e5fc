"""Normal equations shaped like an arrow: a chain of equal blocks, each coupled to the next, and a shared border.

        [ D0 E1'            B0 ]          D_k (n, n)   one knot
        [ E1 D1 E2'         B1 ]          E_k (n, n)   knot k with the one before it
    H = [    E2 D2 ...      .. ]          B_k (n, S)   knot with the shared parameters
        [          ...         ]          C   (S, S)   shared parameters
        [ B0' B1' ...       C  ]

They are asked for part by part, and a part is gone once it is eliminated: of a long recording the whole would be gigabytes. A
step of the chain needs the border once more, times the step of what is shared, which whoever has the equations finds without
writing it out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from calib_core.types import FloatArray, IntArray


@dataclass
class ArrowPart:
    """The rows of k knots in a row, and what belongs to no other part of the shared ones.

    diagonal: (k, n, n).   lower: (k, n, n) each knot with the one before it, which the chain's first has not.
    border: (k, n, C), corner: (C, C), gradient_shared: (C,), of the shared columns `columns` (C,), each once.   gradient: (k, n).
    """

    diagonal: FloatArray
    lower: FloatArray
    border: FloatArray
    columns: IntArray
    corner: FloatArray
    gradient: FloatArray
    gradient_shared: FloatArray


class ArrowEquations(Protocol):
    """What a solver asks of normal equations of K knots with n unknowns each, and S shared ones.

    Parts are asked for on several threads at once.
    """

    @property
    def knots(self) -> int:
        """K."""
        ...

    @property
    def shared(self) -> int:
        """S."""
        ...

    @property
    def frozen(self) -> tuple[int, ...]:
        """Shared columns held fixed."""
        ...

    def part(self, first: int, last: int) -> ArrowPart:
        """Knots first..last (exclusive)."""
        ...

    def common(self) -> tuple[FloatArray, FloatArray]:
        """Of the shared unknowns what belongs to no part: corner (S, S) and gradient (S,)."""
        ...

    def pulls(self, along: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """The gradient alone, of the knots (K, n) and of what is shared (S,), which is B' along more where the knots have moved
        by `along` (K, n); what it has of the knots then is not asked for."""
        ...

    def border_times(self, shared: FloatArray) -> FloatArray:
        """(K, n, m) B times columns (S, m)."""
        ...


@dataclass
class ArrowSystem:
    """H and gradient of a sum of squares written out, accumulated factor by factor: of a short chain.

    diagonal: (K, n, n).   lower: (K - 1, n, n), row block k + 1, column block k.   border: (K, n, S).   corner: (S, S).
    gradient: (K, n).   gradient_shared: (S,).   cost: half the sum of squares, where a problem tells it.   frozen: shared
    columns held fixed.
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

    @staticmethod
    def of(equations: ArrowEquations) -> ArrowSystem:
        """Equations written out: of a short chain, to be looked at."""
        part = equations.part(0, equations.knots)
        corner, gradient_shared = equations.common()
        border = np.zeros((*part.gradient.shape, equations.shared))
        border[:, :, part.columns] = part.border
        corner[np.ix_(part.columns, part.columns)] += part.corner
        gradient_shared[part.columns] += part.gradient_shared
        return ArrowSystem(
            part.diagonal, part.lower[1:], border, corner, part.gradient, gradient_shared, frozen=equations.frozen
        )

    @property
    def knots(self) -> int:
        """K."""
        return len(self.diagonal)

    @property
    def shared(self) -> int:
        """S."""
        return len(self.corner)

    def part(self, first: int, last: int) -> ArrowPart:
        """Knots first..last (exclusive), and nothing of the corner."""
        some, size = slice(first, last), self.shared
        before = (
            self.lower[first - 1 : last - 1]
            if first
            else np.concatenate([np.zeros_like(self.diagonal[:1]), self.lower])
        )
        return ArrowPart(
            self.diagonal[some],
            before[: last - first],
            self.border[some],
            np.arange(size),
            np.zeros((size, size)),
            self.gradient[some],
            np.zeros(size),
        )

    def common(self) -> tuple[FloatArray, FloatArray]:
        """The corner, and its gradient."""
        return self.corner.copy(), self.gradient_shared.copy()

    def pulls(self, along: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """The gradient, of the knots and of what is shared, this where the knots have moved by `along` (K, n)."""
        if along is None:
            return self.gradient, self.gradient_shared
        return self.gradient, self.gradient_shared + np.einsum("kns,kn->s", self.border, along, optimize=True)

    def border_times(self, shared: FloatArray) -> FloatArray:
        """(K, n, m) the border times columns (S, m)."""
        return np.asarray(self.border @ shared)
