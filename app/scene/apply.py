"""From items to viser: a thin adapter that sends only what changed. The one place that knows viser's scene."""

from __future__ import annotations

import socket
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, cast

import numpy as np
import viser
from numpy.typing import NDArray

from app.scene.aim import Stage, Stand, hidden, stand
from app.scene.cutaway import pieces
from app.scene.cycle import Cycle, pierced
from app.scene.doorless import DoorlessViser, leaving
from app.scene.items import WHOLE_ROOM, Axes, Cloud, Content, Edges, Floor, Item, Label, Line, Sheet, fingerprint
from app.scene.readout import read_out
from app.scene.region import frustum_sides
from app.scene.wipe import Camera
from calib_core.types import FloatArray

OnPatch = Callable[[int], None]
OnRay = Callable[[FloatArray, FloatArray, bool], None]
OnCamera = Callable[[], None]
OnBox = Callable[[FloatArray], None]

#: A canvas is taken to be so wide for its height until a browser tells.
ASPECT = 1.6
#: What is behind the clouds: nothing drawn may vanish into it, neither white nor dark blue.
BACKGROUNDS: dict[bool, tuple[int, int, int]] = {True: (12, 14, 17), False: (204, 210, 217)}


#: What viser's own panel, which nobody sees, is called once there is something to see.
FIRST_PICTURE = "first picture"
#: Lines on the ground, to be seen on either background without drawing the eye.
GRID = (110, 116, 124)


class _Node(Protocol):
    visible: bool

    def remove(self) -> None:
        """Take the node out of the scene."""


@dataclass
class _Put:
    """A node of the scene, what it was made of, and the wall that it is hidden with."""

    mark: int
    item: Item
    node: _Node
    wall: int | None


def quat_wxyz(rotation: FloatArray) -> tuple[float, float, float, float]:
    """The quaternion of a rotation matrix in viser's order, scalar first. Nothing else converts."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = (float(part) for part in Rotation.from_matrix(rotation).as_quat())
    return w, x, y, z


def rotation_matrix(wxyz: NDArray[np.float64]) -> FloatArray:
    """The rotation (3, 3) of a quaternion in viser's order."""
    from scipy.spatial.transform import Rotation

    w, x, y, z = wxyz
    return np.asarray(Rotation.from_quat([x, y, z, w]).as_matrix(), dtype=np.float64)


def camera_of(camera: viser.CameraHandle) -> Camera:
    """Where a browser looks from, as viser tells it."""
    return Camera(
        R_scene_camera=rotation_matrix(camera.wxyz),
        p_scene_camera=np.array(camera.position, dtype=np.float64),
        fov_rad=float(camera.fov),
        aspect=float(camera.aspect),
    )


class ShownScene:
    """One viser server and what it shows.

    on_patch: called with a patch's place when its sheet is clicked; on_ray: with origin (3,) and direction (3,) of any
    click, in scene coordinates, and whether Ctrl or Alt was held. A plain click on a sheet calls both. on_camera: after a
    browser's camera has moved. on_box: with the half-spaces (4, 4) of a rectangle dragged with Shift held, or, while
    `drag_boxes` is on, with any drag. All from viser's threads.
    """

    def __init__(
        self,
        *,
        on_patch: OnPatch,
        on_ray: OnRay,
        on_camera: OnCamera = lambda: None,
        on_box: OnBox = lambda _: None,
    ) -> None:
        self._server = DoorlessViser()
        self._on_patch = on_patch
        self._nodes: dict[str, _Put] = {}
        self._dark: bool | None = None
        self._aim: tuple[str, str, int] | None = None
        self._camera: Camera | None = None
        self._whole: FloatArray | None = None
        self._stage = Stage()
        self._content = Content((), "")
        self._behind: frozenset[int] = frozenset()
        self._labelled = False
        self._cycle = Cycle()
        self._server.scene.set_up_direction("+z")

        def clicked(event: viser.SceneClickEvent) -> None:
            on_ray(np.array(event.ray_origin), np.array(event.ray_direction), event.modifier is not None)

        self._server.scene.on_click()(clicked)
        self._server.scene.on_click(modifier="cmd/ctrl")(clicked)
        self._server.scene.on_click(modifier="alt")(clicked)

        def boxed(event: viser.SceneRectSelectEvent) -> None:
            sides = frustum_sides(camera_of(event.client.camera), event.screen_min, event.screen_max)
            if sides is not None:
                on_box(sides)

        self._boxed = boxed
        self._drags_boxes = False
        self._server.scene.on_rect_select(modifier="shift")(boxed)

        def moved(camera: viser.CameraHandle) -> None:
            self._camera = camera_of(camera)
            self._cut(self._camera.p_scene_camera)
            on_camera()

        def connected(client: viser.ClientHandle) -> None:
            client.camera.on_update(moved)
            self._turn(client)  # what was aimed at while it was connecting

        self._server.on_client_connect(connected)

    def dial(self) -> socket.socket:
        """A connection to the server, which listens nowhere."""
        return self._server.dial()

    @property
    def camera(self) -> Camera | None:
        """Where the browser looks from whose camera moved last; None before there is one."""
        return self._camera

    def read_out(self, place: tuple[float, float]) -> str:
        """What is under the pointer at that place of the canvas, shares of it, in the browser that moved last."""
        camera, content = self._camera, self._content
        if camera is None or content.readout is None:
            return ""
        return read_out(content.readout, content.stage.walls, camera, place)

    def show(self, content: Content, *, dark: bool) -> None:
        """Make the scene be the content."""
        if dark != self._dark:
            self._dark = dark
            self._server.gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False)
            self._server.scene.set_background_image(np.full((1, 1, 3), BACKGROUNDS[dark], dtype=np.uint8), format="png")
        self._set_stage(content.stage)
        self._content = content
        aim = (content.aim or (self._aim or (WHOLE_ROOM,))[0], content.preset, content.looks)
        if aim != self._aim:
            self._look(content, aim)
        wanted = {item.path: (wall, item) for wall, item in _in_pieces(content)}
        with self._server.atomic():
            for path in [path for path in self._nodes if path not in wanted]:
                self._nodes.pop(path).node.remove()
            for path, (wall, item) in wanted.items():
                mark = fingerprint(item)
                known = self._nodes.get(path)
                if known is None or known.mark != mark:
                    node = self._put(item, known)
                    self._nodes[path] = _Put(mark, item, node, wall)
                    node.visible = wall not in self._behind
                known = self._nodes[path]
                if known.wall != wall:
                    known.wall = wall
                    known.node.visible = wall not in self._behind
        if not self._labelled:  # comes after the background and the first content; the page waits for it
            self._labelled = True
            self._server.gui.set_panel_label(FIRST_PICTURE)
        self._server.flush()

    def drag_boxes(self, on: bool) -> None:
        """Let a plain drag draw a rectangle instead of turning the view, or turn it again."""
        if on == self._drags_boxes:
            return
        self._drags_boxes = on
        self._server.scene.remove_rect_select_callback(self._boxed)
        if on:
            self._server.scene.on_rect_select()(self._boxed)
        self._server.scene.on_rect_select(modifier="shift")(self._boxed)

    def export_html(self) -> str:
        """The scene as one self-contained page."""
        return self._server.scene.as_html(dark_mode=bool(self._dark))

    def close(self) -> None:
        """Stop the server; browsers lose their connection."""
        self._server.stop()

    def _put(self, item: Item, known: _Put | None) -> _Node:
        scene = self._server.scene
        match item:
            case Cloud(path=path, xyz=xyz, rgb=rgb, size_m=size_m):
                if known is not None and isinstance(known.node, viser.PointCloudHandle):
                    known.node.points, known.node.colors = xyz, rgb
                    known.node.point_size = size_m
                    return cast(_Node, known.node)
                cloud = scene.add_point_cloud(
                    path, xyz, rgb, point_size=size_m, point_shape="circle", precision="float32", point_shading="flat"
                )
                return cast(_Node, cloud)
            case Sheet():
                return self._put_sheet(item, known)
            case Line(path=path, xyz=xyz, rgb=rgb, width_px=width_px):
                pairs = np.stack([xyz[:-1], xyz[1:]], axis=1)
                return cast(
                    _Node, scene.add_line_segments(path, pairs, rgb, thickness=width_px, thickness_units="screen")
                )
            case Edges(path=path, ends=ends, rgb=rgb, width_px=width_px):
                return cast(
                    _Node, scene.add_line_segments(path, ends, rgb, thickness=width_px, thickness_units="screen")
                )
            case Floor():
                return self._put_floor(item)
            case Axes(path=path, R_scene_frame=rotation, p_scene_frame=position, length_m=length_m):
                return cast(
                    _Node,
                    scene.add_frame(
                        path,
                        axes_length=length_m,
                        axes_radius=length_m / 40,
                        wxyz=quat_wxyz(rotation),
                        position=position,
                    ),
                )
            case Label(path=path, text=text, position=position):
                return cast(_Node, scene.add_label(path, text, position=position))

    def _put_sheet(self, sheet: Sheet, known: _Put | None) -> _Node:
        if known is not None and isinstance(known.item, Sheet) and isinstance(known.node, viser.MeshHandle):
            before = known.item
            if np.array_equal(before.vertices, sheet.vertices) and before.patch == sheet.patch:
                known.node.color, known.node.opacity = sheet.rgb, sheet.opacity
                return cast(_Node, known.node)
        handle = self._server.scene.add_mesh_simple(
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
            handle.on_click(
                lambda event: self._clicked(patch, np.array(event.ray_origin), np.array(event.ray_direction))
            )
        return cast(_Node, handle)

    def _clicked(self, patch: int, origin_m: FloatArray, direction: FloatArray) -> None:
        """A sheet was clicked; clicked again at the same place, the ones behind it take turns."""
        sheets = [put.item for put in list(self._nodes.values()) if isinstance(put.item, Sheet) and put.node.visible]
        for meant in self._cycle.click(patch, pierced(sheets, origin_m, direction), origin_m, direction):
            self._on_patch(meant)

    def _put_floor(self, floor: Floor) -> _Node:
        grid = self._server.scene.add_grid(
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
        return cast(_Node, grid)

    def _set_stage(self, stage: Stage) -> None:
        if not np.allclose(stage.up, self._stage.up, atol=1e-6):
            self._server.scene.set_up_direction(stage.up)
            self._aim = None  # cameras have been turned over with the world
        self._stage = stage

    def _cut(self, eye_m: FloatArray) -> None:
        """Hide what a camera there would see from behind, and show the rest."""
        behind = frozenset(int(wall) for wall in np.flatnonzero(hidden(self._stage.walls, eye_m)))
        if behind == self._behind:
            return
        self._behind = behind
        with self._server.atomic():
            for put in list(self._nodes.values()):
                if put.wall is not None and put.node.visible != (put.wall not in behind):
                    put.node.visible = put.wall not in behind
        self._server.flush()

    def _stand(self, *, fov_rad: float, aspect: float) -> Stand | None:
        if self._whole is None:
            return None
        return stand(self._whole, self._stage, self._content.preset, fov_rad=fov_rad, aspect=aspect)

    def _turn(self, client: viser.ClientHandle) -> None:
        """Have a browser look as the preset says, as wide as its canvas is."""
        found = self._stand(fov_rad=float(client.camera.fov), aspect=float(client.camera.aspect))
        if found is None:
            return
        with leaving(client), client.atomic():
            client.camera.up_direction = self._stage.up
            client.camera.position, client.camera.look_at = found.eye_m, found.middle_m
        self._cut(found.eye_m)

    def _look(self, content: Content, aim: tuple[str, str, int]) -> None:
        """Look as the preset says at all clouds, without any at the sheets, in browsers that are here and those that come."""
        clouds = [item.xyz for item in content.items if isinstance(item, Cloud) and len(item.xyz) > 0]
        whole = clouds or [item.vertices for item in content.items if isinstance(item, Sheet)]
        if not whole:
            return
        points = np.concatenate(whole).astype(np.float64)
        self._whole = points[:: max(1, len(points) // 5000)]
        self._aim = aim
        found = self._stand(fov_rad=float(self._server.initial_camera.fov), aspect=ASPECT)
        if found is None:
            return
        self._server.initial_camera.up = self._stage.up
        self._server.initial_camera.look_at = found.middle_m
        self._server.initial_camera.position = found.eye_m
        self._cut(found.eye_m)
        for client in self._server.get_clients().values():
            self._turn(client)


def _in_pieces(content: Content) -> list[tuple[int | None, Item]]:
    """The items, each with the wall it is hidden with. A cloud without points is no cloud: viser's page complains."""
    found: list[tuple[int | None, Item]] = []
    for item in content.items:
        match item:
            case Cloud(xyz=xyz):
                found += pieces(item, content.stage.walls) if len(xyz) > 0 else []
            case Sheet(wall=wall) | Edges(wall=wall) | Label(wall=wall):
                found.append((wall, item))
            case Line() | Floor() | Axes():
                found.append((None, item))
    return found
