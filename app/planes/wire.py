"""Planes as the wire carries them, with the sentence about determinacy."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from app.planes.geometry import LEAST_EIGENVALUE, SAME_DIRECTION_COS, spread_of_directions
from app.planes.palette import plane_hex
from app.planes.state import EditedPatch, PlaneHistory, PlaneSet
from app.schemas.planes import Determinacy, Foreseen, Patch, Planes
from calib_core.types import FloatArray


def wire_planes(
    history: PlaneHistory,
    *,
    static: bool,
    up: FloatArray | None = None,
    known: Foreseen | None = None,
    doubts: Mapping[int, str] = MappingProxyType({}),
) -> Planes:
    """The planes as every browser sees them. up: (3,) against gravity, map frame; None where that is not known.   doubts: what
    seems wrong with a proposal, by its place.
    """
    fixed = determinacy(history.current, up)
    if not fixed.ok:
        known = None  # of a solve that cannot follow the motion no figure is foreseen; what is missing is said there
    vertical = np.array([0.0, 0.0, 1.0]) if up is None else up
    return Planes(
        patches=[
            Patch(
                index=index,
                name=patch.name,
                normal=list(patch.normal),
                offset_m=patch.offset_m,
                area_m2=patch.area_m2,
                n_points=patch.n_points,
                rms_m=patch.rms_m,
                tilt_deg=math.degrees(math.acos(min(1.0, abs(float(np.array(patch.normal) @ vertical))))),
                confirmed=patch.confirmed,
                restricted=bool(patch.region),
                insisted=patch.insisted,
                doubt="" if history.current.region else _doubt(patch, doubts),
                color=plane_hex(patch.color),
            )
            for index, patch in enumerate(history.current.patches)
        ],
        determinacy=fixed,
        foreseen=known,
        static=static,
        upright=up is not None,
        restricted=bool(history.current.region),
        can_undo=history.can_undo,
        can_redo=history.can_redo,
        revision=history.revision,
    )


def _doubt(patch: EditedPatch, doubts: Mapping[int, str]) -> str:
    """What seems wrong with a patch as it was found: one that a person has cut or merged counts, and is another by now."""
    return "" if patch.region or len(patch.members) != 1 else doubts.get(patch.members[0], "")


def determinacy(planes: PlaneSet, up: FloatArray | None = None) -> Determinacy:
    """Whether the confirmed planes look in enough directions, and if not, which plane is missing."""
    normals = np.array([patch.normal for patch in planes.patches if patch.confirmed], dtype=np.float64).reshape(-1, 3)
    eigenvalue, free = spread_of_directions(normals)
    ok = eigenvalue >= LEAST_EIGENVALUE
    if ok:
        text = f"{len(normals)} confirmed planes fix all three directions."
    elif len(normals) == 0:
        text = "No plane is confirmed: confirm at least three that face different ways."
    elif np.all(np.abs(normals @ normals[0]) > SAME_DIRECTION_COS):
        which = "The confirmed plane fixes" if len(normals) == 1 else "The confirmed planes face one way and fix"
        text = f"{which} one direction of three: confirm two more, facing two other ways."
    else:
        text = f"Nothing fixes motion {_words(free, up)}: confirm a plane that faces that way."
    return Determinacy(ok=ok, text=text, smallest_eigenvalue=eigenvalue)


def _words(direction: FloatArray, up: FloatArray | None) -> str:
    """A direction of the map frame in words: to someone upright where the vertical is known."""
    if up is not None and abs(float(direction @ up)) > 0.94:
        return "up and down"
    if up is not None and abs(float(direction @ up)) < 0.34:
        return "level, along the walls that are confirmed"
    axis = int(np.abs(direction).argmax())
    if abs(direction[axis]) > 0.94:
        return f"along the lidar's {'xyz'[axis]} axis"
    signed = direction if direction[axis] > 0 else -direction
    return "along the lidar's direction (" + ", ".join(f"{component:.2f}" for component in signed) + ")"
