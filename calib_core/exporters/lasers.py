"""Each laser's own errors as corrections: by how much to lengthen its ranges, to raise it and to turn it.

A correction is what is added, never what is wrong: the result's offsets and scales of ranges (intrinsics.py) have the other
sign. With the table's columns, whose first six other programs rely on, of the laser that returned a point, in this order,

    range      = (published range + range_offset_m) (1 + range_scale)
    elevation  = published elevation + elevation_rad      [from the lidar's xy plane, upwards]
    azimuth    = published azimuth + azimuth_rad          [atan2(y, x)]

A correction of a range holds the laser's own offset and the one that all lasers share. Its standard deviation takes the two for
independent; what a recording tells is mostly their sum, so that it is rather too large than too small.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot

from calib_core.errors import InputError
from calib_core.exporters.velodyne_models import VelodyneModel, velodyne_model
from calib_core.intrinsics import blocks_of
from calib_core.result import CalibrationResult, Intrinsic

_OF_LASERS = blocks_of("laser")
#: The table's columns, each with its field and decimals: micrometres, and a tenth of a microradian, which is a micrometre at ten
#: metres.
_COLUMNS = {
    "range_offset_m": ("range_m", 6),
    "range_offset_std_m": ("range_std_m", 6),
    "elevation_rad": ("elevation_rad", 7),
    "elevation_std_rad": ("elevation_std_rad", 7),
    "azimuth_rad": ("azimuth_rad", 7),
    "azimuth_std_rad": ("azimuth_std_rad", 7),
    "range_scale": ("range_scale", 7),
    "range_scale_std": ("range_scale_std", 7),
}


@dataclass(frozen=True, slots=True)
class Correction:
    """What is added: to a published range, then to a factor of 1 on it, to its elevation and its azimuth, each with its standard
    deviation. ring: as the points name it.   number: firing order.
    """

    ring: int
    number: int
    range_m: float
    range_std_m: float
    range_scale: float
    range_scale_std: float
    elevation_rad: float
    elevation_std_rad: float
    azimuth_rad: float
    azimuth_std_rad: float


@dataclass(frozen=True, slots=True)
class Lasers:
    """Of one lidar, in firing order where its model is known, else by ring. considered: found, but not applied.

    eccentricity_rad, incidence_m, grazing_rad: what all lasers share and no correction of a laser holds, as intrinsics.py has it;
    of the eccentricity its size.
    """

    corrections: tuple[Correction, ...]
    model: VelodyneModel | None
    considered: bool
    eccentricity_rad: float
    incidence_m: float
    grazing_rad: float


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
    return Lasers(
        corrections=tuple(sorted(corrections, key=lambda each: each.number)),
        model=model,
        considered=considered,
        eccentricity_rad=hypot(_one(found, "eccentricity", "sine")[0], _one(found, "eccentricity", "cosine")[0]),
        incidence_m=_one(found, "incidence", "all")[0],
        grazing_rad=_one(found, "grazing", "all")[0],
    )


def lasers_csv(result: CalibrationResult) -> str:
    """A row a laser; nothing but the table, so that every reader of tables takes it."""
    rows = [f"{each.number},{each.ring},{','.join(_cells(each))}" for each in lasers_of(result).corrections]
    return "\n".join([f"laser,ring,{','.join(_COLUMNS)}", *rows]) + "\n"


def _cells(correction: Correction) -> list[str]:
    return [f"{getattr(correction, field):z.{decimals}f}" for field, decimals in _COLUMNS.values()]


def _one(found: Mapping[tuple[str, str], Intrinsic], block: str, name: str) -> tuple[float, float]:
    """Value and standard deviation of a parameter, zeros where it is none of the result's."""
    parameter = found.get((block, name))
    return (0.0, 0.0) if parameter is None else (parameter.value, parameter.std)


def _correction(found: Mapping[tuple[str, str], Intrinsic], ring: int, number: int) -> Correction:
    own, own_std = _one(found, "laser_range_offset", str(ring))
    every, every_std = _one(found, "range_offset", "all")
    scale, scale_std = _one(found, "laser_range_scale", str(ring))
    elevation, elevation_std = _one(found, "laser_elevation", str(ring))
    azimuth, azimuth_std = _one(found, "laser_azimuth", str(ring))
    return Correction(
        ring=ring,
        number=number,
        range_m=-(own + every),
        range_std_m=hypot(own_std, every_std),
        range_scale=-scale / (1.0 + scale),
        range_scale_std=scale_std,
        elevation_rad=elevation,
        elevation_std_rad=elevation_std,
        azimuth_rad=azimuth,
        azimuth_std_rad=azimuth_std,
    )


def _named(result: CalibrationResult) -> str:
    """The lidar's preset: as asked for, else as recognised."""
    asked = result.provenance.settings.get("lidar")
    return asked if isinstance(asked, str) and asked else result.provenance.recording.lidar_model
