"""The surface of a solved room on disk."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.storage.atomic import whole_file
from calib_core.types import Float32Array

#: In the folder of its solve.
SURFACE = "surface.npz"


@dataclass(frozen=True)
class Surface:
    """Triangles, map frame. vertices_m: (V, 3).   faces: (T, 3) indices."""

    vertices_m: Float32Array
    faces: NDArray[np.uint32]


def write_surface(path: Path, surface: Surface) -> None:
    """Write the surface to `path` (.npz), whole or not at all."""
    with whole_file(path) as fresh:
        np.savez(fresh, vertices_m=surface.vertices_m, faces=surface.faces)


def read_surface(path: Path) -> Surface:
    """The surface as it was written."""
    with np.load(path, allow_pickle=False) as arrays:
        return Surface(arrays["vertices_m"].astype(np.float32), arrays["faces"].astype(np.uint32))
