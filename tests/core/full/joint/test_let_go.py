"""A whole solve, watched: points and what was gathered of them are there once, not once for each frame that has held them."""

from __future__ import annotations

import weakref
from typing import Any

import pytest

from calib_core.calibrate import calibrate
from calib_core.full.joint import alternation
from calib_core.full.joint.moments import Micro
from calib_core.full.joint.problem import JointProblem
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import Recording


def test_nothing_of_the_points_of_one_round_is_there_in_the_next(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Seen: five copies of a lidar's points and two of their equations, half of a long recording's memory.

    Mutations: the stillest state with its points; a caller that holds on to the state it gave away; the problem of one descent
    held while the next is made.
    """
    points: list[weakref.ref[Micro]] = []
    problems: list[weakref.ref[JointProblem]] = []
    alive: list[tuple[str, int, int]] = []
    associate, descend = alternation.associate, alternation.descend

    def count(step: str) -> None:
        alive.append((step, sum(each() is not None for each in points), sum(each() is not None for each in problems)))

    def given(*rest: Any, **more: Any) -> Any:
        count("points given")
        state = associate(*rest, **more)
        assert state.observations is not None
        points.append(weakref.ref(state.observations))
        return state

    def descended(*rest: Any, **more: Any) -> Any:
        count("descent")
        state, problem = descend(*rest, **more)
        problems.append(weakref.ref(problem))
        return state, problem

    monkeypatch.setattr(alternation, "associate", given)
    monkeypatch.setattr(alternation, "descend", descended)
    calibrate(noisy[0], CalibrateSettings(crispness=False))
    assert len(points) >= 3
    assert len(problems) > len(points)
    # Points given anew: none of before. A descent: those that it is about. No problem but the one that is made.
    assert set(alive) == {("points given", 0, 0), ("descent", 1, 0)}
