"""From items to viser: a thin adapter that sends only what changed, hides walls seen from behind, and turns cameras."""

from __future__ import annotations

import importlib
import socket
from collections.abc import Callable

import numpy as np
import viser

from app.scene.aim import Stage, Stand, hidden, stand, wall_of
from app.scene.camera import Camera, Place
from app.scene.cutaway import pieces
from app.scene.cycle import Cycle, pierced
from app.scene.embedded_viser import DoorlessViser, leaving
from app.scene.items import WHOLE_ROOM, Axes, Cloud, Content, Edges, Floor, Item, Label, Line, Sheet, fingerprint
from app.scene.nodes import Put, put
from app.scene.readout import read_out
from app.scene.region import frustum_sides
from app.scene.takeaway import cutting_itself
from app.scene.viser_poses import camera_of
from calib_core.types import BoolArray, Float32Array, FloatArray

OnPatch = Callable[[int], None]
OnRay = Callable[[FloatArray, FloatArray, bool], None]
OnCamera = Callable[[], None]
OnBox = Callable[[FloatArray], None]

#: A canvas is taken to be so wide for its height until a browser tells.
ASPECT = 1.6
#: How much of its opacity a sheet keeps that is cut away and shown as glass.
GLASS = 0.3
#: What is behind the clouds, by whether it is dark: nothing drawn may vanish into it, neither white nor dark blue.
BACKGROUNDS: dict[bool, tuple[int, int, int]] = {True: (12, 14, 17), False: (204, 210, 217)}

#: What viser's own panel, which nobody sees, is called once there is something to see.
FIRST_PICTURE = "first picture"
#: Light from everywhere, as bright as the viewer's own sky was: with less, a plane's face is not seen between its points.
AMBIENT = 1.5


def warm_up() -> None:
    """Import what the first scene needs: viser encodes its background with libraries that are brought in there and then."""
    importlib.import_module("imageio.v3").imwrite("<bytes>", np.zeros((1, 1, 3), dtype=np.uint8), extension=".png")


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
        self._nodes: dict[str, Put] = {}
        self._dark: bool | None = None
        self._aim: tuple[str, str, int] | None = None
        self._camera: Camera | None = None
        self._whole: FloatArray | None = None
        self._stage = Stage()
        self._content = Content((), "")
        self._eye_m: FloatArray | None = None
        self._behind: frozenset[int] = frozenset()
        self._labelled = False
        self._cycle = Cycle()
        self._server.scene.set_up_direction("+z")
        # Nothing here mirrors a sky or throws a shadow worth seeing, and a browser that draws in software would work ten seconds
        # on the viewer's own before its first picture. What the sky gave to surfaces, a light from everywhere gives.
        self._server.scene.configure_environment_map(None)
        self._server.scene.configure_default_lights(cast_shadow=False)
        self._server.scene.add_light_ambient("/light", intensity=AMBIENT)

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

    def read_out(self, place: Place) -> str:
        """What is under the pointer at that place of the canvas, shares of it, in the browser that moved last."""
        camera, content = self._camera, self._content
        if camera is None or content.readout is None:
            return ""
        return read_out(content.readout, content.stage.walls, camera, place)

    def drawn(self, points_m: Float32Array) -> BoolArray:
        """(N,) which points (N, 3) of the content are shown now: not those of walls that are cut away."""
        shown: BoolArray = ~np.isin(wall_of(points_m, self._stage.walls), list(self._behind))
        return shown

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
                    node = put(self._server.scene, item, known, self._clicked)
                    self._nodes[path] = Put(mark, item, node, wall)
                self._nodes[path].wall = wall
                self._cut_node(self._nodes[path])
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
        wall_of = {
            path: each.wall
            for path, each in list(self._nodes.items())
            if each.wall is not None and not self._is_glass(each)
        }
        return cutting_itself(self._server.scene.as_html(dark_mode=bool(self._dark)), self._stage.walls, wall_of)

    def close(self) -> None:
        """Stop the server; browsers lose their connection. What was shown is let go now, not when somebody counts references:
        the files it is mapped from may be about to be deleted.
        """
        self._server.stop()
        self._nodes.clear()
        self._content = Content((), "")
        self._cycle = Cycle()

    def _clicked(self, patch: int, origin_m: FloatArray, direction: FloatArray) -> None:
        """A sheet was clicked; clicked again at the same place, the ones behind it take turns. Glass is looked through: it is
        meant where nothing else is.
        """
        sheets = [
            each.item for each in list(self._nodes.values()) if isinstance(each.item, Sheet) and each.node.visible
        ]
        glass = {sheet.patch for sheet in sheets if sheet.wall in self._behind}
        hits = sorted(pierced(sheets, origin_m, direction), key=lambda hit: hit in glass)
        for meant in self._cycle.click(patch, hits, origin_m, direction):
            self._on_patch(meant)

    def _set_stage(self, stage: Stage) -> None:
        if not np.allclose(stage.up, self._stage.up, atol=1e-6):
            self._server.scene.set_up_direction(stage.up)
            self._aim = None  # cameras have been turned over with the world
        self._stage = stage
        if self._eye_m is not None:  # walls that came or went have other numbers, with nobody's camera moved
            self._behind = self._behind_at(self._eye_m)

    def _cut(self, eye_m: FloatArray) -> None:
        """Hide what a camera there would see from behind, and show the rest."""
        self._eye_m = eye_m
        behind = self._behind_at(eye_m)
        if behind == self._behind:
            return
        self._behind = behind
        with self._server.atomic():
            for each in list(self._nodes.values()):
                if each.wall is not None:
                    self._cut_node(each)
        self._server.flush()

    def _cut_node(self, each: Put) -> None:
        """Hide it, or have it as glass, if it is cut away now; else have it as it is."""
        behind = each.wall in self._behind
        visible = not behind or self._is_glass(each)
        if each.node.visible != visible:
            each.node.visible = visible
        if isinstance(each.item, Sheet) and isinstance(each.node, viser.MeshHandle):
            opacity = each.item.opacity * (GLASS if behind else 1.0)
            if each.node.opacity != opacity:
                each.node.opacity = opacity

    def _is_glass(self, each: Put) -> bool:
        return self._content.glass and not isinstance(each.item, Cloud)

    def _behind_at(self, eye_m: FloatArray) -> frozenset[int]:
        return frozenset(int(wall) for wall in np.flatnonzero(hidden(self._stage.walls, eye_m)))

    def _stand(self, *, fov_rad: float, aspect: float) -> Stand | None:
        if self._whole is None:
            return None
        content = self._content
        return stand(self._whole, self._stage, content.preset, fov_rad=fov_rad, aspect=aspect, whole=content.glass)

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
