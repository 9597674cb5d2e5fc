"""A calibration file of the Velodyne drivers (velodyne_pointcloud, nebula), made of the lasers' corrections.

A driver adds `dist_correction` to the measured distance; `vert_correction` is the elevation; `rot_correction` is taken off the
azimuth of the head, which counts clockwise, and so added to that of the cloud. A laser that reads 9 mm short gets +0.009.
"""

from __future__ import annotations

import numpy as np

from calib_core.exporters.extrinsic import FOUND_BESIDE, decimal, printable
from calib_core.exporters.lasers import Correction, Lasers, lasers_of
from calib_core.exporters.velodyne_models import VelodyneModel
from calib_core.result import CalibrationResult

#: Keys that a driver wants to find; what they stand for is not estimated.
_UNUSED = (
    "dist_correction_x",
    "dist_correction_y",
    "vert_offset_correction",
    "horiz_offset_correction",
    "focal_distance",
    "focal_slope",
)
#: Of the drivers' own files: metres a count, where the model is not known that of a VLP-16.
_USUAL_RESOLUTION_M = 0.002


def velodyne_calibration(result: CalibrationResult) -> str:
    """One entry a laser, in firing order."""
    lasers = lasers_of(result)
    comments = "".join(f"# {line}\n" for line in _comments(result, lasers))
    resolution_m = _USUAL_RESOLUTION_M if lasers.model is None else lasers.model.distance_resolution_m
    entries = "".join(_entry(each, lasers.model) for each in lasers.corrections)
    return (
        f"{comments}lasers:\n{entries}num_lasers: {len(lasers.corrections)}\n"
        f"distance_resolution: {decimal(resolution_m)}\n"
    )


def _entry(correction: Correction, model: VelodyneModel | None) -> str:
    elevation_rad, azimuth_rad = correction.elevation_rad, correction.azimuth_rad
    if model is not None:
        elevation_rad += float(np.radians(model.elevation_deg[correction.number]))
        azimuth_rad += float(np.radians(model.azimuth_deg[correction.number]))
    values = [
        ("laser_id", str(correction.number)),
        ("rot_correction", decimal(azimuth_rad)),
        ("vert_correction", decimal(elevation_rad)),
        ("dist_correction", decimal(correction.range_m)),
        *((name, "0.0") for name in _UNUSED),
    ]
    return "- {" + ", ".join(f"{name}: {value}" for name, value in values) + "}\n"


def _comments(result: CalibrationResult, lasers: Lasers) -> list[str]:
    recording = result.provenance.recording
    worst = max(lasers.corrections, key=lambda each: abs(each.range_m))
    how = f"{abs(worst.range_m) * 1e3:.1f} mm {'short' if worst.range_m > 0 else 'long'}"
    source = f"unsweep: {printable(recording.name)}, topic {printable(recording.lidar_topic)}, status {result.status}."
    lines = [
        source,
        "dist_correction is added to the measured distance: that of a laser that reads short is positive.",
        f"Check: laser {worst.number} (ring {worst.ring}) reads {how}.",
        "The recording's driver is taken to have used the usual angles and no dist_correction of its own.",
        "Where the driver's file has other values, add these corrections to those, and keep its other keys.",
    ]
    if lasers.model is None:
        lines += [
            "The lidar's model is not known: laser_id is the ring, and vert_correction and rot_correction are only what is",
            "to be added to the sensor's own angles. Name a Velodyne with `unsweep calibrate --lidar` for a whole file.",
        ]
    else:
        lines.append(
            f"laser_id is the firing order; the angles are a {lasers.model.name}'s with the corrections found."
        )
    lines.append(_left_out(lasers))
    return [*lines, FOUND_BESIDE] if lasers.considered else lines


def _left_out(lasers: Lasers) -> str:
    """What a driver's file has no key for. A two-point correction is no scale: it goes by |x| and |y|, and is an HDL-64's."""
    scale = max((each.range_scale for each in lasers.corrections), key=abs)
    return (
        f"No place is in this form for a range scale (up to {scale:+z.3%} to be added), an encoder off its axis (up to "
        f"{np.degrees(lasers.eccentricity_rad):.4f} deg once a turn) and what a slant does to ranges (incidence "
        f"{1e3 * lasers.incidence_m:+z.1f} mm, grazing {1e3 * lasers.grazing_rad:+z.2f} mrad): left out."
    )
