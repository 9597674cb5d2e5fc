"""Where the joint estimation begins when the IMU was not recorded yet while the lidar was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.events import ignore_event, never_cancel
from calib_core.full.initialise.start import LidarTrack, LinearStart, RotationStart, Start
from calib_core.full.joint.estimation import JointData
from calib_core.full.joint.first_estimate import begin, map_planes
from calib_core.full.joint.state_views import map_pose
from calib_core.full.odometry.reference import Followed
from calib_core.full.prepare.prepare import prepare
from calib_core.settings import CalibrateSettings, ImuNoise
from calib_core.simulate import Truth
from calib_core.types import FloatArray, ImuData, Plane, Recording
from tests.core.full.joint.conftest import PLANES_GIVEN, true_motions


def _late(imu: ImuData, by_s: float) -> ImuData:
    kept = imu.stamps_ns > imu.stamps_ns[0] + round(by_s * 1e9)
    return replace(imu, stamps_ns=imu.stamps_ns[kept], gyro_rad_s=imu.gyro_rad_s[kept], accel_m_s2=imu.accel_m_s2[kept])


def _outlined(plane: Plane) -> Plane:
    across = np.linalg.svd(plane.normal[None])[2][1:]
    corners = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) @ across
    return replace(plane, outline_m=corners - plane.offset_m * plane.normal)


def _off_plane_m(plane: Plane, points: FloatArray) -> FloatArray:
    return points @ plane.normal + plane.offset_m


def _begun(recording: Recording, truth: Truth) -> JointData:
    known = ImuNoise(gyroscope_noise_density_rad_s_sqrt_hz=2e-4, accelerometer_noise_density_m_s2_sqrt_hz=2e-3)
    run = prepare(recording, CalibrateSettings(imu_noise=known), ignore_event, never_cancel)
    motions = true_motions(truth, run.clocks.lidar_epoch_ns, run.clocks.scan_s)
    rotation = RotationStart(run.clocks.offset_s(truth.time_offset_ns), truth.R_imu_lidar, np.zeros(3), 0.0, 1.0, None)
    start = Start(rotation, LinearStart(np.array([0.0, 0.0, -9.8]), truth.p_imu_lidar, np.zeros(3), 0.0))
    lidar = LidarTrack.of(motions, run.clocks.scan_s, run.clocks.sweep_s)
    return begin(run, Followed(0, list(truth.planes), motions), lidar, start, None, PLANES_GIVEN)[0]


def test_links_know_of_steps_and_of_what_was_lost(noisy: tuple[Recording, Truth]) -> None:
    """An accelerometer of 0.2 m/s2, and one of whose readings some were lost on a rough road. Mutations: either left out; steps
    that are not told to whoever looks for tones.
    """
    recording, truth = noisy
    imu = recording.imu
    coarse = replace(imu, accel_m_s2=np.rint(imu.accel_m_s2 / 0.2) * 0.2)
    of_steps, of_none = _begun(replace(recording, imu=coarse), truth), _begun(recording, truth)
    assert (of_steps.run.noise.coarse, of_none.run.noise.coarse) == (True, False)
    looser, usual = of_steps.readings.excess_density2, of_none.readings.excess_density2
    assert np.mean(looser[:, 3:] - usual[:, 3:]) > 0.2**2 / 12.0 * 0.01
    assert np.allclose(looser[:, :3], usual[:, :3])
    rough = 0.3 * np.random.default_rng(1).standard_normal(imu.accel_m_s2.shape)
    kept = np.ones(len(imu.stamps_ns), np.bool_)
    kept[150:-150:100] = False
    lossy = ImuData(imu.stamps_ns[kept], imu.gyro_rad_s[kept], (imu.accel_m_s2 + rough)[kept])
    looser = _begun(replace(recording, imu=lossy), truth).readings.excess_density2[:, 3:].max(axis=1)
    assert np.count_nonzero(looser > 1.5 * np.median(looser)) == np.count_nonzero(~kept)


@pytest.mark.parametrize("late_s", [0.0, 0.3, 2.0])
def test_the_map_is_the_frame_of_a_scan_that_the_imu_covers(clean: tuple[Recording, Truth], late_s: float) -> None:
    """The planes are of the first scan; an IMU recorded from 2 s on knows nothing of where the lidar was then. Seen: five seconds
    were guessed backwards, the map laid hundreds of metres away, and the equations were singular.

    A moment that the IMU missed at the beginning changes nothing: the planes stay in the frame of the scan they were shown in.
    The lidar's pose at the map's instant is no turn and no way; planes, outlines and gravity are told from there.
    Mutations: the longest range unknown, or the grid that left its points; keep the reference; move it for 0.3 s too; move the
    planes and not the track, or not gravity; outlines left, or what was dropped; nobody late, nothing dropped.
    """
    recording, truth = clean
    recording = replace(recording, imu=_late(recording.imu, late_s))
    run = prepare(recording, CalibrateSettings(), ignore_event, never_cancel)
    clocks = run.clocks
    motions = true_motions(truth, clocks.lidar_epoch_ns, clocks.scan_s)
    to_map = truth.lidar(np.array([(truth.map_time_ns - truth.epoch_ns) * 1e-9])).R_world[0].T
    rotation = RotationStart(clocks.offset_s(truth.time_offset_ns), truth.R_imu_lidar, np.zeros(3), 0.0, 1.0, None)
    linear = LinearStart(to_map @ truth.gravity_world_m_s2, truth.p_imu_lidar, np.zeros(3), 0.0)
    planes = [_outlined(plane) for plane in truth.planes]
    came_late = tuple(k == 4 for k in range(len(planes)))
    followed = Followed(0, planes, motions, late=came_late, dropped=planes[:1])
    lidar = LidarTrack.of(motions, clocks.scan_s, clocks.sweep_s)
    data, state, _ = begin(replace(run, sieve_m=0.1), followed, lidar, Start(rotation, linear), None, PLANES_GIVEN)
    assert state.lidar_noise.sieve_m == 0.1
    assert [plane.late for plane in state.planes] == list(came_late)
    (dropped,) = data.dropped  # as the plane itself, which is told in the map's frame
    np.testing.assert_allclose(
        [*dropped.normal, dropped.offset_m], [*state.estimate.normals[0], state.estimate.offsets_m[0]]
    )
    farthest_m = max(float(np.linalg.norm(scan.points["xyz"], axis=1).max()) for scan in recording.scans)
    assert farthest_m - 0.1 < state.lidar_noise.farthest_m <= farthest_m
    assert state.lidar_noise.nearest_m == run.nearest_m
    first = data.reference
    assert (first == 0) == (late_s < 1.0)
    assert first == 0 or clocks.scan_s[first] > clocks.scan_s[0] + 1.5
    R, p = map_pose(data, state)
    np.testing.assert_allclose(R, np.eye(3), atol=2e-3)
    np.testing.assert_allclose(p, 0.0, atol=5e-3)
    lidar_s = np.array([clocks.scan_s[first]]) + (clocks.lidar_epoch_ns - truth.epoch_ns) * 1e-9
    np.testing.assert_allclose(
        state.estimate.gravity, truth.lidar(lidar_s).R_world[0].T @ truth.gravity_world_m_s2, atol=1e-6
    )
    for plane, name, normal, offset_m in zip(
        followed.planes, state.planes, state.estimate.normals, state.estimate.offsets_m, strict=True
    ):
        assert name.outline_m is not None
        np.testing.assert_allclose(_off_plane_m(Plane("", normal, float(offset_m)), name.outline_m), 0.0, atol=1e-9)
        origin_m = -motions[first].R.T @ motions[first].p  # where the first scan's origin is seen from there
        assert normal @ origin_m + offset_m == pytest.approx(plane.offset_m, abs=1e-9)


def test_a_plane_was_found_where_somebody_was_shown_it() -> None:
    """A proposal whose plane the straightened sweep has laid elsewhere, and one that came into view on the way.

    Mutations: as the track has it; by their order.
    """
    level = np.array([0.0, 0.0, 1.0])
    shown = (Plane("wall", np.array([1.0, 0.0, 0.0]), 2.0), Plane("floor", level, 0.6))
    planes = [Plane("floor", level, 0.65), Plane("floor 2", level, 1.31)]
    track = Followed(0, planes, [], proposals=shown, of_proposal=(1, -1), late=(False, True))
    assert [plane.found_m for plane in map_planes(track)] == [0.6, 1.31]
    assert [plane.late for plane in map_planes(track)] == [False, True]
