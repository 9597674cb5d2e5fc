"""When planes keep away from what stands beside them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.factors.lidar_plane import Gate, LidarNoise
from calib_core.factors.support import ExtentSurvey
from calib_core.full.joint import association


@pytest.mark.parametrize(
    ("normals", "keeps_away"),
    [
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], False),
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], True),
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.6, 0.8, 0.0]], True),
    ],
)
def test_planes_keep_away_from_what_stands_beside_them_where_they_leave_a_way_open(
    normals: list[list[float]], keeps_away: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Seen: of twelve choices of two walls each, in simulated rooms, the mean square of the errors was twice what is stated.
    Mutations: never; always, which costs a furnished room half of its points."""
    asked: list[bool] = []
    monkeypatch.setattr(ExtentSurvey, "finish", lambda _self, _within, *, aloof: asked.append(aloof))
    monkeypatch.setattr(association, "over_batches", lambda *_: [])
    view: Any = SimpleNamespace(estimate=SimpleNamespace(normals=np.array(normals)))
    association.survey(view, [], LidarNoise(0.01, 0.001), Gate(), stride=1)
    assert asked == [keeps_away]
