"""A joint estimation that has begun from the truth: the first half of a recording is estimated, the rest lies ahead."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from calib_core.events import ignore_event, never_cancel
from calib_core.full.initialise.start import LidarTrack, LinearStart, RotationStart, Start
from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.first_estimate import begin
from calib_core.full.joint.round import one_round
from calib_core.full.joint.schedule import FULL, Schedule
from calib_core.full.odometry.reference import Followed
from calib_core.full.odometry.register import ScanMotion
from calib_core.full.prepare.prepare import prepare
from calib_core.geometry import log
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import FloatArray, Recording

#: Scans that were "tracked": three of the recording's six seconds.
TRACKED = 30
#: Neither planes join nor any are dropped: they are the room's own.
PLANES_GIVEN = replace(FULL, planes=None)


@dataclass(frozen=True)
class Half:
    """data, state: after two rounds over the tracked half.   truth: of the recording."""

    data: JointData
    state: Estimation
    truth: Truth
    schedule: Schedule = PLANES_GIVEN

    def true_lidar(self, lidar_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The lidar's true poses in the map frame at times after the first scan: R (N, 3, 3), p (N, 3)."""
        return true_lidar(self.truth, self.data.run.clocks.lidar_epoch_ns, lidar_s)


def true_lidar(truth: Truth, epoch_ns: int, lidar_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """As above."""
    return truth.map_lidar(np.asarray(lidar_s) + (epoch_ns - truth.epoch_ns) * 1e-9)


def true_motions(truth: Truth, epoch_ns: int, scan_s: FloatArray) -> list[ScanMotion]:
    """What a perfect odometry would have found of these scans."""
    h = 1e-4
    R, p = true_lidar(truth, epoch_ns, scan_s)
    after_R, after_p = true_lidar(truth, epoch_ns, scan_s + h)
    omega = log(np.swapaxes(R, 1, 2) @ after_R) / h
    return [ScanMotion(k, R[k], p[k], omega[k], (after_p[k] - p[k]) / h) for k in range(len(scan_s))]


@pytest.fixture(scope="session")
def half(clean: tuple[Recording, Truth]) -> Half:
    recording, truth = clean
    run = prepare(recording, CalibrateSettings(), ignore_event, never_cancel)
    clocks = run.clocks
    motions = true_motions(truth, clocks.lidar_epoch_ns, clocks.scan_s[:TRACKED])
    R_world_map = truth.lidar(np.array([(truth.map_time_ns - truth.epoch_ns) * 1e-9])).R_world[0]
    rotation = RotationStart(clocks.offset_s(truth.time_offset_ns), truth.R_imu_lidar, np.zeros(3), 0.0, 1.0, None)
    linear = LinearStart(R_world_map.T @ truth.gravity_world_m_s2, truth.p_imu_lidar, np.zeros(3), 0.0)
    followed = Followed(0, list(truth.planes), motions)
    lidar = LidarTrack.of(motions, clocks.scan_s[:TRACKED], clocks.sweep_s[:TRACKED])
    data, state, _ = begin(run, followed, lidar, Start(rotation, linear), None, PLANES_GIVEN)
    for each in (PLANES_GIVEN.motion, PLANES_GIVEN.coarse[-1]):
        state = one_round(data, state, each, PLANES_GIVEN.sampling)
    return Half(data, state, truth)
