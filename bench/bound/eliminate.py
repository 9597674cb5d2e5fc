"""A square-root information filter: instants are eliminated one after the other by orthogonal transformations.

Information about [moving, lasting] errors z is kept as the triangle T of |T z|^2. A step substitutes
moving0 = S z1 + N w, w of unit variance, joins the rows [I w] and [T_moving N w + (T_moving S + T_lasting) z1], and a QR
decomposition with w's columns first eliminates w: what is below its rows is the triangle about z1. Nothing is squared.
"""

from __future__ import annotations

import numpy as np

from bench.bound.model import FloatArray


def triangle_of(rows: FloatArray) -> FloatArray:
    """The square upper triangle that says the same as the rows. rows: (M, n). Returns (n, n)."""
    n = rows.shape[1]
    if len(rows) < n:
        rows = np.vstack([rows, np.zeros((n - len(rows), n))])
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)


def stepped(triangle: FloatArray, back: FloatArray, noise: FloatArray, rows: FloatArray) -> FloatArray:
    """The triangle after one step, joined with the rows that speak of the errors after it.

    triangle: (n, n) before.   back: (moving, n), noise: (moving, noises), of motion.py.   rows: (M, n).
    """
    moving, n = back.shape
    noises = noise.shape[1]
    stack = np.zeros((noises + n + len(rows), noises + n))
    stack[:noises, :noises] = np.eye(noises)
    carried = stack[noises : noises + n]
    carried[:, :noises] = triangle[:, :moving] @ noise
    carried[:, noises:] = triangle[:, :moving] @ back
    carried[:, noises + moving :] += triangle[:, moving:]
    stack[noises + n :, noises:] = rows
    return triangle_of(stack)[noises:, noises:]


def covariance_of_last(triangle: FloatArray, count: int) -> FloatArray:
    """Covariance of the last `count` unknowns, all others eliminated; infinite where nothing determines them."""
    mine = triangle[-count:, -count:]
    try:
        root = np.linalg.inv(mine)
    except np.linalg.LinAlgError:
        return np.full((count, count), np.inf)
    covariance: FloatArray = root @ root.T
    return covariance
