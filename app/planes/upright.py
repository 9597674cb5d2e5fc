"""The doctor's vertical, carried over to the proposals, and the names that it gives them.

The doctor lists the same planes, knows gravity from the motion, and calls planes what they are to someone who stands upright. A
plane of ours that faces the same way at the same distance is the same plane; where enough of them are, both frames are one, and
the doctor's vertical is ours. Then all planes are called what they are, numbered in the doctor's order and without a gap: in
reports of older versions, which looked at samples, a plane may be missing, or be one too many.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from app.planes.state import EditedPatch, PlaneHistory, PlaneSet
from calib_core.doctor.report import Forecast, PlanesReport
from calib_core.plane_kinds import PLAIN_NAME, kind_of, names_of, next_name
from calib_core.types import FloatArray, PlaneProposals

#: A sample and the whole scans gave the same plane to about this: noise of 20 mm over a patch of half a metre.
SAME_COS = np.cos(np.radians(5.0))
SAME_DISTANCE_M = 0.1
#: One plane may agree by chance; two that face different ways do not.
LEAST_MATCHED = 2


@dataclass(frozen=True)
class Room:
    """names: of a proposal's patches, by their place.   up: (3,) unit vector, map frame; None where it is not known.

    forecast: what a solve would know with the planes as they were suggested.   ranks: in the report, of a proposal's patches.
    foresight: folder where the inspection kept what tells how the forecast changes with the planes.   doubts: of a proposal's
    patches that a solve would leave out, by their place, what seems wrong with them.
    """

    names: dict[int, str] = field(default_factory=dict)
    up: FloatArray | None = None
    forecast: Forecast | None = None
    ranks: dict[int, int] = field(default_factory=dict)
    foresight: Path | None = None
    doubts: dict[int, str] = field(default_factory=dict)


def room_of(report: PlanesReport | None, proposals: PlaneProposals, forecast: Forecast | None = None) -> Room:
    """What the report says of the proposals' planes; nothing where the two are not in one frame."""
    if report is None:
        return Room(forecast=forecast)
    ranks: dict[int, int] = {}
    for rank, plane in enumerate(report.planes):
        if plane.normal is None:
            return Room(forecast=forecast)
        for place, patch in enumerate(proposals.patches):
            faces = float(patch.plane.normal @ np.array(plane.normal))
            apart_m = abs(abs(patch.plane.offset_m) - plane.distance_m)
            if place not in ranks and faces > SAME_COS and apart_m < SAME_DISTANCE_M:
                ranks[place] = rank
                break
    if len(ranks) < LEAST_MATCHED or report.up is None:
        return Room(forecast=forecast)
    up = np.array(report.up)
    order = sorted(range(len(proposals.patches)), key=lambda place: (ranks.get(place, len(report.planes)), place))
    kinds = [kind_of(proposals.patches[place].plane.normal, up)[0] for place in order]
    doubts = {place: report.planes[rank].doubt for place, rank in ranks.items() if report.planes[rank].doubt}
    return Room(dict(zip(order, names_of(kinds), strict=True)), up, forecast, ranks, doubts=doubts)


def named(history: PlaneHistory, room: Room) -> PlaneHistory:
    """The history with the doctor's names where nobody has given others."""
    if not room.names:
        return history
    return history.model_copy(update={"steps": tuple(_named(planes, room) for planes in history.steps)})


def _named(planes: PlaneSet, room: Room) -> PlaneSet:
    taken = {patch.name for patch in planes.patches}
    patches = []
    for patch in planes.patches:
        if PLAIN_NAME.fullmatch(patch.name) is not None:
            wanted = room.names.get(patch.color) or _next_name(patch, room, taken | set(room.names.values()))
            if wanted not in taken:
                taken.add(wanted)
                patch = patch.model_copy(update={"name": wanted})  # noqa: PLW2901 - the same patch under its name
        patches.append(patch)
    return planes.model_copy(update={"patches": tuple(patches)})


def _next_name(patch: EditedPatch, room: Room, taken: set[str]) -> str:
    """What a plane is called that was grown by hand: its kind, with the next number where there are some."""
    return next_name(kind_of(np.array(patch.normal), room.up)[0], taken)
