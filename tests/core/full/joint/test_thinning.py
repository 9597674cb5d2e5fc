"""Thinned scans: every laser's points are among them, and as many as were asked for."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.full.joint.thinning import across_lasers, thinned
from calib_core.types import POINT_DTYPE, PointArray

COLUMNS = 1024


@pytest.mark.parametrize("lasers", [16, 32, 40, 64, 80, 128])
def test_thinned_points_are_of_every_laser(lasers: int) -> None:
    """And as many of them as were asked for, to a half. Mutation: the stride as it comes: four of sixteen lasers."""
    laser = np.arange(3 * 4000 * lasers) % lasers
    for asked in range(1, 40):
        stride = across_lasers(asked)
        assert set(laser[::stride]) == set(range(lasers))
        assert abs(stride - asked) <= max(1, asked / 2)


def scan(lasers: int, *, by_laser: bool) -> PointArray:
    """A whole sweep, laser by laser as some drivers send it, or column by column as it was taken."""
    points = np.zeros(lasers * COLUMNS, POINT_DTYPE)
    column, laser = np.divmod(np.arange(len(points)), lasers)
    order = np.argsort(laser, kind="stable") if by_laser else slice(None)
    points["ring"], points["offset_ns"] = laser[order], column[order]
    return points


@pytest.mark.parametrize("by_laser", [True, False])
@pytest.mark.parametrize(("lasers", "parts"), [(16, 1), (32, 2), (40, 2), (64, 4), (128, 8), (131, 1)])
def test_a_thinned_scan_has_few_lasers_and_some_scans_all(lasers: int, parts: int, by_laser: bool) -> None:
    """A part of them in each, of the whole sweep, and about as many points as were asked for; any few scans have all lasers. 131
    are lines of pixels. Oracle: counted.

    Mutations: every laser in each scan; the same part in all; the part by the scan's number alone, which each eighth of them
    shares; parts of 8 lasers; the part's own stride as it comes, which leaves half of its lasers out.
    """
    points = scan(lasers, by_laser=by_laser)
    asked = across_lasers(12 * parts)
    for every in (1, 8, 12):
        seen: set[int] = set()
        for position in range(0, 16 * every, every):
            some = points[thinned(points, asked, position)]
            own = set(some["ring"].tolist())
            assert len(own) == lasers // parts
            assert len(points) / (2 * asked) < len(some) < 2 * len(points) / asked
            assert some["offset_ns"].min() < 0.02 * COLUMNS
            assert some["offset_ns"].max() > 0.98 * COLUMNS
            seen |= own
        assert seen == set(range(lasers))


def test_where_few_points_are_left_out_all_lasers_are_taken() -> None:
    """A stride of 5 is 2 times 3 at most, of 64 lasers two parts are left; of 1 and 3 every so many-th point, as of few lasers.

    Mutation: as many parts as there are lasers for, whatever the stride: a fourth of the points where a third is asked for.
    """
    points = scan(64, by_laser=False)
    assert thinned(points, 1, 3).tolist() == list(range(len(points)))
    assert thinned(points, 3, 3).tolist() == list(range(0, len(points), 3))
    assert len(set(points["ring"][thinned(points, 7, 3)])) == 32


def test_of_no_points_none_are_left() -> None:
    """Mutation: the greatest ring of nothing."""
    assert thinned(np.zeros(0, POINT_DTYPE), 37, 0).tolist() == []
