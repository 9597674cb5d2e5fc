"""From tracked scans and readings to a solve's inputs: start values, knots, trained windows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.paper import initial
from calib_core.paper.lidar_factor import CalibrationState
from calib_core.paper.problem import PaperState
from calib_core.paper.records import FrontEnd, ImuStates, PaperOptions
from calib_core.paper.timeline import Timeline, build_timeline
from calib_core.paper.upsample import HeldReadings, ReadingSource, train_scan_windows
from calib_core.settings import CalibrateSettings
from calib_core.types import FloatArray, InitialGuess, IntArray, Recording


@dataclass(frozen=True)
class Run:
    """One solve's inputs. time_offset_s: the prior, on the recording's relative clocks.   state: the start."""

    front: FrontEnd
    timeline: Timeline
    source: ReadingSource
    gravity_world: FloatArray
    range_std_m: float
    time_offset_s: float
    state: PaperState
    options: PaperOptions


def prepare(
    recording: Recording,
    settings: CalibrateSettings,
    front: FrontEnd,
    guess: InitialGuess | None,
    options: PaperOptions,
) -> Run:
    """Start values, knots and trained windows."""
    guess, epoch_ns = guess or InitialGuess(), front.epoch_ns
    imu, period_s = recording.imu, recording.lidar.period_s
    # Readings on the lidar's clock as far as it is known before anything is estimated.
    imu_s = seconds(imu.stamps_ns + recording.coarse_offset_ns, epoch_ns)
    poses = initial.rough_poses(front.scans)
    attitude = initial.GyroAttitude.integrate(imu_s, imu.gyro_rad_s)
    if guess.time_offset_ns is None:
        offset_s = initial.time_shift(poses, attitude)
    else:
        offset_s = (guess.time_offset_ns - recording.coarse_offset_ns) * 1e-9
    R, p = guess.R_imu_lidar, guess.p_imu_lidar
    shared = CalibrationState(
        initial.extrinsic_rotation(poses, attitude, offset_s) if R is None else R,
        np.zeros(3) if p is None else p,
        np.zeros(3),
        np.zeros(3),
        0.0,
    )
    positions = range(front.scans[0].position, front.scans[-1].position + 1)
    stamps_ns = np.array([recording.scans[i].stamp_ns for i in positions], dtype=np.int64)
    timeline = build_timeline(positions, seconds(stamps_ns, epoch_ns), period_s)
    known = options.fixed_states
    if known is None:
        at_rest = (imu_s + offset_s >= 0.0) & (imu_s + offset_s <= period_s)
        force = imu.accel_m_s2[at_rest].mean(axis=0) if at_rest.any() else imu.accel_m_s2[0]
        states = initial.initial_states(poses, attitude, timeline.start_s, shared, initial.upright(force), offset_s)
    else:
        states = ImuStates(known.R[timeline.position], known.p[timeline.position], known.v[timeline.position])
    return Run(
        front=front,
        timeline=timeline,
        source=_source(imu_s, np.hstack([imu.gyro_rad_s, imu.accel_m_s2]), timeline, offset_s, period_s, options),
        gravity_world=np.array([0.0, 0.0, -settings.gravity.magnitude_m_s2]),
        range_std_m=settings.range_std_m or front.range_std_m,
        time_offset_s=offset_s,
        state=PaperState(shared, states),
        options=options,
    )


def seconds(stamps_ns: IntArray, epoch_ns: int) -> FloatArray:
    """Stamps (N,) as seconds after an epoch."""
    return (stamps_ns - epoch_ns).astype(np.float64) * 1e-9


def _source(
    imu_s: FloatArray, values: FloatArray, timeline: Timeline, offset_s: float, period_s: float, options: PaperOptions
) -> ReadingSource:
    if options.motion_in_sweep == "held":
        return HeldReadings(imu_s, values, np.var(np.diff(values[:20], axis=0), axis=0) / 2.0)
    centre_s = timeline.start_s + 0.5 * timeline.duration_s - offset_s
    return train_scan_windows(imu_s, values, centre_s, period_s, smoothness=options.smoothness)
