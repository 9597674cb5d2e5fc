"""Records as they come: what is shared is not written to."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.types import POINT_DTYPE, Scan


def test_points_are_read_whether_they_are_kept_in_memory_or_in_a_file() -> None:
    """One kind of array, so that a loop is compiled once; and no copy. Mutations: left as they come; whose array it is cannot
    write to it either.
    """
    points = np.zeros(5, POINT_DTYPE)
    scan = Scan(0, 0, points)
    assert not scan.points.flags.writeable
    assert not scan.points["xyz"].flags.writeable
    with pytest.raises(ValueError, match="read-only"):
        scan.points["ring"] = 1
    points["ring"] = 7
    assert (scan.points["ring"] == 7).all()
    assert Scan(0, 0, scan.points).points is scan.points
