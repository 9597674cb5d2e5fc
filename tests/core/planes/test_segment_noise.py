"""Clouds that hold no plane."""

from __future__ import annotations

import numpy as np

from calib_core.planes.segment import segment_planes
from calib_core.types import FloatArray

#: Elevations of a 16-beam lidar.
_RINGS_RAD = np.radians(np.arange(-15.0, 16.0, 2.0))


def _rings(radius_m: FloatArray) -> FloatArray:
    """Returns of a 16-beam lidar at the given ranges. radius_m: (16, A)."""
    azimuth = np.linspace(-np.pi, np.pi, radius_m.shape[1], endpoint=False)
    level = np.cos(_RINGS_RAD)[:, None]
    direction = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(_RINGS_RAD)[:, None] + 0 * azimuth])
    return np.moveaxis(direction * radius_m, 0, -1).reshape(-1, 3)


def test_rings_that_lie_on_no_plane_give_none() -> None:
    """Fails when `_is_surface` accepts everything: single rings lie in planes of their own, and pass for floors.

    A ragged wood, and points in no order at all.
    """
    rng = np.random.default_rng(1)
    wood = _rings(rng.uniform(2.0, 12.0, size=(16, 500)))
    fog = rng.uniform(-5.0, 5.0, size=(8000, 3))
    for cloud in (wood, fog):
        assert segment_planes(cloud) == []
