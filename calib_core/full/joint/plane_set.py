"""The planes in play: those that come into view are taken in, those that turn out to be none are dropped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib_core.full.joint.doubtful_planes import level_at_m, plane_doubts, say_left_out
from calib_core.full.joint.estimation import Estimation, JointData, MapPlane
from calib_core.full.joint.many_scans import over_scans
from calib_core.full.joint.policies import PlaneSet
from calib_core.full.joint.residuals import plane_chi2, plane_misfit, wandering_m
from calib_core.full.joint.round import gathered
from calib_core.full.joint.state import Estimate
from calib_core.full.joint.state_views import map_pose, present_view
from calib_core.full.planes.plane_tests import fault_of
from calib_core.full.planes.settings import JUDGEMENT
from calib_core.phrasing import counted
from calib_core.plane_kinds import kind_of, next_name
from calib_core.planes.same_plane import same_place, same_surface
from calib_core.planes.segment import PlaneFit, segment_planes
from calib_core.planes.settings import SegmentSettings
from calib_core.types import BoolArray, FloatArray


def add_planes(data: JointData, state: Estimation, positions: Sequence[int], rules: PlaneSet) -> Estimation:
    """With the planes that lie among the points of these scans on none so far; the same state where there are none.

    Those that a person has dropped do not come back, nor what lies on them.
    """
    view = present_view(data, state)
    some = positions[:: max(1, len(positions) // rules.scans)]
    strays = np.concatenate(over_scans(view, some, lambda i: view.strays(i, rules.points_per_scan, rules.away_m)))
    dropped = dropped_now(data, state)
    strays = strays[np.all(np.abs(strays @ dropped[0].T + dropped[1]) > rules.away_m, axis=1)]
    eye = np.mean([view.slice_poses(i).p[0] for i in some], axis=0)
    if len(strays) < rules.fewest_points:
        return state
    settings = SegmentSettings(
        min_share=rules.least_share,
        min_points=rules.least_points,
        min_breadth_m=rules.least_breadth_m,
        max_planes=rules.most,
        distance_m=rules.flat_m,
    )
    fits = segment_planes(strays, viewpoint_m=eye, seed=data.run.settings.random_seed, settings=settings)
    found = new_ones(state.estimate, fits, strays, rules, dropped=dropped)
    if not found:
        return state
    data.run.say(
        "info",
        "planes.found",
        f"{counted(len(found), 'more plane')} came into view after the start and {'is' if len(found) == 1 else 'are'} used",
    )
    return with_planes(state, found, taken=[plane.name for plane in data.dropped])


def dropped_now(data: JointData, state: Estimation) -> tuple[FloatArray, FloatArray]:
    """Where the planes are that a person has dropped, in the frame of the solve: normals (D, 3), offsets (D,) [m].

    As they were proposed, in a sweep that is bent yet, and as the motion has told them where it has (plane_choice.py).
    """
    e = state.estimate
    if not data.dropped:
        return e.aside_normals, e.aside_offsets_m
    normals, offsets_m = np.array([q.normal for q in data.dropped]), np.array([q.offset_m for q in data.dropped])
    R, p = map_pose(data, state)
    normals, offsets_m = normals @ R.T, offsets_m - normals @ (R.T @ p)
    return np.vstack([normals, e.aside_normals]), np.append(offsets_m, e.aside_offsets_m)


def new_ones(
    estimate: Estimate,
    fits: Sequence[PlaneFit],
    cloud_m: FloatArray,
    rules: PlaneSet,
    *,
    dropped: tuple[FloatArray, FloatArray] = (np.empty((0, 3)), np.empty(0)),
) -> list[PlaneFit]:
    """The fits that are none of the planes known already, nor of those dropped. cloud_m: (N, 3), in which they were found."""
    found = []
    for fit in fits:
        centre = cloud_m[fit.inliers].mean(axis=0)
        known = (
            same_place(
                normals, offsets_m, fit.normal, centre,
                within_deg=times * rules.same_normal_deg, within_m=times * rules.same_place_m,
            )
            for (normals, offsets_m), times in (
                ((estimate.normals, estimate.offsets_m), 1.0), (dropped, rules.dropped_apart)
            )
        )  # fmt: skip
        if not any(each.any() for each in known):
            found.append(fit)
    return found


def with_planes(state: Estimation, found: Sequence[PlaneFit], taken: Sequence[str] = ()) -> Estimation:
    """These planes after those there are, called what they are. Points are still given to the old ones only.

    taken: names of planes that are not among them.
    """
    e = state.estimate
    estimate = replace(
        e,
        normals=np.vstack([e.normals, [f.normal for f in found]]),
        offsets_m=np.append(e.offsets_m, [f.offset_m for f in found]),
    )
    up = -e.gravity / np.linalg.norm(e.gravity)
    names = [plane.name for plane in state.planes]
    for fit in found:
        names.append(next_name(kind_of(fit.normal, up)[0], [*names, *taken]))
    named = tuple(MapPlane(name, late=True) for name in names[len(state.planes) :])
    return replace(state, estimate=estimate, planes=state.planes + named)


def drop_planes(
    data: JointData, state: Estimation, rules: PlaneSet, *, settled: bool = False, most_share: float = 1.0
) -> Estimation:
    """Without the planes whose points do not agree with the motion that the others share: what moves, bends or was imagined.

    Those that were chosen stay.   The same state where there are none.   settled: the motion is as good as it gets. Then a
    plane's averages count too: clutter may scatter hardly more than a wall, but where it lies wanders from sweep to sweep.
    most_share: what holds a greater part of the points is not judged yet.
    """
    twin_of = twins(state, rules)
    if twin_of:
        for k, other in twin_of.items():
            text = f"{state.planes[k].name} is the same plane as {state.planes[other].name}: left out"
            data.run.say("info", "planes.merged", text)
        none = np.zeros(len(state.planes), np.bool_)
        return only_planes(state, np.array([k not in twin_of for k in range(len(none))]), none, rules)
    problem = gathered(data, state)
    chi2, points = plane_chi2(problem, state.estimate)
    if points.sum() == 0:
        return state
    # Nor is what scatters no more than noise makes it, however little a floor does that is seen at a grazing angle.
    badness = scatter = over_usual(chi2, points, least=1.0 / rules.worst_scatter) / rules.worst_scatter
    if settled:
        # How uneven a floor at a grazing angle is shows beside its noise, which is a millimetre: it is a floor for all that.
        wanders = wandering_m(problem, state.estimate) > JUDGEMENT.least_m
        wandering = over_usual(plane_misfit(problem, state.estimate), points)
        badness = np.maximum(badness, np.where(wanders, wandering / rules.worst_wandering, 0.0))
    doubt = plane_doubts(problem, state.estimate, None if settled else rules.rough_m)
    badness = np.maximum(badness, doubt.max(axis=1))
    spared = np.array([plane.chosen for plane in state.planes]) | (points > most_share * points.sum())
    badness = np.where(spared, 0.0, badness)
    keep = kept_planes(badness, points, rules.fewest)
    if keep.all() or keep.sum() < rules.fewest:
        return state
    left = [plane for plane, kept in zip(state.planes, keep, strict=True) if not kept]
    say_left_out(data.run, left, doubt[~keep], level_at_m(state.planes, state.estimate)[~keep])
    return only_planes(state, keep, (scatter < 1.0) & (doubt[:, 2] < 1.0), rules)


def twins(state: Estimation, rules: PlaneSet) -> dict[int, int]:
    """Planes that have come to lie where another does, and which that is: neither has points then, which may be either's.

    Of two the later, or the one that nobody chose. Those that were chosen stay, and parts of a wall that are cut out of it.
    """
    e = state.estimate
    mine = (e.normals, e.offsets_m)
    same = same_surface(*mine, of=mine, within_deg=rules.twin_deg, within_m=rules.twin_m)
    whole = np.array([plane.outline_m is None for plane in state.planes])
    found = dict[int, int]()
    # Who may go goes first, the last before the others.
    for k in reversed(range(len(state.planes))):
        others = [int(j) for j in np.flatnonzero(same[k] & whole) if j != k and j not in found]
        if others and whole[k] and not state.planes[k].chosen:
            found[k] = others[0]
    return found


def mark_planes(data: JointData, state: Estimation, rules: PlaneSet) -> Estimation:
    """The same planes, of those that were chosen and hold few of the points each with what is wrong while gates are wide."""
    problem = gathered(data, state)
    doubt = plane_doubts(problem, state.estimate, rules.rough_m)
    _, points = plane_chi2(problem, state.estimate)
    clutter = (points <= rules.clutter_share * points.sum()) & np.array([plane.chosen for plane in state.planes])
    faults = [fault_of(row) for row in doubt * clutter[:, None]]
    planes = tuple(replace(plane, fault=fault) for plane, fault in zip(state.planes, faults, strict=True))
    return replace(state, planes=planes)


def only_planes(state: Estimation, keep: BoolArray, single: BoolArray, rules: PlaneSet) -> Estimation:
    """With some of the planes (P,), the others put aside; points have to be given anew. single: (P,) which are one surface.

    A wall that is left out still stands where it meets another, and what lies in that edge is not the other's. One that is
    parallel to a plane that stays, and near it, is the same surface seen twice: put aside, it would claim that one's points.
    Clutter taken for a plane has no edge at all.
    """
    planes = tuple(plane for plane, kept in zip(state.planes, keep, strict=True) if kept)
    e = state.estimate
    twice = same_surface(
        e.normals[~keep], e.offsets_m[~keep], of=(e.normals[keep], e.offsets_m[keep]),
        within_deg=rules.same_normal_deg, within_m=rules.same_surface_m,
    )  # fmt: skip
    aside = np.flatnonzero(~keep)[~twice.any(axis=1) & single[~keep]]
    estimate = replace(
        e,
        normals=e.normals[keep],
        offsets_m=e.offsets_m[keep],
        aside_normals=np.vstack([e.aside_normals, e.normals[aside]]),
        aside_offsets_m=np.append(e.aside_offsets_m, e.offsets_m[aside]),
    )
    state, left = replace(state, estimate=estimate, planes=planes, observations=None), state.nuisance.of_planes(keep)
    return state if left is state.nuisance else state.with_nuisance(left)


def over_usual(badness: FloatArray, points: FloatArray, least: float = 1e-30) -> FloatArray:
    """How many times as bad as the one in the middle, counted by points, each plane is. (P,) each. least: of that one."""
    order = np.argsort(badness)
    typical = badness[order][np.searchsorted(np.cumsum(points[order]), 0.5 * points.sum())]
    return np.asarray(badness / max(typical, least))


def kept_planes(badness: FloatArray, points: FloatArray, fewest: int) -> BoolArray:
    """Which planes stay, (P,): those that have points and a badness (P,) below one, but so many best of them in any case.

    Two good walls among much clutter: that a third is doubtful is no reason to keep everything.
    """
    ranked = np.where(points > 0, badness, np.inf)
    keep = ranked < 1.0
    best = np.argsort(ranked, kind="stable")[:fewest]
    keep[best] |= np.isfinite(ranked[best])
    return keep
