"""The first view of a room, an attic and a rosette, from the recording to the camera, held against the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from app.scene.items import Label
from bench.first_views import draw, is_below, look


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
