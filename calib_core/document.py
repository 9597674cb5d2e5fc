"""The result document: one builder for what either method answers, and for what could not be answered."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from calib_core.geometry import euler_xyz_deg, quaternion_xyzw, transform_matrix
from calib_core.method import Answer
from calib_core.result import (
    CalibrationResult,
    Message,
    Observability,
    Provenance,
    Quality,
    RecordingProvenance,
    Transform,
    Uncertainty,
)
from calib_core.settings import CalibrateSettings
from calib_core.stamp_rate import rate_hz
from calib_core.types import Recording


def document(
    recording: Recording, settings: CalibrateSettings, answer: Answer, messages: list[Message], duration_s: float
) -> CalibrationResult:
    """The result document of an answer. messages: what was said on the way."""
    R, p, std = answer.R_imu_lidar, answer.p_imu_lidar, np.sqrt(np.diag(answer.covariance))
    return CalibrationResult(
        status="weak" if answer.is_weak else "calibrated",
        messages=[*messages, *answer.remarks],
        T_imu_lidar=Transform(
            matrix=transform_matrix(R, p).tolist(),
            translation_m=p.tolist(),
            quaternion_xyzw=quaternion_xyzw(R),
            euler_xyz_deg=euler_xyz_deg(R),
        ),
        time_offset_s=answer.time_offset_ns * 1e-9,
        time_offset_ns=answer.time_offset_ns,
        gyroscope_bias_rad_s=answer.gyro_bias_rad_s.tolist(),
        accelerometer_bias_m_s2=answer.accel_bias_m_s2.tolist(),
        gravity_m_s2=answer.gravity_m_s2,
        uncertainty=Uncertainty(
            rotation_std_deg=np.degrees(std[:3]).tolist(),
            translation_std_m=std[3:6].tolist(),
            time_offset_std_s=float(std[6]),
            gravity_std_m_s2=answer.gravity_std_m_s2,
            covariance=answer.covariance.tolist(),
        ),
        observability=Observability(
            weak_axes=list(answer.weak_axes), weak_directions=list(answer.weak_directions), advice=list(answer.advice)
        ),
        quality=Quality(
            point_to_plane_rms_m=answer.rms_m,
            points_used=answer.points_used,
            scans_used=answer.scans_used,
            scans_total=recording.scans_total or answer.scans_total,
            planes=list(answer.planes),
            iterations=answer.iterations,
            duration_s=duration_s,
        ),
        provenance=provenance(recording, settings),
        intrinsics=list(answer.intrinsics),
        clock_rate_ppm=None if answer.clock_rate_ppm is None else answer.clock_rate_ppm[0],
        clock_rate_ppm_std=None if answer.clock_rate_ppm is None else answer.clock_rate_ppm[1],
        time_offset_at_s=answer.time_offset_at_s,
        imu_noise=answer.imu_noise,
        imu_frame=answer.imu_frame,
        gyroscope_axes=answer.gyroscope_axes,
        evidence=answer.evidence,
    )


def refused(
    recording: Recording, settings: CalibrateSettings, messages: list[Message], duration_s: float
) -> CalibrationResult:
    """The document of a recording that cannot give the answer; messages has the reasons."""
    return CalibrationResult(
        status="refused",
        messages=messages,
        T_imu_lidar=None,
        time_offset_s=None,
        time_offset_ns=None,
        gyroscope_bias_rad_s=None,
        accelerometer_bias_m_s2=None,
        gravity_m_s2=None,
        uncertainty=None,
        observability=Observability(),
        quality=Quality(
            point_to_plane_rms_m=0.0,
            points_used=0,
            scans_used=0,
            scans_total=recording.scans_total or len(recording.scans),
            planes=[],
            iterations=0,
            duration_s=duration_s,
        ),
        provenance=provenance(recording, settings),
    )


def provenance(recording: Recording, settings: CalibrateSettings) -> Provenance:
    """Where the result comes from."""
    return Provenance(
        recording=RecordingProvenance(
            name=recording.name,
            sha256=recording.sha256,
            duration_s=recording.duration_s,
            lidar_topic=recording.lidar.topic,
            imu_topic=recording.imu.topic,
            lidar_frame_id=recording.lidar.frame_id,
            imu_frame_id=recording.imu.frame_id,
            lidar_model=recording.lidar.model,
            imu_rate_hz=rate_hz(recording.imu.stamps_ns) or None,
        ),
        settings=settings.model_dump(mode="json"),
        software={"unsweep": _version("unsweep"), "numpy": np.__version__, "python": platform.python_version()},
    )


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"
