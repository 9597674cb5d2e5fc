"""What is said of the point under the pointer: the right one, where it is, and nothing where nothing is drawn."""

from __future__ import annotations

import re

import numpy as np
import pytest

from app.planes.state import suggested
from app.scene.build import build_planes
from app.scene.inspect import build_inspection
from app.scene.readout import Readout, lean, read_out
from tests.app.support import world
from tests.app.support.inspection import LOOK, MOTIONS, RECORDING, seen_from_above

#: Seen from 10 m above with 90 degrees and twice as wide as high: 40 m by 20 m at the ground.
CAMERA = seen_from_above()
NO_WALLS = np.zeros((0, 4))


def place_of(point_m: np.ndarray) -> tuple[float, float]:
    """Shares of the canvas at which the camera above sees a point, by similar triangles."""
    away = 10.0 - point_m[2]
    return 0.5 + point_m[0] / (4.0 * away), 0.5 - point_m[1] / (2.0 * away)


@pytest.mark.parametrize("place", [0, 1, 2])
def test_the_point_under_the_pointer_is_the_one_that_is_told(place: int) -> None:
    """Mutations: shares taken from the lower left; the canvas taken for square; the ray not turned into the scene."""
    points = np.array([[3.0, 1.0, 0.0], [-4.0, 2.0, 1.0], [1.0, -3.0, 2.0]], dtype=np.float32)
    readout = Readout(points, "point {}".format)
    assert read_out(readout, NO_WALLS, CAMERA, place_of(points[place])) == f"point {place}"
    assert read_out(readout, NO_WALLS, CAMERA, (0.9, 0.9)) == ""


def test_what_is_cut_away_is_looked_through() -> None:
    """A ceiling that the camera sees from behind is not drawn: the floor below it is told. Mutation: walls ignored."""
    floor, ceiling = np.array([[0.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 3.0]])
    readout = Readout(np.concatenate([floor, ceiling]).astype(np.float32), ["floor", "ceiling"].__getitem__)
    below = np.array([[0.0, 0.0, -1.0, 3.0]])  # its inner side is where z < 3
    assert read_out(readout, below, CAMERA, (0.5, 0.5)) == "floor"
    assert read_out(readout, -below, CAMERA, (0.5, 0.5)) == "ceiling"


def test_a_point_of_a_scan_is_told_with_its_laser_and_range() -> None:
    """Oracle: the scan's own records. Mutations: another point's record; the range of the map's origin; both clouds' facts
    in the wrong order."""
    content = build_inspection(RECORDING, LOOK, MOTIONS, None)
    assert content.readout is not None
    points = RECORDING.scans[LOOK.place].points
    half = len(content.readout.points_m) // 2
    assert half == len(points)
    for place in (0, half - 1, half, half + 100):
        point = points[place % half]
        told = content.readout.says(place)
        range_m = np.linalg.norm(point["xyz"])
        assert f"ring {point['ring']}, {range_m:.2f} m away, {point['offset_ns'] * 1e-6:.1f} ms into scan 6" in told
    assert re.match(r"[+−]?\d+ mm from ", content.readout.says(half))


def test_a_point_of_the_planes_is_told_with_its_plane_and_tilt() -> None:
    """Oracle: the planes that were proposed. Mutations: the place in the thinned cloud taken for that in the whole; the tilt
    from the horizontal told for all; the point's distance said of the plane."""
    proposals = world.make_proposals()
    planes = suggested(proposals)
    content = build_planes(proposals, planes, limit=len(proposals.cloud_m) // 3, up=np.array([0.0, 0.0, 1.0]))
    assert content.readout is not None
    normals = np.array([patch.normal for patch in planes.patches])
    offsets_m = np.array([patch.offset_m for patch in planes.patches])
    for place in range(0, len(content.readout.points_m), 97):
        told = content.readout.says(place)
        point = content.readout.points_m[place].astype(np.float64)
        owner = next((k for k, patch in enumerate(planes.patches) if told.startswith(f"{patch.name}: ")), None)
        assert f"this point is {np.linalg.norm(point):.2f} m from the lidar" in told
        if owner is not None:
            assert abs(normals[owner] @ point + offsets_m[owner]) < 0.15
            of_plane, of_point = told.split("; ")
            assert of_plane.endswith(f", {abs(offsets_m[owner]):.2f} m from the lidar")
            assert of_point.endswith(" mm from the plane")
            assert ("off level" in told) == (abs(normals[owner][2]) > 0.9)


def test_how_a_plane_stands_is_told_as_a_level_and_a_plumb_line_would() -> None:
    """Mutation: the normal's angle told for a wall."""
    up, tilt = np.array([0.0, 0.0, 1.0]), np.radians(2.0)
    assert lean(np.array([np.sin(tilt), 0.0, np.cos(tilt)]), up) == "2.0° off level"
    assert lean(np.array([-np.cos(tilt), 0.0, np.sin(tilt)]), up) == "2.0° off plumb"
