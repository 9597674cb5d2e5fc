"""The doctor's names and its vertical, carried over to the proposals.

The doctor looks for planes in samples of the same scans, knows gravity from the motion, and calls planes what they are to
someone who stands upright. A plane of ours that faces the same way at the same distance is the same plane, so it gets the
doctor's name; where enough of them are, both frames are one, and the doctor's vertical is ours. Nothing else names planes.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from app.planes.state import EditedPatch, PlaneHistory, PlaneSet
from calib_core.doctor.report import Forecast, PlanesReport
from calib_core.types import FloatArray, PlaneProposals

#: Samples and whole scans give the same plane to about this: noise of 20 mm over a patch of half a metre.
SAME_COS = np.cos(np.radians(5.0))
SAME_DISTANCE_M = 0.1
#: One plane may agree by chance; two that face different ways do not.
LEAST_MATCHED = 2
#: What the search for planes calls its finds, which says nothing to a person.
PLAIN_NAME = re.compile(r"plane \d+")


@dataclass(frozen=True)
class Room:
    """names: of a proposal's patches, by their place.   up: (3,) unit vector, map frame; None where it is not known.

    forecast: what a solve would know with the planes as they were suggested.
    """

    names: dict[int, str] = field(default_factory=dict)
    up: FloatArray | None = None
    forecast: Forecast | None = None


def room_of(report: PlanesReport | None, proposals: PlaneProposals, forecast: Forecast | None = None) -> Room:
    """What the report says of the proposals' planes; nothing where the two are not in one frame."""
    if report is None:
        return Room(forecast=forecast)
    names: dict[int, str] = {}
    for plane in report.planes:
        if plane.normal is None:
            return Room(forecast=forecast)
        for place, patch in enumerate(proposals.patches):
            faces = float(patch.plane.normal @ np.array(plane.normal))
            apart_m = abs(abs(patch.plane.offset_m) - plane.distance_m)
            if place not in names and faces > SAME_COS and apart_m < SAME_DISTANCE_M:
                names[place] = plane.name
                break
    if len(names) < LEAST_MATCHED:
        return Room(forecast=forecast)
    return Room(names, None if report.up is None else np.array(report.up), forecast)


def named(history: PlaneHistory, room: Room) -> PlaneHistory:
    """The history with the doctor's names where nobody has given others."""
    if not room.names:
        return history
    return history.model_copy(update={"steps": tuple(_named(planes, room) for planes in history.steps)})


def _named(planes: PlaneSet, room: Room) -> PlaneSet:
    taken = {patch.name for patch in planes.patches}

    def name(patch: EditedPatch) -> EditedPatch:
        wanted = room.names.get(patch.color)
        if wanted is None or wanted in taken or PLAIN_NAME.fullmatch(patch.name) is None:
            return patch
        return patch.model_copy(update={"name": wanted})

    return planes.model_copy(update={"patches": tuple(name(patch) for patch in planes.patches)})
