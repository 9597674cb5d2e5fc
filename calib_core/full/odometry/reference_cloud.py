"""The cloud of the standstill around the reference scan, and the planes in it, for a person to look at.

Scans that follow the reference without motion are merged into its cloud; that they do is told by registering them to its
planes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_core.events import OnEvent, ShouldCancel, StageEvent, ignore_event, never_cancel
from calib_core.full.odometry.plane_map import PlaneMap
from calib_core.full.odometry.register import ScanMotion, register, sample_points
from calib_core.full.odometry.settings import STANDSTILL, TrackSettings
from calib_core.full.planes.propose import (
    determines_a_pose,
    distinct,
    find_reference,
    make_patch,
    named_planes,
    near_plane,
    scan_points,
)
from calib_core.full.planes.settings import SEARCH
from calib_core.geometry import log
from calib_core.phrasing import counted
from calib_core.planes.segment import segment_planes
from calib_core.settings import CalibrateSettings
from calib_core.types import Plane, PlaneProposals, Recording, Scan


def propose_planes(
    recording: Recording,
    settings: CalibrateSettings,
    *,
    position: int | None = None,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> PlaneProposals:
    """The planes of the reference cloud as patches, largest first, all confirmed, and the cloud itself.

    position: the reference scan's, where it is told; else it is the one whose planes determine a pose.
    """
    on_event(StageEvent(stage="planes", fraction=0.0, text="looking for planes"))
    scans = recording.scans
    if position is None:
        reference, fits = find_reference(scans, settings, should_cancel=should_cancel)
    else:
        points_m = scan_points(scans[position], settings.field_of_view_deg)
        reference, fits = position, segment_planes(points_m, seed=settings.random_seed)
    determined = determines_a_pose(fits)
    fits = distinct(fits, scan_points(scans[reference], settings.field_of_view_deg))
    still = [reference]
    if len(fits) >= SEARCH.fewest_planes:
        still = still_after(scans, reference, named_planes(fits))
    on_event(StageEvent(stage="planes", fraction=0.5, text=f"merging {counted(len(still), 'scan')}"))
    cloud = np.concatenate([scan_points(scans[i], settings.field_of_view_deg) for i in still])
    intensity = np.concatenate([_intensity(scans[i], settings.field_of_view_deg) for i in still])
    stride = max(1, len(cloud) // STANDSTILL.cloud_points + 1)
    cloud, intensity = cloud[::stride], intensity[::stride]
    if len(still) > 1:
        some = cloud[:: max(1, len(cloud) // STANDSTILL.searched_points)]
        merged = distinct(segment_planes(some, seed=settings.random_seed), some)
        if len(merged) >= len(fits):
            fits = merged
    patch = np.full(len(cloud), -1, dtype=np.int16)
    patches = []
    ranges_m = np.linalg.norm(cloud, axis=1)
    for j, plane in enumerate(named_planes(fits)):
        near = near_plane(cloud, plane, ranges_m) & (patch < 0)
        patch[near] = j
        patches.append(make_patch(plane, cloud[near]))
    on_event(StageEvent(stage="planes", fraction=1.0, text=counted(len(patches), "plane")))
    return PlaneProposals(
        patches=tuple(patches),
        cloud_m=cloud.astype(np.float32),
        cloud_patch=patch,
        cloud_intensity=intensity,
        reference_scans=tuple(still),
        static=len(still) >= STANDSTILL.fewest_scans,
        determined=determined,
    )


def still_after(scans: Sequence[Scan], reference: int, planes: Sequence[Plane]) -> list[int]:
    """The reference scan and those after it during which the lidar did not move."""
    s = TrackSettings()
    known = PlaneMap.endless(planes)
    tie = np.full(12, 1 / STANDSTILL.rest_std**2)
    start = ScanMotion(reference, np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3))
    still = []
    for position in range(reference, min(reference + STANDSTILL.scans, len(scans))):
        points, tau = sample_points(scans[position], s.points)
        if len(points) < s.fewest_points:
            break
        motion = register(points, tau, known, start, tie=tie, settings=s, position=position).motion
        turned, moved = np.degrees(np.linalg.norm(log(motion.R))), np.linalg.norm(motion.p)
        if turned > STANDSTILL.still_deg or moved > STANDSTILL.still_m:
            break
        still.append(position)
    return still or [reference]


def _intensity(scan: Scan, field_of_view_deg: float | None) -> np.ndarray[tuple[int], np.dtype[np.float32]]:
    values = scan.points["intensity"].astype(np.float32)
    if field_of_view_deg is None:
        return values
    xyz = scan.points["xyz"]
    return values[np.abs(np.arctan2(xyz[:, 1], xyz[:, 0])) <= np.radians(field_of_view_deg)]
