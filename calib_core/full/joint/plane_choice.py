"""The planes that a person has chosen, in a motion that all structure has told: the others are known too, and count no more.

A choice that tells little would lose its way from start values that are off: two planes of a corner, whose third shows where the
lidar went. Which planes count is another question than how the rig moved, as for the track before (initialise/lidar_motion.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib_core.full.initialise.proposed_planes import matched
from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.first_estimate import map_planes, put_aside
from calib_core.full.joint.round import anchored
from calib_core.full.joint.schedule import Schedule
from calib_core.full.joint.state_views import map_pose
from calib_core.full.odometry.reference import Followed
from calib_core.full.prepare.nuisance import unknowns_of
from calib_core.full.run import Run
from calib_core.types import FloatArray, Plane


def with_choice(
    run: Run, motion: tuple[JointData, Estimation, Sequence[int]], track: Followed, schedule: Schedule
) -> tuple[JointData, Estimation]:
    """The problem in which these planes count. track: the planes, and what was dropped, in the map frame.   motion: the problem
    and the state of the motion by all, and which of its planes each of these is, -1 for none.

    What joined on the way counts where the schedule lets planes join. All others are put aside: what lies near them is theirs.
    """
    data, state, which = motion
    sensors = unknowns_of(run)
    data = replace(data, run=run, limits=schedule.limits, sensors=sensors, dropped=track.dropped)
    held = not run.settings.estimate_planes
    if held:  # the frame is that of the planes given
        state = anchored(data, state)
    R, p = (np.eye(3), np.zeros(3)) if held else map_pose(data, state)
    e, planes = state.estimate, map_planes(track)
    known = [Plane(m.name, n, float(w)) for m, n, w in zip(state.planes, e.normals, e.offsets_m, strict=True)]
    counting = _moved(track.planes, R, p)
    if not held:
        # Two that are drawn on one surface are told apart by where they are drawn.
        counting = [
            q if which.index(k) < i or k < 0 else known[k] for i, (q, k) in enumerate(zip(counting, which, strict=True))
        ]
    # What strayed in that motion is held against the answer; of two that are drawn on one surface, the first is it.
    planes = tuple(
        replace(q, strayed=state.planes[k].strayed) if k >= 0 and which.index(k) == i else q
        for i, (q, k) in enumerate(zip(planes, which, strict=True))
    )
    if schedule.planes is not None:
        came = [k for k, plane in enumerate(state.planes) if plane.late and k not in which]
        counting, planes = [*counting, *(known[k] for k in came)], (*planes, *(state.planes[k] for k in came))
    estimate = replace(
        e,
        normals=np.array([q.normal for q in counting]),
        offsets_m=np.array([q.offset_m for q in counting]),
    )
    dropped = _moved(track.dropped, R, p)
    lost = [q for q, k in zip(dropped, matched(dropped, known), strict=True) if k < 0]
    estimate = put_aside(estimate, [*known, *lost])
    return data, replace(state, estimate=estimate, planes=planes, support=None, observations=None, minimum=None)


def _moved(planes: Sequence[Plane], R: FloatArray, p: FloatArray) -> list[Plane]:
    """The same planes in a frame in which theirs lies at R (3, 3), p (3,)."""
    return [Plane(q.name, R @ q.normal, float(q.offset_m - q.normal @ (R.T @ p))) for q in planes]
