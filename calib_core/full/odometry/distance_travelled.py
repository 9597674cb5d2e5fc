"""How far the lidar came in all, and whether that is standing still: one answer for whoever asks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_core.errors import Refused
from calib_core.full.odometry.register import ScanMotion
from calib_core.full.odometry.settings import FOLLOWING
from calib_core.geometry import log
from calib_core.types import Plane


@dataclass(frozen=True, slots=True)
class Travelled:
    """How far the lidar came from its first followed scan at most: by turn, and by place."""

    turn_deg: float
    move_m: float

    @property
    def stood(self) -> bool:
        """Whether both are so little that the lidar stood still."""
        return self.turn_deg < FOLLOWING.stood_deg and self.move_m < FOLLOWING.stood_m


def stood_text() -> str:
    """The sentence that the lidar stood still. It tells the limit, not the measured motion: `inspect` follows a sample of the
    points and a solve all of them, and the two differ by some hundredths of a degree.
    """
    still = f"it turned by less than {FOLLOWING.stood_deg:g} deg and moved by less than {1e3 * FOLLOWING.stood_m:g} mm"
    return f"the lidar stood still: {still} in the whole recording"


def travelled(motions: Sequence[ScanMotion]) -> Travelled:
    """How far the lidar came in the scans that were followed."""
    first = motions[0]
    turn_rad = max(float(np.linalg.norm(log(first.R.T @ m.R))) for m in motions)
    move_m = max(float(np.linalg.norm(m.p - first.p)) for m in motions)
    return Travelled(float(np.degrees(turn_rad)), move_m)


def ways_faced(planes: Sequence[Plane]) -> int:
    """In how many independent ways planes face: 1 to 3."""
    spread = np.linalg.svd(np.array([plane.normal for plane in planes]), compute_uv=False)
    return int(np.count_nonzero(spread[:3] > FOLLOWING.another_way * spread[0]))


def directions_faced(planes: Sequence[Plane]) -> str:
    """The same in words."""
    return ("one direction only", "two directions only", "three directions")[ways_faced(planes) - 1]


def require_motion(motions: Sequence[ScanMotion], scans: int, planes: Sequence[Plane]) -> None:
    """Raises Refused where the followed scans show no motion: the lidar stood still, or its planes were lost too soon to tell.

    scans: how many the recording has.   planes: those that were followed.
    """
    if not travelled(motions).stood:
        return
    if len(motions) < FOLLOWING.followed_share * scans:
        lost = (
            f"the planes could be followed over only {len(motions)} of {scans} scans, in which the lidar stood still: they face "
            f"{directions_faced(planes)}; record where three planes that face different directions stay in view"
        )
        raise Refused("planes.lost", lost)
    raise no_motion(stood_text())


def no_motion(stood: str) -> Refused:
    """The refusal of a recording in which nothing moves, with what to record. stood: what stood still, as a clause."""
    advice = "after a few seconds of standing still, turn it about all three axes and move it for half a minute"
    return Refused("motion.none", f"{stood}; {advice}")
