"""Axes within planes."""

from __future__ import annotations

import numpy as np

from calib_core.geometry import plane_axes


def test_plane_axes_are_a_right_handed_frame() -> None:
    """Fails when e1 and e2 change places, or e1 is not normalised."""
    normals = np.random.default_rng(6).normal(size=(4, 50, 3))
    normals[0, :6] = np.vstack([np.eye(3), -np.eye(3)])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    frame = np.concatenate([plane_axes(normals), normals[..., None, :]], axis=-2)
    np.testing.assert_allclose(frame @ np.swapaxes(frame, -1, -2), np.broadcast_to(np.eye(3), frame.shape), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(frame), 1.0)
