"""Surfaces that were taken for planes and are curved: as far as a lidar's band reaches, the wall of a silo lies on one.

    d(u) = a + b . u + u' K u / 2,       u: (2,) on the plane, K: curvatures [1/m]

by least squares on the points of a fit. Motion within a sweep bends flat walls, too: where the lidar turns by a share e of the
sweep's own turn meanwhile, a wall at the distance w seems to be curved by 2 e / w. A wall that goes round the lidar is by 1 / w.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_core.full.planes.propose import find_reference, scan_points, ways_held
from calib_core.full.planes.settings import CURVED
from calib_core.geometry import plane_axes
from calib_core.planes.segment import PlaneFit
from calib_core.settings import CalibrateSettings
from calib_core.types import FloatArray, Scan


@dataclass(frozen=True, slots=True)
class CurvedSurfaces:
    """What was taken for planes where curved surfaces are. curved: of how many in all, of which radius [m] in the median."""

    curved: int
    all: int
    radius_m: float


def curved_surfaces(scans: Sequence[Scan], settings: CalibrateSettings) -> CurvedSurfaces | None:
    """Of the scan in which planes are looked for; None where the flat ones hold a place in as many directions as all do."""
    position, fits = find_reference(scans, settings)
    if not fits:
        return None
    points_m = scan_points(scans[position], settings.field_of_view_deg)
    curvature = np.array([curvature_of(points_m[fit.inliers], fit) for fit in fits])
    away_m = np.abs([fit.offset_m for fit in fits])
    is_curved = curvature * away_m > CURVED.of_distance
    normals = np.array([fit.normal for fit in fits])
    if ways_held(normals[~is_curved]) == ways_held(normals):
        return None
    return CurvedSurfaces(int(is_curved.sum()), len(fits), float(1.0 / np.median(curvature[is_curved])))


def curvature_of(points_m: FloatArray, fit: PlaneFit) -> float:
    """The greatest curvature of a fit's points (N, 3) [1/m]; 0 where it lifts them by no more than what is called flat is off."""
    on_plane = points_m @ plane_axes(fit.normal).T
    u, v = (on_plane - on_plane.mean(axis=0)).T
    d = points_m @ fit.normal
    columns = np.stack([np.ones_like(u), u, v, 0.5 * u**2, u * v, 0.5 * v**2], axis=1)
    left_m = [d - some @ np.linalg.lstsq(some, d, rcond=None)[0] for some in (columns[:, :3], columns)]
    if np.mean(left_m[0] ** 2) - np.mean(left_m[1] ** 2) < CURVED.least_m**2:
        return 0.0
    a, b, c = np.linalg.lstsq(columns, d, rcond=None)[0][3:]
    return float(np.abs(np.linalg.eigvalsh([[a, b], [b, c]])).max())
