"""Views and their scenes: what is wished, what is shown of it, and what clicks and drags in the canvas do.

One viser server per recording that is looked at (open_scenes.py), shared by all browsers, closed when idle.
"""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from pydantic import ValidationError

from app.bus import Bus
from app.errors import ApiError, BadRequest, NotFound
from app.events import ClickWasRefused, ViewEdited
from app.planes.service import PlaneService
from app.scene.apply import ShownScene, warm_up
from app.scene.camera import Camera, Place
from app.scene.compose import Composed, Composer
from app.scene.open_scenes import OpenScene, OpenScenes
from app.scene.picking import pick
from app.scene.tabs import Tabs
from app.scene.throttle import Throttle
from app.schemas.planes import Grow, Restrict, Side, Toggle
from app.schemas.view import ChangeView, View, ViewState
from app.settings import AppSettings
from app.storage.records import RecordingRecord
from app.storage.store import DocumentStore, RecordingStore
from calib_core.types import FloatArray

DOCUMENT = "view"
#: Live updates of a converging cloud: more than this a browser without a graphics card cannot draw.
LIVE_INTERVAL_S = 0.1
SWEEP_INTERVAL_S = 15.0


class SceneHub:
    """Views and their scenes. Thread-safe. Tells the bus of changed views, and of clicks that cannot be done.

    open: the scenes that are open now.   tabs: which screen each tab shows.
    """

    def __init__(
        self,
        recordings: RecordingStore,
        documents: DocumentStore,
        planes: PlaneService,
        composer: Composer,
        bus: Bus,
        *,
        settings: AppSettings,
    ) -> None:
        self._recordings = recordings
        self._documents = documents
        self._planes = planes
        self._composer = composer
        self._bus = bus
        self.open = OpenScenes(at_most=settings.max_scenes, idle_s=settings.scene_idle_s)
        self.tabs = Tabs()
        self._closed = threading.Event()

    def start(self) -> None:
        """Begin closing idle scenes; what the first of them needs is imported before anybody waits for it."""
        threading.Thread(target=self._sweep, name="scenes", daemon=True).start()

    def view(self, recording_id: str) -> View:
        """What is shown now."""
        return self._compose(self._record(recording_id)).view

    def change_view(self, recording_id: str, change: ChangeView, *, tab: str | None = None) -> View:
        """What is shown after the change.   tab: which one wishes for it; None: nobody's, as a script's."""
        record = self._record(recording_id)
        if tab is not None and "mode" in change.model_fields_set:
            self.tabs.entered(recording_id, tab, change.mode)
        with self.open.locked(recording_id):
            before = self._state(recording_id)
            wished = {name: getattr(change, name) for name in change.model_fields_set}
            state = before.model_copy(update=wished)
            if "mode" in wished and state.mode != before.mode and "click" not in wished:
                state = state.model_copy(update={"click": "toggle"})
            if state.click != "restrict":
                state = state.model_copy(update={"target": None})
            if state != before:
                self._documents.write(recording_id, DOCUMENT, state.model_dump_json())
            composed = self._compose(record)
            self._show(recording_id, composed)
        if state != before:
            self._bus.publish(ViewEdited(recording_id, composed.view))
        return composed.view

    def refresh(self, recording_id: str) -> None:
        """Show again: something the scene is made of has changed. What is said beside the scene changes with it."""
        with self.open.locked(recording_id):
            record = self._recordings.find(recording_id)
            if record is None or self.open.find(recording_id) is None:
                return
            composed = self._compose(record)
            self._show(recording_id, composed)
        self._bus.publish(ViewEdited(recording_id, composed.view))

    def refresh_live(self, recording_id: str) -> None:
        """Show a running solve's latest step: only where somebody looks, and not too often."""
        scene = self.open.find(recording_id)
        if scene is not None and scene.watchers > 0:
            scene.live.request()

    def dial(self, recording_id: str) -> tuple[socket.socket, OpenScene]:
        """A connection to the recording's viser server, which is started if need be, and the scene that it leads to."""
        with self._opened(recording_id) as scene:
            return scene.shown.dial(), scene

    @contextmanager
    def _opened(self, recording_id: str) -> Iterator[OpenScene]:
        """The recording's scene, open for as long as this lasts."""
        record = self._record(recording_id)
        self.open.make_room(recording_id)
        with self.open.locked(recording_id):
            scene, made = self.open.opened(recording_id, lambda: self._new_scene(recording_id))
            if made:
                self._show(recording_id, self._compose(record))
            yield scene

    def camera(self, recording_id: str) -> Camera | None:
        """Where the browser looks from whose camera moved last; None before there is one."""
        scene = self.open.find(recording_id)
        return None if scene is None else scene.shown.camera

    def read_out(self, recording_id: str, place: Place) -> str:
        """What is seen at that place of the canvas, shares of it; "" where there is nothing, or no scene."""
        scene = self.open.find(recording_id)
        return "" if scene is None else scene.shown.read_out(place)

    def export_html(self, recording_id: str) -> str:
        """The scene as one self-contained page to share."""
        with self._opened(recording_id) as scene:
            return scene.shown.export_html()

    def close(self) -> None:
        """Stop all."""
        self._closed.set()
        self.open.close_all()

    def click_patch(self, recording_id: str, patch: int) -> None:
        """A sheet was clicked: confirm or drop it, or let the next box be its own, or nothing where clicks grow planes."""
        state = self._state(recording_id)
        if state.mode == "planes" and state.click == "toggle":
            self._edit(recording_id, Toggle(op="toggle", index=patch))
        if state.mode == "planes" and state.click == "restrict":
            self.change_view(recording_id, ChangeView(target=None if state.target == patch else patch))

    def draw_box(self, recording_id: str, sides: FloatArray) -> None:
        """A rectangle was dragged: what lies outside makes no plane, or is no part of the plane chosen before."""
        state = self._state(recording_id)
        if state.mode != "planes":
            return
        box = [Side(normal=side[:3].tolist(), offset_m=float(side[3])) for side in sides]
        if self._edit(recording_id, Restrict(op="restrict", sides=box, index=state.target)):
            self.change_view(recording_id, ChangeView(target=None))

    def click_ray(self, recording_id: str, origin_m: FloatArray, direction: FloatArray, *, modified: bool) -> None:
        """The canvas was clicked: grow a plane where the ray meets the cloud, if clicks do that now."""
        state = self._state(recording_id)
        scene = self.open.find(recording_id)
        if scene is None or state.mode != "planes" or not (modified or state.click == "grow"):
            return
        seed_m = pick(scene.pickable_m, origin_m, direction, scene.shown.drawn)
        if seed_m is None:
            text = "The cloud has no point there; click on its points, or come nearer."
            self._bus.publish(ClickWasRefused(recording_id, BadRequest("planes.no_point_there", text)))
            return
        self._edit(recording_id, Grow(op="grow", seed_m=seed_m.tolist()))

    def _edit(self, recording_id: str, operation: Toggle | Grow | Restrict) -> bool:
        """Whether the operation could be done; if not, those who look are told why."""
        try:
            self._planes.apply(recording_id, operation)
        except ApiError as error:
            self._bus.publish(ClickWasRefused(recording_id, error))
            return False
        return True

    def _state(self, recording_id: str) -> ViewState:
        text = self._documents.read(recording_id, DOCUMENT)
        try:
            return ViewState() if text is None else ViewState.model_validate_json(text)
        except ValidationError:  # kept by an older version
            return ViewState()

    def _compose(self, record: RecordingRecord) -> Composed:
        return self._composer.compose(record, self._state(record.id), self.camera(record.id))

    def _show(self, recording_id: str, composed: Composed) -> None:
        scene = self.open.find(recording_id)
        if scene is not None:
            scene.pickable_m = composed.content.pickable_m
            scene.shown.drag_boxes(composed.view.mode == "planes" and composed.view.click == "restrict")
            scene.shown.show(composed.content, dark=composed.view.dark)

    def _show_if(self, recording_id: str, *, mode: str, show: str | None = None) -> None:
        state = self._state(recording_id)
        if state.mode == mode and show in {None, state.show} and not self._closed.is_set():
            self.refresh(recording_id)

    def _record(self, recording_id: str) -> RecordingRecord:
        record = self._recordings.find(recording_id)
        if record is None:
            raise NotFound("recording.not_found", "The recording has been deleted.")
        return record

    def _new_scene(self, recording_id: str) -> OpenScene:
        cut = Throttle(lambda: self._show_if(recording_id, mode="inspect", show="wipe"), LIVE_INTERVAL_S)
        live = Throttle(lambda: self._show_if(recording_id, mode="solve"), LIVE_INTERVAL_S)
        shown = ShownScene(
            on_patch=lambda patch: self.click_patch(recording_id, patch),
            on_ray=lambda origin_m, direction, modified: self.click_ray(
                recording_id, origin_m, direction, modified=modified
            ),
            on_camera=cut.request,
            on_box=lambda sides: self.draw_box(recording_id, sides),
        )
        return OpenScene(shown, time.monotonic(), live, cut)

    def _sweep(self) -> None:
        warm_up()
        while not self._closed.wait(SWEEP_INTERVAL_S):
            self.open.close_idle(time.monotonic())
