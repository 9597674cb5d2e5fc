"""Whether planes are one: a wall turned and moved about the limits, against angles and distances known beforehand."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.planes.same_plane import apart, same_place, same_points, same_surface

#: A wall at x = 2 m, seen from the origin, and the floor.
NORMALS, OFFSETS_M = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([2.0, 1.5])


def turned(angle_deg: float) -> np.ndarray:
    """The wall's normal turned about the vertical."""
    angle = np.radians(angle_deg)
    return np.array([-np.cos(angle), np.sin(angle), 0.0])


@pytest.mark.parametrize(
    ("angle_deg", "away_m", "same"), [(4.9, 0.0, True), (5.1, 0.0, False), (0.0, 0.09, True), (0.0, 0.11, False)]
)
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_patch_is_of_a_plane_within_both_limits(angle_deg: float, away_m: float, same: bool, side: float) -> None:
    """Far along the wall too: what counts is the patch's own place. Mutations: either limit left out; `abs` left out of the
    distance; the sine for the cosine; offsets compared instead of the place."""
    centre = np.array([2.0 + side * away_m, 7.0, 0.3])
    found = same_place(NORMALS, OFFSETS_M, turned(side * angle_deg), centre, within_deg=5.0, within_m=0.1)
    assert found.tolist() == [same, False]


def test_how_near_may_be_another_for_each_plane() -> None:
    """Mutation: the largest of the limits for all."""
    centre = np.array([2.3, 0.0, -1.5])
    normals, offsets_m = np.array([NORMALS[0], NORMALS[0]]), np.array([2.0, 2.0])
    found = same_place(normals, offsets_m, NORMALS[0], centre, within_deg=5.0, within_m=np.array([0.1, 0.4]))
    assert found.tolist() == [False, True]


def test_a_surface_seen_twice_is_told_from_the_wall_opposite_and_from_the_wall_behind() -> None:
    """Mutations: normals compared by size alone; rows for columns; the distance's limit left out."""
    others = np.array([turned(2.0), -NORMALS[0], NORMALS[0]]), np.array([2.05, 2.0, 2.2])
    found = same_surface(NORMALS, OFFSETS_M, others, within_deg=5.0, within_m=0.1)
    assert found.tolist() == [[True, False, False], [False, False, False]]


@pytest.mark.parametrize(
    ("angle_deg", "away_m", "same"), [(1.0, 0.0, True), (4.0, 0.0, False), (4.9, 0.07, False), (6.0, 0.0, False)]
)
def test_all_points_of_a_patch_are_asked_where_there_are_any(angle_deg: float, away_m: float, same: bool) -> None:
    """A patch 4 m wide about its own middle: turned by a, its points lie sin(a) 4 / sqrt(12) m off the wall, root mean square,
    0.08 m at 4 deg. The short one within 6 deg of it lies near the wall and faces another way.

    Mutations: its middle asked alone; the turn's limit left out; the mean for the root mean square.
    """
    wide = 4.0 if angle_deg < 5.0 else 0.4
    along = np.linspace(-0.5 * wide, 0.5 * wide, 401)
    angle = np.radians(angle_deg)
    points = np.stack([2.0 + away_m + np.sin(angle) * along, np.cos(angle) * along, np.zeros(401)], axis=1)
    off = apart(NORMALS, OFFSETS_M, points)
    assert off[0] == pytest.approx(np.hypot(away_m, np.sin(angle) * wide / np.sqrt(12.0)), rel=1e-2)
    found = same_points(NORMALS, turned(angle_deg), off, within_deg=5.0, within_m=0.07)
    assert found.tolist() == [same, False]
