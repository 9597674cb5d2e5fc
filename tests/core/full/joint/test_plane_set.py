"""Which planes are none, from numbers made by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.full.assess.residuals import misfit, plane_misfit
from calib_core.full.joint.plane_set import kept_planes, over_usual


def test_the_usual_is_what_half_of_the_points_are() -> None:
    """Fails when the middle plane counts instead of the middle point: three bushes would outvote two walls."""
    badness = np.array([0.5, 0.6, 5.0, 6.0, 7.0])
    points = np.array([900.0, 800.0, 50.0, 40.0, 30.0])
    assert over_usual(badness, points) == pytest.approx(badness / 0.6)


def test_three_planes_are_left_and_none_of_them_without_points() -> None:
    """Fails when everything is kept because two walls alone are beyond doubt, or a plane without points fills up."""
    points = np.array([900.0, 800.0, 0.0, 50.0, 40.0, 30.0])
    few = np.array([0.2, 0.3, 0.0, 4.0, 1.2, 9.0])
    assert kept_planes(few, points).tolist() == [True, True, False, False, True, False]
    enough = np.array([0.2, 0.3, 0.0, 0.9, 0.5, 9.0])
    assert kept_planes(enough, points).tolist() == [True, True, False, True, True, False]
    assert kept_planes(few[:3], points[:3]).tolist() == [True, True, False]


def test_a_plane_wanders_by_its_bins_averages() -> None:
    """Fails when distances are summed before they are squared (a wandering plane has mean zero), or bins go by points.

    Two planes of two bins each. A bin of n points of weight 1 at distance d has scatter[3, 3] = n, scatter[3, 4] = n d.
    """
    away = np.array([0.01, -0.01, 0.3, -0.3])
    count = np.array([400.0, 100.0, 100.0, 100.0])
    scatter = np.zeros((4, 5, 5))
    scatter[:, 3, 3] = count
    scatter[:, 3, 4] = count * away
    seen = np.zeros((4, 5))
    seen[:, 4] = 1.0
    bins = SimpleNamespace(scatter=scatter, plane=np.array([0, 0, 1, 1]))
    problem: Any = SimpleNamespace(bins=bins, planes_seen=lambda _: (seen, {}))
    estimate: Any = SimpleNamespace(normals=np.eye(3)[:2])
    found = plane_misfit(problem, estimate)
    assert found == pytest.approx([(0.04 + 0.01) / 2, 9.0])
    assert misfit(problem, estimate) == pytest.approx(found.mean())
