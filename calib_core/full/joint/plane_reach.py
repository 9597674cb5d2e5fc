"""How far a plane may reach while the estimate is propagated: its support, what may join on to it, and never past its outline."""

from __future__ import annotations

import numpy as np

from calib_core.factors.support import CELL_M, HALF_CELLS, PlaneExtents, reach_around
from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.moments import Micro
from calib_core.full.joint.policies import Propagation
from calib_core.full.joint.propagation_window import Window
from calib_core.full.joint.round import gate_of, survey
from calib_core.full.joint.schedule import Schedule
from calib_core.full.joint.state_views import outlined_cells
from calib_core.geometry import plane_axes
from calib_core.types import BoolArray

_UPPER_CENTRE = np.array([3, 7, 10])  # of a packed scatter: sum w x, and sum w
_UPPER_44 = 12


def spread(
    reach: PlaneExtents, points: Micro, window: Window, outlined: BoolArray | None, policy: Propagation
) -> PlaneExtents:
    """Planes that reach on from where their points lie now, within their outlines."""
    e = window.estimate
    poses = window.problem.motion(e).lidar_at(points.time_s - e.time_offset_s, e.R_imu_lidar, e.p_imu_lidar)
    weight = np.maximum(points.scatter[:, _UPPER_44], 1e-30)
    centre = points.scatter[:, _UPPER_CENTRE] / weight[:, None]
    there = (poses.R @ centre[..., None])[..., 0] + poses.p
    axes = plane_axes(reach.normals)[points.plane]
    cell = np.floor(np.einsum("bai,bi->ba", axes, there) / CELL_M).astype(np.int64) + HALF_CELLS
    cells = round(policy.join_on_m / CELL_M)
    inside = reach.inside.copy()
    for plane, (row, column) in zip(points.plane, cell, strict=True):
        inside[plane, max(row - cells, 0) : row + cells + 1, max(column - cells, 0) : column + cells + 1] = True
    if outlined is not None:
        inside[~outlined] = False
    return PlaneExtents(reach.normals, inside)


def surveyed_reach(
    data: JointData, state: Estimation, schedule: Schedule, policy: Propagation
) -> tuple[Estimation, PlaneExtents, BoolArray | None]:
    """After a solve of the whole: the planes' support, that and what may join on to it, and what outlines leave of them."""
    state = survey(data, state, gate_of(state, policy.gate_m, schedule.sampling), schedule.sampling)
    assert state.support is not None
    outlined = outlined_cells(data, state)
    return state, reach_within(state.support, outlined, policy), outlined


def reach_within(support: PlaneExtents, outlined: BoolArray | None, policy: Propagation) -> PlaneExtents:
    """The support and what may join on to it, within the outlines."""
    reach = reach_around(support, policy.join_on_m)
    return reach if outlined is None else PlaneExtents(reach.normals, reach.inside & outlined)
