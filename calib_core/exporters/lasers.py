"""Each laser's own errors as corrections: by how much to lengthen its ranges, to raise it and to turn it.

A correction of a range is minus the range offset found (calib_core/intrinsics.py): what is added to a published range. It holds
the laser's own offset and the one that all lasers share. Its standard deviation takes the two for independent; what a recording
tells is mostly their sum, so that it is rather too large than too small.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

from calib_core.errors import InputError
from calib_core.exporters.velodyne_models import VelodyneModel, velodyne_model
from calib_core.intrinsics import blocks_of
from calib_core.result import CalibrationResult, Intrinsic

_OF_LASERS = blocks_of("laser")


@dataclass(frozen=True, slots=True)
class Correction:
    """What is added: to a published range, elevation and azimuth. ring: as the points name it.   number: firing order."""

    ring: int
    number: int
    range_m: float
    range_std_m: float
    elevation_rad: float
    elevation_std_rad: float
    azimuth_rad: float
    range_scale: float


@dataclass(frozen=True, slots=True)
class Lasers:
    """Of one lidar, in firing order where its model is known, else by ring. considered: found, but not applied."""

    corrections: tuple[Correction, ...]
    model: VelodyneModel | None
    considered: bool


def lasers_of(result: CalibrationResult) -> Lasers:
    """What a result says of lasers one by one. Raises InputError where it says nothing."""
    found = {(each.block, each.name): each for each in result.intrinsics}
    rings = sorted({int(name) for block, name in found if block in _OF_LASERS and name.isdecimal()})
    if not rings:
        raise InputError(
            f"Expected the parameters of single lasers to export, but the result of {result.provenance.recording.name} "
            f"(status `{result.status}`) holds none; calibrate a recording whose points name their laser, with "
            "`--intrinsics auto`.",
            code="export.no_lasers",
        )
    model = velodyne_model(_named(result), len(rings))
    numbers = {ring: ring for ring in rings} if model is None else dict(enumerate(model.laser_of_ring))
    if set(numbers) != set(rings):
        model, numbers = None, {ring: ring for ring in rings}
    corrections = (_correction(found, ring, numbers[ring]) for ring in rings)
    considered = any(each.state == "considered" for (block, _), each in found.items() if block in _OF_LASERS)
    return Lasers(tuple(sorted(corrections, key=lambda each: each.number)), model, considered)


def lasers_csv(result: CalibrationResult) -> str:
    """A row a laser; nothing but the table, so that every reader of tables takes it."""
    rows = [
        f"{each.number},{each.ring},{each.range_m:.6f},{each.range_std_m:.6f},"
        f"{each.elevation_rad:.7f},{each.elevation_std_rad:.7f}"
        for each in lasers_of(result).corrections
    ]
    head = "laser,ring,range_offset_m,range_offset_std_m,elevation_rad,elevation_std_rad"
    return "\n".join([head, *rows]) + "\n"


def _correction(found: dict[tuple[str, str], Intrinsic], ring: int, number: int) -> Correction:
    def one(block: str, name: str) -> tuple[float, float]:
        parameter = found.get((block, name))
        return (0.0, 0.0) if parameter is None else (parameter.value, parameter.std)

    own, own_std = one("laser_range_offset", str(ring))
    every, every_std = one("range_offset", "all")
    elevation, elevation_std = one("laser_elevation", str(ring))
    return Correction(
        ring=ring,
        number=number,
        range_m=-(own + every),
        range_std_m=hypot(own_std, every_std),
        elevation_rad=elevation,
        elevation_std_rad=elevation_std,
        azimuth_rad=one("laser_azimuth", str(ring))[0],
        range_scale=one("laser_range_scale", str(ring))[0],
    )


def _named(result: CalibrationResult) -> str:
    """The lidar's preset: as asked for, else as recognised."""
    asked = result.provenance.settings.get("lidar")
    return asked if isinstance(asked, str) and asked else result.provenance.recording.lidar_model
