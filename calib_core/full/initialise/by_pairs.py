"""Lag and rotation from turns between neighbouring scans, each pair by itself: where no track tells them.

They are the turns between some instants of two sweeps, and of which ones depends on what the planes of each are and on how the
lidar was shaken meanwhile. Once they tell how the IMU is turned, its gyroscope straightens the sweeps, and what is left is the
turn between two instants that are known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import overload

import numpy as np

from calib_core.errors import Refused
from calib_core.full.initialise.agreement import Agreement, agreement_of
from calib_core.full.initialise.inertial_motion import GyroTurning
from calib_core.full.initialise.rotation import fit_lags
from calib_core.full.initialise.settings import AGREEING, VECTORS
from calib_core.full.initialise.start import RotationStart
from calib_core.full.initialise.stream_lag import lags_by_vectors
from calib_core.full.initialise.time_offset import GyroTurns, LidarTurns
from calib_core.full.odometry.motion_prior import Turning
from calib_core.full.odometry.scan_pairs import pair_turns
from calib_core.full.odometry.settings import FOLLOWING
from calib_core.full.run import Run
from calib_core.types import Scan


def tell_turns(starts: Sequence[RotationStart]) -> bool:
    """Whether the best of them fits and leaves no axis open."""
    return bool(starts) and starts[0].residual <= AGREEING.fits and starts[0].open_axis_imu is None


def pairs_start(run: Run) -> tuple[list[RotationStart], Agreement]:
    """Lag and rotation from turns between neighbouring scans, each by itself, best first; and how well they agree.

    Where they tell them, the sweeps are straightened by the gyroscope and asked again, until the lag rests: as long as it is off,
    sweeps are straightened by what the gyroscope turned at another time. Raises Refused where that bends what was straight.
    """
    run.stage("track", 0.0, "turning from scan to scan")
    scans = run.recording.scans
    starts, agreed = _by_pairs(run, scans, None)
    for turn in range(AGREEING.again):
        # What was alike by chance is not any more once sweeps are straightened by it.
        if not starts or starts[0].residual > AGREEING.fits:
            break
        before = starts[0]
        straight = _by_pairs(run, scans, GyroTurning.of(run, before))
        if turn == 0:
            _require_measured_points(run, before, straight[0])
        if _left(straight[0]) > before.residual:
            break
        starts, agreed = straight
        if abs(starts[0].time_offset_s - before.time_offset_s) < FOLLOWING.turning_s:
            break
    return starts, agreed


def _left(starts: Sequence[RotationStart]) -> float:
    """What the best of them leaves of the turns, in rms; all where there is none."""
    return starts[0].residual if starts else 1.0


def _require_measured_points(run: Run, raw: RotationStart, straight: Sequence[RotationStart]) -> None:
    """Raises Refused where sweeps go with the gyroscope as they are, and do not once its turning is taken out of them: they were
    without it.

    A track of planes tells the same better (`within_sweeps.py`), where there is one.
    """
    left = _left(straight)
    if not straight or raw.correlation < AGREEING.trusted or left < AGREEING.bent * raw.residual:
        return
    shown = (
        "the rotations from sweep to sweep differ from the gyroscope's by a share of "
        f"{raw.residual:.2f} as the clouds are, and of {left:.2f} with the motion within each sweep taken out"
    )
    backwards, _ = _by_pairs(run, _Backwards(run.recording.scans), GyroTurning.of(run, raw))
    if _left(backwards) < raw.residual:
        raise Refused(
            "points.times_backwards",
            f"the times of the points run backwards: {shown}, but only of {_left(backwards):.2f} with the times reversed; "
            "expected the second to be the smallest; correct the points' times in the lidar's driver",
        )
    raise Refused(
        "points.straightened",
        "the motion was taken out of the clouds before they were recorded, or the points' times are not those of their "
        f"measurement: {shown}; expected the second to be smaller; record the driver's own clouds, with its motion compensation "
        "switched off",
    )


class _Backwards(Sequence[Scan]):
    """Scans as they would be if the times of their points ran the other way."""

    def __init__(self, scans: Sequence[Scan]) -> None:
        self._scans = scans

    def __len__(self) -> int:
        return len(self._scans)

    @overload
    def __getitem__(self, at: int) -> Scan: ...
    @overload
    def __getitem__(self, at: slice) -> Sequence[Scan]: ...
    def __getitem__(self, at: int | slice) -> Scan | Sequence[Scan]:
        if isinstance(at, slice):
            return _Backwards(self._scans[at])
        scan = self._scans[at]
        points = scan.points.copy()
        points["offset_ns"] = points["offset_ns"].max(initial=0) - points["offset_ns"]
        return replace(scan, points=points)


def _by_pairs(run: Run, scans: Sequence[Scan], turning: Turning | None) -> tuple[list[RotationStart], Agreement]:
    """As `pairs_start`, of sweeps straightened by these turns. Where three axes tell more of their agreement than the sizes do,
    it is that of the axes.
    """
    pairs = pair_turns(scans, turning=turning, seed=run.settings.random_seed)
    # A sweep taken as one rigid look is a look from where its middle was.
    middle_s = run.clocks.scan_s + 0.5 * run.clocks.sweep_s
    start_s, end_s = middle_s[pairs.first], middle_s[pairs.first + 1]
    worth = 1.0 / (pairs.std_rad**2 + VECTORS.pair_std_rad**2)
    rate_rad_s = pairs.rotvec_rad / np.maximum(end_s - start_s, AGREEING.shortest_span_s)[:, None]
    turns = LidarTurns(start_s, end_s, rate_rad_s, worth)
    imu_s, gyro_rad_s = run.clocks.imu_s, run.recording.imu.gyro_rad_s
    lags = lags_by_vectors(turns, imu_s, gyro_rad_s)
    starts = fit_lags(turns, GyroTurns(imu_s, gyro_rad_s), lags)
    agreed = agreement_of(turns, imu_s, gyro_rad_s)
    if starts and (starts[0].correlation > VECTORS.alike or starts[0].residual < VECTORS.left):
        # What is left of them knows the few that went wrong, which likeness does not.
        alike = max(starts[0].correlation, math.sqrt(1.0 - min(starts[0].residual, 1.0) ** 2))
        agreed = replace(agreed, correlation=max(agreed.correlation, alike))
    return starts, agreed
