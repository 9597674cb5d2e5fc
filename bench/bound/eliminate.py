"""A square-root information filter: instants are eliminated one after the other by orthogonal transformations.

Information about [moving, lasting] errors z is kept as the triangle T of |T z|^2. A step substitutes
moving0 = S z1 + N w, w of unit variance, joins the rows [I w] and [T_moving N w + (T_moving S + T_lasting) z1], and a QR
decomposition with w's columns first eliminates w: what is below its rows is the triangle about z1. Nothing is squared.

Columns behind the unknowns are right-hand sides, carried along: with what the sensors really drew in them, the triangle is
solved by the errors of the efficient estimate.
"""

from __future__ import annotations

import numpy as np

from bench.bound.model import FloatArray


def triangle_of(rows: FloatArray) -> FloatArray:
    """The upper triangle that says the same as the rows. rows: (M, n). Returns (n, n)."""
    n = rows.shape[1]
    if len(rows) < n:
        rows = np.vstack([rows, np.zeros((n - len(rows), n))])
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)


def stepped(
    triangle: FloatArray, back: FloatArray, noise: FloatArray, rows: FloatArray, drawn: FloatArray | None = None
) -> FloatArray:
    """The triangle after one step, joined with the rows that speak of the errors after it.

    triangle: (n, n + e) before, e right-hand sides.   back: (moving, n), noise: (moving, noises), of motion.py.
    rows: (M, n + e).   drawn: (noises,) right-hand side of the noises; None: zero.
    """
    moving, n = back.shape
    noises = noise.shape[1]
    stack = np.zeros((noises + n + len(rows), noises + triangle.shape[1]))
    stack[:noises, :noises] = np.eye(noises)
    if drawn is not None:
        stack[:noises, -1] = drawn
    carried = stack[noises : noises + n]
    carried[:, :noises] = triangle[:, :moving] @ noise
    carried[:, noises : noises + n] = triangle[:, :moving] @ back
    carried[:, noises + moving :] += triangle[:, moving:]
    stack[noises + n :, noises:] = rows
    return triangle_of(stack)[noises : noises + n, noises:]


def covariance_of_last(triangle: FloatArray, count: int) -> FloatArray:
    """Covariance of the last `count` unknowns, all others eliminated; infinite where nothing determines them."""
    n = len(triangle)
    mine = triangle[-count:, n - count : n]
    try:
        root = np.linalg.inv(mine)
    except np.linalg.LinAlgError:
        return np.full((count, count), np.inf)
    covariance: FloatArray = root @ root.T
    return covariance


def solution_of_last(triangle: FloatArray, count: int) -> FloatArray:
    """(count,) the last unknowns that solve the first right-hand side; NaN where nothing determines them."""
    n = len(triangle)
    try:
        return np.asarray(np.linalg.solve(triangle[-count:, n - count : n], triangle[-count:, n]), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.full(count, np.nan)
