"""Lasers that read long or short and look elsewhere than they say.

Of the point that laser l returns from true range d at incidence angle i:

    published range     = d (1 + scale_l) + offset_l + offset + offset of the surface - 1/4 divergence d tan(i)
    true elevation      = published elevation + elevation_l
    true azimuth        = published azimuth + azimuth_l + eccentricity sin(published azimuth + phase)

A beam that meets a surface slantwise lights a spot that is `divergence d tan(i)` deep; a leading edge triggers at its near
part, and the range comes out short.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_core.simulate.patterns import Firings
from calib_core.types import FloatArray, IntArray

Values = tuple[float, ...]

#: Where within the stretched echo a leading edge triggers, as a share of its depth before the middle. Half would be its
#: very beginning; a threshold at a fixed share of the peak lies between.
_TRIGGERS_EARLY_BY = 0.25
#: Beyond this angle a ray skims along the surface and no formula holds.
_STEEPEST_TANGENT = 20.0


@dataclass(frozen=True, slots=True)
class LidarDeviations:
    """What sets one lidar apart from an ideal one. Tuples by channel in firing order, empty for none; see the module.

    surface_range_offset_m: of each of a scene's surfaces instead.
    """

    laser_range_offset_m: Values = ()
    laser_elevation_rad: Values = ()
    laser_azimuth_rad: Values = ()
    laser_range_scale: Values = ()
    range_offset_m: float = 0.0
    beam_divergence_rad: float = 0.0
    surface_range_offset_m: Values = ()
    eccentricity_rad: float = 0.0
    eccentricity_phase_rad: float = 0.0

    @property
    def grazing_rad(self) -> float:
        """What the beam's divergence takes of a range, times range and tangent."""
        return _TRIGGERS_EARLY_BY * self.beam_divergence_rad

    def fired(self, published: Firings) -> Firings:
        """Where the lasers really look when the driver publishes these directions."""
        if not (self.laser_elevation_rad or self.laser_azimuth_rad or self.eccentricity_rad):
            return published
        x, y, z = published.directions
        azimuth, elevation = np.arctan2(y, x), np.arcsin(np.clip(z, -1.0, 1.0))
        turned = azimuth + self.eccentricity_rad * np.sin(azimuth + self.eccentricity_phase_rad)
        turned = turned + (np.asarray(self.laser_azimuth_rad) if self.laser_azimuth_rad else 0.0)
        raised = elevation + (np.asarray(self.laser_elevation_rad) if self.laser_elevation_rad else 0.0)
        level = np.cos(raised)
        directions = np.stack([level * np.cos(turned), level * np.sin(turned), np.sin(raised)])
        return replace(published, directions=directions)

    def published_ranges(self, range_m: FloatArray, cos_incidence: FloatArray, surface: IntArray) -> FloatArray:
        """What the lasers report. range_m: (C, K) true, finite.   cos_incidence: (C, K).   surface: (C, K) that was hit."""
        published = range_m
        if self.laser_range_scale:
            published = published * (1.0 + np.asarray(self.laser_range_scale))
        if self.laser_range_offset_m:
            published = published + np.asarray(self.laser_range_offset_m)
        if self.surface_range_offset_m:
            published = published + np.asarray(self.surface_range_offset_m)[surface]
        if self.beam_divergence_rad:
            cosine = np.clip(cos_incidence, 1e-6, 1.0)
            tangent = np.minimum(np.sqrt(1.0 - cosine**2) / cosine, _STEEPEST_TANGENT)
            published = published - self.grazing_rad * range_m * tangent
        return published + self.range_offset_m if self.range_offset_m else published


IDEAL_LIDAR = LidarDeviations()
