"""The motion of a recording with its calibration known: what taking the motion out of the sweeps needs.

Where planes are seen, the joint solve runs once more with the calibration held by priors far tighter than any
recording could contradict; its trajectory carries turning and moving. Where none are seen (another recording, a
skew that the solve bridged) the gyroscope's turning is used alone, with the IMU taken as standing: over one sweep
turning is what smears a cloud most. What the calibration found of single lasers can be taken out of the points before.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calib_core.deskew import deskew_points
from calib_core.errors import InputError, Refused, SettingsError
from calib_core.events import LogEvent, OnEvent, ShouldCancel, ignore_event, never_cancel
from calib_core.full.assess.own_errors import lasers_of
from calib_core.full.calibrate import calibrate_full
from calib_core.full.clock_skew import without_skew
from calib_core.full.initialise.initial_guess import HELD_REFUTED
from calib_core.full.prepare.prepare import prepare, require_length
from calib_core.imu.integrated_rotation import turned_since
from calib_core.intrinsics import CLOCK_RATE_STD_PPM
from calib_core.maps.accumulate import covers
from calib_core.method import Answer
from calib_core.result import CalibrationResult
from calib_core.settings import CalibrateSettings, Prior
from calib_core.threads import one_blas_thread
from calib_core.types import Float32Array, FloatArray, ImuData, InitialGuess, Recording, Scan, Trajectory

#: Held to a micrometre, a microradian and a microsecond.
HELD_STD = 1e-6


@dataclass(frozen=True)
class HeldMotion:
    """The motion of a recording with its calibration held.

    solved: where planes gave it; None where they did not.   turning: the gyroscope's alone, all through.   correct: what is
    done to a scan's points before.
    """

    solved: Trajectory | None
    turning: Trajectory
    correct: Callable[[Scan], Scan] = lambda scan: scan

    def deskew(self, scan: Scan) -> Float32Array:
        """(N, 3) [m]: the scan's points in the lidar frame at its first point's time."""
        known = self.solved is not None and covers(self.solved, scan)
        return deskew_points(self.correct(scan), self.solved if known and self.solved is not None else self.turning)


def held_motion(
    recording: Recording,
    result: CalibrationResult,
    *,
    correct_lasers: bool = False,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> HeldMotion:
    """The motion of `recording` with the result's calibration held.

    correct_lasers: what the calibration found of the lasers is taken out of the points, too.   Raises InputError where the
    recording's own motion refutes the calibration.
    """
    for text in other_frames(recording, result):
        on_event(LogEvent(level="warning", code="deskew.other_frame", text=text))
    correct = laser_corrector(result) if correct_lasers else _as_published
    guess, priors = held_calibration(result, recording)
    turning = turning_alone(recording.imu, guess, np.array(result.gyroscope_bias_rad_s or [0.0, 0.0, 0.0]))
    settings = _as_solved(result).model_copy(update={"priors": priors, "crispness": False})
    try:
        solved = _solved_motion(recording, settings, guess, on_event, should_cancel)
    except Refused as refused:
        raise InputError(
            f"Expected the calibration of the sensors of {recording.name}, but the one from {result.provenance.recording.name} "
            f"does not fit this recording: {refused}; name the calibration of this rig, or calibrate this recording.",
            code="deskew.other_calibration",
        ) from refused
    if solved is None:
        text = "The planes of this recording do not determine its motion: only the gyroscope's rotation is taken out."
        on_event(LogEvent(level="warning", code="deskew.turning_only", text=text))
    return HeldMotion(solved, turning, correct)


def other_frames(recording: Recording, result: CalibrationResult) -> list[str]:
    """A sentence for each sensor whose frame in the recording is not the one that the result was found in, where both are named.

    A lidar's driver publishes in one of two frames that are half a turn apart (Ouster's os_lidar and os_sensor), and a rig may
    have two lidars: an extrinsic of the other takes out a motion that never was.
    """
    found = result.provenance.recording
    pairs = (
        ("lidar", recording.lidar.frame_id, found.lidar_frame_id),
        ("IMU", recording.imu.frame_id, found.imu_frame_id),
    )
    return [
        f"The {sensor} of {recording.name} is in the frame {here}, but the calibration from {found.name} is of the frame "
        f"{there}: it is right only if both names mean the same axes; check the drivers, or calibrate this recording."
        for sensor, here, there in pairs
        if here and there and here.lstrip("/") != there.lstrip("/")
    ]


def laser_corrector(result: CalibrationResult) -> Callable[[Scan], Scan]:
    """A function that takes the lasers' errors out of a scan's points. Raises SettingsError where none are known."""
    found = {(each.block, each.name): each.value for each in result.intrinsics}
    lasers = lasers_of(found)
    if lasers is None:
        raise SettingsError(
            f"Expected parameters of lasers to correct points by, but the result of {result.provenance.recording.name} holds "
            "none; calibrate again with `--intrinsics auto`, or leave --correct-lasers out."
        )
    return lasers.corrected


def _as_published(scan: Scan) -> Scan:
    return scan


def _solved_motion(
    recording: Recording,
    settings: CalibrateSettings,
    guess: InitialGuess,
    on_event: OnEvent,
    should_cancel: ShouldCancel,
) -> Trajectory | None:
    """The motion by the joint solve; None where the recording gives none. Raises Refused where it refutes the calibration."""

    def solve(stamped: Recording, clock_rate_std_ppm: float) -> Answer:
        run = prepare(stamped, settings, on_event, should_cancel)
        return calibrate_full(replace(run, clock_rate_std_ppm=clock_rate_std_ppm), None, guess)

    try:
        require_length(recording, "the motion")
        with one_blas_thread():
            return without_skew(recording, solve)[0].trajectory
    except Refused as refused:
        if refused.code == HELD_REFUTED:
            raise
        return None


def _as_solved(result: CalibrationResult) -> CalibrateSettings:
    """What the calibration takes stamps to mean: one whose IMU's stamps were put on a line holds for the line."""
    known = result.provenance.settings
    imu, lidar = known.get("imu_sampling"), known.get("lidar_sampling")
    return CalibrateSettings(
        imu_sampling=imu if imu in {"as-stamped", "even"} else "detect",
        lidar_sampling="as-stamped" if lidar == "as-stamped" else "detect",
        cloud="as-sent" if known.get("cloud") == "as-sent" else "detect",
    )


def turning_alone(imu: ImuData, calibration: InitialGuess, gyro_bias_rad_s: FloatArray) -> Trajectory:
    """The lidar's motion if the IMU only turned."""
    if calibration.R_imu_lidar is None or calibration.p_imu_lidar is None or calibration.time_offset_ns is None:
        raise ValueError("the turning alone needs a whole calibration")
    epoch_ns = int(imu.stamps_ns[0]) + calibration.time_offset_ns
    times_s = (imu.stamps_ns - imu.stamps_ns[0]) * 1e-9
    R_first_imu = turned_since(times_s, imu.gyro_rad_s - gyro_bias_rad_s)
    return Trajectory(
        epoch_ns=epoch_ns,
        times_s=times_s,
        R_map_lidar=R_first_imu @ calibration.R_imu_lidar,
        p_map_lidar=R_first_imu @ calibration.p_imu_lidar,
        valid=np.ones(times_s.size, dtype=bool),
    )


def held_calibration(
    result: CalibrationResult, recording: Recording | None = None
) -> tuple[InitialGuess, tuple[Prior, ...]]:
    """The calibration as a start, and priors that keep it there. Raises SettingsError where it was refused.

    recording: whose motion is asked for. What the clocks' rates make of the offset is known of the recording it was found in.
    """
    if result.T_imu_lidar is None or result.time_offset_ns is None:
        raise SettingsError(
            f"Expected a result with a calibration, but that of {result.provenance.recording.name} has the status "
            f"`{result.status}` and holds none; calibrate a recording with more motion first."
        )
    of_same = recording is not None and recording.sha256 and recording.sha256 == result.provenance.recording.sha256
    away_s = recording.middle_s - (result.time_offset_at_s or 0.0) if recording is not None and of_same else 0.0
    gained_s = 1e-6 * (result.clock_rate_ppm or 0.0) * away_s
    unsure_s = 1e-6 * CLOCK_RATE_STD_PPM * away_s if result.clock_rate_ppm is None else 0.0
    offset_ns = result.time_offset_ns + round(1e9 * gained_s)
    return held(np.array(result.T_imu_lidar.matrix), offset_ns, offset_std_s=math.hypot(HELD_STD, unsure_s))


def held(
    T_imu_lidar: FloatArray, time_offset_ns: int, *, offset_std_s: float = HELD_STD
) -> tuple[InitialGuess, tuple[Prior, ...]]:
    """A calibration as a start, and priors that keep it there. T_imu_lidar: (4, 4)."""
    R_imu_lidar, p_imu_lidar = T_imu_lidar[:3, :3], T_imu_lidar[:3, 3]
    guess = InitialGuess(R_imu_lidar=R_imu_lidar, p_imu_lidar=p_imu_lidar, time_offset_ns=time_offset_ns)
    x, y, z = (float(value) for value in p_imu_lidar)
    turns = (Prior(axis="rx", value=0.0, std=HELD_STD), Prior(axis="ry", value=0.0, std=HELD_STD))
    places = (Prior(axis="tx", value=x, std=HELD_STD), Prior(axis="ty", value=y, std=HELD_STD))
    last = (Prior(axis="tz", value=z, std=HELD_STD), Prior(axis="dt", value=time_offset_ns * 1e-9, std=offset_std_s))
    return guess, (*turns, Prior(axis="rz", value=0.0, std=HELD_STD), *places, *last)
