"""Surfaces that were taken for planes and are curved, on rays that meet walls in closed form."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from calib_core.full.planes.curved import curvature_of, curved_surfaces
from calib_core.full.planes.propose import scan_points
from calib_core.planes.segment import PlaneFit, segment_planes
from calib_core.settings import CalibrateSettings
from calib_core.types import POINT_DTYPE, FloatArray, Scan

NOISE_M = 0.01


def _scan(wall: Callable[[FloatArray], FloatArray], *, turns_per_sweep: float = 0.0) -> Scan:
    """Of 32 lasers and 900 columns between a floor 1 m down and a roof 1.6 m up. wall: its distance (N,) from directions (N, 2).

    turns_per_sweep: by how much of a round the lidar itself turns about its axis during the sweep.
    """
    at = np.arange(900) / 900.0
    azimuth = np.repeat(2.0 * np.pi * at, 32)
    elevation = np.tile(np.radians(np.linspace(-30.0, 30.0, 32)), 900)
    seen_at = azimuth * (1.0 + turns_per_sweep)
    level = np.cos(elevation)
    ray = np.stack([level * np.cos(seen_at), level * np.sin(seen_at), np.sin(elevation)], axis=1)
    range_m = wall(ray[:, :2] / level[:, None]) / level
    for height in (-1.0, 1.6):
        to_it = np.where(ray[:, 2] * height > 1e-9, height / np.where(ray[:, 2] == 0.0, 1.0, ray[:, 2]), np.inf)
        range_m = np.minimum(range_m, to_it)
    range_m += np.random.default_rng(3).normal(0.0, NOISE_M, len(range_m))
    points = np.zeros(len(range_m), POINT_DTYPE)
    own = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=1)
    points["xyz"] = own * range_m[:, None]
    return Scan(0, 0, points)


def _round(direction: FloatArray) -> FloatArray:
    """The wall of a silo of 3 m about a place half a metre away."""
    away = np.array([0.4, 0.3])
    along = direction @ away
    return along + np.sqrt(along**2 + 9.0 - away @ away)


def _square(direction: FloatArray) -> FloatArray:
    """Four walls, 2 to 3 m away."""
    walls = np.array([[1.0, 0.0, 2.0], [0.0, 1.0, 2.4], [-1.0, 0.0, 2.6], [0.0, -1.0, 3.0]])
    towards = np.maximum(direction @ walls[:, :2].T, 1e-6)
    return np.asarray((walls[:, 2] / towards).min(axis=1))


def test_the_wall_of_a_silo_is_curved_and_a_rooms_is_flat() -> None:
    """Floor and roof hold one direction of a place. A motor that turns the lidar by a tenth of a round in each sweep bends all
    walls of a room, and makes none of them one that goes round it.

    Mutations: no sweep can bend a wall; curved, however flat.
    """
    found = curved_surfaces([_scan(_round)], CalibrateSettings())
    assert found is not None
    assert found.all - 2 <= found.curved < found.all
    assert found.radius_m == pytest.approx(3.0, rel=0.15)
    for turns_per_sweep in (0.0, -0.1, 0.1):
        assert curved_surfaces([_scan(_square, turns_per_sweep=turns_per_sweep)], CalibrateSettings()) is None
    assert curved_surfaces([], CalibrateSettings()) is None


def test_a_round_wall_beside_two_flat_ones_is_no_reason() -> None:
    """Most of a silo's wall, with two walls across it, which hold the place. Mutation: any curved surface counts."""

    def cut(direction: FloatArray) -> FloatArray:
        flat = (1.5 / np.maximum(direction, 1e-6)).min(axis=1)
        return np.asarray(np.minimum(flat, _round(direction)))

    scan = _scan(cut)
    points_m = scan_points(scan)
    curvatures = [curvature_of(points_m[fit.inliers], fit) for fit in segment_planes(points_m)]
    assert max(curvatures) == pytest.approx(1.0 / 3.0, rel=0.2)
    assert curved_surfaces([scan], CalibrateSettings()) is None


@pytest.mark.parametrize("radius_m", [0.8, 3.0, 12.0])
def test_curvature_is_that_of_the_surface_and_none_of_noise(radius_m: float) -> None:
    """A wall bent along any direction on it, seen as far as it is off a plane by 12 cm. Mutations: twice of it; the mean of both
    directions; noise counts.
    """
    rng = np.random.default_rng(1)
    half_m = np.sqrt(0.12 * radius_m)
    u, v = rng.uniform(-half_m, half_m, (2, 4000))
    away_m = 2.5 + rng.normal(0.0, NOISE_M, 4000)
    along = 0.6 * u + 0.8 * v
    for bent, expected in ((along**2 / (2.0 * radius_m), 1.0 / radius_m), (0.0 * u, 0.0)):
        points_m = np.stack([u, v, -away_m + bent], axis=1)
        fit = PlaneFit(np.array([0.0, 0.0, 1.0]), 2.5, np.ones(4000, bool), 0.0)
        assert curvature_of(points_m, fit) == pytest.approx(expected, rel=0.05)
