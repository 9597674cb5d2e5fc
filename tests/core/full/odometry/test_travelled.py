"""How far the lidar came, and what is refused where it came nowhere."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.errors import Refused
from calib_core.full.odometry.travelled import require_motion
from calib_core.geometry import exp


def motions(count: int, *, turn_deg: float = 0.0, move_m: float = 0.0) -> Any:
    """Scans in a row, the middle one turned and moved by so much."""
    shares = np.eye(count)[count // 2]
    turn = np.radians(turn_deg) * np.array([0.6, 0.0, 0.8])
    return [SimpleNamespace(R=exp(share * turn), p=np.array([0.0, share * move_m, 0.0])) for share in shares]


@pytest.mark.parametrize(("followed", "code"), [(50, "motion.none"), (49, "planes.lost")])
def test_a_lidar_that_stood_is_told_from_one_that_was_lost(followed: int, code: str) -> None:
    """Of a hundred scans. Mutations: one code for both; the share counted the other way; the last scan alone is asked."""
    with pytest.raises(Refused) as refusal:
        require_motion(motions(followed, turn_deg=0.9, move_m=0.04), 100)
    assert refusal.value.code == code
    require_motion(motions(followed, turn_deg=1.1), 100)
    require_motion(motions(followed, move_m=0.06), 100)
