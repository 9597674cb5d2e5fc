"""The same room laid together by the IMU with the given extrinsic and with the found one.

Each is given its own motion, solved with it held, so that a wrong extrinsic is not judged by the right one's motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.audit.report import AuditCrispness
from calib_core.maps.carry import Mounting, carried
from calib_core.maps.crispness import compare_rooms, laid, sampled
from calib_core.result import RoomCrispness
from calib_core.types import FloatArray, Recording, Trajectory

#: Differences of entropy that the places of four grids make by chance, on simulated rooms of 10 s.
_BY_CHANCE_NAT = 0.0005


@dataclass(frozen=True, slots=True)
class Judged:
    """An extrinsic with the motion that was solved with it."""

    mounting: Mounting
    trajectory: Trajectory
    gyro_bias_rad_s: FloatArray


def audit_crispness(recording: Recording, given: Judged, found: Judged) -> AuditCrispness | None:
    """Of both rooms; None where too little of them was seen."""
    motions = [carried(j.trajectory, recording.imu, j.mounting, j.gyro_bias_rad_s) for j in (given, found)]
    known = [motion for motion in motions if motion is not None]
    if len(known) < 2:
        return None
    seen = {scan.index for scan in sampled(recording.scans, known[0])}
    chosen = [scan for scan in sampled(recording.scans, known[1]) if scan.index in seen]
    rooms = compare_rooms([laid(chosen, motion) for motion in known])
    return None if rooms is None else AuditCrispness(given=rooms[0], found=rooms[1], text=_sentence(*rooms))


def mounting_of(T_imu_lidar: FloatArray, time_offset_ns: int) -> Mounting:
    """The parts of a transform (4, 4)."""
    T = np.asarray(T_imu_lidar, dtype=np.float64)
    return Mounting(T[:3, :3], T[:3, 3], time_offset_ns)


def _sentence(given: RoomCrispness, found: RoomCrispness) -> str:
    more = given.mean_entropy_nat - found.mean_entropy_nat
    thickness = [f"{1e3 * room.thickness_std_m:.2f} mm" for room in (given, found)]
    thick = f"surfaces {thickness[0]} thick (rms) against {thickness[1]}"
    # Entropy that differs where no surface shows thicker is a matter of where points lie in the grids.
    if abs(more) <= _BY_CHANCE_NAT or thickness[0] == thickness[1]:
        return f"The room looks the same with both, {thick}: the difference between them does not show in it."
    if more > 0:
        return f"With the given extrinsic the room is blurrier, by {more:.4f} nat of map entropy: {thick}."
    return f"With the given extrinsic the room is even crisper, by {-more:.4f} nat of map entropy: {thick}."
