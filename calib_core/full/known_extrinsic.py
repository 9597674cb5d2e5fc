"""The motion of a recording with its calibration known: what taking the motion out of the sweeps needs.

Where planes are seen, the joint solve runs once more with the calibration held by priors far tighter than any
recording could contradict; its trajectory carries turning and moving. Where none are seen (another recording, a
stretch that the solve bridged) the gyroscope's turning is used alone, with the IMU taken as standing: over one sweep
turning is what smears a cloud most. What the calibration found of single lasers can be taken out of the points before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from calib_core.deskew import deskew_points
from calib_core.errors import Refused, SettingsError
from calib_core.events import LogEvent, OnEvent, ShouldCancel, ignore_event, never_cancel
from calib_core.factors.laser_features import LaserErrors
from calib_core.full.calibrate import calibrate_full
from calib_core.full.prepare.prepare import prepare, require_length
from calib_core.geometry import exp
from calib_core.result import CalibrationResult
from calib_core.settings import CalibrateSettings, Prior
from calib_core.types import Float32Array, FloatArray, ImuData, InitialGuess, Recording, Scan, Trajectory

#: Held to a micrometre, a microradian and a microsecond.
HELD_STD = 1e-6
#: A scan may begin or end this long outside of the solved motion: the solve's own first and last knots.
_OVERHANG_S = 0.02


def deskewer(
    recording: Recording,
    result: CalibrationResult,
    *,
    correct_lasers: bool = False,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> Callable[[Scan], Float32Array]:
    """A function that takes the motion out of a scan of `recording`: (N, 3) [m], lidar frame, first point's time.

    correct_lasers: take out what the calibration found of the lasers, too.
    """
    correct = laser_corrector(result) if correct_lasers else _as_published
    guess, priors = held_calibration(result)
    turning = turning_alone(recording.imu, guess, np.array(result.gyroscope_bias_rad_s or [0.0, 0.0, 0.0]))
    settings = _as_solved(result).model_copy(update={"priors": priors})
    solved = _solved_motion(recording, settings, guess, on_event, should_cancel)
    if solved is None:
        text = "The planes of this recording do not give its motion: only the gyroscope's turning is taken out."
        on_event(LogEvent(level="warning", code="deskew.turning_only", text=text))

    def deskew(scan: Scan) -> Float32Array:
        scan = correct(scan)
        return deskew_points(scan, solved if solved is not None and covers(solved, scan) else turning)

    return deskew


def laser_corrector(result: CalibrationResult) -> Callable[[Scan], Scan]:
    """A function that takes the lasers' errors out of a scan's points. Raises SettingsError where none are known."""
    found = {(each.block, each.name): each.value for each in result.intrinsics}
    blocks = ("laser_range_offset", "laser_range_scale", "laser_elevation", "laser_azimuth")
    rings = [int(name) for block, name in found if block in blocks and name.isdecimal()]
    every = found.get(("range_offset", "all"), 0.0)
    if not rings and not every:
        raise SettingsError(
            f"Expected parameters of lasers to correct points by, but the result of {result.provenance.recording.name} holds "
            "none; calibrate again with `--intrinsics auto`, or leave --correct-lasers out."
        )
    # Where lasers are not told apart, one stands for all.
    lasers = max(rings, default=0) + 1
    offset, scale, elevation, azimuth = (
        np.array([found.get((block, str(laser)), 0.0) for laser in range(lasers)]) for block in blocks
    )
    errors = LaserErrors(offset + every, scale, elevation, azimuth, 0.0)

    def correct(scan: Scan) -> Scan:
        points = scan.points.copy()
        laser = points["ring"] if rings else np.zeros_like(points["ring"])
        points["xyz"] = errors.corrected(np.ascontiguousarray(points["xyz"]), np.ascontiguousarray(laser))
        return replace(scan, points=points)

    return correct


def _as_published(scan: Scan) -> Scan:
    return scan


def _solved_motion(
    recording: Recording,
    settings: CalibrateSettings,
    guess: InitialGuess,
    on_event: OnEvent,
    should_cancel: ShouldCancel,
) -> Trajectory | None:
    """The motion by the joint solve; None where the recording does not give it."""
    try:
        require_length(recording, "the motion")
        # Small matrices by the thousand: a second BLAS thread only ever waits, and one thread gives one answer.
        with threadpool_limits(limits=1, user_api="blas"):
            return calibrate_full(prepare(recording, settings, on_event, should_cancel), None, guess).trajectory
    except Refused:
        return None


def _as_solved(result: CalibrationResult) -> CalibrateSettings:
    """What the calibration takes stamps to mean: one whose IMU's stamps were put on a line holds for the line."""
    match result.provenance.settings.get("imu_sampling"):
        case "as-stamped":
            return CalibrateSettings(imu_sampling="as-stamped")
        case "even":
            return CalibrateSettings(imu_sampling="even")
        case _:
            return CalibrateSettings()


def covers(trajectory: Trajectory, scan: Scan) -> bool:
    """Whether the motion is known, and not bridged, all through the sweep."""
    start_s = (scan.stamp_ns - trajectory.epoch_ns) * 1e-9
    end_s = start_s + (float(scan.points["offset_ns"].max()) * 1e-9 if scan.points.size else 0.0)
    t = trajectory.times_s
    if start_s < t[0] - _OVERHANG_S or end_s > t[-1] + _OVERHANG_S:
        return False
    first = max(int(np.searchsorted(t, start_s, side="right")) - 1, 0)
    last = min(int(np.searchsorted(t, end_s, side="left")), t.size - 1)
    return bool(trajectory.valid[first : last + 1].all())


def turning_alone(imu: ImuData, calibration: InitialGuess, gyro_bias_rad_s: FloatArray) -> Trajectory:
    """The lidar's motion if the IMU only turned: its rates integrated, each held from one reading to the next."""
    if calibration.R_imu_lidar is None or calibration.p_imu_lidar is None or calibration.time_offset_ns is None:
        raise ValueError("the turning alone needs a whole calibration")
    epoch_ns = int(imu.stamps_ns[0]) + calibration.time_offset_ns
    times_s = (imu.stamps_ns - imu.stamps_ns[0]) * 1e-9
    middle_rad_s = 0.5 * (imu.gyro_rad_s[1:] + imu.gyro_rad_s[:-1]) - gyro_bias_rad_s
    steps = exp(middle_rad_s * np.diff(times_s)[:, None])
    R_first_imu = np.empty((times_s.size, 3, 3))
    R_first_imu[0] = np.eye(3)
    for k, step in enumerate(steps):
        R_first_imu[k + 1] = R_first_imu[k] @ step
    return Trajectory(
        epoch_ns=epoch_ns,
        times_s=times_s,
        R_map_lidar=R_first_imu @ calibration.R_imu_lidar,
        p_map_lidar=R_first_imu @ calibration.p_imu_lidar,
        valid=np.ones(times_s.size, dtype=bool),
    )


def held_calibration(result: CalibrationResult) -> tuple[InitialGuess, tuple[Prior, ...]]:
    """The calibration as a start, and priors that keep it there. Raises SettingsError where it was refused."""
    if result.T_imu_lidar is None or result.time_offset_ns is None:
        raise SettingsError(
            f"Expected a calibration to take the motion out with, but the result of {result.provenance.recording.name} "
            f"has the status `{result.status}` and holds none; calibrate a recording with more motion first."
        )
    T = np.array(result.T_imu_lidar.matrix)
    guess = InitialGuess(R_imu_lidar=T[:3, :3], p_imu_lidar=T[:3, 3], time_offset_ns=result.time_offset_ns)
    x, y, z = (float(value) for value in T[:3, 3])
    turns = (Prior(axis="rx", value=0.0, std=HELD_STD), Prior(axis="ry", value=0.0, std=HELD_STD))
    places = (Prior(axis="tx", value=x, std=HELD_STD), Prior(axis="ty", value=y, std=HELD_STD))
    last = (Prior(axis="tz", value=z, std=HELD_STD), Prior(axis="dt", value=result.time_offset_ns * 1e-9, std=HELD_STD))
    return guess, (*turns, Prior(axis="rz", value=0.0, std=HELD_STD), *places, *last)
