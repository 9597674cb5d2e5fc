"""Result documents to export, built by hand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib_core.geometry import euler_xyz_deg
from calib_core.result import (
    CalibrationResult,
    Message,
    Observability,
    Provenance,
    Quality,
    RecordingProvenance,
    Status,
    Transform,
    Uncertainty,
    WeakDirection,
)


def make_result(
    R: NDArray[np.float64],
    p: NDArray[np.float64],
    time_offset_ns: int = 0,
    *,
    status: Status = "calibrated",
    lidar_frame_id: str = "velodyne",
    imu_frame_id: str = "imu_link",
    name: str = "room.bag",
) -> CalibrationResult:
    """A result with T_imu_lidar = (R, p); the answer is None where `status` is refused."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p
    rotation = Rotation.from_matrix(R)
    refused = status == "refused"
    transform = Transform(
        matrix=T.tolist(),
        translation_m=p.tolist(),
        quaternion_xyzw=rotation.as_quat().tolist(),
        euler_xyz_deg=euler_xyz_deg(R),
    )
    uncertainty = Uncertainty(
        rotation_std_deg=[0.004, 0.005, 0.006],
        translation_std_m=[3e-4, 4e-4, 5e-4],
        time_offset_std_s=1e-5,
        gravity_std_m_s2=1e-3,
        covariance=np.diag([7e-5, 9e-5, 1e-4, 3e-4, 4e-4, 5e-4, 1e-5]).__pow__(2).tolist(),
    )
    direction = WeakDirection(label="tz", vector=[0, 0, 0, 0, 0, 1, 0], std_scaled=4.0, text="tz is known to 40 mm.")
    return CalibrationResult(
        status=status,
        messages=[Message(code="solve.static", level="error", text="The platform never moved; turn it.")] * refused,
        T_imu_lidar=None if refused else transform,
        time_offset_s=None if refused else time_offset_ns * 1e-9,
        time_offset_ns=None if refused else time_offset_ns,
        gyroscope_bias_rad_s=None if refused else [0.001, -0.002, 0.003],
        accelerometer_bias_m_s2=None if refused else [0.01, 0.02, -0.03],
        gravity_m_s2=None if refused else 9.807,
        uncertainty=None if refused else uncertainty,
        observability=Observability(
            weak_directions=[direction] if status == "weak" else [],
            advice=["Turn about x."] if status == "weak" else [],
        ),
        quality=Quality(
            point_to_plane_rms_m=0.002,
            points_used=1_000_000,
            scans_used=190,
            scans_total=200,
            planes=[],
            iterations=9,
            duration_s=3.2,
        ),
        provenance=Provenance(
            recording=RecordingProvenance(
                name=name,
                sha256="00",
                duration_s=20.0,
                lidar_topic="/velodyne_points",
                imu_topic="/imu/data",
                lidar_frame_id=lidar_frame_id,
                imu_frame_id=imu_frame_id,
            ),
            settings={},
            software={"unsweep": "0"},
        ),
    )
