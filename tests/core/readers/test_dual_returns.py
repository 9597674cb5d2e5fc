"""Returns that are there twice, and what only looks like it. The way through a bag is in traps.py."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.container.storage import RawMessage
from calib_core.readers.dual_returns import once_each, repeated
from calib_core.readers.timing.point_time import PointTiming
from calib_core.settings import ReadSettings

TIMING = PointTiming("t", "ns", "header-first", 0.0, 1e8)
DTYPE = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("t", "<u4")])


def _cloud(columns: int = 512, rings: int = 64, *, step_m: float = 0.0) -> RawCloud:
    """A turn among walls a metre away, column by column. step_m: coordinates are told in steps of this."""
    elevation, azimuth = np.meshgrid(np.linspace(-0.3, 0.3, rings), np.linspace(0.0, 6.28, columns, endpoint=False))
    points = np.zeros(columns * rings, DTYPE)
    for axis, values in zip("xyz", (np.cos(azimuth), np.sin(azimuth), np.tan(elevation)), strict=True):
        points[axis] = values.ravel() if step_m == 0.0 else np.round(values.ravel() / step_m) * step_m
    points["ring"], points["t"] = np.tile(np.arange(rings), columns), np.repeat(np.arange(columns) * 195_000, rings)
    return RawCloud(0, 0, "lidar", points, points.size, 1)


def test_what_is_there_twice_counts_once_in_its_place() -> None:
    """A third of the returns twice, further on in the cloud, of other brightness. Oracle: which were put there.

    Mutations: brightness compared; the first left out instead of the second; the time not compared; once where the settings
    want them as sent.
    """
    cloud, rng = _cloud(), np.random.default_rng(0)
    again = np.flatnonzero(rng.random(cloud.points.size) < 1 / 3)
    points = np.concatenate([cloud.points, cloud.points[again]])
    points["intensity"][cloud.points.size :] = 7.0
    later = cloud.points[:50].copy()
    later["t"] += 1
    points = np.concatenate([points, later])
    sent = replace(cloud, points=points, width=points.size)
    decoder, findings = once_each([sent], lambda message: sent, TIMING, ReadSettings(), "/points")
    (finding,) = findings
    assert finding.code == "points.twice"
    assert finding.evidence[0].value == pytest.approx(again.size / points.size)
    got = decoder(RawMessage("", 0, b""))
    np.testing.assert_array_equal(got.points, np.concatenate([cloud.points, later]))
    assert (got.width, got.height) == (got.points.size, 1)
    name, value = str(finding.override).removeprefix("--").replace("-", "_").split()
    as_sent = ReadSettings.model_validate({name: value.replace("_", "-")})
    assert once_each([sent], _never, TIMING, as_sent, "/points") == (_never, ())


@pytest.mark.parametrize("step_m", [0.0, 0.01, 0.05])
def test_coarse_coordinates_and_missing_returns_are_no_returns_twice(step_m: float) -> None:
    """Told in steps of centimetres many beams end on the same spot, and what did not return is at the origin.

    Mutations: the ring not compared; points that are none counted.
    """
    cloud = _cloud(step_m=step_m)
    for axis in "xyz":
        cloud.points[axis][::5] = 0.0
        cloud.points[axis][1::5] = np.nan
    cloud.points["ring"][::5] = cloud.points["ring"][1::5] = 0
    assert not repeated(cloud, TIMING).any()
    decoder, findings = once_each([cloud], _never, TIMING, ReadSettings(), "/points")
    assert (decoder, findings) == (_never, ())


def _never(message: RawMessage) -> RawCloud:
    raise AssertionError("decoded")
