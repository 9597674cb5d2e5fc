"""What is wrong with a rig's sensors and its walls: lasers, axes and scales, plaster, messages that are lost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.worlds.lidars import Shots
from bench.worlds.shapes import Hits, Rectangle, Shape
from calib_core.types import BoolArray, FloatArray

#: What a recording may have, by turns; "all" is the cheap IMU, the lasers and the walls.
FAULTS = ("ideal", "lasers", "imu", "walls", "industrial", "consumer", "all")
_MOST_LASERS = 128
#: Doors' panels and boxes are flat.
_BENDS_FROM_M = 0.6


@dataclass(frozen=True)
class Faults:
    """Of one recording. range_m, elevation_rad: (128,), each laser's.   gyro, accel, by_force: (3, 3).   lost: share of messages.

    bend_m: height of the walls' waves, of these wavelengths [m] and phases (K, 2).   slant_m: read short at 60 deg.
    """

    range_m: FloatArray
    elevation_rad: FloatArray
    gyro: FloatArray
    accel: FloatArray
    by_force: FloatArray
    bend_m: float
    waves_m: FloatArray
    phases: FloatArray
    slant_m: float
    lost: float

    @property
    def imu_axes(self) -> FloatArray:
        """(3, 3) from the IMU's body to the frame that its readings define: the accelerometer's x axis and xy plane."""
        axes, upper = np.linalg.qr(self.accel.T)
        return np.asarray((axes * np.sign(np.diag(upper))).T)


def drawn(rng: np.random.Generator, kind: str, shapes: int) -> Faults:
    """Of a kind out of FAULTS. shapes: how many there are to be bent."""
    cheap, good = kind in ("imu", "consumer", "all"), kind == "industrial"
    scale, askew = (0.006, np.radians(0.35)) if cheap else (0.0015, np.radians(0.06)) if good else (0.0, 0.0)
    lasers, walls = kind in ("lasers", "industrial", "consumer", "all"), kind in ("walls", "all")
    off = 1.0 - np.eye(3)
    return Faults(
        range_m=rng.normal(0, 0.008, _MOST_LASERS) * lasers,
        elevation_rad=np.radians(rng.normal(0, 0.05, _MOST_LASERS)) * (kind in ("lasers", "all")),
        gyro=np.eye(3) + np.diag(rng.normal(0, 1, 3)) * scale + askew * rng.normal(0, 1, (3, 3)) * off,
        accel=np.eye(3) + np.diag(rng.normal(0, 1, 3)) * scale + askew * rng.normal(0, 1, (3, 3)) * off,
        by_force=rng.normal(0, 1, (3, 3)) * (3e-4 if cheap else 3e-5 if good else 0.0),
        bend_m=float(rng.choice([0.003, 0.006])) * walls,
        waves_m=rng.uniform(1.5, 4, (shapes, 2)),
        phases=rng.uniform(0, 2 * np.pi, (shapes, 2)),
        slant_m=float(rng.choice([0.0, 0.0012, 0.003])) * walls,
        lost=float(rng.choice([0.0, 0.0, 0.0, 0.01])) * (kind != "ideal"),
    )


def bent(
    hits: Hits, faults: Faults, shapes: Sequence[Shape], origins_m: FloatArray, directions: FloatArray
) -> FloatArray:
    """(N,) ranges to walls that wave, and that read short where they are met slantwise."""
    range_m = hits.range_m.copy()
    for index in np.unique(hits.shape[hits.shape >= 0]) if faults.bend_m > 0 else ():
        shape = shapes[int(index)]
        if not isinstance(shape, Rectangle):
            continue
        edges = [(edge / np.linalg.norm(edge), np.linalg.norm(edge)) for edge in (shape.u_m, shape.v_m)]
        if min(half for _, half in edges) < 0.5 * _BENDS_FROM_M:
            continue
        mine = hits.shape == index
        place = origins_m[mine] + range_m[mine, None] * directions[mine] - shape.centre_m
        waves, phases = faults.waves_m[index % len(faults.waves_m)], faults.phases[index % len(faults.phases)]
        height_m = (
            faults.bend_m
            / np.sqrt(2)
            * sum(
                np.sin(2 * np.pi * (place @ axis) / wave + phase)
                for (axis, _), wave, phase in zip(edges, waves, phases, strict=True)
            )
        )
        towards = directions[mine] @ shape.normal
        range_m[mine] += height_m / (np.sign(towards) * np.maximum(np.abs(towards), 0.1))
    return np.asarray(range_m + faults.slant_m * (1 / np.maximum(hits.cosine, 0.2) - 1))


def as_read(shots: Shots, range_m: FloatArray, faults: Faults, *, spins: bool) -> FloatArray:
    """(N, 3), where a driver that knows nothing of its lasers' faults puts what they read."""
    direction = shots.direction
    if spins:
        level = np.hypot(direction[:, 0], direction[:, 1])
        elevation = np.arctan2(direction[:, 2], level) - faults.elevation_rad[shots.laser]
        flat = direction[:, :2] / np.maximum(level, 1e-9)[:, None]
        direction = np.column_stack([flat * np.cos(elevation)[:, None], np.sin(elevation)])
    return np.asarray((range_m + faults.range_m[shots.laser])[:, None] * direction)


def through(faults: Faults, gyro_rad_s: FloatArray, accel_m_s2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Readings (Q, 3) of axes that are askew and scales that are off, of a gyroscope that feels forces."""
    return gyro_rad_s @ faults.gyro.T + accel_m_s2 @ faults.by_force.T, accel_m_s2 @ faults.accel.T


def kept(rng: np.random.Generator, faults: Faults, count: int) -> BoolArray:
    """(count,) the messages that arrive."""
    return np.asarray(rng.random(count) >= faults.lost)
