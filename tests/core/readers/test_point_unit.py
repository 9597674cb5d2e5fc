"""Clouds in another unit than metres are refused as that, before anything is cut off by range."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.errors import InputError
from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.point_unit import require_metres


def _cloud(ranges: list[float]) -> RawCloud:
    points = np.zeros(len(ranges), [("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
    points["x"], points["y"] = 0.6 * np.array(ranges), 0.8 * np.array(ranges)
    return RawCloud(0, 0, "lidar", points, len(ranges), 1)


@pytest.mark.parametrize(
    ("ranges", "words"),
    [
        ([2500.0, 3500.0, 9000.0], r"farther than 3,500 m, .* millimetres"),
        ([0.0025, 0.0035, 0.009], r"nearer than 0\.0035 m"),
    ],
)
def test_coordinates_that_are_no_metres_are_refused(ranges: list[float], words: str) -> None:
    """Mutations: either end left out; the two mixed up."""
    with pytest.raises(InputError, match=words) as refused:
        require_metres([_cloud(ranges)], "/points")
    assert refused.value.code == "points.unit"


def test_a_room_a_field_and_a_sky_pass() -> None:
    """What did not return is at the origin or not a number; a few points lie at infinity.

    Mutations: the mean for the median; zeros or what is no number counted.
    """
    require_metres([_cloud([1.0, 4.0, 9.0, 1e7])], "/points")
    require_metres([_cloud([0.0] * 9 + [float("nan")] * 9 + [80.0, 250.0])], "/points")
    require_metres([_cloud([0.0, float("nan")])], "/points")
    require_metres([], "/points")
