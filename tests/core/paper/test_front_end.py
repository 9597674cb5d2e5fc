"""Points and their planes, scan by scan."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.paper.front_end import _seen_from, _View
from calib_core.planes.segment import PlaneFit
from calib_core.types import Plane


def test_a_maps_plane_is_seen_from_where_a_scan_was_taken() -> None:
    """Points put on it and beside it in the map, then looked at from the scan's pose.

    Mutations: R for its transpose; the position left out; the band of the least instead of the scan's own.
    """
    rng = np.random.default_rng(0)
    normal, offset_m = np.array([0.6, 0.0, 0.8]), 1.5
    R, p = Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix(), np.array([0.3, -0.2, 0.5])
    on = rng.uniform(-3.0, 3.0, (60, 3))
    on -= np.outer(on @ normal + offset_m, normal)
    away_m = np.repeat([0.0, 0.05, -0.07], 20)
    points = (on + np.outer(away_m, normal) - p) @ R
    own = PlaneFit(
        np.array([0.0, 0.0, 1.0]), 0.0, np.zeros(60, bool), 0.02
    )  # a scan's own fit may be anything: 3 rms are 6 cm
    found = _seen_from(Plane("wall", normal, offset_m), R, p, own, _View(points, np.zeros(60)))
    np.testing.assert_allclose(points @ found.normal + found.offset_m, away_m, atol=1e-12)
    np.testing.assert_array_equal(found.inliers, np.abs(away_m) < 0.06)
    assert found.rms_m == pytest.approx(0.02)
