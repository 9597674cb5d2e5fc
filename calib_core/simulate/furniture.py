"""Things and people that stand or move in a scene, built from boxes, cylinders and balls. World frame, metres."""

from __future__ import annotations

from dataclasses import replace

from calib_core.simulate.bodies import Body, Box, Cylinder, Path, Sphere
from calib_core.simulate.motion import Wave

AxisWaves = tuple[tuple[Wave, ...], tuple[Wave, ...], tuple[Wave, ...]]


def table(x_m: float, y_m: float, turn_deg: float = 0.0) -> tuple[Body, ...]:
    """A round-legged table, 1.2 x 0.7 m, 0.74 m high; its legs are where they would be unturned."""
    legs = tuple(
        Cylinder("table leg", (x_m + dx, y_m + dy, 0.36), 0.03, 0.72, 0.5)
        for dx, dy in ((-0.45, -0.25), (0.45, -0.25), (-0.45, 0.25), (0.45, 0.25))
    )
    return (Box("table top", (x_m, y_m, 0.73), (1.2, 0.7, 0.03), (0.0, 0.0, turn_deg), 0.6), *legs)


def chair(x_m: float, y_m: float, turn_deg: float = 0.0) -> tuple[Body, ...]:
    """A seat on one leg with a leaning back, as in offices."""
    return (
        Cylinder("chair seat", (x_m, y_m, 0.46), 0.23, 0.06, 0.3),
        Cylinder("chair leg", (x_m, y_m, 0.22), 0.03, 0.42, 0.8),
        Cylinder("chair foot", (x_m, y_m, 0.04), 0.28, 0.06, 0.3),
        Box("chair back", (x_m, y_m + 0.22, 0.78), (0.42, 0.05, 0.5), (-10.0, 0.0, turn_deg), 0.3),
    )


def lamp(x_m: float, y_m: float) -> tuple[Body, ...]:
    """A standing lamp."""
    return (
        Cylinder("lamp pole", (x_m, y_m, 0.75), 0.015, 1.5, 0.7),
        Sphere("lamp shade", (x_m, y_m, 1.6), 0.17, 0.8),
    )


def plant(x_m: float, y_m: float, height_m: float = 1.1) -> tuple[Body, ...]:
    """A pot with foliage."""
    return (
        Cylinder("pot", (x_m, y_m, 0.17), 0.17, 0.34, 0.4),
        Sphere("foliage", (x_m, y_m, height_m - 0.3), 0.3, 0.4),
        Sphere("foliage", (x_m + 0.15, y_m - 0.1, height_m - 0.05), 0.2, 0.4),
    )


def cabinet(x_m: float, y_m: float, turn_deg: float = 0.0) -> tuple[Body, ...]:
    """A cupboard of 0.9 x 0.4 x 1.8 m."""
    return (Box("cabinet", (x_m, y_m, 0.9), (0.9, 0.4, 1.8), (0.0, 0.0, turn_deg), 0.5),)


def tree(x_m: float, y_m: float, height_m: float = 6.0) -> tuple[Body, ...]:
    """A trunk and a crown of three balls."""
    crown = height_m - 1.6
    return (
        Cylinder("trunk", (x_m, y_m, crown / 2.0), 0.16, crown, 0.3),
        Sphere("crown", (x_m, y_m, crown + 0.5), 1.5, 0.4),
        Sphere("crown", (x_m + 0.9, y_m + 0.4, crown), 1.0, 0.4),
        Sphere("crown", (x_m - 0.7, y_m + 0.7, crown - 0.2), 0.9, 0.4),
    )


def car(x_m: float, y_m: float, turn_deg: float = 0.0) -> tuple[Body, ...]:
    """A parked car: hull and cabin."""
    return (
        Box("car hull", (x_m, y_m, 0.6), (4.2, 1.75, 0.75), (0.0, 0.0, turn_deg), 0.5),
        Box("car cabin", (x_m, y_m, 1.2), (2.1, 1.5, 0.5), (0.0, 0.0, turn_deg), 0.15),
    )


def pillar(x_m: float, y_m: float, height_m: float) -> tuple[Body, ...]:
    """A square concrete pillar."""
    return (Box("pillar", (x_m, y_m, height_m / 2.0), (0.5, 0.5, height_m), reflectivity=0.5),)


def person(x_m: float, y_m: float, *, walk: AxisWaves = ((), (), ()), carried: float = 0.0) -> tuple[Body, ...]:
    """Someone 1.75 m tall: trunk, head, arms, and legs that step when there is a walk.

    walk: waves about (x, y) in the world.   carried: share of the lidar's own displacement, for whoever holds it.
    """
    whole = Path(walk, carried)
    step = 0.22 if any(walk) else 0.0
    parts: tuple[tuple[Body, float], ...] = (
        (Cylinder("person trunk", (x_m, y_m, 1.12), 0.17, 0.66, 0.35), 0.0),
        (Sphere("person head", (x_m, y_m, 1.62), 0.12, 0.5), 0.0),
        (Cylinder("person arm", (x_m - 0.17, y_m + 0.17, 1.1), 0.05, 0.6, 0.35), 0.3 * step),
        (Cylinder("person arm", (x_m + 0.17, y_m - 0.17, 1.1), 0.05, 0.6, 0.35), -0.3 * step),
        (Cylinder("person leg", (x_m - 0.07, y_m + 0.07, 0.4), 0.08, 0.8, 0.25), -step),
        (Cylinder("person leg", (x_m + 0.07, y_m - 0.07, 0.4), 0.08, 0.8, 0.25), step),
    )
    return tuple(_on(body, _stepping(whole, swing)) for body, swing in parts)


def _stepping(path: Path, swing_m: float) -> Path:
    if not swing_m:
        return path
    stride = Wave(swing_m / 2.0, 0.9)
    x, y, z = path.waves
    return replace(path, waves=((*x, stride), (*y, stride), z))


def _on(body: Body, path: Path) -> Body:
    if isinstance(body, Box | Cylinder | Sphere):
        return replace(body, path=path)
    return body


def circling(radius_m: float, period_s: float) -> AxisWaves:
    """A walk on a circle about the place given to `person`, starting towards +y."""
    hz = 1.0 / period_s
    quarter = 1.570_796_326_794_896_6
    return (Wave(radius_m, hz, quarter),), (Wave(radius_m, hz),), ()


def standing(bodies: tuple[tuple[Body, ...], ...]) -> tuple[Body, ...]:
    """Several things as one tuple."""
    return tuple(body for group in bodies for body in group)
