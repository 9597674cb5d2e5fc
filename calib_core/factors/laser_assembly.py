"""What the lidar's own parameters add to a cost and to an arrow system, cluster by cluster, compiled.

The clusters' moments come of factors/laser_kernels.py. Each loop has a NumPy twin in the tests.
"""

from __future__ import annotations

import numba
import numpy as np

from calib_core.factors.laser_kernels import (
    COLUMNS,
    OF_COLUMN,
    SIGN,
    Clusters,
    add_moved,
    rows_before,
    vector_before,
)
from calib_core.types import BoolArray, Float32Array, FloatArray, IntArray

#: Columns of a bin's Jacobian but for the clocks' rate (factors/planes_seen.py).
COLUMNS_SEEN = 19


@numba.njit(cache=True, nogil=True, error_model="numpy")
def features_crossed_kernel(c: Clusters, a: FloatArray, change: FloatArray, crossed: FloatArray) -> None:
    """Fills crossed (B,) with sum w (f . change) (y . a) of each cluster. a: (Q, 5) of the bins.   change: (L, F)."""
    seen, of_bin, of_pose = np.empty(5), -1, -1
    for b in range(c.bins.shape[0]):
        q, t, j = c.bins[b], c.pose[b], c.laser[b]
        if q != of_bin or t != of_pose:
            vector_before(c, t, a[q], seen)
            of_bin, of_pose = q, t
        total = 0.0
        for f in range(c.cross.shape[1]):
            moved = change[j, f]
            if moved != 0.0:
                value = 0.0
                for i in range(5):
                    value += c.cross[b, f, i] * seen[i]
                total += moved * value
        crossed[b] = total


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_features_kernel(
    clusters: Clusters,
    knot: IntArray,
    plane: IntArray,
    J: FloatArray,
    a: FloatArray,
    column_of: IntArray,
    change: FloatArray,
    planes_start: int,
    clock_column: int,
    gradient: FloatArray,
    border: FloatArray,
    corner: FloatArray,
    gradient_shared: FloatArray,
) -> None:
    """Adds what the lidar's parameters share with everything to an arrow system, cluster by cluster.

    knot, plane: (Q,) of the bins.   J: (Q, 4, 19 or 20), a: (Q, 5) of the bins.   column_of: (L, 14) shared columns, -1 for
    none.   change: (L, F) of the features' coefficients since the clusters were made.   gradient: (K, 9).

    What all clusters of a bin, of one pose, say of one column is the same four numbers times the bin's J. They are laid side by
    side first, a row for each of the four: what is then multiplied runs along memory, through stretches of columns that any
    cluster touches.
    """
    width, size = J.shape[2], corner.shape[0]
    start, end = _between_columns(column_of, size)
    columns = end - start
    moments, touched = np.zeros((5, columns)), np.zeros(columns, np.bool_)
    begins, ends, u = np.empty(columns + 1, np.int64), np.empty(columns + 1, np.int64), np.empty(4)
    # What all bins, or those of a plane, say of shared columns is summed up by itself, and put in place once.
    common = np.zeros((COLUMNS_SEEN - 11, columns))
    by_plane = np.zeros((3 * (plane.max() + 1 if plane.shape[0] > 0 else 0), columns))
    force = np.zeros(columns)
    bins, pose = clusters.bins, clusters.pose
    by, seen = np.empty((4, width)), np.empty(5)
    b, last = 0, bins.shape[0]
    while b < last:
        q, t = bins[b], pose[b]
        k, at_plane = knot[q], 3 * plane[q]
        u[:] = 0.0
        while b < last and bins[b] == q and pose[b] == t:
            _lay_beside(clusters.cross, b, column_of, change, clusters.laser[b], start, moments, touched, u)
            b += 1
        rows_before(clusters, t, J[q], by)
        vector_before(clusters, t, a[q], seen)
        for i in range(width):
            pull = by[0, i] * u[0] + by[1, i] * u[1] + by[2, i] * u[2] + by[3, i] * u[3]
            if i < 9:
                gradient[k, i] += pull
            elif i < 16:
                gradient_shared[i - 9] += pull
            else:
                gradient_shared[planes_start + at_plane + i - 16 if i < COLUMNS_SEEN else clock_column] += pull
        for s in range(_runs(touched, begins, ends)):
            begin, stop = begins[s], ends[s]
            m0, m1, m2, m3, m4 = (
                moments[0, begin:stop], moments[1, begin:stop], moments[2, begin:stop], moments[3, begin:stop],
                moments[4, begin:stop],
            )  # fmt: skip
            for i in range(width):
                if i < 9:
                    row = border[k, i, start + begin : start + stop]
                elif 16 <= i < COLUMNS_SEEN:
                    row = by_plane[at_plane + i - 16, begin:stop]
                else:
                    row = common[i - 9 if i < 16 else 7, begin:stop]
                _add_product(row, by[0, i], by[1, i], by[2, i], by[3, i], m0, m1, m2, m3)
            _add_product(force[begin:stop], seen[0], seen[1], seen[2], seen[3], m0, m1, m2, m3)
            _end_run(force[begin:stop], seen[4], m0, m1, m2, m3, m4, touched[begin:stop])
    for c in range(columns):
        gradient_shared[start + c] += force[c]
    for at in range(common.shape[0] if width > COLUMNS_SEEN else 7):
        _put_beside(at if at < 7 else clock_column, common, at, start, corner)
    for at in range(by_plane.shape[0]):
        _put_beside(planes_start + at, by_plane, at, start, corner)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def features_times_kernel(c: Clusters, response: FloatArray, crossed: FloatArray) -> None:
    """Adds to crossed (Q, 4, m) what clusters pull their bins by where the lasers' features follow `response` (L, F, m)."""
    pull = np.empty(4)
    for b in range(c.bins.shape[0]):
        q, j = c.bins[b], c.laser[b]
        for s in range(response.shape[2]):
            pull[:] = 0.0
            for f in range(c.cross.shape[1]):
                moved = response[j, f, s]
                if moved != 0.0:
                    for i in range(4):
                        pull[i] += moved * c.cross[b, f, i]
            add_moved(c, c.pose[b], pull, crossed[q, :, s])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def features_pull_kernel(
    c: Clusters, a: FloatArray, column_of: IntArray, change: FloatArray, u: FloatArray, gradient_shared: FloatArray
) -> None:
    """The gradient alone of `add_features_kernel`: adds to u (Q, 4), which times a bin's J is its own, and of lasers' columns."""
    seen, pull, of_bin, of_pose = np.empty(5), np.empty(4), -1, -1
    for b in range(c.bins.shape[0]):
        q, t, j = c.bins[b], c.pose[b], c.laser[b]
        if q != of_bin or t != of_pose:
            vector_before(c, t, a[q], seen)
            of_bin, of_pose = q, t
        pull[:] = 0.0
        for f in range(c.cross.shape[1]):
            moved = change[j, f]
            if moved != 0.0:
                for i in range(4):
                    pull[i] += moved * c.cross[b, f, i]
        add_moved(c, t, pull, u[q])
        for column_at in range(COLUMNS):
            column = column_of[j, column_at]
            if column >= 0:
                f, value = OF_COLUMN[column_at], 0.0
                for i in range(5):
                    value += c.cross[b, f, i] * seen[i]
                gradient_shared[column] += SIGN[column_at] * value


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _between_columns(column_of: IntArray, size: int) -> tuple[int, int]:
    """The first of the columns that any laser has, and one beyond the last. size: of all shared ones."""
    start, end = size, 0
    for j in range(column_of.shape[0]):
        for t in range(column_of.shape[1]):
            if column_of[j, t] >= 0:
                start, end = min(start, column_of[j, t]), max(end, column_of[j, t] + 1)
    return min(start, end), end


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _add_product(
    row: FloatArray,
    j0: float,
    j1: float,
    j2: float,
    j3: float,
    m0: FloatArray,
    m1: FloatArray,
    m2: FloatArray,
    m3: FloatArray,
) -> None:
    """Adds a combination of four rows (C,) to one. Each in memory by itself: then a processor does several at a time."""
    for c in range(row.shape[0]):
        row[c] += j0 * m0[c] + j1 * m1[c] + j2 * m2[c] + j3 * m3[c]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _end_run(
    force: FloatArray,
    a4: float,
    m0: FloatArray,
    m1: FloatArray,
    m2: FloatArray,
    m3: FloatArray,
    m4: FloatArray,
    touched: BoolArray,
) -> None:
    """Adds a4 times the fifth row to force (C,), and makes room for the next bin."""
    for c in range(force.shape[0]):
        force[c] += a4 * m4[c]
        m0[c] = m1[c] = m2[c] = m3[c] = m4[c] = 0.0
        touched[c] = False


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _lay_beside(
    cross: Float32Array,
    b: int,
    column_of: IntArray,
    change: FloatArray,
    j: int,
    start: int,
    moments: FloatArray,
    touched: BoolArray,
    u: FloatArray,
) -> None:
    """Adds cluster b of laser j to moments (5, C) by column, counted from `start`, and to u (4,) as the lasers have changed."""
    for f in range(cross.shape[1]):
        moved = change[j, f]
        if moved != 0.0:
            for c in range(4):
                u[c] += moved * cross[b, f, c]
    for t in range(COLUMNS):
        column = column_of[j, t] - start
        if column >= 0:
            touched[column] = True
            f, sign = OF_COLUMN[t], SIGN[t]
            for c in range(5):
                moments[c, column] += sign * cross[b, f, c]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _runs(touched: BoolArray, begins: IntArray, ends: IntArray) -> int:
    """Fills begins and ends with the stretches of columns that are touched, and nothing between: others fill those meanwhile."""
    runs, before = 0, False
    for c in range(touched.shape[0]):
        if touched[c] and not before:
            begins[runs] = c
        if before and not touched[c]:
            ends[runs] = c
            runs += 1
        before = touched[c]
    if before:
        ends[runs] = touched.shape[0]
        runs += 1
    return runs


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _put_beside(row: int, sums: FloatArray, of: int, start: int, corner: FloatArray) -> None:
    """Adds one row of sums (R, C) to a row and a column of the corner, the columns counted from `start`."""
    for c in range(sums.shape[1]):
        corner[row, start + c] += sums[of, c]
        corner[start + c, row] += sums[of, c]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_grams_kernel(
    grams: FloatArray,
    laser: IntArray,
    column_of: IntArray,
    change: FloatArray,
    corner: FloatArray,
    gradient_shared: FloatArray,
) -> None:
    """Adds what the lidar's parameters share with one another. grams: (G, F, F), laser: (G,); others: add_features_kernel."""
    for g in range(grams.shape[0]):
        j = laser[g]
        for t in range(COLUMNS):
            column, f, sign = column_of[j, t], OF_COLUMN[t], SIGN[t]
            if column < 0:
                continue
            for e in range(grams.shape[2]):
                gradient_shared[column] += sign * grams[g, f, e] * change[j, e]
            for o in range(COLUMNS):
                other = column_of[j, o]
                if other >= 0:
                    corner[column, other] += sign * SIGN[o] * grams[g, f, OF_COLUMN[o]]
