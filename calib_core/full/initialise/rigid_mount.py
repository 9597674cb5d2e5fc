"""Whether the lidar and the IMU are fixed to one another: within a second both turn alike, but for what a rotation, scale
factors, tilted axes and a bias make of it,

    turn_imu = M turn_lidar + b T,        M (3, 3), b (3,) by least squares, reweighted against outliers

What is left is a track's noise, some tenths of a degree. Of a lidar that a motor or a gimbal turns it is degrees, and no
solve would come to rest on that.
"""

from __future__ import annotations

import numpy as np

from calib_core.errors import Refused
from calib_core.full.initialise.settings import RIGID
from calib_core.full.initialise.start import LidarTrack, RotationStart
from calib_core.full.initialise.time_offset import GyroTurns
from calib_core.full.planes.curved import curved_surfaces
from calib_core.full.run import Run
from calib_core.geometry import log
from calib_core.types import FloatArray


def require_rigid(run: Run, track: LidarTrack, rotation: RotationStart) -> None:
    """Raises Refused where the lidar turns against the IMU. rotation: as the turning tells it."""
    imu = GyroTurns(run.clocks.imu_s, run.recording.imu.gyro_rad_s)
    lidar_rad, imu_rad = turns_within(track, imu, rotation.time_offset_s)
    if len(lidar_rad) < RIGID.fewest:
        return
    left_rad, turned_rad = left_of(lidar_rad, imu_rad, rotation.R_imu_lidar)
    if left_rad < max(RIGID.least_rad, RIGID.share * turned_rad):
        return
    surfaces = curved_surfaces(run.recording.scans, run.settings)
    if surfaces is not None:
        raise Refused(
            "planes.lost",
            f"the lidar could not be followed: {surfaces.curved} of the {surfaces.all} surfaces that were taken for planes are "
            f"curved, with a radius of about {surfaces.radius_m:.2g} m, and the flat ones leave its motion open, so that within "
            f"{RIGID.span_s:g} s its rotation differs from the gyroscope's by {np.degrees(left_rad):.2g} deg (median); record "
            "where three flat surfaces that face different directions stay in view, as floor and walls of a room",
        )
    raise Refused(
        "motion.not_rigid",
        f"the lidar turns against the IMU: within {RIGID.span_s:g} s they turn by {np.degrees(turned_rad):.2g} deg, and their "
        f"rotations differ by {np.degrees(left_rad):.2g} deg (medians); they are not fixed to one another (a motor, a gimbal, a "
        "loose mount), or the lidar could not be followed; fix the mount, and record again",
    )


def turns_within(track: LidarTrack, imu: GyroTurns, time_offset_s: float) -> tuple[FloatArray, FloatArray]:
    """Rotation vectors (N, 3) of both over spans of about a second that overlap, each in its own axes."""
    start_s = track.start_s
    apart = max(round(RIGID.span_s / float(np.median(np.diff(start_s)))), 1) if len(start_s) > 1 else 1
    first, last = start_s[:-apart], start_s[apart:]
    lidar_rad = log(np.swapaxes(track.R[:-apart], 1, 2) @ track.R[apart:])
    rate_rad_s = imu.over(first - time_offset_s, last - time_offset_s)
    imu_rad = rate_rad_s * (last - first)[:, None]
    # Beyond half a round a rotation vector is that of the other way round.
    known = (last - first < RIGID.longest * RIGID.span_s) & np.isfinite(imu_rad[:, 0])
    known &= np.maximum(np.linalg.norm(lidar_rad, axis=1), np.linalg.norm(imu_rad, axis=1)) < RIGID.most_rad
    return lidar_rad[known], imu_rad[known]


def left_of(lidar_rad: FloatArray, imu_rad: FloatArray, R_imu_lidar: FloatArray) -> tuple[float, float]:
    """What no linear map from the lidar's turns (N, 3) to the IMU's explains, and how much the lidar turns; medians [rad].

    The map begins with a rotation, from which a track that leaps does not draw it.
    """
    rows = np.column_stack([lidar_rad, np.ones(len(lidar_rad))])
    off = imu_rad - lidar_rad @ R_imu_lidar.T
    left = np.linalg.norm(off - np.median(off, axis=0), axis=1)
    for _ in range(RIGID.passes):
        weight = 1.0 / (1.0 + (left / max(RIGID.outlier_times * float(np.median(left)), RIGID.least_left_rad)) ** 2)
        linear = np.linalg.lstsq(rows * weight[:, None], imu_rad * weight[:, None], rcond=None)[0]
        left = np.linalg.norm(imu_rad - rows @ linear, axis=1)
    turned = np.linalg.norm(lidar_rad - np.mean(lidar_rad, axis=0), axis=1)
    return float(np.median(left)), float(np.median(turned))
