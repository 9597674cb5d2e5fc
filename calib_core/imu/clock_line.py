"""The line of an even clock through the stamps of its samples: straight, or bending where the clock drifts.

A bent line is linear between even nodes, and a least-squares fit: its normal equations are banded by one.
"""

from __future__ import annotations

import numpy as np
import scipy

from calib_core.types import BoolArray, FloatArray, IntArray

#: Clocks drift: a line may bend at nodes this far apart where a straight one does not do.
_NODE_S = 10.0
#: A bend, or a clock started anew, has to be surer than this many standard deviations of its chi-square.
_SURE = 5.0


def line_of(number: IntArray, t: FloatArray, used: BoolArray) -> tuple[FloatArray, int]:
    """Times of the samples and the line's cells: straight, or bending every few seconds where that fits much better."""
    straight = _through(number, t, used, 1)
    cells = int((straight[-1] - straight[0]) / _NODE_S)
    if cells < 2:
        return straight, 1
    bent = _through(number, t, used, cells)
    as_well = fits_as_well((t - straight)[used], (t - bent)[used], freedoms=cells - 1)
    return (straight, 1) if as_well else (bent, cells)


def _through(number: IntArray, t: FloatArray, used: BoolArray, cells: int) -> FloatArray:
    """Least-squares fit of a function that is linear between `cells` + 1 even nodes."""
    x, y = number[used] - number[used].mean(), t[used] - t[used].mean()
    straight = t[used].mean() + float(x @ y / (x @ x)) * (number - number[used].mean())
    if cells == 1:
        return np.asarray(straight, dtype=np.float64)
    cell, right = places(number, cells)
    left = np.where(used, t - straight, 0.0)
    node = scipy.linalg.solveh_banded(normal_equations(cell, right, used, cells), onto_nodes(cell, right, left, cells))
    return np.asarray(straight + (1 - right) * node[cell] + right * node[cell + 1], dtype=np.float64)


def places(number: IntArray, cells: int) -> tuple[IntArray, FloatArray]:
    """The cell each sample is in, and how far towards its right node, 0 to 1."""
    place = (number - number[0]) / max(int(number[-1] - number[0]), 1) * cells
    cell = np.minimum(place.astype(np.int64), cells - 1)
    return cell, np.asarray(place - cell, dtype=np.float64)


def normal_equations(cell: IntArray, right: FloatArray, used: BoolArray, cells: int) -> FloatArray:
    """Upper banded form (2, cells + 1), for samples of unit weight."""
    banded = np.zeros((2, cells + 1))
    banded[1] = onto_nodes(cell, right, np.where(used, 1 - right, 0.0), cells, other=np.where(used, right, 0.0))
    banded[0, 1:] = np.bincount(cell, np.where(used, right * (1 - right), 0.0), cells + 1)[:-1]
    # A node over nothing but lost readings stays where it is.
    banded[1] += 1e-9 * banded[1].max()
    return banded


def onto_nodes(
    cell: IntArray, right: FloatArray, weight: FloatArray, cells: int, *, other: FloatArray | None = None
) -> FloatArray:
    """(cells + 1,): sums of weights onto the nodes left and right. other: the weight for the right node, if another."""
    onto_right = weight if other is None else other
    return np.asarray(
        np.bincount(cell, (1 - right) * weight, cells + 1) + np.bincount(cell + 1, right * onto_right, cells + 1)
    )


def fits_as_well(stiff: FloatArray, loose: FloatArray, *, freedoms: int) -> bool:
    """Whether residuals with fewer free numbers are no larger than chance allows."""
    noise = float(np.mean(loose**2))
    gained = float(stiff @ stiff - loose @ loose)
    # Of pure noise the gain is chi-square with as many degrees of freedom as numbers were set free.
    return gained <= noise * (freedoms + _SURE * np.sqrt(2.0 * freedoms))
