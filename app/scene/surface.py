"""The room as a surface: sheets in the planes' colours, each hidden with the wall it belongs to."""

from __future__ import annotations

import numpy as np

from app.arrays.surface import Surface
from app.planes import palette
from app.results.plane_table import PlaneTable
from app.results.thickness import GATE_M
from app.scene.aim import Stage, wall_of
from app.scene.build import Solved
from app.scene.items import Sheet

LEGEND = "The surface of the de-skewed map, in the colours of its planes; grey: none."


def surface_items(surface: Surface, solved: Solved, stage: Stage) -> tuple[Sheet, ...]:
    """The triangles, sorted by the wall they are cut away with and the plane they lie on."""
    if len(surface.faces) == 0:
        return ()
    centres = surface.vertices_m[surface.faces].mean(axis=1)
    owner, _ = PlaneTable.of(solved.planes).nearest(centres, gate_m=GATE_M)
    wall = wall_of(centres, stage.walls) if len(stage.walls) else np.full(len(centres), -1)
    sheets: list[Sheet] = []
    for place, plane in sorted(set(zip(wall.tolist(), owner.tolist(), strict=True))):
        mine = surface.faces[(wall == place) & (owner == plane)]
        used, faces = np.unique(mine, return_inverse=True)
        rgb = palette.NO_PLANE if plane < 0 else palette.plane_rgb(solved.colors[plane])
        sheets.append(
            Sheet(
                f"/surface/{place + 1}-{plane + 1}",
                surface.vertices_m[used],
                faces.reshape(-1, 3).astype(np.uint32),
                rgb,
                1.0,
                wall=None if place < 0 else place,
            )
        )
    return tuple(sheets)
