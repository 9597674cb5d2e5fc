"""Each kind of item as a node of viser's scene, made anew or, where that will do, changed in place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, cast

import numpy as np
import viser

from app.scene.items import Axes, Cloud, Edges, Floor, Item, Label, Line, Sheet
from app.scene.viser_poses import quat_wxyz
from calib_core.types import FloatArray

#: Called with a patch's place, and origin (3,) and direction (3,) of the click on its sheet, in scene coordinates.
OnSheet = Callable[[int, FloatArray, FloatArray], None]

#: Lines on the ground, to be seen on either background without drawing the eye.
GRID = (110, 116, 124)


class Node(Protocol):
    """What viser gives back for anything in its scene."""

    visible: bool

    def remove(self) -> None:
        """Take the node out of the scene."""


@dataclass
class Put:
    """A node of the scene, what it was made of, and the wall that it is hidden with."""

    mark: int
    item: Item
    node: Node
    wall: int | None


def put(scene: viser.SceneApi, item: Item, known: Put | None, on_sheet: OnSheet) -> Node:
    """The item's node in the scene. known: what stands at its path now."""
    match item:
        case Cloud(path=path, xyz=xyz, rgb=rgb, size_m=size_m):
            if known is not None and isinstance(known.node, viser.PointCloudHandle):
                known.node.points, known.node.colors = xyz, rgb
                known.node.point_size = size_m
                return cast(Node, known.node)
            cloud = scene.add_point_cloud(
                path, xyz, rgb, point_size=size_m, point_shape="circle", precision="float32", point_shading="flat"
            )
            return cast(Node, cloud)
        case Sheet():
            return _put_sheet(scene, item, known, on_sheet)
        case Line(path=path, xyz=xyz, rgb=rgb, width_px=width_px):
            pairs = np.stack([xyz[:-1], xyz[1:]], axis=1)
            return cast(Node, scene.add_line_segments(path, pairs, rgb, thickness=width_px, thickness_units="screen"))
        case Edges(path=path, ends=ends, rgb=rgb, width_px=width_px):
            return cast(Node, scene.add_line_segments(path, ends, rgb, thickness=width_px, thickness_units="screen"))
        case Floor():
            return _put_floor(scene, item)
        case Axes(path=path, R_scene_frame=rotation, p_scene_frame=position, length_m=length_m):
            return cast(
                Node,
                scene.add_frame(
                    path,
                    axes_length=length_m,
                    axes_radius=length_m / 40,
                    wxyz=quat_wxyz(rotation),
                    position=position,
                ),
            )
        case Label(path=path, text=text, position=position):
            return cast(Node, scene.add_label(path, text, position=position))


def _put_sheet(scene: viser.SceneApi, sheet: Sheet, known: Put | None, on_sheet: OnSheet) -> Node:
    if known is not None and isinstance(known.item, Sheet) and isinstance(known.node, viser.MeshHandle):
        before = known.item
        if np.array_equal(before.vertices, sheet.vertices) and before.patch == sheet.patch:
            known.node.color, known.node.opacity = sheet.rgb, sheet.opacity
            return cast(Node, known.node)
    handle = scene.add_mesh_simple(
        sheet.path,
        sheet.vertices,
        sheet.faces,
        color=sheet.rgb,
        opacity=sheet.opacity,
        side="double",
        flat_shading=True,
        cast_shadow=False,
        receive_shadow=False,
    )
    patch = sheet.patch
    if patch is not None:
        handle.on_click(lambda event: on_sheet(patch, np.array(event.ray_origin), np.array(event.ray_direction)))
    return cast(Node, handle)


def _put_floor(scene: viser.SceneApi, floor: Floor) -> Node:
    grid = scene.add_grid(
        floor.path,
        *floor.size_m,
        plane="xy",
        cell_size=1.0,
        cell_color=GRID,
        cell_thickness=0.6,
        section_size=5.0,
        section_color=GRID,
        section_thickness=1.0,
        shadow_opacity=0.0,
        fade_distance=60.0,
        wxyz=quat_wxyz(floor.R_scene_grid),
        position=floor.p_scene_grid,
    )
    return cast(Node, grid)
