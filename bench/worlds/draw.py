"""A seed's world: where, how moved, by which sensors with which faults; and its recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from bench.worlds import bags, faults
from bench.worlds.imus import GRADES, Imu, readings
from bench.worlds.lidars import LIDARS, PERIOD_S
from bench.worlds.motions import MOTIONS, Motion, moved
from bench.worlds.places import PLACES
from bench.worlds.shapes import Cylinder, Shape, cast
from calib_core.types import FloatArray

_NEAREST_M, _FARTHEST_M = 0.4, 80.0
#: Of neighbours in a ring that lie so far apart, half of the nearer are read in between.
_EDGE_M = 0.3
_LOST_SHOTS = 0.02


@dataclass(frozen=True)
class Sensing:
    """How ranges are told. step_m: what they are rounded to, 0 for nothing.   edges: whether some are of two surfaces."""

    std_m: float
    step_m: float
    edges: bool


@dataclass(frozen=True)
class World:
    """Everything that a recording is made of. T_imu_lidar: (4, 4), as the readings define the IMU's frame.

    time_offset_s: what the IMU's stamps lack of the lidar's.   walkers: (W, 2, 2) their middles and ways [m].
    """

    seed: int
    place: str
    motion: str
    lidar: str
    duration_s: float
    imu: Imu
    sensing: Sensing
    T_imu_lidar: FloatArray
    time_offset_s: float
    kind: str
    faults: faults.Faults
    shapes: list[Shape]
    walkers: FloatArray
    moved: Motion
    lever_m: FloatArray
    R_body_lidar: Rotation


def draw(seed: int, kind: str) -> World:
    """That of a seed with faults of a kind out of faults.FAULTS."""
    rng = np.random.default_rng([20261127, seed])
    place_name, motion_name, lidar = (str(rng.choice(list(names))) for names in (PLACES, MOTIONS, LIDARS))
    duration_s, still_s = float(rng.choice([15.0, 20.0, 30.0])), float(rng.choice([0.0, 0.0, 2.0, 3.0]))
    place = PLACES[place_name](rng)
    lever_m, turned = rng.uniform(-0.3, 0.3, 3), Rotation.from_quat(rng.normal(size=4))
    motion = moved(rng, MOTIONS[motion_name], place, duration_s, still_s, lever_m)
    noise, walk = GRADES[rng.integers(len(GRADES))]
    imu = Imu(float(rng.choice([100, 200, 200, 400])), bool(rng.random() < 0.4), noise, walk)
    sensing = Sensing(
        float(rng.choice([0.008, 0.015, 0.025])), float(rng.choice([0, 0.002, 0.004])), bool(rng.random() < 0.5)
    )
    walkers = np.stack([rng.uniform(-2, 2, (2, 2)), rng.uniform(-0.5, 0.5, (2, 2))], axis=1)[: rng.integers(3)]
    wrong = faults.drawn(rng, kind, len(place.shapes))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = wrong.imu_axes @ turned.as_matrix(), wrong.imu_axes @ lever_m
    return World(
        seed, place_name, motion_name, lidar, duration_s, imu, sensing, T, float(rng.uniform(-0.04, 0.04)), kind, wrong,
        place.shapes, walkers, motion, lever_m, turned,
    )  # fmt: skip


def record(world: World, path: Path) -> None:
    """The world's ROS 1 bag."""
    rng = np.random.default_rng([20261128, world.seed])
    lidar, wrong = LIDARS[world.lidar], world.faults
    sweeps = [
        _sweep(rng, world, begins_s)
        for begins_s in np.arange(0.0, world.duration_s - PERIOD_S - 0.02, PERIOD_S).tolist()
    ]
    imu_s, gyro, accel = readings(rng, world.imu, world.moved, world.duration_s)
    gyro, accel = faults.through(wrong, gyro, accel)
    arrive = faults.kept(rng, wrong, len(imu_s))
    bags.write_bag(
        path,
        [sweep for sweep, kept in zip(sweeps, faults.kept(rng, wrong, len(sweeps)), strict=True) if kept],
        imu_s[arrive] - world.time_offset_s, gyro[arrive], accel[arrive],
        layout=lidar.layout, epoch_ns=(1_700_000_000 + world.seed) * 10**9, rng=rng,
    )  # fmt: skip


def _sweep(rng: np.random.Generator, world: World, begins_s: float) -> bags.Sweep:
    lidar, sensing = LIDARS[world.lidar], world.sensing
    shots = lidar.shots(begins_s)
    rotation, p = world.moved.at(shots.time_s)
    origins_m = p + rotation.apply(world.lever_m)
    directions = (rotation * world.R_body_lidar).apply(shots.direction)
    people: list[Shape] = [
        Cylinder(np.array([*(middle + np.sin(way * begins_s)), 0.9]), 0.22, 1.8) for middle, way in world.walkers
    ]
    shapes = [*world.shapes, *people]
    hits = cast(shapes, origins_m, directions)
    came = (hits.range_m > _NEAREST_M) & (hits.range_m < _FARTHEST_M) & (rng.random(len(hits.range_m)) > _LOST_SHOTS)
    range_m = faults.bent(hits, world.faults, shapes, origins_m, directions)
    range_m = range_m + rng.normal(0, sensing.std_m, len(range_m))
    if sensing.edges:
        next_m = np.roll(range_m, -lidar.lasers)
        with np.errstate(invalid="ignore"):
            torn = (np.abs(next_m - range_m) > _EDGE_M) & np.isfinite(next_m) & (rng.random(len(range_m)) < 0.5)
        range_m[torn] += (next_m - range_m)[torn] * rng.random(int(torn.sum()))
    if sensing.step_m > 0:
        range_m = np.round(range_m / sensing.step_m) * sensing.step_m
    came &= np.isfinite(range_m)
    with np.errstate(invalid="ignore"):
        xyz_m = faults.as_read(shots, range_m, world.faults, spins=lidar.spins)
    return bags.Sweep(begins_s, begins_s + PERIOD_S, xyz_m[came], shots.time_s[came], shots.laser[came])
