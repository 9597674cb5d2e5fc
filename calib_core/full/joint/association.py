"""Points to planes under the current motion: every scan through factors/lidar_plane.py, and the extents they show."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from calib_core.factors.lidar_plane import Gate, Hits, LidarNoise, NearHits, as_sieved, near_hits, select
from calib_core.factors.support import ExtentSurvey, PlaneExtents
from calib_core.full.joint.doubtful_planes import face_three_ways
from calib_core.full.joint.many_scans import OnScans, ignore, over_batches
from calib_core.full.joint.moments import Micro
from calib_core.full.joint.settings import SURVEYING
from calib_core.full.joint.view import View
from calib_core.types import BoolArray


def associate(
    view: View,
    positions: Sequence[int],
    noise: LidarNoise,
    gate: Gate,
    extents: PlaneExtents | None,
    *,
    stride: int = 1,
    on_scans: OnScans = ignore,
) -> Micro:
    """The micro-bins of the given scans. stride: use every so many-th point.   on_scans: told how many are done."""
    cap = view.settings.points_per_plane_per_scan

    def whole(batch: Sequence[int]) -> Micro:
        e = view.estimate
        micro = view.whole_scans(batch, noise, gate, extents)
        return replace(micro, laid_out_at=e.sensors, time_offset_s=e.time_offset_s)

    if cap is None and stride == 1 and view.nuisance.surface is None:
        return _joined(view, over_batches(view, positions, 1, whole, on_scans, most=view.most_as_one(positions)))

    def some(batch: Sequence[int]) -> Micro:
        hits = view.hits(batch, gate, stride)
        keep, weight = select(hits, noise, gate, extents)
        hits, keep, weight = as_sieved(hits, noise, gate, keep, weight)
        if cap is not None:
            keep = _capped(hits, keep, cap, seed=view.settings.random_seed + batch[0])
        e = view.estimate
        micro = view.collapsed(batch, hits, keep, weight, stride)
        return replace(micro, laid_out_at=e.sensors, time_offset_s=e.time_offset_s)

    if cap is None:
        return _joined(view, over_batches(view, positions, stride, some, on_scans))
    return _joined(view, over_batches(view, positions, stride, some, on_scans, most=1))


def _joined(view: View, parts: Iterable[Micro]) -> Micro:
    micro = Micro.joined(parts)
    for lasers in (micro.lasers, micro.apart):
        if lasers is not None:
            knot = view.motion.nearest_knot(lasers.time_s - micro.time_offset_s)
            lasers.put_in_order(knot, len(view.estimate.normals))
    return micro


def _capped(hits: Hits, keep: BoolArray, cap: int, seed: int) -> BoolArray:
    """At most so many points a plane, drawn evenly at random (pt/pl/sc).

    Each point of a scan has its place in the draw, whichever others take part: drawn anew whenever one of them came or went, no
    two rounds had the same points, and none came to rest.
    """
    place = np.random.default_rng(seed).random(len(keep))
    out = np.zeros_like(keep)
    for plane in np.unique(hits.plane[keep]):
        mine = np.flatnonzero(keep & (hits.plane == plane))
        out[mine[np.argsort(place[mine])[:cap]]] = True
    return out


def survey(
    view: View,
    positions: Sequence[int],
    noise: LidarNoise,
    gate: Gate,
    *,
    stride: int,
    within: BoolArray | None = None,
) -> PlaneExtents:
    """The cells of every plane, from where the scans' returns lie on and beside it.

    within: (P, rows, columns) that a plane may have at all; None for all.
    """
    std_m = noise.range_std_m
    total = ExtentSurvey.empty(view.estimate.normals, return_std=std_m / (SURVEYING.off_sigmas * std_m + gate.extra_m))

    def some(batch: Sequence[int]) -> NearHits:
        return near_hits(
            view.hits(batch, gate, stride),
            view.estimate.normals,
            noise,
            near_m=SURVEYING.beside_m + gate.extra_m,
            on=(gate.sigmas, gate.extra_m),
            off=(SURVEYING.off_sigmas, gate.extra_m),
        )

    for near in over_batches(view, positions, stride, some):
        total.add(near.plane, near.cell, near.on_plane, near.off)
    # Along a way that planes leave open the motion drifts, and what stands before a wall's end with it, into its cells.
    return total.finish(within, aloof=not face_three_ways(view.estimate.normals))
