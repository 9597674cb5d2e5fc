"""The result document: one builder for what either method answers, and for what could not be answered."""

from __future__ import annotations

import platform
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from calib_core.events import Event, LogEvent, OnEvent, ShouldCancel
from calib_core.geometry import euler_xyz_deg, quaternion_xyzw, transform_matrix
from calib_core.pace import rate_hz
from calib_core.result import (
    CalibrationResult,
    Evidence,
    GyroscopeAxes,
    Intrinsic,
    Message,
    Observability,
    PlaneQuality,
    Provenance,
    Quality,
    RecordingProvenance,
    Transform,
    Uncertainty,
    WeakDirection,
)
from calib_core.settings import Axis, CalibrateSettings, ImuNoise
from calib_core.types import FloatArray, InitialGuess, Plane, Recording, Trajectory


class Heard:
    """What is said on the way to one answer, each sentence once; all events go on to the listener.

    messages: so far, those before included.
    """

    def __init__(self, on_event: OnEvent, before: Sequence[Message]) -> None:
        self._on_event = on_event
        self.messages = list(before)

    def __call__(self, event: Event) -> None:
        if isinstance(event, LogEvent):
            message = Message(code=event.code, level=event.level, text=event.text)
            if message not in self.messages:  # a second attempt finds again what the first one did
                self.messages.append(message)
        self._on_event(event)

    def said_so_far(self) -> list[Message]:
        """A copy of the messages."""
        return list(self.messages)

    def unsay(self, before: Sequence[Message]) -> None:
        """Back to what was said before: what an attempt that led nowhere has said, or retracted, is not true of the answer."""
        self.messages[:] = before

    def retract(self, codes: Collection[str]) -> None:
        """Forget what was said under these codes: whoever said it looks again."""
        self.messages[:] = [message for message in self.messages if message.code not in codes]


@dataclass(frozen=True)
class Question:
    """What is asked of a recording, of either method.

    planes: in the map frame; None: found.   kept_in: folder in which the lidar's motion is kept for the next solve.
    """

    settings: CalibrateSettings
    planes: Sequence[Plane] | None
    guess: InitialGuess | None
    kept_in: Path | None
    on_event: OnEvent
    should_cancel: ShouldCancel


@dataclass(frozen=True)
class Answer:
    """What a method has found, before it is a document.

    R_imu_lidar (3, 3), p_imu_lidar (3,) [m], time_offset_ns: the calibration.   covariance: (7, 7) of it, in the
    contract's order.   rms_m: of all points used.   planes: in the map frame.   remarks: what the document is to say.
    clock_rate_ppm: value and standard deviation.
    """

    R_imu_lidar: FloatArray
    p_imu_lidar: FloatArray
    time_offset_ns: int
    gyro_bias_rad_s: FloatArray
    accel_bias_m_s2: FloatArray
    gravity_m_s2: float
    gravity_std_m_s2: float
    covariance: FloatArray
    is_weak: bool
    weak_axes: tuple[Axis, ...]
    weak_directions: tuple[WeakDirection, ...]
    advice: tuple[str, ...]
    rms_m: float
    points_used: int
    scans_used: int
    scans_total: int
    planes: tuple[PlaneQuality, ...]
    iterations: int
    trajectory: Trajectory
    remarks: tuple[Message, ...]
    intrinsics: tuple[Intrinsic, ...] = ()
    imu_frame: str = ""
    gyroscope_axes: GyroscopeAxes | None = None
    clock_rate_ppm: tuple[float, float] | None = None
    time_offset_at_s: float | None = None
    imu_noise: ImuNoise | None = None
    evidence: Evidence | None = None


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
