"""The part of a plane that was seen, as cells: what is drawn is what is used, without the slabs that strays pull out.

The plane's points are counted in square cells that stand upright in the room. A cell with hardly any point is stray; gaps
between the rings of a lidar are closed; islands far smaller than the whole are dropped. What is left is drawn as strips of
cells with its outline.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib_core.types import BoolArray, Float32Array, FloatArray

#: Cells along the larger side of a patch, and the sizes [m] between which they stay.
CELLS = 48
SMALLEST_M, LARGEST_M = 0.06, 0.5
#: A cell with fewer than this share of the median cell's points is stray.
STRAY_SHARE = 0.15
#: Gaps up to twice so many cells are closed: rings of a sixteen-beam lidar stand that far apart on a ceiling.
CLOSED_CELLS = 4
#: Islands below this share of the largest are dropped.
ISLAND_SHARE = 0.06
#: Each cell is drawn as so many, both ways, so that an outline that runs aslant is no staircase.
FINER = 3
#: Points that a patch's support is found from.
MOST_POINTS = 12_000


@dataclass(frozen=True, eq=False)
class Support:
    """vertices: (4 S, 3), the corners of S strips.   faces: (2 S, 3).   edges: (E, 2, 3), the outline.   middle: (3,)."""

    vertices: Float32Array
    faces: NDArray[np.uint32]
    edges: Float32Array
    middle: FloatArray


def support_of(points_m: Float32Array, plane: FloatArray, up: FloatArray) -> Support | None:
    """The support of points (N, 3) on a plane (n, w); None where too little is left. up: (3,)."""
    if len(points_m) < 3:
        return None
    points = points_m[:: max(1, len(points_m) // MOST_POINTS)].astype(np.float64)
    axes = _axes(plane[:3], up)
    flat = points @ axes.T
    low, high = np.percentile(flat, [0.5, 99.5], axis=0)
    cell_m = float(np.clip((high - low).max() / CELLS, SMALLEST_M, LARGEST_M))
    seen = _seen(flat, low, high, cell_m)
    if not seen.any():
        return None
    origin = low - (CLOSED_CELLS + 1) * cell_m
    seen, cell_m = _smooth(seen), cell_m / FINER
    corners, faces = _strips(seen)
    middle = origin + (np.argwhere(seen).mean(axis=0) + 0.5) * cell_m

    def lifted(cells: NDArray[np.float64]) -> FloatArray:
        in_space: FloatArray = (origin + cells * cell_m) @ axes - plane[3] * plane[:3]
        return in_space

    return Support(
        lifted(corners).astype(np.float32),
        faces,
        lifted(_outline(seen)).astype(np.float32),
        middle @ axes - plane[3] * plane[:3],
    )


def _smooth(seen: BoolArray) -> BoolArray:
    """The cells in finer ones, their stairs rounded off."""
    from scipy import ndimage

    finer = np.kron(seen, np.ones((FINER, FINER)))
    smooth: BoolArray = ndimage.gaussian_filter(finer, sigma=0.9 * FINER) > 0.5
    return smooth


def _axes(normal: FloatArray, up: FloatArray) -> FloatArray:
    """(2, 3) directions along the plane: level, and as upright as it gets."""
    level = np.cross(up, normal)
    if np.linalg.norm(level) < 0.1:  # a floor: along whatever axis lies in it best
        level = np.cross(np.eye(3)[int(np.abs(normal).argmin())], normal)
    level = level / np.linalg.norm(level)
    return np.stack([level, np.cross(normal, level)])


def _seen(flat: FloatArray, low: FloatArray, high: FloatArray, cell_m: float) -> BoolArray:
    """Which cells are the plane's, with room around them."""
    from scipy import ndimage

    margin = CLOSED_CELLS + 1
    shape = np.ceil((high - low) / cell_m).astype(int) + 1 + 2 * margin
    cells = np.floor((flat - low) / cell_m).astype(int) + margin
    cells = cells[((cells >= 0) & (cells < shape)).all(axis=1)]
    counts = np.zeros(shape, dtype=np.int64)
    np.add.at(counts, tuple(cells.T), 1)
    filled = counts > STRAY_SHARE * np.median(counts[counts > 0])
    disk = np.hypot(*np.mgrid[-CLOSED_CELLS : CLOSED_CELLS + 1, -CLOSED_CELLS : CLOSED_CELLS + 1]) <= CLOSED_CELLS + 0.5
    closed = ndimage.binary_closing(filled, structure=disk)
    islands, count = ndimage.label(closed)
    if count < 2:
        seen: BoolArray = closed
        return seen
    points_on = ndimage.sum_labels(counts, islands, np.arange(1, count + 1))
    large: BoolArray = np.isin(islands, 1 + np.flatnonzero(points_on >= ISLAND_SHARE * points_on.max()))
    return large


def _strips(seen: BoolArray) -> tuple[NDArray[np.float64], NDArray[np.uint32]]:
    """Corners (4 S, 2) in cells and faces (2 S, 3) of the strips that neighbouring cells of a row make."""
    steps = np.diff(np.pad(seen, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, first = np.nonzero(steps == 1)
    _, last = np.nonzero(steps == -1)
    corners = np.stack(
        [np.stack([row, first]), np.stack([row + 1, first]), np.stack([row + 1, last]), np.stack([row, last])]
    )
    base = 4 * np.arange(len(row))[:, None]
    faces = np.concatenate([base + np.array([0, 1, 2]), base + np.array([0, 2, 3])])
    return corners.transpose(2, 0, 1).reshape(-1, 2).astype(np.float64), faces.astype(np.uint32)


def _outline(seen: BoolArray) -> NDArray[np.float64]:
    """(E, 2, 2) the edges between cells that are seen and cells that are not, in cells."""
    edges: list[NDArray[np.int64]] = []
    for axis in (0, 1):
        at = np.argwhere(np.diff(seen.astype(np.int8), axis=axis) != 0)
        start = at.copy()
        start[:, axis] += 1
        end = start.copy()
        end[:, 1 - axis] += 1
        edges.append(np.stack([start, end], axis=1))
    return np.concatenate(edges).astype(np.float64)
