"""The published method's answer as a result document, beside ours (`--method paper`).

Its covariance is that of the cost's own weights: with the factor balance of eq. (14) it is not the errors' covariance,
and the document says so.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from calib_core.calibrate import Calibration, provenance, refused
from calib_core.events import OnEvent, ShouldCancel
from calib_core.full.assess.observability import assess
from calib_core.full.assess.residuals import euler_xyz_deg, quaternion_xyzw, transform_matrix
from calib_core.full.joint.priors import PriorRow, Priors
from calib_core.paper import PaperRefusal, PaperSolution, calibrate_paper
from calib_core.result import (
    CalibrationResult,
    Message,
    Observability,
    PlaneQuality,
    Quality,
    Transform,
    Uncertainty,
)
from calib_core.settings import CalibrateSettings
from calib_core.types import InitialGuess, Plane, Recording


def calibrate_published(
    recording: Recording,
    settings: CalibrateSettings,
    planes: Sequence[Plane] | None,
    guess: InitialGuess | None,
    on_event: OnEvent,
    should_cancel: ShouldCancel,
    messages: list[Message],
    started: float,
) -> Calibration:
    """The paper's method, with its own defaults (100 points a plane and scan, +-45 deg) where none was set."""
    if any(plane.outline_m is not None for plane in planes or ()):
        text = "the published method knows no outlines of planes: theirs are not used; `--method full` uses them"
        messages.append(Message(code="planes.outline_unused", level="warning", text=text))
    answer = calibrate_paper(
        recording, settings, planes=planes, initial_guess=guess, on_event=on_event, should_cancel=should_cancel
    )
    messages.extend(Message(code=f.code, level=f.level, text=f.text) for f in answer.messages)
    if isinstance(answer, PaperRefusal):
        return Calibration(refused(recording, settings, messages, time.monotonic() - started), None)
    if not answer.converged:
        messages.append(Message(code="solve.diverged", level="error", text="the published method did not converge"))
        return Calibration(refused(recording, settings, messages, time.monotonic() - started), None)
    return Calibration(_document(recording, settings, answer, messages, time.monotonic() - started), answer.trajectory)


def _document(
    recording: Recording, settings: CalibrateSettings, answer: PaperSolution, messages: list[Message], duration_s: float
) -> CalibrationResult:
    information = np.asarray(np.linalg.inv(answer.covariance), dtype=np.float64)
    standing = [1.0] * 3 + [10.0] * 3 + [10.0]
    rows = tuple(PriorRow(i, 0.0, std) for i, std in enumerate(standing))
    information = information + np.diag(1.0 / np.array(standing) ** 2)
    knowledge = assess(information, Priors(answer.R_imu_lidar, rows, answer.gravity_m_s2, 0.0))
    std = np.sqrt(np.diag(knowledge.covariance))
    messages.append(
        Message(
            code="uncertainty.published",
            level="warning",
            text="the standard deviations are those of the published cost, whose factor balance is not a noise model: "
            "use `--method full` for error bars",
        )
    )
    return CalibrationResult(
        status="weak" if knowledge.is_weak else "calibrated",
        messages=messages,
        T_imu_lidar=Transform(
            matrix=transform_matrix(answer.R_imu_lidar, answer.p_imu_lidar).tolist(),
            translation_m=answer.p_imu_lidar.tolist(),
            quaternion_xyzw=quaternion_xyzw(answer.R_imu_lidar),
            euler_xyz_deg=euler_xyz_deg(answer.R_imu_lidar),
        ),
        time_offset_s=answer.time_offset_s,
        time_offset_ns=answer.time_offset_ns,
        gyroscope_bias_rad_s=answer.gyro_bias_rad_s.tolist(),
        accelerometer_bias_m_s2=answer.accel_bias_m_s2.tolist(),
        gravity_m_s2=answer.gravity_m_s2,
        uncertainty=Uncertainty(
            rotation_std_deg=np.degrees(std[:3]).tolist(),
            translation_std_m=std[3:6].tolist(),
            time_offset_std_s=float(std[6]),
            gravity_std_m_s2=0.0,
            covariance=knowledge.covariance.tolist(),
        ),
        observability=Observability(weak_directions=list(knowledge.weak)),
        quality=Quality(
            point_to_plane_rms_m=answer.rms_m,
            points_used=answer.points_used,
            scans_used=answer.scans_used,
            scans_total=recording.scans_total or answer.scans_total,
            planes=[
                PlaneQuality(
                    name=p.plane.name,
                    normal=p.plane.normal.tolist(),
                    offset_m=p.plane.offset_m,
                    points=p.n_points,
                    rms_m=p.rms_m,
                )
                for p in answer.planes
            ],
            iterations=answer.iterations,
            duration_s=duration_s,
        ),
        provenance=provenance(recording, settings),
    )
