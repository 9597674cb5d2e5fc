"""Coordinates in metres: where half of the returns lie farther than any lidar measures, or nearer, they are something else."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_core.errors import InputError
from calib_core.presets.lidar import FARTHEST_M, NEAREST_M
from calib_core.readers.clouds.cloud import RawCloud

#: Of each cloud: a median of thousands is known to a percent, and units are a thousand apart.
_POINTS = 2000


@np.errstate(invalid="ignore", over="ignore")  # damaged floats are left out, not warned of
def require_metres(clouds: Sequence[RawCloud], topic: str) -> None:
    """Raises InputError where half of the returns of a sample cannot be distances in metres; nothing returned tells nothing."""
    ranges_m = []
    for cloud in clouds:
        some = cloud.points[:: max(1, len(cloud.points) // _POINTS)]
        xyz = np.stack([some[axis].astype(np.float64) for axis in "xyz"], axis=1)
        range_m = np.linalg.norm(xyz[np.isfinite(xyz).all(axis=1)], axis=1)
        ranges_m.append(range_m[range_m > 0.0])
    every_m = np.concatenate(ranges_m) if ranges_m else np.zeros(0)
    if not every_m.size:
        return
    half_m = float(np.median(every_m))
    if NEAREST_M < half_m < FARTHEST_M:
        return
    where, unit = ("farther", "millimetres or centimetres") if half_m > 1.0 else ("nearer", "kilometres or damaged")
    raise InputError(
        f"Half of the points on {topic} lie {where} than {half_m:,.4g} m, where no lidar measures: coordinates have to be in"
        f" metres, these seem to be {unit}; convert them in the lidar's driver.",
        code="points.unit",
    )
