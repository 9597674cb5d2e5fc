"""Lag and rotation from turns between neighbouring scans, each pair by itself: where no track tells them.

They are the turns between some instants of two sweeps, and of which ones depends on what the planes of each are and on how the
lidar was shaken meanwhile. Once they tell how the IMU is turned, its gyroscope straightens the sweeps, and what is left is the
turn between two instants that are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib_core.full.initialise.agreement import Agreement, agreement_of
from calib_core.full.initialise.felt import GyroTurning
from calib_core.full.initialise.rotation import fit_lags
from calib_core.full.initialise.settings import AGREEING, VECTORS
from calib_core.full.initialise.start import RotationStart
from calib_core.full.initialise.time_offset import GyroTurns, Turns
from calib_core.full.initialise.vectors import lags_by_vectors
from calib_core.full.odometry.pairs import pair_turns
from calib_core.full.odometry.settings import FOLLOWING
from calib_core.full.odometry.turning import Turning
from calib_core.full.run import Run


def tell_turns(starts: Sequence[RotationStart]) -> bool:
    """Whether the best of them fits and leaves no axis open."""
    return bool(starts) and starts[0].residual <= AGREEING.fits and starts[0].open_axis_imu is None


def pairs_start(ctx: Run) -> tuple[list[RotationStart], Agreement]:
    """Lag and rotation from turns between neighbouring scans, each by itself, best first; and how well they agree.

    Where they tell them, the sweeps are straightened by the gyroscope and asked again, until the lag rests: as long as it is off,
    sweeps are straightened by what the gyroscope turned at another time.
    """
    ctx.stage("track", 0.0, "turning from scan to scan")
    starts, agreed = _by_pairs(ctx, None)
    for _ in range(AGREEING.again):
        # What was alike by chance is not any more once sweeps are straightened by it.
        if not starts or starts[0].residual > AGREEING.fits or starts[0].correlation < AGREEING.believed:
            break
        before = starts[0]
        straight = _by_pairs(ctx, GyroTurning.of(ctx, before))
        if not straight[0] or straight[0][0].residual > before.residual:
            break
        starts, agreed = straight
        if abs(starts[0].time_offset_s - before.time_offset_s) < FOLLOWING.turning_s:
            break
    return starts, agreed


def _by_pairs(ctx: Run, turning: Turning | None) -> tuple[list[RotationStart], Agreement]:
    """As `pairs_start`, of sweeps straightened by these turns. Where three axes tell more of their agreement than the sizes do,
    it is that of the axes.
    """
    pairs = pair_turns(ctx.recording.scans, turning=turning, seed=ctx.settings.random_seed)
    # A sweep taken as one rigid look is a look from where its middle was.
    middle_s = ctx.clocks.scan_s + 0.5 * ctx.clocks.sweep_s
    start_s, end_s = middle_s[pairs.first], middle_s[pairs.first + 1]
    worth = 1.0 / (pairs.std_rad**2 + VECTORS.pair_std_rad**2)
    rate_rad_s = pairs.rotvec_rad / np.maximum(end_s - start_s, AGREEING.shortest_span_s)[:, None]
    turns = Turns(start_s, end_s, rate_rad_s, worth)
    imu_s, gyro_rad_s = ctx.clocks.imu_s, ctx.recording.imu.gyro_rad_s
    lags = lags_by_vectors(turns, imu_s, gyro_rad_s)
    starts = fit_lags(turns, GyroTurns(imu_s, gyro_rad_s), lags)
    agreed = agreement_of(turns, imu_s, gyro_rad_s)
    if starts and starts[0].correlation > VECTORS.alike:
        agreed = replace(
            agreed, correlation=max(agreed.correlation, starts[0].correlation), lag_s=starts[0].time_offset_s
        )
    return starts, agreed
