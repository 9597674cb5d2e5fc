"""The cut-away room: a surface seen from behind is hidden with all its points, so that the room behind it can be seen.

A plane's normal points to the side that it was seen from. A camera on the other side would look at the wall's back, which
nobody has ever seen: wall, ceiling or floor is then not drawn. Every point belongs to the plane next to it, so that what
hangs on a wall goes with it; hiding is one word to the browser, and no point is sent twice.
"""

from __future__ import annotations

from app.scene.aim import wall_of
from app.scene.items import Cloud
from calib_core.types import FloatArray


def pieces(cloud: Cloud, walls: FloatArray) -> list[tuple[int | None, Cloud]]:
    """The cloud as one cloud a wall and one of what belongs to none, each with its wall. walls: (K, 4)."""
    if len(walls) == 0 or len(cloud.xyz) == 0:
        return [(None, cloud)]
    wall = wall_of(cloud.xyz, walls)
    found: list[tuple[int | None, Cloud]] = []
    for place in range(-1, len(walls)):
        mine = wall == place
        if mine.any():
            piece = Cloud(f"{cloud.path}/{place + 1}", cloud.xyz[mine], cloud.rgb[mine], cloud.size_m)
            found.append((None if place < 0 else place, piece))
    return found
