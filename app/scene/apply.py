"""From items to viser: a thin adapter that sends only what changed. The one place that knows viser's scene."""

from __future__ import annotations

import socket
from collections.abc import Callable
from typing import Protocol, cast

import numpy as np
import viser
from numpy.typing import NDArray

from app.scene.doorless import DoorlessViser
from app.scene.items import WHOLE_ROOM, Axes, Cloud, Content, Item, Label, Line, Sheet, fingerprint
from app.scene.region import frustum_sides
from app.scene.wipe import Camera
from calib_core.types import FloatArray

OnPatch = Callable[[int], None]
OnRay = Callable[[FloatArray, FloatArray, bool], None]
OnCamera = Callable[[], None]
OnBox = Callable[[FloatArray], None]

#: Where a camera stands that looks at the whole: this direction from the middle, and this much farther than needed.
AIM_DIRECTION = np.array([-0.55, -0.55, 0.6])
AIM_MARGIN = 1.1
#: Nearer than this to the middle of the points nobody looks at them.
MIN_AWAY_M = 1.0
#: A canvas is taken to be so wide for its height until a browser tells.
ASPECT = 1.6
#: What is behind the clouds: nothing drawn may vanish into it, neither white nor dark blue.
BACKGROUNDS: dict[bool, tuple[int, int, int]] = {True: (12, 14, 17), False: (204, 210, 217)}


class _Removable(Protocol):
    def remove(self) -> None:
        """Take the node out of the scene."""


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


def whole_view(points_m: FloatArray, *, fov_rad: float, aspect: float) -> tuple[FloatArray, FloatArray]:
    """A middle (3,) to look at and a place (3,) to look from, so that nearly all points (N, 3) fill the canvas.

    A point at (x, y) across the view and z towards the camera is on the canvas when |x - u| <= (t - z) half aspect and
    |y - v| <= (t - z) half, with the camera at (u, v, t). What is near spreads over more of the canvas than what is far,
    so the middle of the points is not the middle of their picture: u and v are where both edges are met at once.
    """
    back = AIM_DIRECTION / np.linalg.norm(AIM_DIRECTION)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    origin = np.median(points_m, axis=0)
    x, y, z = np.stack([right, up, back]) @ (points_m - origin).T
    half = float(np.tan(fov_rad / 2))
    needed_m = max(_between_edges(x, z, half * aspect)[1], _between_edges(y, z, half)[1])
    depth_m = float(np.median(z))
    away_m = depth_m + max(MIN_AWAY_M, AIM_MARGIN * (needed_m - depth_m))
    u, v = _centred(x, z, away_m, half * aspect), _centred(y, z, away_m, half)
    middle = origin + u * right + v * up + depth_m * back
    return middle, middle + (away_m - depth_m) * back


def _between_edges(across_m: FloatArray, near_m: FloatArray, half: float) -> tuple[float, float]:
    """Where across the camera stands, and how far away, so that nearly all points touch neither edge of the canvas."""
    high = float(np.percentile(across_m + half * near_m, 99.5))
    low = float(np.percentile(across_m - half * near_m, 0.5))
    return (high + low) / 2, (high - low) / (2 * half)


def _centred(across_m: FloatArray, near_m: FloatArray, away_m: float, half: float) -> float:
    """Where across the camera stands, at that distance, so that both edges are equally far from the points' picture.

    That is where both edges of a narrower canvas are met; its width is found by halving.
    """
    narrow, wide = 1e-3 * half, half
    for _ in range(24):
        width = (narrow + wide) / 2
        if _between_edges(across_m, near_m, width)[1] > away_m:
            narrow = width
        else:
            wide = width
    return _between_edges(across_m, near_m, wide)[0]


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
        self._handles: dict[str, tuple[int, Item, _Removable]] = {}
        self._dark: bool | None = None
        self._aim = ""
        self._camera: Camera | None = None
        self._whole: FloatArray | None = None
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

    def show(self, content: Content, *, dark: bool) -> None:
        """Make the scene be the content."""
        if dark != self._dark:
            self._dark = dark
            self._server.gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False)
            self._server.scene.set_background_image(np.full((1, 1, 3), BACKGROUNDS[dark], dtype=np.uint8), format="png")
        if self._aim == "" or content.aim not in {"", self._aim}:
            self._look_at_all(content)
        # A cloud without points is no cloud: viser's page complains about empty buffers.
        wanted = {item.path: item for item in content.items if not isinstance(item, Cloud) or len(item.xyz) > 0}
        with self._server.atomic():
            for path in [path for path in self._handles if path not in wanted]:
                self._handles.pop(path)[2].remove()
            for path, item in wanted.items():
                mark = fingerprint(item)
                known = self._handles.get(path)
                if known is None or known[0] != mark:
                    self._handles[path] = (mark, item, self._put(item, known))
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

    def _put(self, item: Item, known: tuple[int, Item, _Removable] | None) -> _Removable:
        scene = self._server.scene
        match item:
            case Cloud(path=path, xyz=xyz, rgb=rgb, size_m=size_m):
                if known is not None and isinstance(known[2], viser.PointCloudHandle):
                    known[2].points, known[2].colors = xyz, rgb
                    known[2].point_size = size_m
                    return cast(_Removable, known[2])
                return cast(
                    _Removable,
                    scene.add_point_cloud(path, xyz, rgb, point_size=size_m, precision="float32", point_shading="flat"),
                )
            case Sheet():
                return self._put_sheet(item, known)
            case Line(path=path, xyz=xyz, rgb=rgb, width_px=width_px):
                pairs = np.stack([xyz[:-1], xyz[1:]], axis=1)
                return cast(
                    _Removable, scene.add_line_segments(path, pairs, rgb, thickness=width_px, thickness_units="screen")
                )
            case Axes(path=path, R_scene_frame=rotation, p_scene_frame=position, length_m=length_m):
                return cast(
                    _Removable,
                    scene.add_frame(
                        path,
                        axes_length=length_m,
                        axes_radius=length_m / 40,
                        wxyz=quat_wxyz(rotation),
                        position=position,
                    ),
                )
            case Label(path=path, text=text, position=position):
                return cast(_Removable, scene.add_label(path, text, position=position))

    def _put_sheet(self, sheet: Sheet, known: tuple[int, Item, _Removable] | None) -> _Removable:
        if known is not None and isinstance(known[1], Sheet) and isinstance(known[2], viser.MeshHandle):
            before = known[1]
            if np.array_equal(before.vertices, sheet.vertices) and before.patch == sheet.patch:
                known[2].color, known[2].opacity = sheet.rgb, sheet.opacity
                return cast(_Removable, known[2])
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
            handle.on_click(lambda _: self._on_patch(patch))
        return cast(_Removable, handle)

    def _turn(self, client: viser.ClientHandle) -> None:
        """Have a browser look at the whole, as wide as its canvas is."""
        if self._whole is None:
            return
        middle, away = whole_view(self._whole, fov_rad=float(client.camera.fov), aspect=float(client.camera.aspect))
        with client.atomic():
            client.camera.position, client.camera.look_at = away, middle

    def _look_at_all(self, content: Content) -> None:
        """Look at the middle of all clouds from above one corner, in browsers that are here and those that come."""
        clouds = [item.xyz for item in content.items if isinstance(item, Cloud) and len(item.xyz) > 0]
        if not clouds:
            return
        points = np.concatenate(clouds).astype(np.float64)
        self._whole = points[:: max(1, len(points) // 5000)]
        fov_rad = float(self._server.initial_camera.fov)
        middle, away = whole_view(self._whole, fov_rad=fov_rad, aspect=ASPECT)
        self._server.initial_camera.look_at = middle
        self._server.initial_camera.position = away
        if self._aim != "":
            for client in self._server.get_clients().values():
                self._turn(client)
        self._aim = content.aim or WHOLE_ROOM
