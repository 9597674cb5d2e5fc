"""The first view of a room, an attic and a rosette, from the recording to the camera, held against the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from app.scene.items import Label
from bench.first_views import aside_rad, draw, is_below, look


@pytest.mark.parametrize("slug", ["paper-normal", "attic", "livox"])
def test_the_first_view_is_the_room_upright(slug: str, tmp_path: Path) -> None:
    """Oracle: the simulator's planes. Mutation: the doctor's vertical turned over."""
    view = look(slug, tmp_path, duration_s=5.0)
    assert view.faults == []
    assert sum(isinstance(item, Label) for item in view.content.items) >= 3
    colours = draw(view).getcolors(maxcolors=2**24)
    assert colours is not None
    assert len(colours) > 10


def test_a_floor_seen_above_what_stands_on_it_is_found_out() -> None:
    """By hand: a floor with a post on it. Mutation: rows compared the other way round."""
    floor = np.array([0.0, 0.0, 1.0, 0.0])
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.1, 1.0], [5.0, 0.0, 1.0]])
    assert is_below(points, np.array([200.0, 100.0, 300.0]), floor) is True
    assert is_below(points, np.array([100.0, 200.0, 0.0]), floor) is False
    assert is_below(points[:1], np.zeros(1), floor) is None


def test_what_lies_between_two_rings_was_seen_and_what_lies_aside_was_not() -> None:
    """By hand, seen from the origin. Mutations: degrees for radians; the chord for its half."""
    rings = np.array([[10.0, 0.0, 0.0], [20.0, 0.0, 0.0], [0.0, 1.0, 0.0]], np.float32)
    asked = np.array([[15.0, 0.0, 0.0], [10.0, 10.0 * np.tan(0.05), 0.0], [-3.0, 0.0, 0.0]])
    np.testing.assert_allclose(aside_rad(asked, rings), [0.0, 0.05, np.pi / 2], atol=1e-6)
