"""Rigs and rooms at the edge of what anybody records: each is one departure from a random rig of rigs.py.

A recording here is answered within its sigmas, or refused for the reason that is true: `EXTREMES` says by its name what is
out of the ordinary.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from bench.rigs import draw
from calib_core.simulate import Scenario
from calib_core.simulate.motion import Pose, Start, Sway, Turn, Vector, Wave
from calib_core.simulate.patterns import Rosette, Spinning
from calib_core.simulate.rooms import wall
from calib_core.simulate.scene import Face, Scene

Extreme = Callable[[Scenario, np.random.Generator], Scenario]


def extreme(kind: str, seed: int, *, duration_s: float = 12.0) -> tuple[str, str, Scenario]:
    """What kind, lidar's name and scenario of a seed."""
    _, name, scenario = draw(seed, duration_s=duration_s)
    rng = np.random.default_rng([seed, 51])
    return kind, name, replace(EXTREMES[kind](scenario, rng), slug=f"{kind}-{seed}", title=f"{kind} {seed}")


def _sway(scenario: Scenario) -> Sway:
    assert isinstance(scenario.motion, Sway)
    return scenario.motion


def _paced(scenario: Scenario, times: float, growth: float) -> Scenario:
    """The motion with its waves so many times as quick, and so many times as large."""
    motion = _sway(scenario)

    def waves(some: tuple[Wave, ...], growth: float) -> tuple[Wave, ...]:
        return tuple(replace(w, amplitude=growth * w.amplitude, frequency_hz=times * w.frequency_hz) for w in some)

    x, y, z = motion.position
    return replace(
        scenario,
        motion=replace(
            motion,
            position=(
                waves(x, 1.0 / max(times, 1.0)),
                waves(y, 1.0 / max(times, 1.0)),
                waves(z, 1.0 / max(times, 1.0)),
            ),
            turns=tuple(replace(turn, waves=waves(turn.waves, growth)) for turn in motion.turns),
        ),
    )


def _based(scenario: Scenario, at_m: Vector, yaw_deg: float) -> Scenario:
    motion = _sway(scenario)
    return replace(scenario, motion=replace(motion, base=Pose((5.0, 8.0, yaw_deg), at_m)))


def _corridor(scenario: Scenario, rng: np.random.Generator) -> Scenario:
    """60 m long, its ends far and slanting: the third direction barely shows."""
    width, height, length = float(rng.uniform(1.6, 2.4)), float(rng.uniform(2.3, 2.8)), 60.0
    faces = (
        Face("floor", (0.0, 0.003, 1.0), (0.0, 0.0, 0.0), reflectivity=0.3),
        Face("ceiling", (0.002, 0.0, -1.0), (0.0, 0.0, height), reflectivity=0.6),
        Face("wall west", (1.0, 0.004, 0.0), (0.0, 0.0, 1.0), reflectivity=0.6),
        Face("wall east", (-1.0, 0.006, 0.003), (width, 0.0, 1.0), reflectivity=0.6),
        Face("end south", (0.02, 1.0, 0.0), (1.0, 0.0, 1.0), reflectivity=0.5),
        Face("end north", (0.01, -1.0, 0.0), (1.0, length, 1.0), reflectivity=0.5),
    )
    at = (0.5 * width, float(rng.uniform(6.0, 25.0)), 1.2)
    return _based(replace(scenario, scene=Scene(faces)), at, float(rng.uniform(-180.0, 180.0)))


def _staircase(scenario: Scenario, rng: np.random.Generator) -> Scenario:
    """A flight of fourteen steps between two walls: forty small planes that face two ways, and the walls."""
    width, rise, going = float(rng.uniform(1.6, 2.6)), 0.18, 0.28
    faces = [
        Face("wall west", (1.0, 0.004, 0.0), (0.0, 0.0, 1.0), reflectivity=0.6),
        Face("wall east", (-1.0, 0.006, 0.003), (width, 0.0, 1.0), reflectivity=0.6),
        Face("wall south", (0.01, 1.0, 0.0), (0.0, -2.5, 0.0), reflectivity=0.6),
        Face("ceiling", (0.0, 0.3, -1.0), (0.0, 0.0, 3.4), reflectivity=0.6),
        wall("landing", (0.0, 0.0, 1.0), (0.0, -2.6, 0.0), (width, 0.0, 0.0), (0.0, 2.6, 0.0), 0.4),
    ]
    for step in range(14):
        y, z = step * going, step * rise
        faces.append(wall(f"riser {step}", (0.0, -1.0, 0.0), (0.0, y, z), (width, 0.0, 0.0), (0.0, 0.0, rise), 0.4))
        top = z + rise
        faces.append(wall(f"tread {step}", (0.0, 0.0, 1.0), (0.0, y, top), (width, 0.0, 0.0), (0.0, going, 0.0), 0.4))
    faces.append(Face("far wall", (0.0, -1.0, 0.02), (0.0, 14 * going + 1.2, 3.0), reflectivity=0.6))
    return _based(
        replace(scenario, scene=Scene(tuple(faces))), (0.5 * width, -1.2, 1.3), float(rng.uniform(60.0, 120.0))
    )


def _two_planes(scenario: Scenario, rng: np.random.Generator) -> Scenario:
    """One wall and the ground in the open: two directions and no more."""
    ground = Face("ground", (0.01, -0.008, 1.0), (0.0, 0.0, 0.0), reflectivity=0.3)
    facade = wall("facade", (0.0, -1.0, 0.0), (-15.0, 5.0, -1.0), (30.0, 0.0, 0.0), (0.0, 0.0, 9.0))
    scene = Scene((ground, facade))
    return _based(replace(scenario, scene=scene), (0.0, 1.5, 1.3), 90.0 + float(rng.uniform(-20.0, 20.0)))


def _creeping(scenario: Scenario, _rng: np.random.Generator) -> Scenario:
    """Three deg/s or so."""
    return _paced(scenario, 0.2, 0.5)


def _shaken(scenario: Scenario, rng: np.random.Generator) -> Scenario:
    """2 to 4 rad/s in the mean, as brisk as a hand can."""
    axes = _sway(scenario).turns
    rate = sum((w.amplitude * w.frequency_hz) ** 2 for turn in axes for w in turn.waves) ** 0.5 * 2.0 * np.pi / 2**0.5
    return _paced(scenario, 1.8, float(rng.uniform(2.0, 4.0)) / 1.8 / rate)


def _upside_down(scenario: Scenario, _rng: np.random.Generator) -> Scenario:
    motion = _sway(scenario)
    roll, pitch, yaw = motion.base.rpy_deg
    return replace(scenario, motion=replace(motion, base=Pose((180.0 + roll, pitch, yaw), motion.base.position_m)))


def _on_its_side(scenario: Scenario, _rng: np.random.Generator) -> Scenario:
    motion = _sway(scenario)
    roll, pitch, yaw = motion.base.rpy_deg
    return replace(scenario, motion=replace(motion, base=Pose((90.0 + roll, pitch, yaw), motion.base.position_m)))


def _imu_hz(rate_hz: float) -> Extreme:
    def changed(scenario: Scenario, _rng: np.random.Generator) -> Scenario:
        return replace(scenario, imu=replace(scenario.imu, rate_hz=rate_hz))

    return changed


def _lidar_hz(rate_hz: float) -> Extreme:
    def changed(scenario: Scenario, _rng: np.random.Generator) -> Scenario:
        pattern = scenario.lidar.pattern
        assert isinstance(pattern, Spinning | Rosette)  # as many shots a second: fewer a turn where it turns faster
        return replace(scenario, lidar=replace(scenario.lidar, pattern=replace(pattern, rate_hz=rate_hz)))

    return changed


def _late(offset_s: float) -> Extreme:
    def changed(scenario: Scenario, _rng: np.random.Generator) -> Scenario:
        return replace(scenario, time_offset_s=offset_s)

    return changed


def _lasting(duration_s: float) -> Extreme:
    def changed(scenario: Scenario, _rng: np.random.Generator) -> Scenario:
        return replace(scenario, duration_s=duration_s)

    return changed


def _moving_at_once(scenario: Scenario, _rng: np.random.Generator) -> Scenario:
    motion = _sway(scenario)
    return _paced(replace(scenario, motion=replace(motion, start=Start(0.0, 0.0))), 1.3, 1.2)


def _one_axis(scenario: Scenario, _rng: np.random.Generator) -> Scenario:
    """Turned about the vertical only, as on a cart."""
    motion = _sway(scenario)
    yaw = Turn((0.0, 0.0, 1.0), tuple(replace(w, amplitude=2.0 * w.amplitude) for w in motion.turns[0].waves))
    return replace(scenario, motion=replace(motion, turns=(yaw,), position=(*motion.position[:2], ())))


def _stops(scenario: Scenario, _rng: np.random.Generator) -> Scenario:
    """Standing still for the first two thirds."""
    motion = _sway(scenario)
    return replace(scenario, motion=replace(motion, start=Start(0.6 * scenario.duration_s, 1.0)))


EXTREMES: dict[str, Extreme] = {
    "corridor": _corridor,
    "staircase": _staircase,
    "two planes": _two_planes,
    "creeping": _creeping,
    "shaken": _shaken,
    "upside down": _upside_down,
    "on its side": _on_its_side,
    "one axis": _one_axis,
    "stands long": _stops,
    "moving at once": _moving_at_once,
    "IMU 100 Hz": _imu_hz(100.0),
    "IMU 1000 Hz": _imu_hz(1000.0),
    "IMU 50 Hz": _imu_hz(50.0),
    "lidar 5 Hz": _lidar_hz(5.0),
    "lidar 20 Hz": _lidar_hz(20.0),
    "+0.5 s": _late(0.5),
    "-0.5 s": _late(-0.5),
    "6 s": _lasting(6.0),
    "8 s": _lasting(8.0),
    "90 s": _lasting(90.0),
}
