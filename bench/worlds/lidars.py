"""When lidars fire, and where to: rotors with their lasers in columns, and rosettes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib_core.types import FloatArray, IntArray

PERIOD_S = 0.1


@dataclass(frozen=True)
class Shots:
    """Of one sweep. time_s: (N,).   direction: (N, 3) lidar frame, of unit length.   laser: (N,)."""

    time_s: FloatArray
    direction: FloatArray
    laser: IntArray


@dataclass(frozen=True)
class Lidar:
    """shots: those of the sweep that begins at a time [s].   layout: as bags.py has it.   lasers: how many."""

    shots: Callable[[float], Shots]
    layout: str
    lasers: int

    @property
    def spins(self) -> bool:
        """Whether its lasers keep to cones."""
        return self.layout != "livox"


def _pointing(azimuth_rad: FloatArray, elevation_rad: FloatArray) -> FloatArray:
    level = np.cos(elevation_rad)
    return np.stack([level * np.cos(azimuth_rad), level * np.sin(azimuth_rad), np.sin(elevation_rad)], axis=1)


def _rotor(
    elevation_deg: FloatArray, columns: int, *, one_by_one: bool, aside_deg: FloatArray | None = None
) -> Callable[[float], Shots]:
    """Clockwise, as they do. one_by_one: a column's lasers fire one after the other.   aside_deg: their azimuths within it."""
    count = len(elevation_deg)
    laser = np.tile(np.arange(count), columns)
    share = (np.repeat(np.arange(columns), count) + (0.9 / count * laser if one_by_one else 0.0)) / columns
    azimuth = -2 * np.pi * share
    if aside_deg is not None:
        azimuth = azimuth - np.radians(aside_deg)[laser]
    direction = _pointing(azimuth, np.radians(elevation_deg)[laser])
    return lambda begins_s: Shots(begins_s + share * PERIOD_S, direction, laser)


def _rosette(begins_s: float) -> Shots:
    """70 deg wide, a flower whose petals do not come back."""
    shots = 9000
    time_s = begins_s + np.arange(shots) * PERIOD_S / shots
    laser = np.arange(shots) % 6
    around, out = 2 * np.pi * 47.3 * time_s, np.radians(35) * np.cos(2 * np.pi * 66.13 * time_s + 0.04 * laser)
    return Shots(time_s, np.stack([np.cos(out), np.sin(out) * np.cos(around), np.sin(out) * np.sin(around)], 1), laser)


def _dome(begins_s: float) -> Shots:
    """All around, from 7 deg below to 51 above."""
    shots = 9000
    time_s = begins_s + np.arange(shots) * PERIOD_S / shots
    laser = np.arange(shots) % 4
    elevation = np.radians(22 + 29 * np.sin(2 * np.pi * 61.7 * time_s + laser))
    return Shots(time_s, _pointing(2 * np.pi * 7.3 * time_s + 1.4 * laser, elevation), laser)


_UNEVEN_DEG = np.concatenate([np.linspace(-25, -7, 12), np.linspace(-6, 2, 20), np.linspace(3, 15, 8)])
LIDARS: dict[str, Lidar] = {
    "VLP-16": Lidar(_rotor(np.linspace(-15, 15, 16), 1000, one_by_one=True), "velodyne", 16),
    "RS-16": Lidar(_rotor(np.linspace(-15, 15, 16), 900, one_by_one=True), "robosense", 16),
    "OS-32": Lidar(
        _rotor(np.linspace(-22.5, 22.5, 32), 512, one_by_one=False, aside_deg=np.tile([-3.0, -1.0, 1.0, 3.0], 8)),
        "ouster",
        32,
    ),
    "Pandar-40": Lidar(_rotor(_UNEVEN_DEG, 450, one_by_one=False), "hesai", 40),
    "Mid-360": Lidar(_dome, "livox", 4),
    "Avia": Lidar(_rosette, "livox", 6),
}
