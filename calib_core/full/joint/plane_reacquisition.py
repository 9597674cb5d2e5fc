"""Planes that come back after the motion has strayed too far for a gate: known again by their normals.

The gyroscope keeps directions long after positions are lost. The newest whole scan is cut into planes by itself; one that
faces as a lost plane does, and lies where that could have come to lie, is that plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib_core.factors.lidar_plane import Gate, collapse, find_hits, select
from calib_core.factors.support import PlaneExtents
from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.moments import Micro
from calib_core.full.joint.policies import Propagation
from calib_core.full.joint.propagation_window import Window
from calib_core.full.joint.settings import REGAINING
from calib_core.full.joint.state import Estimate
from calib_core.full.joint.view import View
from calib_core.planes.same_plane import same_place
from calib_core.planes.segment import PlaneFit, segment_planes
from calib_core.types import BoolArray, FloatArray, IntArray


def regain(
    data: JointData,
    state: Estimation,
    window: Window,
    scans: Sequence[int],
    *,
    lost: BoolArray,
    straying_m: FloatArray,
    reach: PlaneExtents,
    outlined: BoolArray | None,
    policy: Propagation,
) -> Micro | None:
    """Points of lost planes in the middle one of these scans; None where there are none. lost, straying_m: (P,)."""
    if not lost.any() or not scans:
        return None
    position = scans[len(scans) // 2]
    view = window.view(data)
    cloud, index = view.cloud(position, REGAINING.points)
    if len(index) < REGAINING.fewest_points:
        return None
    eye = view.slice_poses(position).p
    fits = segment_planes(cloud, viewpoint_m=eye[len(eye) // 2], settings=REGAINING.segments)
    found = []
    for fit in fits:
        plane = same_lost_plane(window.estimate, fit, cloud, lost=lost, straying_m=straying_m, policy=policy)
        if plane is None:
            continue
        within = (
            None if outlined is None else PlaneExtents(reach.normals[plane : plane + 1], outlined[plane : plane + 1])
        )
        gate = Gate(extra_m=3.0 * float(straying_m[plane]) + policy.regained_gate_m)
        points = _points_of(view, state, position, index[fit.inliers], plane=plane, gate=gate, within=within)
        if len(points.count):
            found.append(points)
    return Micro.joined(found) if found else None


def same_lost_plane(
    estimate: Estimate,
    fit: PlaneFit,
    cloud_m: FloatArray,
    *,
    lost: BoolArray,
    straying_m: FloatArray,
    policy: Propagation,
) -> int | None:
    """Which lost plane a fit is: it faces the same way and lies where that may have strayed to; the nearest of them."""
    centre = cloud_m[fit.inliers].mean(axis=0)
    alike = lost & same_place(
        estimate.normals, estimate.offsets_m, fit.normal, centre,
        within_deg=policy.same_normal_deg, within_m=3.0 * straying_m + policy.same_place_m,
    )  # fmt: skip
    if not alike.any():
        return None
    off = np.abs(estimate.normals @ centre + estimate.offsets_m)
    return int(np.flatnonzero(alike)[np.argmin(off[alike])])


def _points_of(
    view: View,
    state: Estimation,
    position: int,
    points_at: IntArray,
    *,
    plane: int,
    gate: Gate,
    within: PlaneExtents | None,
) -> Micro:
    """Some points of a scan, given to one plane: told by its normal, no other is asked."""
    points = view.scans[position].points[np.sort(points_at)]
    e = view.estimate
    only = slice(plane, plane + 1)
    poses = view.slice_poses(position)
    hits = find_hits(points["xyz"], points["offset_ns"] * 1e-9, poses, e.normals[only], e.offsets_m[only], gate)
    keep, weight = select(hits, state.lidar_noise, gate, within)
    bins = collapse(hits, keep, weight, 1)
    return view.micro([position], replace(bins, plane=np.full(len(bins.plane), plane)))
