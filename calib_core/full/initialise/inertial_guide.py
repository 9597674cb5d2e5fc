"""Whether the lidar went as the IMU has felt it, looked at while it is followed by its planes alone.

A person who walks by draws a track along, and what joins the planes from there on holds it there: followed to its end, it
would have to be followed again. Some seconds of it tell rotation, lever arm, gravity and bias well enough for the next step:
from where the lidar was in the last second and a half,

    p_lidar(t) = R(t) l + p_0 + v t + g t^2 / 2 + the readings' double integral,       l: from the IMU to the lidar, lidar axes

with p_0 and v by least squares. From the first motion that was not felt, the track goes on by that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib_core.full.initialise.agreement import agreement
from calib_core.full.initialise.inertial_motion import GyroTurning, TrackCheck, check_track, told_rotation
from calib_core.full.initialise.linear import double_integral
from calib_core.full.initialise.settings import AGREEING, GUIDING, LINEAR
from calib_core.full.initialise.start import LidarTrack, RotationStart
from calib_core.full.odometry.motion_prior import Misled, Turning
from calib_core.full.odometry.register import ScanMotion, is_determined
from calib_core.full.odometry.within_sweeps import require_measured_sweeps
from calib_core.full.run import Run
from calib_core.geometry import log
from calib_core.types import BoolArray, FloatArray


@dataclass(frozen=True)
class ImuMotion:
    """The IMU's motion from scan to scan, on from wherever a track is: dead reckoning with start values of the track.

    scan_s: (M,) on the lidar's clock.   R: (M, 3, 3) world <- lidar, by the gyroscope, at each scan's start.   V, P: (M - 1, 3)
    world, integrals of the readings without their bias from each scan's start to the next one's, and of that integral.
    known: (M - 1,) whether the IMU says something of it.   lever_m: (3,) lidar axes, from the IMU to the lidar.   gravity: (3,)
    of the map.
    """

    turning: GyroTurning
    scan_s: FloatArray
    R: FloatArray
    V: FloatArray
    P: FloatArray
    known: BoolArray
    lever_m: FloatArray
    gravity: FloatArray

    @staticmethod
    def of(run: Run, found: TrackCheck) -> ImuMotion:
        """From what a stretch of a track has told."""
        rotation, linear = found.rotation, found.steps.start
        turning = GyroTurning.of(run, rotation)
        imu_s, scan_s = run.clocks.imu_s, run.clocks.scan_s
        at_s = scan_s - rotation.time_offset_s
        readings = run.recording.imu.accel_m_s2 - linear.accel_bias
        V, P = double_integral(imu_s, (turning.gyro.at(imu_s) @ readings[..., None])[..., 0], at_s)
        silent = np.flatnonzero(np.diff(imu_s) > GUIDING.silence_s)
        known = (at_s[:-1] >= imu_s[0]) & (at_s[1:] <= imu_s[-1])
        for start_s, end_s in zip(imu_s[silent], imu_s[silent + 1], strict=True):
            known &= (at_s[1:] < start_s) | (at_s[:-1] > end_s)
        return ImuMotion(
            turning,
            scan_s,
            turning.gyro.at(np.clip(at_s, imu_s[0], imu_s[-1])) @ rotation.R_imu_lidar,
            V,
            P,
            known,
            rotation.R_imu_lidar.T @ linear.p_imu_lidar,
            linear.gravity,
        )

    @property
    def coasts(self) -> bool:
        """As the gyroscope's turns do."""
        return self.turning.coasts

    def between(self, start_ns: int, end_ns: int) -> FloatArray | None:
        """As the gyroscope has it."""
        return self.turning.between(start_ns, end_ns)

    def turn_std_rad(self, turn_rad: float, over_s: float) -> float:
        """As the gyroscope has it."""
        return self.turning.turn_std_rad(turn_rad, over_s)

    def step(self, motions: Sequence[ScanMotion], to: int, /) -> FloatArray | None:
        """(3,) map [m] from the last scan to another, None where the IMU or the last second and a half say nothing of it."""
        last = motions[-1]
        near = [
            m for m in motions[-GUIDING.most_behind :] if self._away_s(m.position, last.position) < GUIDING.behind_s
        ]
        behind = [m for m in near if m.share > 0 and is_determined(m)]
        if len(behind) < GUIDING.fewest_behind:
            return None
        at = np.array([m.position for m in behind])
        low, high = min(int(at.min()), last.position, to), max(int(at.max()), last.position, to)
        if not self.known[low:high].all():
            return None
        t, went, lever = self._went(low, high, last)
        # What is left is a straight line.
        straight = np.array([m.p for m in behind]) - lever[at - low] - went[at - low]
        from_mean = t[at - low] - t[at - low].mean()
        v = from_mean @ straight / (from_mean @ from_mean)
        return np.asarray(v * t[to - low] + went[to - low] + lever[to - low] - lever[last.position - low])

    def _went(self, low: int, high: int, last: ScanMotion) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Of scans from low to high: (N,) seconds since the last one's start, (N, 3) map the IMU's way since then but for some
        constant velocity, and (N, 3) map its lever arm.
        """
        origin = last.position - low
        t = self.scan_s[low : high + 1] - self.scan_s[last.position]
        map_world = last.R @ self.R[last.position].T
        velocity = np.vstack([np.zeros(3), np.cumsum(self.V[low:high], axis=0)])
        parts = self.P[low:high] + velocity[:-1] * np.diff(t)[:, None]
        way = np.vstack([np.zeros(3), np.cumsum(parts, axis=0)])
        way = way - way[origin]
        lever = (map_world @ self.R[low : high + 1]) @ self.lever_m
        return t, way @ map_world.T + 0.5 * self.gravity * t[:, None] ** 2, lever

    def has_felt(self, motions: Sequence[ScanMotion], newest: ScanMotion) -> bool | None:
        """Whether the IMU has felt the newest motion after those; None where it says nothing of it."""
        last, step = motions[-1], self.step(motions, newest.position)
        if step is None:
            return None
        turned = self.R[last.position].T @ self.R[newest.position]
        apart_rad = np.linalg.norm(log(turned.T @ last.R.T @ newest.R))
        apart_m = np.linalg.norm(newest.p - last.p - step)
        most_rad, most_m = AGREEING.leap_rad, LINEAR.astray_times * LINEAR.position_std_m
        return bool(apart_rad < GUIDING.times * most_rad and apart_m < GUIDING.times * most_m)

    def _away_s(self, one: int, other: int) -> float:
        return abs(float(self.scan_s[one] - self.scan_s[other]))


class Guide:
    """The guide of one track: compares each motion with the IMU, and leads from the first one on that was not felt.

    led: whether it has led the track for any scan.
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self._known: ImuMotion | None = None
        self._told: RotationStart | None = None
        self._leads = False
        self._next_s = GUIDING.first_s
        self._begun_by: type[Turning] | None = None
        self.led = False

    @property
    def leading(self) -> Turning | None:
        """What it leads the track by; None where it does not."""
        return self._known if self._leads else None

    def lead(self, motions: Sequence[ScanMotion], newest: ScanMotion | None) -> Turning | None:
        """What leads the track on, once its newest motion was not felt, or is none; None as long as each was, or none is known.

        Raises Misled where what lies behind was not felt, either.
        """
        if self._known is None or self._leads:
            self._look_back(motions)
        if self._known is None:
            return None
        if not self._leads and newest is not None:
            if self._known.has_felt(motions, newest) is not False:
                return None
            self._learn(motions)  # what the first seconds told may be what is wrong
            if self._known.has_felt(motions, newest) is not False:
                return None
        self.led = self._leads = True
        return self._known

    def _look_back(self, motions: Sequence[ScanMotion]) -> None:
        """Learn what leads the track from what lies behind, now and then."""
        scan_s = self._run.clocks.scan_s
        last_s = scan_s[motions[-1].position]
        if abs(last_s - scan_s[motions[0].position]) < self._next_s:
            return
        self._next_s = max(self._next_s + GUIDING.again_s, GUIDING.again_times * self._next_s if self._leads else 0.0)
        over_s = np.inf if self._leads else GUIDING.over_s
        self._learn([m for m in motions if abs(last_s - scan_s[m.position]) < over_s])

    def _learn(self, motions: Sequence[ScanMotion]) -> None:
        """Learn what leads the track from those motions, where they tell it. Raises Misled where they went astray."""
        run = self._run
        part = sorted(motions, key=lambda m: m.position)
        at = [m.position for m in part]
        lidar = LidarTrack.of(part, run.clocks.scan_s[at], run.clocks.sweep_s[at])
        alike = agreement(lidar, run.clocks.imu_s, run.recording.imu.gyro_rad_s)
        if alike.correlation < AGREEING.trusted or not alike.is_of_a_unit:
            return
        rotation = told_rotation(run, lidar)
        if rotation is None or rotation.open_axis_imu is not None:
            return
        if self.led and self._told is not None:
            rotation = _no_surer(rotation, self._told)
        self._told = rotation
        found = check_track(run, part, lidar, rotation)
        leading = ImuMotion.of(run, found) if found.tells else None
        if leading is not None:
            self._known = leading
        turning = leading or GyroTurning.of(run, rotation)
        if found.faults > 0 and self._begun_by not in (type(turning), ImuMotion):
            if self._begun_by is None:
                # Rates within the sweeps are the gyroscope's from here on, and tell no more whether the clouds are raw.
                require_measured_sweeps(run, found.sound)
            self.led, self._leads, self._begun_by, self._next_s = (
                True,
                leading is not None,
                type(turning),
                GUIDING.first_s,
            )
            raise Misled(turning)


def _no_surer(told: RotationStart, before: RotationStart) -> RotationStart:
    """What a track tells that was led by what was told before: how well the two fit says little of how right either is, and a
    track that is twice as long tells twice as much.
    """
    half = GUIDING.surer
    return replace(
        told,
        std_rad=max(told.std_rad, half * before.std_rad),
        bias_std_rad_s=max(told.bias_std_rad_s, half * before.bias_std_rad_s),
    )
