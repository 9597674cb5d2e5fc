"""What is said of two rooms. Oracle: by hand."""

from __future__ import annotations

import pytest

from calib_core.audit.crisp import _sentence
from calib_core.result import RoomCrispness


def room(entropy_nat: float, thickness_mm: float) -> RoomCrispness:
    return RoomCrispness(mean_entropy_nat=entropy_nat, thickness_std_m=1e-3 * thickness_mm, points=1000, cubes=100)


@pytest.mark.parametrize(
    ("given", "found", "begins"),
    [
        (room(-5.0, 20.31), room(-5.01, 19.80), "With the given extrinsic the room is blurrier, by 0.0100 nat"),
        (room(-5.01, 19.80), room(-5.0, 20.31), "With the given extrinsic the room is even crisper, by 0.0100 nat"),
        (room(-5.0, 19.81), room(-5.0004, 19.80), "The room looks the same with both"),
        (room(-5.0, 19.802), room(-5.0008, 19.798), "The room looks the same with both"),
    ],
)
def test_a_room_is_blurrier_where_its_surfaces_show_thicker(
    given: RoomCrispness, found: RoomCrispness, begins: str
) -> None:
    """Seen: "blurrier, by 0.0008 nat: 19.80 mm against 19.80". Mutations: by entropy alone; by thickness alone; turned round."""
    assert _sentence(given, found).startswith(begins)
