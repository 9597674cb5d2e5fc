"""The lidar's motion as the IMU felt it: what the tracker leans on where what it followed was not what it took it for.

A box that is taken for the floor, or a person for a wall, draws a track aside by half a metre within a second, and the planes
that join from there on hold it there. Its own residuals hardly tell: a surface is a surface. The IMU does: nothing moved so.
Turns come from the gyroscope, steps from the accelerometer under the linear start that the sound steps tell; the track is
then followed again, hardly leaving them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib_core.full.initialise.linear import Steps, linear_steps
from calib_core.full.initialise.rotation import rotation_start
from calib_core.full.initialise.settings import AGREEING, LINEAR
from calib_core.full.initialise.start import LidarTrack, RotationStart
from calib_core.full.initialise.time_offset import GyroTurns
from calib_core.full.odometry.register import ScanMotion
from calib_core.full.run import Run
from calib_core.geometry import log
from calib_core.types import FloatArray, IntArray


@dataclass(frozen=True)
class GyroTurning:
    """The gyroscope's turns as the lidar's, under a time offset and a rotation between the two.

    epoch_ns: of the lidar's clock.   coasts: as in `Turning`.
    """

    gyro: GyroTurns
    rotation: RotationStart
    epoch_ns: int
    coasts: bool = False

    @staticmethod
    def of(run: Run, rotation: RotationStart, *, coasts: bool = False) -> GyroTurning:
        """With the bias that came with the rotation taken off."""
        gyro = GyroTurns(run.clocks.imu_s, run.recording.imu.gyro_rad_s - rotation.gyro_bias)
        return GyroTurning(gyro, rotation, run.clocks.lidar_epoch_ns, coasts)

    def between(self, start_ns: int, end_ns: int) -> FloatArray | None:
        """R (3, 3) from the lidar's axes at the end to those at the start; None of a span of which the IMU says nothing."""
        t = np.array([start_ns - self.epoch_ns, end_ns - self.epoch_ns]) * 1e-9 - self.rotation.time_offset_s
        if not self.gyro.tells(t.min(keepdims=True), t.max(keepdims=True)).all():
            return None
        R = self.gyro.at(t)
        R_c = self.rotation.R_imu_lidar
        return np.asarray(R_c.T @ R[0].T @ R[1] @ R_c)

    def turn_std_rad(self, turn_rad: float, over_s: float) -> float:
        """As the rotation and the bias are known."""
        return self.rotation.turn_std_rad(turn_rad, over_s)

    def step(self, _motions: Sequence[ScanMotion], _to: int, /) -> FloatArray | None:
        """Nothing is known of steps."""
        return None


@dataclass(frozen=True)
class Unturned:
    """The turns of a lidar whose gyroscope does not turn: none, whatever the time offset and the rotation between the two.

    Slower turning than AGREEING.least_turning_rad_s is within a third of the standard deviations at which turns are believed.
    coasts: as in `Turning`.
    """

    coasts: bool = False

    def between(self, _start_ns: int, _end_ns: int, /) -> FloatArray:
        """R (3, 3): the same axes."""
        return np.eye(3)

    def turn_std_rad(self, _turn_rad: float, _over_s: float, /) -> float:
        """As wrong as turns that are believed may be."""
        return np.inf

    def step(self, _motions: Sequence[ScanMotion], _to: int, /) -> FloatArray | None:
        """Nothing is known of steps."""
        return None


@dataclass(frozen=True)
class OwnTurns:
    """The turns of a lidar that its planes alone tell, while one direction of its place may stay open.

    As of a vehicle on the floor of a corridor: it turns about one axis alone, and no gyroscope's turns are known as the lidar's.
    """

    coasts: bool = True

    def between(self, _start_ns: int, _end_ns: int, /) -> FloatArray | None:
        """Nothing else is known of turns."""
        return None

    def turn_std_rad(self, _turn_rad: float, _over_s: float, /) -> float:
        """As wrong as turns that are believed may be."""
        return np.inf

    def step(self, _motions: Sequence[ScanMotion], _to: int, /) -> FloatArray | None:
        """Nothing is known of steps."""
        return None


@dataclass(frozen=True)
class GyroAndSteps:
    """The gyroscope's turns, and the steps from scan to scan that the accelerometer felt along one track.

    steps_m: by position of a scan, (3,) map, the step to the next scan.
    """

    turning: GyroTurning
    steps_m: dict[int, FloatArray]

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
        """(3,) map [m] from the last scan to another, None where one between them is not known."""
        position = motions[-1].position
        first, last = min(position, to), max(position, to)
        parts = [self.steps_m.get(each) for each in range(first, last)]
        known = [part for part in parts if part is not None]
        if len(known) < len(parts) or not known:
            return None
        whole = np.sum(known, axis=0)
        return np.asarray(whole if to > position else -whole)


@dataclass(frozen=True)
class TrackCheck:
    """A track compared with the IMU, motion by motion.

    rotation, steps: the start values by the track, and its steps as the accelerometer felt them.   leaps: places in `motions`
    from which it turned to the next as the gyroscope has not felt it.
    """

    rotation: RotationStart
    steps: Steps
    motions: Sequence[ScanMotion]
    leaps: IntArray

    @property
    def astray(self) -> IntArray:
        """Places in `motions` from which the step to the next was not felt by the accelerometer, bridged ones aside."""
        seen = np.array([m.share > 0 for m in self.motions])
        at = self.steps.step
        return np.asarray(at[self.steps.astray & seen[at] & seen[at + 1]])

    @property
    def faults(self) -> int:
        """How many leaps and steps astray there are."""
        return len(self.leaps) + len(self.astray)

    @property
    def sound_stretch(self) -> Sequence[ScanMotion]:
        """The longest run of motions between two faults."""
        cuts = np.unique(np.concatenate([[-1], self.leaps, self.astray, [len(self.motions) - 1]]))
        longest = int(np.argmax(np.diff(cuts)))
        return self.motions[int(cuts[longest]) + 1 : int(cuts[longest + 1]) + 1]

    @property
    def tells(self) -> bool:
        """Whether so many of its steps are right that the start values by them can be relied on."""
        usual_m = float(np.median(self.steps.off_m)) if len(self.steps.off_m) else np.inf
        return usual_m < LINEAR.position_std_m and float(np.mean(self.steps.astray)) < LINEAR.most_astray

    @property
    def sound(self) -> list[ScanMotion]:
        """The motions, those before a leap as if they had been bridged."""
        leapt = set(self.leaps.tolist())
        return [replace(m, share=0.0) if k in leapt else m for k, m in enumerate(self.motions)]

    def felt(self, run: Run, *, coasts: bool = False) -> GyroAndSteps:
        """The IMU's motion, in the track's map frame."""
        scans = (self.motions[int(step)].position for step in self.steps.step)
        return GyroAndSteps(
            GyroTurning.of(run, self.rotation, coasts=coasts), dict(zip(scans, self.steps.felt_m, strict=True))
        )


def told_rotation(run: Run, lidar: LidarTrack) -> RotationStart | None:
    """The best rotation between a track's turns and the gyroscope's; None where they are nowhere alike."""
    starts = rotation_start(lidar, run.clocks.imu_s, run.recording.imu.gyro_rad_s)
    return starts[0] if starts and starts[0].residual < AGREEING.fits else None


def check_track(run: Run, motions: Sequence[ScanMotion], lidar: LidarTrack, rotation: RotationStart) -> TrackCheck:
    """A track compared with the IMU. motions, lidar: the track as motions, and as arrays.   rotation: the start to do it with."""
    imu_s, imu = run.clocks.imu_s, run.recording.imu
    magnitude_m_s2 = run.settings.gravity.magnitude_m_s2
    steps = linear_steps(lidar, imu_s, imu.accel_m_s2, rotation, gravity_m_s2=magnitude_m_s2)
    return TrackCheck(rotation, steps, motions, leaps(run, motions, rotation))


def leaps(run: Run, motions: Sequence[ScanMotion], rotation: RotationStart) -> IntArray:
    """The motions, by number, from which the next one is turned as the gyroscope has not felt it, bridged ones aside."""
    turning = GyroTurning.of(run, rotation)
    t_s = run.clocks.scan_s[[m.position for m in motions]] - rotation.time_offset_s
    # What the gyroscope turned and what the track did, as one lidar's.
    felt = turning.gyro.at(t_s) @ rotation.R_imu_lidar
    shown = np.array([m.R for m in motions])
    felt, shown = (np.swapaxes(R[:-1], 1, 2) @ R[1:] for R in (felt, shown))
    apart_rad = np.linalg.norm(log(np.swapaxes(felt, 1, 2) @ shown), axis=1)
    found = np.array([m.share > 0 for m in motions])
    told = turning.gyro.tells(t_s[:-1], t_s[1:]) & found[:-1] & found[1:]
    return np.flatnonzero(told & (apart_rad > AGREEING.leap_rad))
