"""Stretches of time that contradict each other make an answer weak, however narrow its error bars are."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.full.assess.confidence import is_torn
from calib_core.full.assess.disagreement import Disagreement


@pytest.mark.parametrize(
    ("name", "ratio", "excess", "torn"),
    [("time", 8.4, 1.0, True), ("time", 4.9, 1.0, False), ("surfaces", 9.2, 1.0, False), ("time", 8.4, 0.0, False)],
)
def test_time_that_contradicts_itself(name: str, ratio: float, excess: float, torn: bool) -> None:
    """Mutations: places on bent walls, too; whatever the ratio; what is within what noise allows."""
    calm = Disagreement("range", 1.1, np.zeros((7, 7)))
    assert is_torn([calm, Disagreement(name, ratio, excess * np.eye(7))]) is torn
