"""What a calibration method, `full` or `paper`, is asked, and what it answers: the records between them and `calibrate.py`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calib_core.events import ShouldCancel
from calib_core.message_log import MessageLog
from calib_core.result import Evidence, GyroscopeAxes, Intrinsic, Message, PlaneQuality, WeakDirection
from calib_core.settings import Axis, CalibrateSettings, ImuNoise
from calib_core.types import FloatArray, InitialGuess, Plane, Trajectory


@dataclass(frozen=True)
class Question:
    """What is asked of a recording.

    planes: those that count, in the map frame; None: all that are found.
    guess: start values that are known beforehand; None: all are found.
    cache_dir: folder in which the lidar's motion is kept for the next solve of the same recording; None: nothing is kept.
    log: who hears events; its messages become the result's.
    told_at_ns: stamp of the scan in whose frame the planes were proposed, where scans were left out since; None: none were.
    """

    settings: CalibrateSettings
    planes: Sequence[Plane] | None
    guess: InitialGuess | None
    cache_dir: Path | None
    log: MessageLog
    should_cancel: ShouldCancel
    told_at_ns: int | None = None


@dataclass(frozen=True)
class Answer:
    """What a method has found, before it is a document.

    R_imu_lidar: (3, 3).   p_imu_lidar: (3,) [m], IMU frame.   time_offset_ns: added to IMU stamps, exact across clock epochs.
    gyro_bias_rad_s, accel_bias_m_s2: (3,), IMU frame.   covariance: (7, 7) of the calibration in `COVARIANCE_ORDER` [rad, m, s].
    rms_m: point to plane, of all points used.   planes: in the map frame.   remarks: messages that stand behind those of the log.
    clock_rate_ppm: value and standard deviation.   time_offset_at_s: lidar time at which the time offset holds,
    from the first of the scans that the method was given.   imu_noise: as it was measured or given, in the document's units.
    at_once: mean square by which planes that are seen at the same time disagree about the time offset, 1 by chance.
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
    at_once: float = 1.0
