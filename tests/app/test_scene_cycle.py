"""Clicks on planes that lie behind each other."""

from __future__ import annotations

import numpy as np

from app.scene.cycle import Cycle, pierced
from app.scene.items import Sheet

EYE, AHEAD = np.zeros(3), np.array([1.0, 0.0, 0.0])


def wall(patch: int | None, x_m: float, *, half_m: float = 1.0) -> Sheet:
    """A square of two triangles across the view, so far away."""
    corners = [[x_m, y, z] for y, z in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    vertices = (np.array(corners) * [1.0, half_m, half_m]).astype(np.float32)
    return Sheet(f"/{x_m}", vertices, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32), (0, 0, 0), 0.3, patch=patch)


def test_a_ray_meets_the_sheets_in_its_way_nearest_first() -> None:
    """Oracle: squares at known distances. Mutations: no sorting; what is behind the eye counted; u + v not limited."""
    sheets = [wall(7, 4.0), wall(3, 2.0), wall(5, -1.0), wall(None, 1.0), wall(9, 3.0, half_m=0.1)]
    assert pierced(sheets, EYE, 5.0 * AHEAD) == [3, 9, 7]
    assert pierced(sheets, EYE, np.array([1.0, 0.2, 0.0])) == [3, 7]
    assert pierced(sheets, EYE, np.array([1.0, 0.9, 0.9])) == []
    assert pierced(sheets, EYE, np.array([0.0, 1.0, 0.0])) == []  # along all of them


def test_the_same_place_clicked_again_means_the_next_one_behind() -> None:
    """Toggled: 3; 3 back and 9; 9 back and 7; 7 back; 3. Mutation: the one before is not put right."""
    cycle = Cycle()
    assert [cycle.click(3, [3, 9, 7], EYE, AHEAD) for _ in range(5)] == [[3], [3, 9], [9, 7], [7], [3]]


def test_another_place_or_another_eye_begins_anew() -> None:
    """Mutations: rays not compared; eyes not compared; a lone sheet cycles with itself."""
    cycle = Cycle()
    assert cycle.click(3, [3, 9], EYE, AHEAD) == [3]
    assert cycle.click(3, [3, 9], EYE, np.array([1.0, 0.05, 0.0])) == [3]
    assert cycle.click(3, [3, 9], EYE + 0.1, np.array([1.0, 0.05, 0.0])) == [3]
    assert cycle.click(4, [4], EYE, AHEAD) == [4]
    assert cycle.click(4, [4], EYE, AHEAD) == [4]
    assert cycle.click(8, [4, 5], EYE, AHEAD) == [8]  # the browser's word counts
