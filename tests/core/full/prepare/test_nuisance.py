"""Which parameters of a pair of sensors are unknowns: by their points, their priors and what is asked for."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, get_args

import numpy as np
import pytest

from calib_core.full.prepare.nuisance import choose_nuisance, count_lasers, nuisance_of
from calib_core.full.prepare.settings import LASERS
from calib_core.intrinsics import CLOCK_RATE_STD_PPM, KINDS, UNKNOWN_IMU, UNKNOWN_LIDAR, Block, Owner, blocks_of
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import POINT_DTYPE, FloatArray, Recording, Scan


def _scan(ring: np.ndarray, xyz: np.ndarray) -> Scan:
    points = np.zeros(len(ring), POINT_DTYPE)
    points["ring"], points["xyz"] = ring, xyz
    return Scan(0, 0, points)


def _fan(lasers: int, *, steady: bool) -> Scan:
    rng = np.random.default_rng(0)
    ring = rng.integers(0, lasers, 200 * lasers)
    elevation = np.radians(2.0 * ring if steady else rng.uniform(-20.0, 20.0, len(ring)))
    azimuth, r = rng.uniform(-np.pi, np.pi, len(ring)), rng.uniform(2.0, 8.0, len(ring))
    level = r * np.cos(elevation)
    return _scan(ring, np.stack([level * np.cos(azimuth), level * np.sin(azimuth), r * np.sin(elevation)], axis=1))


@pytest.mark.parametrize(
    ("lasers", "steady", "expected"), [(16, True, (16, True)), (6, False, (6, False)), (1, True, (0, False))]
)
def test_lasers_are_counted_from_the_points(lasers: int, steady: bool, expected: tuple[int, bool]) -> None:
    """Mutations: a single ring taken for a laser of its own, the elevation's spread not looked at."""
    assert count_lasers([_fan(lasers, steady=steady)]) == expected


def test_no_scan_and_wild_numbers_name_no_laser() -> None:
    """Mutation: no bound on the numbers."""
    assert count_lasers([]) == (0, False)
    wild = _fan(16, steady=True)
    points = wild.points.copy()
    points["ring"][0] = 40_000
    assert count_lasers([replace(wild, points=points)]) == (0, False)


def test_blocks_lie_one_after_the_other() -> None:
    """Mutation: a block without room kept; names of the lasers left out."""
    every = choose_nuisance(UNKNOWN_IMU, UNKNOWN_LIDAR, lasers=16, clock_rate_std_ppm=40.0)
    assert every.size == 25 + 1 + 4 * 16 + 2 + 3
    assert every.lasers == 16
    assert every.start("clock_rate") == 25
    vector = np.arange(every.size, dtype=float)
    assert every.values(vector, "laser_azimuth").tolist() == list(range(26 + 32, 26 + 48))
    solid = choose_nuisance(UNKNOWN_IMU, UNKNOWN_LIDAR, lasers=0, clock_rate_std_ppm=0.0)
    assert solid.start("clock_rate") == -1
    assert solid.start("laser_range_offset") == -1
    assert solid.size == 25 + 5


def test_where_lasers_look_to_in_the_mean_is_the_lidars_frame() -> None:
    """Oracle: variances of a mean and of a difference. Mutations: azimuths independent; narrowed all alike."""
    one = choose_nuisance(UNKNOWN_IMU, UNKNOWN_LIDAR, lasers=16, clock_rate_std_ppm=40.0)
    covariance = one.prior_root @ one.prior_root.T
    mean = np.zeros(one.size)
    mean[one.places["laser_azimuth"]] = 1.0 / 16
    std = UNKNOWN_LIDAR.laser_elevation_std_rad
    assert np.sqrt(mean @ covariance @ mean) == pytest.approx(LASERS.azimuth_together * std / 4.0)
    apart = np.zeros(one.size)
    apart[[one.start("laser_azimuth"), one.start("laser_azimuth") + 5]] = 1.0, -1.0
    assert np.sqrt(apart @ covariance @ apart) == pytest.approx(2**0.5 * std)
    elsewhere = np.setdiff1d(np.arange(one.size), np.arange(one.size)[one.places["laser_azimuth"]])
    np.testing.assert_allclose(covariance[np.ix_(elsewhere, elsewhere)], np.diag(one.prior_std[elsewhere] ** 2))


def test_settings_decide(noisy: tuple[Recording, Truth]) -> None:
    """Mutations: "off" ignored, names ignored, a named preset not asked."""
    recording, _ = noisy
    assert nuisance_of(recording, CalibrateSettings(intrinsics="off")).size == 0
    some = nuisance_of(recording, CalibrateSettings(intrinsics=("clock_rate", "incidence")))
    assert [each.block for each in some.blocks] == ["clock_rate", "incidence"]
    usual = nuisance_of(recording, CalibrateSettings())
    named = nuisance_of(recording, CalibrateSettings(imu_noise="xsens-mti-300"))
    place = usual.places["gyroscope_scale"]
    assert (named.prior_std[place] < 0.5 * usual.prior_std[place]).all()


def test_every_block_has_its_row() -> None:
    """And every owner its blocks, in the order of the unknowns. Mutations: a row left out; two blocks change places."""
    assert tuple(KINDS) == get_args(Block)
    assert tuple(each for owner in get_args(Owner) for each in blocks_of(owner)) == tuple(KINDS)
    assert all(kind.names or kind.owner == "laser" for kind in KINDS.values())


def test_clocks_that_part_by_more_than_crystals_have_an_unknown_rate_whatever_is_asked(
    noisy: tuple[Recording, Truth],
) -> None:
    """Mutations: none with ideal sensors, whose answer turns alone would put on one clock; none beside others that are named."""
    recording = noisy[0]

    def of(intrinsics: Literal["off", "auto"] | tuple[Block, ...], std_ppm: float) -> dict[str, FloatArray]:
        found = nuisance_of(recording, CalibrateSettings(intrinsics=intrinsics), clock_rate_std_ppm=std_ppm)
        return {block.block: block.prior_std for block in found.blocks}

    assert of("off", CLOCK_RATE_STD_PPM) == {}
    assert of("off", 90.0)["clock_rate"] == pytest.approx([90.0])
    assert len(of("off", 90.0)) == 1
    assert set(of(("incidence",), 90.0)) == {"incidence", "clock_rate"}
    assert of("auto", 90.0)["clock_rate"] == pytest.approx([90.0])
