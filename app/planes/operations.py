"""The operations: each a pure function from a set of planes to the next one, or a refusal in one sentence."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from app.errors import BadRequest
from app.planes.geometry import FittedPlane, fit_plane, labels, within_region
from app.planes.state import EditedPatch, PlaneSet, Side, suggested
from app.schemas.planes import Confirm, Drop, Grow, Insist, Merge, Rename, Restrict, Toggle, UseSuggestion
from app.schemas.planes import Side as WireSide
from calib_core.types import FloatArray, PlanePatch, PlaneProposals

Editing = Confirm | Drop | Toggle | Insist | Rename | Merge | Grow | Restrict | UseSuggestion
GrowPlane = Callable[[PlaneProposals, FloatArray], PlanePatch | None]

#: Patches are one plane only if their common plane leaves no more than this beside what each alone leaves.
MERGE_EXTRA_RMS_M = 0.05
#: Patches that a page offers to merge face the same way within this, and lie as near: pieces of one wall that a scan bent.
MERGE_OFFERED_DEG, MERGE_OFFERED_M = 12.0, 0.4
#: Fewer points than this inside a box are no plane.
LEAST_POINTS = 30
#: A seed this near to a point of the cloud is that point.
SAME_POINT_M = 0.02
#: Half-spaces kept of one set or patch: a dozen boxes, each of which every point is asked about.
MOST_SIDES = 48


def apply(planes: PlaneSet, operation: Editing, *, proposals: PlaneProposals, grow: GrowPlane) -> PlaneSet:
    """The set after the operation."""
    match operation:
        case Confirm(index=index) | Insist(index=index):
            return _with(planes, index, confirmed=True, insisted=isinstance(operation, Insist))
        case Drop(index=index):
            return _with(planes, index, confirmed=False)
        case Toggle(index=index):
            return _with(planes, index, confirmed=not _patch(planes, index).confirmed)
        case Rename(index=index, name=name):
            return _renamed(planes, index, name.strip())
        case Merge(indices=indices):
            return _merged(planes, indices, proposals)
        case Grow(seed_m=seed_m):
            return _grown(planes, np.array(seed_m), proposals, grow)
        case Restrict(index=index, sides=sides):
            return _restricted(planes, index, [_side(side) for side in sides], proposals)
        case UseSuggestion():
            return suggested(proposals)


def _patch(planes: PlaneSet, index: int) -> EditedPatch:
    if index >= len(planes.patches):
        raise BadRequest(
            "planes.index", f"There is no plane {index}; there are {len(planes.patches)}, counted from 0: look again."
        )
    return planes.patches[index]


def _replaced(planes: PlaneSet, index: int, patch: EditedPatch) -> PlaneSet:
    return planes.model_copy(update={"patches": (*planes.patches[:index], patch, *planes.patches[index + 1 :])})


def _with(planes: PlaneSet, index: int, *, confirmed: bool, insisted: bool = False) -> PlaneSet:
    patch = _patch(planes, index)
    if confirmed and patch.confirmed:
        insisted = insisted or patch.insisted
    return _replaced(planes, index, patch.model_copy(update={"confirmed": confirmed, "insisted": insisted}))


def _renamed(planes: PlaneSet, index: int, name: str) -> PlaneSet:
    patch = _patch(planes, index)
    if not name or not name.isprintable():
        raise BadRequest("planes.name", "A plane's name has at least one visible character; type another.")
    if any(other.name == name for other in planes.patches if other is not patch):
        raise BadRequest("planes.name_taken", f"Another plane is called {name!r}; choose a name of its own.")
    return _replaced(planes, index, patch.model_copy(update={"name": name}))


def _merged(planes: PlaneSet, indices: list[int], proposals: PlaneProposals) -> PlaneSet:
    chosen = sorted(set(indices))
    if len(chosen) < 2:
        raise BadRequest("planes.merge_one", "Merging takes two planes or more; choose another one too.")
    parts = [_patch(planes, index) for index in chosen]
    points_m = proposals.cloud_m[np.isin(labels(proposals, planes), chosen)]
    fitted = fit_plane(points_m)
    most_m = max(part.rms_m for part in parts) + MERGE_EXTRA_RMS_M
    names = " and ".join(part.name for part in parts)
    if fitted is None or fitted.rms_m > most_m:
        left_m = "no plane" if fitted is None else f"{fitted.rms_m * 1e3:.0f} mm"
        raise BadRequest(
            "planes.merge_apart",
            f"{names} do not lie in one plane: together they would leave {left_m}, at most {most_m * 1e3:.0f} mm is "
            "accepted; merge pieces of one wall only.",
        )
    whole = _fitted(parts[0], fitted, len(points_m)).model_copy(
        update={
            "confirmed": any(part.confirmed for part in parts),
            "members": tuple(member for part in parts for member in part.members),
            # Different boxes have no box in common that would be the whole's; the first one's would cut the others off.
            "region": parts[0].region if all(part.region == parts[0].region for part in parts) else (),
        }
    )
    rest = tuple(patch for index, patch in enumerate(planes.patches) if index not in chosen[1:])
    return _replaced(planes.model_copy(update={"patches": rest}), chosen[0], whole)


def _restricted(planes: PlaneSet, index: int | None, sides: list[Side], proposals: PlaneProposals) -> PlaneSet:
    """The set, or one patch of it, within the half-spaces; what has points left is fitted to them again."""
    if index is None:
        wanted = planes.model_copy(update={"region": (*planes.region, *sides)})
        most = len(wanted.region)
    else:
        patch = _patch(planes, index)
        patch = patch.model_copy(update={"region": (*patch.region, *sides)})
        wanted, most = _replaced(planes, index, patch), len(patch.region)
    if most > MOST_SIDES:
        raise BadRequest(
            "planes.many_boxes",
            f"At most {MOST_SIDES // 4} boxes add up; undo some, or use the suggestion and begin anew.",
        )
    before, after = labels(proposals, planes), labels(proposals, wanted)
    left: list[EditedPatch] = []
    for place, patch in enumerate(wanted.patches):
        mine = after == place
        if np.array_equal(mine, before == place):
            left.append(patch)
            continue
        fitted = fit_plane(proposals.cloud_m[mine]) if mine.sum() >= LEAST_POINTS else None
        if fitted is not None:
            left.append(_fitted(patch, fitted, int(mine.sum())))
        elif index is not None:
            raise BadRequest(
                "planes.box_empty", f"Nothing of {patch.name} lies in that box; draw it around a part of it."
            )
    if not left:
        raise BadRequest("planes.box_empty", "No plane lies in that box; draw it around walls, floor or ceiling.")
    return wanted.model_copy(update={"patches": tuple(left)})


def _fitted(patch: EditedPatch, fitted: FittedPlane, n_points: int) -> EditedPatch:
    """The patch on another plane through other points."""
    return patch.model_copy(
        update={
            "normal": tuple(fitted.normal.tolist()),
            "offset_m": fitted.offset_m,
            "outline_m": tuple(map(tuple, fitted.outline_m.tolist())),
            "n_points": n_points,
            "rms_m": fitted.rms_m,
            "area_m2": fitted.area_m2,
        }
    )


def _side(side: WireSide) -> Side:
    """The half-space with a normal of unit length."""
    length = float(np.linalg.norm(side.normal))
    if not np.isfinite(length) or length < 1e-9:
        raise BadRequest("planes.side", "A side of a box needs a normal that is not zero; give three numbers.")
    x, y, z = (component / length for component in side.normal)
    return x, y, z, side.offset_m / length


def _grown(planes: PlaneSet, seed_m: FloatArray, proposals: PlaneProposals, grow: GrowPlane) -> PlaneSet:
    owner = labels(proposals, planes)
    _refuse_taken(planes, seed_m, proposals, owner)
    # Only what no patch of today's set has taken, and inside its box: also what a box has set free, never a piece twice.
    inside = within_region(proposals.cloud_m, planes.region)
    found = grow(
        replace(
            proposals,
            cloud_m=proposals.cloud_m[inside],
            cloud_patch=owner[inside],
            cloud_intensity=proposals.cloud_intensity[inside],
        ),
        seed_m,
    )
    if found is None:
        raise BadRequest(
            "planes.no_plane_there",
            "Around that point the cloud is not flat enough for a plane; click a wall or a floor.",
        )
    patch = EditedPatch(
        name=free_name((patch.name for patch in planes.patches), found.plane.name or "plane"),
        normal=found.plane.normal.tolist(),
        offset_m=float(found.plane.offset_m),
        outline_m=found.outline_m.tolist(),
        n_points=int(found.n_points),
        rms_m=float(found.rms_m),
        area_m2=float(found.area_m2),
        confirmed=True,
        members=(),
        color=1 + max((patch.color for patch in planes.patches), default=-1),
    )
    return planes.model_copy(update={"patches": (*planes.patches, patch)})


def _refuse_taken(planes: PlaneSet, seed_m: FloatArray, proposals: PlaneProposals, owner: NDArray[np.int16]) -> None:
    """Say whose the point is where it is somebody's: "not flat enough" would be a riddle on a wall."""
    if len(proposals.cloud_m) == 0:
        return
    away_m = np.linalg.norm(proposals.cloud_m - seed_m, axis=1)
    nearest = int(np.argmin(away_m))
    if away_m[nearest] > SAME_POINT_M or owner[nearest] < 0:
        return
    patch = planes.patches[owner[nearest]]
    if patch.confirmed:
        text = f"That point is on {patch.name} already; click a flat part that no plane has yet."
    else:
        text = f"That point is on {patch.name}, which is dropped; confirm it instead of growing another."
    raise BadRequest("planes.point_taken", text)


def free_name(taken: Iterable[str], wanted: str) -> str:
    """The wanted name, or the first of `wanted 2`, `wanted 3`, ... that is free."""
    names = set(taken)
    if wanted not in names:
        return wanted
    number = 2
    while f"{wanted} {number}" in names:
        number += 1
    return f"{wanted} {number}"
