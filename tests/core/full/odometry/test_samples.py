"""Some points of a scan, and those of a march taken ahead of it, against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.full.odometry.prefetch import Ahead
from calib_core.full.odometry.register import sample_points
from calib_core.planes.sample import evenly_spread
from calib_core.types import POINT_DTYPE, Scan


def _scan(n: int, stamp_ns: int = 0) -> Scan:
    rng = np.random.default_rng(n)
    points = np.zeros(n, POINT_DTYPE)
    points["xyz"], points["offset_ns"] = rng.normal(size=(n, 3)), np.sort(rng.integers(0, 10**8, n))
    points["intensity"], points["ring"] = rng.random(n), rng.integers(0, 16, n)
    return Scan(0, stamp_ns, points)


@pytest.mark.parametrize("n", [1, 2, 599, 600, 601, 5000, 29_000])
@pytest.mark.parametrize("count", [1, 600, 5000])
def test_places_are_the_multiples_of_the_golden_ratio(n: int, count: int) -> None:
    """A twin in NumPy. Mutations: every count-th place; places in the order in which they were found."""
    taken = np.zeros(n, bool)
    taken[(np.arange(count) * 0.5 * (np.sqrt(5.0) - 1.0) % 1.0 * n).astype(int)] = True
    np.testing.assert_array_equal(evenly_spread(n, count), np.flatnonzero(taken))


@pytest.mark.parametrize("n", [0, 40, 5000])
def test_samples_hold_what_the_records_hold(n: int) -> None:
    """Of clouds that lie on disk, that are a part of another one, and of none. Mutations: the first of the records for
    those asked for; nanoseconds for seconds.
    """
    whole = _scan(2 * n)
    parts = [_scan(n).points, whole.points[::2], np.frombuffer(_scan(n).points.tobytes() or bytearray(), POINT_DTYPE)]
    for points in parts:
        xyz, tau = sample_points(Scan(0, 0, points), 1000)
        which = evenly_spread(n, 1000) if n > 1000 else np.arange(n)
        np.testing.assert_array_equal(xyz, points["xyz"][which].astype(np.float64))
        np.testing.assert_array_equal(tau, points["offset_ns"][which] * 1e-9)


@pytest.mark.parametrize("within", [range(30), range(5, 24), range(-3, 4), range(28, 40)])
def test_a_march_is_given_its_own_scans_either_way(within: range) -> None:
    """Scans of differing sizes, from the middle outwards. Mutations: a block's first scan for that of the range; scans
    beyond the recording asked for.
    """
    scans = [_scan(100 + k, 1000 * k) for k in range(30)]
    ahead = Ahead(scans, 60, within)
    inside = [k for k in within if 0 <= k < 30]
    assert [k for k in range(-5, 40) if k in ahead] == inside
    middle = inside[len(inside) // 2]
    for direction, positions in ((1, range(middle, inside[-1] + 1)), (-1, range(middle, inside[0] - 1, -1))):
        for position in positions:
            xyz, tau = ahead.sample(position, direction)
            expected = sample_points(scans[position], 60)
            np.testing.assert_array_equal(xyz, expected[0])
            np.testing.assert_array_equal(tau, expected[1])
    assert ahead.between_s(inside[0], inside[-1]) == pytest.approx(1e-6 * (inside[-1] - inside[0]))
