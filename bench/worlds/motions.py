"""Ways a rig is moved, on a fine grid of time: attitudes as yaw, pitch and roll, and the IMU's place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from bench.worlds.places import Place
from calib_core.types import FloatArray

#: Fine enough that what lies between two of these is a straight line to a tenth of a micrometre.
GRID_HZ = 4000.0
#: Before and after the recording, for readings that are averages.
MARGIN_S = 1.0
_EASE_S = 2.0
_GRAVITY_M_S2 = 9.81

Rng = np.random.Generator
#: (N, 3) roll, pitch, yaw [rad] and (N, 3) place beside the start [m], from a generator and (N,) times [s].
Way = Callable[[Rng, FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class Motion:
    """time_s: (N,) from -MARGIN_S on.   rotation: N of them, world from IMU.   p_m: (N, 3) of the IMU, world, z up."""

    time_s: FloatArray
    rotation: Rotation
    p_m: FloatArray

    def at(self, time_s: FloatArray) -> tuple[Rotation, FloatArray]:
        """Attitudes and places in between, M and (M, 3)."""
        x = (time_s - self.time_s[0]) * GRID_HZ
        i = x.astype(int)
        share = (x - i)[:, None]
        one, other = self.rotation[i], self.rotation[i + 1]
        turned = one * Rotation.from_rotvec(share * (one.inv() * other).as_rotvec())
        return turned, self.p_m[i] * (1 - share) + self.p_m[i + 1] * share


def smooth(rng: Rng, n: int, below_hz: float, columns: int = 3) -> FloatArray:
    """(n, columns) of unit scatter, without what is quicker."""
    steps = scipy.signal.butter(3, below_hz / (GRID_HZ / 2), output="sos")
    spare = int(GRID_HZ)
    noise = scipy.signal.sosfiltfilt(steps, rng.standard_normal((n + 2 * spare, columns)), axis=0)[spare:-spare]
    return np.asarray(noise / noise.std(axis=0))


def hand(rng: Rng, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Waved about by hand."""
    turns = smooth(rng, len(t), rng.uniform(0.25, 0.9)) * np.radians(rng.uniform(12, 35)) * [1, 1, 2.2]
    return turns, smooth(rng, len(t), rng.uniform(0.2, 0.7)) * [0.35, 0.35, 0.2]


def shaken(rng: Rng, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """To and fro twice a second, hundreds of degrees a second."""
    return smooth(rng, len(t), 2.0) * np.radians(18), smooth(rng, len(t), 2.2) * 0.08


def slow(rng: Rng, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """As by someone who was told to be careful."""
    return smooth(rng, len(t), 0.12) * np.radians(25), smooth(rng, len(t), 0.12) * [0.5, 0.5, 0.15]


def walk(rng: Rng, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """In figures of eight, upright, with heel strikes."""
    pace_hz = 1.8
    sway = 0.1 * smooth(rng, len(t), 0.5, 2)
    looking = np.radians(60) * np.sin(2 * np.pi * t / rng.uniform(6, 10))
    strikes = np.zeros(len(t))
    for at_s in np.arange(t[0], t[-1], 1 / pace_hz):
        strikes += 0.004 * np.exp(-(((t - at_s - 0.02 * rng.standard_normal()) / 0.03) ** 2))
    turns = [
        np.radians(3) * np.sin(np.pi * pace_hz * t) + sway[:, 0],
        np.radians(3) * np.sin(2 * np.pi * pace_hz * t + 1) + sway[:, 1],
        looking + np.cumsum(smooth(rng, len(t), 0.15, 1)[:, 0]) / GRID_HZ * 0.5,
    ]
    height = 0.03 * np.cos(2 * np.pi * pace_hz * t) + strikes
    return np.stack(turns, axis=1), np.stack([np.sin(0.25 * t), 0.7 * np.sin(0.5 * t + 0.3), height], axis=1)


def drone(rng: Rng, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """It leans into what it accelerates; its propellers hum."""
    p = smooth(rng, len(t), 0.35) * [0.7, 0.7, 0.25]
    leans = np.gradient(np.gradient(p, 1 / GRID_HZ, axis=0), 1 / GRID_HZ, axis=0) / _GRAVITY_M_S2
    turns = np.stack([-leans[:, 1], leans[:, 0], smooth(rng, len(t), 0.15, 1)[:, 0]], axis=1)
    hum_rad_s = 2 * np.pi * rng.uniform(60, 140)
    hum = np.array([0.3, 0.3, 0.6]) / hum_rad_s**2 * np.sin(hum_rad_s * t[:, None] + [0, 1, 2])
    return turns + np.radians(1.5) * smooth(rng, len(t), 1.5), p + hum


def arm(rng: Rng, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A robot's arm: from pose to pose, at rest in between."""
    turns, p = np.zeros((len(t), 3)), np.zeros((len(t), 3))
    at_s = float(t[0]) + MARGIN_S
    while at_s < t[-1]:
        takes_s = rng.uniform(0.8, 2.0)
        share = _eased((t - at_s) / takes_s)[:, None]
        turns += share * (rng.uniform(-1, 1, 3) * [0.8, 0.8, 1.6] - turns[-1])
        p += share * (rng.uniform(-0.4, 0.4, 3) - p[-1])
        at_s += takes_s + rng.uniform(0.1, 0.6)
    return turns, p


def swing(rng: Rng, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """On a rope of 1.6 m, turning about it."""
    length_m = 1.6
    rate = np.sqrt(_GRAVITY_M_S2 / length_m)
    along, across = 0.45 * np.sin(rate * t), 0.3 * np.sin(1.03 * rate * t + rng.uniform(0, 2))
    p = length_m * np.stack([np.sin(along), np.sin(across), 1 - np.cos(along) * np.cos(across)], axis=1)
    return np.stack([-across, along, 0.8 * np.sin(0.9 * t)], axis=1), p


MOTIONS: dict[str, Way] = {
    "hand": hand,
    "shaken": shaken,
    "slow": slow,
    "walk": walk,
    "drone": drone,
    "arm": arm,
    "swing": swing,
}


def moved(rng: Rng, way: Way, place: Place, duration_s: float, still_s: float, lever_m: FloatArray) -> Motion:
    """A way gone through in a place, from rest, so that the lidar, lever_m (3,) off the IMU, keeps to what is free."""
    t = np.arange(round((duration_s + 2 * MARGIN_S) * GRID_HZ)) / GRID_HZ - MARGIN_S
    turns, p = way(rng, t)
    begun = _eased((t - still_s) / _EASE_S)[:, None]
    rotation = Rotation.from_euler("ZYX", (turns * begun)[:, ::-1])
    p, lever = p * begun, rotation.apply(lever_m)
    while True:
        at = p + lever
        if np.hypot(at[:, 0], at[:, 1]).max() <= place.free_m and np.abs(at[:, 2]).max() <= 0.8:
            return Motion(t, rotation, place.start_m + p)
        p = 0.93 * p


def _eased(share: FloatArray) -> FloatArray:
    """From 0 to 1 without a jerk at either end."""
    s = np.clip(share, 0.0, 1.0)
    return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))
