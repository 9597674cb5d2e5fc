"""What planes are called: by where they face, numbered together where they were found together."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.plane_kinds import Kind, called, next_name
from calib_core.types import Plane

UP = np.array([0.0, 0.0, 1.0])
EAST, NORTH = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def _plain(*normals: np.ndarray) -> list[Plane]:
    return [Plane(f"plane {k + 1}", normal, 1.0) for k, normal in enumerate(normals)]


def test_planes_are_called_what_they_are() -> None:
    """Mutations: up the other way; numbered where there is one; later ones renumber those that inspect has named."""
    planes = _plain(EAST, UP, -EAST, -UP, NORTH, UP)
    assert [p.name for p in called(planes, UP, 4)] == ["wall 1", "floor", "wall 2", "ceiling", "wall 3", "floor 2"]
    assert [p.name for p in called(planes, UP, 6)] == ["wall 1", "floor 1", "wall 2", "ceiling", "wall 3", "floor 2"]


def test_a_name_that_a_person_gave_stays() -> None:
    """Mutation: all renamed."""
    planes = [*_plain(EAST, UP), Plane("my ramp", np.array([0.6, 0.0, 0.8]), 1.0)]
    assert [p.name for p in called(planes, UP, 3)] == ["wall", "floor", "my ramp"]


def test_what_comes_into_view_takes_no_name_that_a_person_gave() -> None:
    """Mutation: numbered on from the kinds alone: two planes of one name."""
    planes = [Plane("wall 2", EAST, 1.0), *_plain(UP, NORTH)]
    assert [p.name for p in called(planes, UP, 2)] == ["wall 2", "floor", "wall 3"]


@pytest.mark.parametrize(
    ("kind", "taken", "name"),
    [
        ("wall", [], "wall"),
        ("wall", ["wall"], "wall 2"),
        ("wall", ["wall 1", "wall 2", "floor"], "wall 3"),
        ("slanted", ["wall 1"], "slope"),
        ("plane", ["plane 1"], "plane 2"),
        ("plane", [], "plane 1"),
    ],
)
def test_one_more_of_a_kind_takes_the_next_number(kind: Kind, taken: list[str], name: str) -> None:
    """Mutation: a name that is taken."""
    assert next_name(kind, taken) == name
