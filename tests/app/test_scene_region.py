"""A rectangle on the screen as half-spaces of the scene."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.planes.geometry import within_region
from app.scene.camera import Camera
from app.scene.region import frustum_sides


@pytest.mark.parametrize("seed", range(5))
def test_points_inside_are_those_that_project_into_the_rectangle(seed):
    """Oracle: a pinhole projection of every point. Fails with width and height swapped; with the camera at the origin."""
    rng = np.random.default_rng(seed)
    camera_m, rotation = rng.normal(size=3) * 3, Rotation.random(random_state=seed).as_matrix()
    low, high = np.sort(rng.uniform(0.05, 0.95, (2, 2)), axis=0)
    fov_y_rad, aspect = 1.1, 1.7
    points = rng.uniform(-8, 8, (5000, 3)).astype(np.float32)
    camera = Camera(R_scene_camera=rotation, p_scene_camera=camera_m, fov_rad=fov_y_rad, aspect=aspect)
    sides = frustum_sides(camera, tuple(low), tuple(high))
    seen = (points.astype(np.float64) - camera_m) @ rotation
    focal = 0.5 / np.tan(fov_y_rad / 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        screen = seen[:, :2] / seen[:, 2:] * [focal / aspect, focal] + 0.5
    expected = (seen[:, 2] > 0) & (screen >= low).all(axis=1) & (screen <= high).all(axis=1)
    found = within_region(points, [tuple(side) for side in sides.tolist()])
    assert expected.sum() > 0
    np.testing.assert_array_equal(found, expected)


def test_a_slipped_click_is_no_rectangle():
    """Fails without the least size: a click in this mode would cut the planes to nothing."""
    camera = Camera(R_scene_camera=np.eye(3), p_scene_camera=np.zeros(3), fov_rad=1.0, aspect=1.0)
    assert frustum_sides(camera, (0.5, 0.2), (0.505, 0.9)) is None
