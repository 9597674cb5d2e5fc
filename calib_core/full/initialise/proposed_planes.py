"""What was proposed, what a person chose of it, and which of a track's planes are which.

Planes are proposed in the reference scan as it was taken. A track that begins on the move straightens that scan and finds its
planes anew, and others come into view on the way: what was proposed is told by where it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib_core.full.initialise.settings import AGREEING
from calib_core.full.odometry.reference import Followed
from calib_core.full.planes.settings import PATCHES
from calib_core.plane_kinds import PLAIN_NAME, called, kind_of, next_name
from calib_core.planes.same_plane import same_surface
from calib_core.types import BoolArray, FloatArray, IntArray, Plane


def joined(found: Sequence[Plane], given: Sequence[Plane]) -> list[Plane]:
    """The found planes, and those given that are not among them."""
    known: BoolArray = np.any(_same(given, found), axis=1)
    return [
        *found,
        *(Plane(p.name, p.normal, p.offset_m) for p, is_known in zip(given, known, strict=True) if not is_known),
    ]


def choice_among(proposals: Sequence[Plane], given: Sequence[Plane] | None) -> Sequence[Plane] | None:
    """What a person has chosen; None where that is nothing: none of the proposals was touched, and none was cut."""
    if given is None or not all(plane.suggested and plane.outline_m is None for plane in given):
        return given
    return None if proposals and len(joined(given, proposals)) == len(given) else given


def matched(planes: Sequence[Plane], proposals: Sequence[Plane]) -> IntArray:
    """(P,) which of the proposals each of the planes is, the nearest of those that it may be; -1 for none.

    Those of a straightened scan are found anew: in another order, one of them twice, and as far from the proposals as a sweep
    bends them.
    """
    normals, others = (np.array([p.normal for p in some]).reshape(-1, 3) for some in (planes, proposals))
    offsets_m, theirs_m = (np.array([p.offset_m for p in some]) for some in (planes, proposals))
    may_be = same_surface(
        normals, offsets_m, of=(others, theirs_m), within_deg=PATCHES.distinct_deg, within_m=PATCHES.distinct_m
    )
    if not may_be.size:
        return np.full(len(planes), -1)
    turned = np.degrees(np.arccos(np.clip(normals @ others.T, -1.0, 1.0))) / PATCHES.distinct_deg
    apart = np.where(may_be, turned + np.abs(offsets_m[:, None] - theirs_m) / PATCHES.distinct_m, np.inf)
    return np.where(may_be.any(axis=1), np.argmin(apart, axis=1), -1)


def named(followed: Followed, given: Sequence[Plane], up: FloatArray) -> Followed:
    """The same track, its proposals and planes called alike: by the names given, or by what they are. No two planes share one.

    given: planes with names.   up: (3,) unit, in their frame.
    """
    if not followed.proposals:
        return replace(followed, planes=called(followed.planes, up, 0))
    proposals = called(_named_as(given, followed.proposals), up, len(followed.proposals))
    names = [plane.name for plane in proposals]
    planes, told = list[Plane](), set[int]()
    for plane, which in zip(followed.planes, followed.of_proposal, strict=True):
        if which >= 0 and which not in told:
            name = names[which]
        elif PLAIN_NAME.fullmatch(plane.name):
            name = next_name(kind_of(plane.normal, up)[0], [*names, *(other.name for other in planes)])
        else:
            name = plane.name
        told.add(which)
        planes.append(replace(plane, name=name))
    return replace(followed, proposals=tuple(proposals), planes=planes)


def late_and_dropped(followed: Followed, choice: Sequence[Plane]) -> tuple[list[Plane], list[Plane]]:
    """The track's planes that came into view, and are neither proposed nor chosen; and those that were dropped, as they are known
    by now. choice: what was not dropped.
    """
    kept = np.any(_same(choice, followed.proposals), axis=0)
    is_chosen: list[bool] = np.any(_same(followed.planes, choice), axis=1).tolist()
    planes = list(zip(followed.planes, followed.of_proposal, is_chosen, strict=True))
    late = [plane for plane, which, chosen in planes if which < 0 and not chosen]
    dropped = [plane for plane, which, _ in planes if which >= 0 and not kept[which]]
    return late, dropped + [plane for plane in lost(followed) if not _same(choice, [plane]).any()]


def lost(followed: Followed) -> list[Plane]:
    """The proposals that are none of the track's planes: of their own they were in the sweep as it was taken alone."""
    return [plane for k, plane in enumerate(followed.proposals) if k not in followed.of_proposal]


def tracked(followed: Followed, planes: Sequence[Plane]) -> IntArray:
    """(P,) which of the track's planes each of these is, chosen ones by the proposal that they are; -1 for none.

    Where it was proposed says no more than that: what is clutter, or a corner, the motion may have turned to another surface.
    """
    same = _same(planes, followed.planes)
    if followed.proposals:
        of = np.array(followed.of_proposal, int)
        proposed = _same(planes, followed.proposals)
        by_proposal = np.where(of >= 0, proposed[:, np.maximum(of, 0)], False)
        # A plane that came into view is near no proposal, one that was chosen may be near its neighbour by now.
        is_proposed: BoolArray = np.any(proposed, axis=1)
        same = np.where(is_proposed[:, None], by_proposal, same & (of < 0))
    normals, others = (np.array([p.normal for p in some]).reshape(-1, 3) for some in (planes, followed.planes))
    offsets_m, theirs_m = (np.array([p.offset_m for p in some]) for some in (planes, followed.planes))
    apart = np.linalg.norm(normals[:, None] - others, axis=2) + np.abs(offsets_m[:, None] - theirs_m)
    return np.where(np.any(same, axis=1), np.argmin(np.where(same, apart, np.inf), axis=1), -1)


def own_and_merged(followed: Followed, choice: Sequence[Plane]) -> tuple[list[Plane], list[Plane]]:
    """Those of a choice that are planes of their own; and those that were proposed and are none in the track: each lost, or the
    same as one before it.

    Both would be laid where a bent sweep showed them, beside the true ones, whose points they claim.
    """
    which = tracked(followed, choice).tolist()
    own, merged = list[Plane](), list[Plane]()
    for i, (plane, k) in enumerate(zip(choice, which, strict=True)):
        is_merged = bool(followed.proposals) and plane.suggested and (k < 0 or k in which[:i])
        (merged if is_merged else own).append(plane)
    return own, merged


def _named_as(given: Sequence[Plane], proposals: Sequence[Plane]) -> list[Plane]:
    """The proposals, by the names of those given that are the same."""
    same = _same(given, proposals)
    return [
        replace(plane, name=given[int(np.argmax(one))].name) if one.any() else plane
        for plane, one in zip(proposals, same.T, strict=True)
    ]


def _same(planes: Sequence[Plane], others: Sequence[Plane]) -> BoolArray:
    """(P, Q) which of the planes are which of the others."""
    mine, theirs = (
        (np.array([p.normal for p in some]).reshape(-1, 3), np.array([p.offset_m for p in some]))
        for some in (planes, others)
    )
    return same_surface(*mine, of=theirs, within_deg=AGREEING.same_deg, within_m=AGREEING.same_m)
