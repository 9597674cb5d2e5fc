"""What a step of the solve believes of the motion, small enough to be told: a few instants of a dozen sweeps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_core.events import SweepMotion
from calib_core.full.joint.motion import Motion
from calib_core.types import FloatArray, Scan

SWEEPS = 12
#: Instants of one sweep: within half of it the twist hardly changes, as far as the eye can tell.
INSTANTS = 3


def sweep_motions(
    scans: Sequence[Scan],
    epoch_ns: int,
    motion: Motion,
    *,
    time_offset_s: float,
    R_imu_lidar: FloatArray,
    p_imu_lidar: FloatArray,
) -> tuple[SweepMotion, ...]:
    """The lidar through sweeps spread over the recording, as far as the motion reaches yet; frame of the solve."""
    from scipy.spatial.transform import Rotation

    places = np.unique(np.linspace(0, len(scans) - 1, SWEEPS).astype(np.int64))
    told = []
    for scan in (scans[int(place)] for place in places):
        if len(scan.points) == 0:
            continue
        offset_s = np.linspace(0.0, float(scan.points["offset_ns"].max()) * 1e-9, INSTANTS)
        when_s = (scan.stamp_ns - epoch_ns) * 1e-9 + offset_s - time_offset_s
        poses = motion.lidar_at(when_s, R_imu_lidar, p_imu_lidar)
        if not poses.usable.all():
            continue
        told.append(
            SweepMotion(
                stamp_ns=scan.stamp_ns,
                offset_s=np.round(offset_s, 6).tolist(),
                quaternion_xyzw=np.round(Rotation.from_matrix(poses.R).as_quat(), 6).tolist(),
                position_m=np.round(poses.p, 5).tolist(),
            )
        )
    return tuple(told)
