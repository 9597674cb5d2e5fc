"""Where nothing may be concluded from how the lidar was followed, or less: what is refused or said, and in which words."""

from __future__ import annotations

import numpy as np

from calib_core.errors import Refused
from calib_core.full.initialise.agreement import NO_AGREEMENT, Agreement, mean_rate
from calib_core.full.initialise.settings import AGREEING
from calib_core.full.initialise.time_offset import GyroTurns
from calib_core.full.odometry.distance_travelled import directions_faced, no_motion, travelled, ways_faced
from calib_core.full.odometry.reference import Followed
from calib_core.full.prepare.imu_noise import rests_throughout
from calib_core.full.run import Run
from calib_core.geometry import log
from calib_core.types import FloatArray


def refuse_standing_clouds(run: Run, followed: Followed, gyro_rad_s: FloatArray) -> None:
    """Raise Refused where the surroundings stand still in clouds that were followed throughout, and the gyroscope turns.

    gyro_rad_s: (Q, 3) without bias.
    """
    scans = len(run.recording.scans)
    if followed.seen < AGREEING.whole * scans or ways_faced(followed.planes) < 3:
        return
    positions = np.array([m.position for m in followed.motions])
    R = np.array([m.R for m in followed.motions])
    period_s = np.maximum(np.diff(run.clocks.scan_s[positions]), AGREEING.shortest_span_s)
    shown = float(np.median(np.linalg.norm(log(np.swapaxes(R[:-1], 1, 2) @ R[1:]), axis=1) / period_s))
    # Over as long as from scan to scan: what shakes the gyroscope faster turns no lidar.
    imu_s, width_s = run.clocks.imu_s, float(np.median(period_s))
    turned = float(np.nanmedian(mean_rate(imu_s, gyro_rad_s, imu_s, imu_s + width_s)))
    if turned < AGREEING.surely_turning_rad_s or shown > AGREEING.standing * turned:
        return
    raise Refused(
        "points.standing",
        f"the lidar's surroundings stand still in its clouds ({followed.seen} of {scans} scans), while the gyroscope turns at "
        f"{np.degrees(turned):.0f} deg/s: the clouds are in a frame that does not move with the lidar (a map's or an "
        "odometry's), or the lidar is not fixed to this IMU; record the lidar driver's own clouds",
    )


def of_rest(run: Run, refusal: Refused) -> Refused:
    """The refusal, or that nothing moved where it is about planes and the IMU rests throughout: other planes would not help.

    It is asked only once the planes have failed. An IMU that is shaken by an engine may seem to rest in a gentle motion that the
    planes of a lidar tell.
    """
    if refusal.code.partition(".")[0] != "planes" or not rests_throughout(run.clocks.imu_s, run.recording.imu):
        return refusal
    return no_motion("the rig stood still: the IMU feels neither a turn nor an acceleration in the whole recording")


def refuse_lost(run: Run, followed: Followed, agreed: Agreement) -> None:
    """Raise Refused where the track is no motion of this gyroscope's: nothing may be concluded from it."""
    scans, clocks = len(run.recording.scans), run.clocks
    gyro = GyroTurns(clocks.imu_s, run.recording.imu.gyro_rad_s - np.median(run.recording.imu.gyro_rad_s, axis=0))
    turned = gyro.at(clocks.imu_s[:: max(1, len(clocks.imu_s) // AGREEING.orientations)])
    turned_deg = float(np.degrees(np.linalg.norm(log(turned[0].T @ turned), axis=1).max()))
    if turned_deg < AGREEING.surely_turned_deg:
        return
    stood = travelled(followed.motions).stood
    unlike = agreed is not NO_AGREEMENT and agreed.correlation < AGREEING.believed
    if stood:
        raise Refused(
            "planes.lost",
            f"the lidar could not be followed: its planes face {directions_faced(followed.planes)}, and in the "
            f"{followed.seen} of {scans} scans in which they were seen it hardly moved, while the gyroscope turns by "
            f"{turned_deg:.0f} deg in the recording; record where three planes that face different directions stay in view",
        )
    if unlike:
        raise Refused(
            "planes.lost",
            f"the lidar could not be followed: its rotation, by the planes of {followed.seen} of {scans} scans, does not agree "
            f"with the gyroscope's (correlation {agreed.correlation:.2f}); move more slowly, where three planes that face "
            "different directions stay in view, with nobody close by",
        )


def say_open(run: Run, followed: Followed) -> None:
    """That its planes left a direction open, where it was followed for all that, and what would close it."""
    if not followed.coasts:
        return
    run.say(
        "info",
        "track.open_way",
        f"over {followed.coasting} of {len(followed.motions)} scans the planes leave one direction undetermined, as along a "
        "corridor: motion along it is taken from the IMU alone; a wall across that direction would determine it too",
    )
