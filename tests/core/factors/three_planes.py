"""One scan of three planes, for tests of what points on planes say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from calib_core.factors.lidar_plane import (
    SLICE_S,
    SlicePoses,
)
from calib_core.types import Float32Array, FloatArray

NORMALS = np.array([[0.02, 0.01, 1.0], [1.0, 0.05, -0.03], [0.0, -1.0, 0.1]])
NORMALS /= np.linalg.norm(NORMALS, axis=1, keepdims=True)
OFFSETS_M = np.array([1.2, 2.5, 3.0])


@dataclass
class Scene:
    """One scan of three planes from a lidar that does not move within it, with range noise."""

    xyz: Float32Array
    offset_s: FloatArray
    poses: SlicePoses


def scanned(seed: int, *, noise_m: float = 0.02, slices: int = 3, n: int = 600) -> Scene:
    """The scene of a seed, which draws the pose and the rays; points that meet a plane at a grazing angle are left out."""
    rng = np.random.default_rng(seed)
    R, p = Rotation.from_rotvec(0.3 * rng.normal(size=3)).as_matrix(), 0.2 * rng.normal(size=3)
    ray = rng.normal(size=(n, 3))
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    cosine = ray @ (NORMALS @ R).T
    reach = np.where(cosine < -0.15, -(NORMALS @ p + OFFSETS_M) / np.minimum(cosine, -0.15), np.inf).min(axis=1)
    hit = np.isfinite(reach)
    xyz = (ray * (reach + noise_m * rng.normal(size=n))[:, None])[hit]
    still = np.zeros((slices, 3))
    poses = SlicePoses(
        np.repeat(R[None], slices, 0), np.repeat(p[None], slices, 0), still, still, np.ones(slices, bool)
    )
    return Scene(xyz.astype(np.float32), rng.uniform(0, slices * SLICE_S, hit.sum()), poses)
