"""The planes in play: those that come into view are taken in, those that turn out to be none are dropped."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from calib_core.full.assess.residuals import plane_chi2, plane_misfit
from calib_core.full.joint.association import gather
from calib_core.full.joint.doubt import plane_doubts, say_left_out
from calib_core.full.planes.standing import LEAST_M
from calib_core.planes.segment import SegmentSettings, segment_planes
from calib_core.types import BoolArray, FloatArray

if TYPE_CHECKING:
    from calib_core.full.joint.schedule import Rounds

#: A plane is none that scatters, or whose averages wander, so many times as much as others: walls stay below three.
_BAD_TIMES = 5.0
_WANDERING_TIMES = 4.0
#: While the motion is rough a plane may be that far off from place to place and be none the worse.
_ROUGH_M = 0.008
#: Fewer planes do not hold a pose.
_FEWEST = 3


def discover(rounds: Rounds, positions: list[int]) -> bool:
    """Planes that the reference scan did not show, among the points that lie on none; whether any were found."""
    view = rounds.present_view()
    step = max(1, len(positions) // 60)
    some = positions[::step]
    strays = np.concatenate(view.over_scans(some, lambda i: view.strays(i, 1500, 0.15)))
    eye = np.mean([view.slice_poses(i).p[0] for i in some], axis=0)
    if len(strays) < 1000:
        return False
    settings = SegmentSettings(min_share=0.03, min_points=300, min_breadth_m=0.25, max_planes=6, distance_m=0.05)
    found = []
    for fit in segment_planes(strays, viewpoint_m=eye, seed=rounds.ctx.settings.random_seed, settings=settings):
        centre = strays[fit.inliers].mean(axis=0)
        alike = rounds.estimate.normals @ fit.normal > np.cos(np.radians(8.0))
        near = np.abs(rounds.estimate.normals @ centre + rounds.estimate.offsets_m) < 0.25
        if not (alike & near).any():
            found.append(fit)
    if not found:
        return False
    e = rounds.estimate
    rounds.estimate = replace(
        e,
        normals=np.vstack([e.normals, [f.normal for f in found]]),
        offsets_m=np.append(e.offsets_m, [f.offset_m for f in found]),
    )
    first = len(rounds.names) + 1
    rounds.names += [f"plane {first + k}" for k in range(len(found))]
    rounds.outlines_m += [None] * len(found)
    rounds.ctx.say("info", "planes.found", f"{len(found)} more planes came into view after the start and are used")
    return True


def cull(rounds: Rounds, *, settled: bool = False) -> bool:
    """Drop planes whose points do not agree with the motion that the others share: what moves, bends or was imagined.

    Returns whether any was.   settled: the motion is as good as it gets. Then a plane's averages count too: clutter may
    scatter hardly more than a wall, but where it lies wanders from sweep to sweep.
    """
    assert rounds.micro is not None
    problem = rounds.problem()
    problem = replace(problem, bins=gather(rounds.micro, problem.motion(rounds.estimate), rounds.estimate))
    chi2, points = plane_chi2(problem, rounds.estimate)
    if points.sum() == 0:
        return False
    badness = over_usual(chi2, points) / _BAD_TIMES
    if settled:
        badness = np.maximum(badness, over_usual(plane_misfit(problem, rounds.estimate), points) / _WANDERING_TIMES)
    doubt = plane_doubts(problem, rounds.estimate, LEAST_M if settled else _ROUGH_M)
    badness = np.maximum(badness, doubt.max(axis=1))
    keep = kept_planes(badness, points)
    if keep.all() or keep.sum() < _FEWEST:
        return False
    dropped = [name for name, kept in zip(rounds.names, keep, strict=True) if not kept]
    say_left_out(rounds.ctx, dropped, doubt[~keep])
    rounds.names = [name for name, kept in zip(rounds.names, keep, strict=True) if kept]
    rounds.outlines_m = [outline_m for outline_m, kept in zip(rounds.outlines_m, keep, strict=True) if kept]
    e = rounds.estimate
    rounds.estimate = replace(e, normals=e.normals[keep], offsets_m=e.offsets_m[keep])
    rounds.micro = None
    return True


def over_usual(badness: FloatArray, points: FloatArray) -> FloatArray:
    """How many times as bad as the one in the middle, counted by points, each plane is. (P,) each."""
    order = np.argsort(badness)
    typical = badness[order][np.searchsorted(np.cumsum(points[order]), 0.5 * points.sum())]
    return np.asarray(badness / max(typical, 1e-30))


def kept_planes(badness: FloatArray, points: FloatArray) -> BoolArray:
    """Which planes stay, (P,): those that have points and a badness (P,) below one, but the three best of them in any case.

    Two good walls among much clutter: that a third is doubtful is no reason to keep everything.
    """
    ranked = np.where(points > 0, badness, np.inf)
    keep = ranked < 1.0
    best = np.argsort(ranked, kind="stable")[:_FEWEST]
    keep[best] |= np.isfinite(ranked[best])
    return keep
