"""Random rigs in random rooms, drawn by seed, and one cluttered room.

Each seed draws a place (a room of 3 to 12 m, a hall, an attic, an outdoor corner), up to 12 boxes and two walkers, a
lidar, a motion from slow to brisk, a mounting and an offset. Lidars fire at half their rate or less: a solve takes
seconds, and what decides a start is where a lidar looks, not how often.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.simulate import Scenario, Truth, furniture, sensors
from calib_core.simulate.bodies import Body, Box
from calib_core.simulate.motion import Pose, Start, Sway, Turn, Vector, Wave
from calib_core.simulate.patterns import Rosette, Spinning
from calib_core.simulate.rooms import closed_room, wall
from calib_core.simulate.scenario import checked_mounting
from calib_core.simulate.scene import Face, Scene
from calib_core.types import FloatArray, Plane

#: A rig in hand keeps so far from what stands or walks.
_CLEAR_M = 0.75
_RS_16 = sensors.Lidar(
    Spinning(
        elevations_deg=tuple(-15.0 + 2.0 * channel for channel in range(16)),
        channel_ns=tuple(2800 * channel for channel in range(16)),
        column_period_ns=50_000.0,
        columns_per_packet=24,
    ),
    layout="hesai",
    topic="/rslidar_points",
    frame_id="rslidar",
    range_std_m=0.02,
)
LIDARS: dict[str, sensors.Lidar] = {
    "VLP-16": sensors.VLP_16,
    "OS1-64": sensors.OS1_64,
    "XT-32": sensors.XT_32,
    "RS-16": _RS_16,
    "rosette": sensors.LIVOX,
}
#: So many times fewer shots than the sensor's own.
_THINNED = {"VLP-16": 2, "OS1-64": 4, "XT-32": 4, "RS-16": 2, "rosette": 2}
PLACES = ("room", "room", "room", "room", "room", "hall", "attic", "corner")


def draw(seed: int, *, duration_s: float = 16.0, bare: bool = False) -> tuple[str, str, Scenario]:
    """Place, lidar's name and scenario of a seed. bare: without what is not of the building."""
    rng = np.random.default_rng([seed, 15])
    place = PLACES[int(rng.integers(len(PLACES)))]
    faces, size, home = _PLACES[place](rng)
    name = list(LIDARS)[int(rng.integers(len(LIDARS)))]
    yaw = float(rng.uniform(-180.0, 180.0))
    if place == "corner":  # towards the building
        yaw = float(np.degrees(np.arctan2(-home[1], -home[0])) + rng.uniform(-25.0, 25.0))
    elif name == "rosette":  # towards a corner of the room, as one records with a narrow view
        corner = np.array([size[0] * rng.integers(2), size[1] * rng.integers(2)])
        yaw = float(np.degrees(np.arctan2(*(corner - home[:2])[::-1])) + rng.uniform(-20.0, 20.0))
    motion = _motion(rng, home, yaw)
    bodies = _bodies(rng, size, home, place)
    scenario = Scenario(
        slug=f"rooms-{seed}",
        title=f"{place} {seed}",
        text="A random rig in a random room.",
        scene=Scene(faces, () if bare else bodies),
        motion=motion,
        mounting=_mounting(rng),
        lidar=thinned(name),
        imu=(sensors.MTI_3, sensors.BMI_088_LIVOX, sensors.ICM_20948_OUSTER)[int(rng.integers(3))],
        time_offset_s=_offset_s(rng),
        duration_s=duration_s,
        gyro_bias_rad_s=_triple(rng.normal(0.0, 0.003, 3)),
        accel_bias_m_s2=_triple(rng.normal(0.0, 0.05, 3)),
    )
    return place, name, scenario


def thinned(name: str) -> sensors.Lidar:
    """The lidar with a part of its shots."""
    lidar, times = LIDARS[name], _THINNED[name]
    pattern = lidar.pattern
    if isinstance(pattern, Spinning):
        return replace(lidar, pattern=replace(pattern, column_period_ns=times * pattern.column_period_ns))
    assert isinstance(pattern, Rosette)
    return replace(lidar, pattern=replace(pattern, shots_per_s=pattern.shots_per_s / times))


def cluttered(*, duration_s: float = 20.0, bare: bool = False) -> Scenario:
    """A room with two walking persons and ten boxes, a VLP-16 in hand; bare: the same room empty."""
    rng = np.random.default_rng(20)
    size, home = np.array([6.0, 5.0, 2.8]), np.array([2.6, 2.3, 1.2])
    lean = tuple((float(a), float(b)) for a, b in rng.uniform(-1.2, 1.2, (6, 2)))
    bodies = [*_boxes(rng, size, home, 10), *_walkers(rng, size, home, 2)]
    return Scenario(
        slug="cluttered",
        title="Two persons and ten boxes",
        text="A VLP-16 in hand in a room with two walking persons and ten boxes.",
        scene=closed_room(_triple(size), lean, () if bare else tuple(bodies)),
        motion=_motion(rng, home, 40.0, brisk=1.0),
        mounting=_mounting(rng),
        lidar=thinned("VLP-16"),
        time_offset_s=0.031,
        duration_s=duration_s,
        gyro_bias_rad_s=(0.003, -0.002, 0.001),
        accel_bias_m_s2=(0.04, -0.03, 0.05),
    )


def _triple(values: FloatArray) -> Vector:
    return (float(values[0]), float(values[1]), float(values[2]))


Place = tuple[tuple[Face, ...], FloatArray, FloatArray]


def _room(rng: np.random.Generator) -> Place:
    size = np.array([rng.uniform(3.0, 12.0), rng.uniform(3.0, 12.0), rng.uniform(2.3, 3.5)])
    lean = tuple((float(a), float(b)) for a, b in rng.uniform(-1.4, 1.4, (6, 2)))
    return closed_room(_triple(size), lean).faces, size, _home(rng, size)


def _hall(rng: np.random.Generator) -> Place:
    size = np.array([rng.uniform(15.0, 35.0), rng.uniform(10.0, 20.0), rng.uniform(4.0, 9.0)])
    lean = tuple((float(a), float(b)) for a, b in rng.uniform(-0.6, 0.6, (6, 2)))
    return closed_room(_triple(size), lean).faces, size, _home(rng, size)


def _attic(rng: np.random.Generator) -> Place:
    """A room under a saddle roof: two slopes instead of the ceiling, low knee walls."""
    size = np.array([rng.uniform(4.0, 7.0), rng.uniform(4.0, 9.0), rng.uniform(2.6, 3.6)])
    knee = float(rng.uniform(0.5, 1.0))
    pitch = np.arctan2(size[2] - knee, size[0] / 2)
    s, c = float(np.sin(pitch)), float(np.cos(pitch))
    lean = rng.uniform(-0.02, 0.02, 10)
    faces = (
        Face("floor", (0.0, 0.004, 1.0), (0.0, 0.0, 0.0), reflectivity=0.4),
        Face("roof west", (s, float(lean[0]), -c), (0.0, float(size[1]) / 2, knee)),
        Face("roof east", (-s, float(lean[1]), -c), (float(size[0]), float(size[1]) / 2, knee)),
        Face("gable south", (float(5 * lean[2]), 1.0, float(lean[3])), (float(size[0]) / 2, 0.0, 1.0)),
        Face("gable north", (float(5 * lean[4]), -1.0, float(lean[5])), (float(size[0]) / 2, float(size[1]), 1.0)),
        Face("knee wall west", (1.0, float(lean[6]), float(lean[7])), (0.0, float(size[1]) / 2, 0.2)),
        Face("knee wall east", (-1.0, float(lean[8]), float(lean[9])), (float(size[0]), float(size[1]) / 2, 0.2)),
    )
    middle = np.array([size[0] / 2 + rng.uniform(-0.4, 0.4), size[1] * rng.uniform(0.35, 0.65), rng.uniform(0.9, 1.3)])
    return faces, size, middle


def _corner(rng: np.random.Generator) -> Place:
    """The outer corner of a building on open ground."""
    turn = np.radians(rng.uniform(-12.0, 12.0))
    along_y, along_x = rng.uniform(6.0, 14.0, 2)
    height = float(rng.uniform(4.0, 10.0))
    side = np.array([-np.cos(turn), -np.sin(turn), 0.0])
    out = np.array([-side[1], side[0], 0.0]) * -1.0
    faces = (
        Face(
            "ground", (float(rng.uniform(-0.03, 0.03)), float(rng.uniform(-0.03, 0.03)), 1.0), (0.0, 0.0, 0.0), (), 0.2
        ),
        wall(
            "facade east", (1.0, 0.0, 0.0), (0.0, -float(along_y), -1.0), (0.0, float(along_y), 0.0), (0.0, 0.0, height)
        ),
        wall("facade north", _triple(out), (0.0, 0.0, -1.0), _triple(side * along_x), (0.0, 0.0, height)),
    )
    home = np.array([rng.uniform(1.5, 4.0), rng.uniform(1.5, 4.0), rng.uniform(1.0, 1.6)])
    return faces, np.array([8.0, 8.0, height]), home


_PLACES = {"room": _room, "hall": _hall, "attic": _attic, "corner": _corner}


def _home(rng: np.random.Generator, size: FloatArray) -> FloatArray:
    """Where the rig is held: at least 1.1 m from the walls."""
    low, high = np.minimum(1.1, 0.45 * size[:2]), np.maximum(size[:2] - 1.1, 0.55 * size[:2])
    return np.array([*rng.uniform(low, high), rng.uniform(0.8, 1.5)])


def _mounting(rng: np.random.Generator) -> tuple[float, float, float, float, float, float, float]:
    q = rng.normal(size=4)
    q /= np.linalg.norm(q)
    p = rng.normal(size=3)
    p *= rng.uniform(0.0, 0.3) / np.linalg.norm(p)
    return checked_mounting((*_triple(p), float(q[0]), float(q[1]), float(q[2]), float(q[3])))


def _offset_s(rng: np.random.Generator) -> float:
    """Mostly tenths of a second, sometimes seconds, sometimes another epoch."""
    kind = rng.uniform()
    small = float(rng.uniform(-0.12, 0.12))
    return small if kind < 0.7 else small + float(rng.uniform(-3.0, 3.0)) if kind < 0.9 else small + 1.2e9


def _motion(rng: np.random.Generator, home: FloatArray, yaw_deg: float, brisk: float | None = None) -> Sway:
    """Slow to brisk: two waves on every axis, 10 to 70 deg/s in the mean."""
    pace = float(rng.uniform(0.35, 1.5)) if brisk is None else brisk

    def waves(most: float) -> tuple[Wave, ...]:
        hz = rng.uniform((0.2, 0.45), (0.45, 0.8)) * np.sqrt(pace)
        size = rng.uniform((0.5, 0.2), (1.0, 0.5)) * most * np.sqrt(pace)
        phase = rng.uniform(0.0, 2 * np.pi, 2)
        return tuple(Wave(float(a), float(f), float(p)) for a, f, p in zip(size, hz, phase, strict=True))

    turn = np.radians(16.0)
    axes: tuple[Vector, ...] = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
    base = Pose((float(rng.uniform(-15.0, 15.0)), float(rng.uniform(-20.0, 35.0)), yaw_deg), _triple(home))
    static_s = float(rng.choice([0.0, 1.0, 3.0]))
    return Sway(
        base=base,
        position=(waves(0.2), waves(0.2), waves(0.15)),
        turns=tuple(Turn(axis, waves(turn)) for axis in axes),
        start=Start(static_s=static_s, ramp_s=1.5 if static_s else 0.0),
    )


def _bodies(rng: np.random.Generator, size: FloatArray, home: FloatArray, place: str) -> tuple[Body, ...]:
    boxes, walkers = int(rng.integers(0, 13)), int(rng.integers(0, 3))
    bodies = [*_boxes(rng, size, home, boxes), *_walkers(rng, size, home, walkers)]
    if place == "corner":
        bodies += [*furniture.tree(float(rng.uniform(6.0, 9.0)), float(rng.uniform(3.0, 6.0)))]
        bodies += [
            *furniture.car(float(rng.uniform(5.0, 8.0)), float(rng.uniform(-8.0, -3.0)), float(rng.uniform(0, 90)))
        ]
    return tuple(bodies)


def _boxes(rng: np.random.Generator, size: FloatArray, home: FloatArray, count: int) -> list[Body]:
    """Boxes on the floor, clear of the rig."""
    found: list[Body] = []
    while len(found) < count:
        box = rng.uniform((0.25, 0.25, 0.3), (1.0, 0.8, 1.8))
        at = rng.uniform((0.3, 0.3), size[:2] - 0.3)
        if np.linalg.norm(at - home[:2]) < _CLEAR_M + 0.6 * float(np.hypot(box[0], box[1])):
            if min(size[:2]) < 4.0:
                count -= 1  # a small room holds fewer
            continue
        centre = (float(at[0]), float(at[1]), float(box[2] / 2))
        found.append(Box(f"box {len(found)}", centre, _triple(box), (0.0, 0.0, float(rng.uniform(0.0, 90.0)))))
    return found


def _walkers(rng: np.random.Generator, size: FloatArray, home: FloatArray, count: int) -> list[Body]:
    """Persons on circles that do not come near the rig, at 0.6 to 1.3 m/s."""
    found: list[Body] = []
    for _ in range(count):
        for _ in range(200):
            radius = float(rng.uniform(0.4, 1.6))
            at = rng.uniform(radius, np.maximum(size[:2] - radius, radius + 0.01))
            away = abs(float(np.linalg.norm(at - home[:2])) - radius)
            if away > _CLEAR_M + 0.15:
                pace = float(rng.uniform(0.6, 1.3))
                walk = furniture.circling(radius, 2 * np.pi * radius / pace)
                found += furniture.person(float(at[0]), float(at[1]), walk=walk)
                break
    return found


def rate_deg_s(truth: Truth, duration_s: float) -> float:
    """Root mean square of the lidar's turning."""
    omega = truth.lidar(np.arange(0.0, duration_s, 0.02)).omega_rad_s
    return float(np.degrees(np.sqrt(np.mean(np.sum(omega**2, axis=1)))))


def true_planes(truth: Truth) -> list[Plane]:
    """The building's own planes in the map frame of the first scan."""
    return [Plane(p.name, np.asarray(p.normal), float(p.offset_m)) for p in truth.planes]
