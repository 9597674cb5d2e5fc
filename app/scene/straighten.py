"""One sweep, straightened by the estimate of the moment: what is watched while a solve converges.

Within a tenth of a second the turning is nearly all of the motion, so the gyroscope alone shows how well rotation,
lever arm and clock are known; the solved trajectory takes over in the inspection afterwards.

    x_L0 = R_c^T ( R(t_0)^T R(t_i) (R_c x_i + p_c) - p_c )        R from the gyroscope, read at t - time_offset
"""

from __future__ import annotations

import numpy as np

from calib_core.types import Float32Array, FloatArray, ImuData, Recording, Scan

#: Slices of one sweep that share a rotation: at 400 deg/s and 0.1 s half a slice is 0.2 deg.
SLICES = 100
#: Readings this far outside the sweep serve wrong clocks too.
MARGIN_S = 0.3


def fastest_scan(recording: Recording) -> int:
    """The place of the scan during which the IMU turned fastest."""
    if len(recording.scans) == 0:
        return 0
    t_s = (recording.imu.stamps_ns + recording.coarse_offset_ns - recording.scans[0].stamp_ns) * 1e-9
    rate = np.linalg.norm(recording.imu.gyro_rad_s, axis=1)
    peak_s = float(t_s[int(np.argmax(np.convolve(rate, np.ones(15) / 15, mode="same")))])
    stamps_s = np.array([(scan.stamp_ns - recording.scans[0].stamp_ns) * 1e-9 for scan in recording.scans])
    middle_s = stamps_s + recording.lidar.period_s / 2
    return int(np.abs(middle_s - peak_s).argmin())


def straighten(scan: Scan, imu: ImuData, *, T_imu_lidar: FloatArray, time_offset_s: float) -> Float32Array:
    """(N, 3) [m]: the scan's points in the lidar frame at its start.   T_imu_lidar: (4, 4)."""
    xyz = scan.points["xyz"].astype(np.float64)
    rotations = _sweep_rotations(scan, imu, time_offset_s)
    if rotations is None or len(xyz) == 0:
        return xyz.astype(np.float32)
    last_ns = max(1, int(scan.points["offset_ns"].max()))
    slice_of = np.minimum(scan.points["offset_ns"].astype(np.int64) * SLICES // last_ns, SLICES - 1)
    R_c, p_c = T_imu_lidar[:3, :3], T_imu_lidar[:3, 3]
    turn = R_c.T @ rotations @ R_c
    shift = (rotations @ p_c - p_c) @ R_c
    moved: Float32Array = (np.einsum("nij,nj->ni", turn[slice_of], xyz) + shift[slice_of]).astype(np.float32)
    return moved


def _sweep_rotations(scan: Scan, imu: ImuData, time_offset_s: float) -> FloatArray | None:
    """(SLICES, 3, 3): R(t_0)^T R(t) at the slices' middles; None where the IMU does not cover the sweep."""
    from scipy.spatial.transform import Rotation, Slerp

    start_ns = scan.stamp_ns - round(time_offset_s * 1e9)
    end_s = float(scan.points["offset_ns"].max()) * 1e-9 if len(scan.points) else 0.0
    t_s = (imu.stamps_ns - start_ns) * 1e-9
    near = (t_s > -MARGIN_S) & (t_s < end_s + MARGIN_S)
    t_s, gyro = t_s[near], imu.gyro_rad_s[near]
    if len(t_s) < 2 or t_s[0] > 0.0 or t_s[-1] < end_s:
        return None
    steps = Rotation.from_rotvec(0.5 * (gyro[1:] + gyro[:-1]) * np.diff(t_s)[:, None])
    path = [Rotation.identity()]
    for step in steps:
        path.append(path[-1] * step)
    slerp = Slerp(t_s, Rotation.concatenate(path))
    middles_s = (np.arange(SLICES) + 0.5) / SLICES * end_s
    relative: FloatArray = (slerp([0.0])[0].inv() * slerp(middles_s)).as_matrix()
    return relative
