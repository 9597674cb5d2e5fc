"""The open scenes: one viser server per recording that is looked at, shared by all browsers, closed when idle."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from app.errors import ApiError, NotFound
from app.planes.service import PlaneService
from app.scene.apply import ShownScene
from app.scene.compose import Composed, Composer
from app.scene.picking import pick
from app.schemas.planes import Grow, Toggle
from app.schemas.view import ChangeView, View, ViewState
from app.settings import AppSettings
from app.storage.records import RecordingRecord
from app.storage.store import DocumentStore, RecordingStore
from calib_core.types import Float32Array, FloatArray

_LOG = logging.getLogger("unsweep")

DOCUMENT = "view"
#: Live updates of a converging cloud: more than this a browser without a graphics card cannot draw.
LIVE_INTERVAL_S = 0.1
SWEEP_INTERVAL_S = 15.0


@dataclass
class OpenScene:
    """A recording's viser server, when it was last of use, and how many browsers are connected to it."""

    shown: ShownScene
    used_at_s: float
    watchers: int = 0
    pickable_m: Float32Array = field(default_factory=lambda: np.zeros((0, 3), dtype=np.float32))


class SceneHub:
    """Views and their scenes. Thread-safe.

    on_view: called when a view has changed.
    """

    def __init__(
        self,
        recordings: RecordingStore,
        documents: DocumentStore,
        planes: PlaneService,
        composer: Composer,
        *,
        settings: AppSettings,
    ) -> None:
        self._recordings = recordings
        self._documents = documents
        self._planes = planes
        self._composer = composer
        self._settings = settings
        self._lock = threading.RLock()
        self._open: dict[str, OpenScene] = {}
        self._live_at_s: dict[str, float] = {}
        self._closed = threading.Event()
        self.on_view: Callable[[str, View], None] = lambda _, __: None

    def start(self) -> None:
        """Begin closing idle scenes."""
        threading.Thread(target=self._sweep, name="scenes", daemon=True).start()

    def view(self, recording_id: str) -> View:
        """What is shown now."""
        return self._compose(self._record(recording_id)).view

    def change_view(self, recording_id: str, change: ChangeView) -> View:
        """What is shown after the change."""
        record = self._record(recording_id)
        with self._lock:
            before = self._state(recording_id)
            wished = {name: getattr(change, name) for name in change.model_fields_set}
            state = before.model_copy(update=wished)
            if "mode" in wished and state.mode != before.mode and "click" not in wished:
                state = state.model_copy(update={"click": "toggle"})
            if state != before:
                self._documents.write(recording_id, DOCUMENT, state.model_dump_json())
            composed = self._compose(record)
            self._show(recording_id, composed)
        if state != before:
            self.on_view(recording_id, composed.view)
        return composed.view

    def refresh(self, recording_id: str) -> None:
        """Show again: something the scene is made of has changed."""
        with self._lock:
            record = self._recordings.find(recording_id)
            if record is not None and recording_id in self._open:
                self._show(recording_id, self._compose(record))

    def refresh_live(self, recording_id: str) -> None:
        """The same for a running solve: only when somebody looks, and not too often."""
        now_s = time.monotonic()
        with self._lock:
            scene = self._open.get(recording_id)
            if scene is None or now_s - self._live_at_s.get(recording_id, 0.0) < LIVE_INTERVAL_S:
                return
            self._live_at_s[recording_id] = now_s
        if scene.watchers > 0 and self._state(recording_id).mode == "solve":
            self.refresh(recording_id)

    def port(self, recording_id: str) -> int:
        """Where the recording's viser server listens; started if need be."""
        record = self._record(recording_id)
        with self._lock:
            scene = self._open.get(recording_id)
            if scene is None:
                self._make_room()
                scene = OpenScene(self._new_scene(recording_id), time.monotonic())
                self._open[recording_id] = scene
                self._show(recording_id, self._compose(record))
            scene.used_at_s = time.monotonic()
            return scene.shown.port

    def watcher_came(self, recording_id: str, change: int) -> None:
        """A browser connected to the scene (+1) or left it (-1)."""
        with self._lock:
            scene = self._open.get(recording_id)
            if scene is not None:
                scene.watchers = max(0, scene.watchers + change)
                scene.used_at_s = time.monotonic()

    def watchers(self, recording_id: str) -> int:
        """Browsers connected to the recording's scene now."""
        scene = self._open.get(recording_id)
        return 0 if scene is None else scene.watchers

    def export_html(self, recording_id: str) -> str:
        """The scene as one self-contained page to share."""
        self.port(recording_id)
        with self._lock:
            return self._open[recording_id].shown.export_html()

    def close_scene(self, recording_id: str) -> None:
        """Stop the recording's viser server."""
        with self._lock:
            scene = self._open.pop(recording_id, None)
        if scene is not None:
            scene.shown.close()

    def close(self) -> None:
        """Stop all."""
        self._closed.set()
        for recording_id in list(self._open):
            self.close_scene(recording_id)

    def close_idle(self, now_s: float) -> None:
        """Stop the scenes that nobody has looked at for the time allowed."""
        with self._lock:
            for recording_id, scene in list(self._open.items()):
                if scene.watchers > 0:
                    scene.used_at_s = now_s
                elif now_s - scene.used_at_s > self._settings.scene_idle_s:
                    self.close_scene(recording_id)

    def click_patch(self, recording_id: str, patch: int) -> None:
        """A sheet was clicked: confirm or drop it, unless clicks grow planes now."""
        state = self._state(recording_id)
        if state.mode == "planes" and state.click == "toggle":
            self._edit(recording_id, Toggle(op="toggle", index=patch))

    def click_ray(self, recording_id: str, origin_m: FloatArray, direction: FloatArray, *, modified: bool) -> None:
        """The canvas was clicked: grow a plane where the ray meets the cloud, if clicks do that now."""
        state = self._state(recording_id)
        with self._lock:
            scene = self._open.get(recording_id)
        if scene is None or state.mode != "planes" or not (modified or state.click == "grow"):
            return
        seed_m = pick(scene.pickable_m, origin_m, direction)
        if seed_m is not None:
            self._edit(recording_id, Grow(op="grow", seed_m=seed_m.tolist()))

    def _edit(self, recording_id: str, operation: Toggle | Grow) -> None:
        try:
            self._planes.apply(recording_id, operation)
        except ApiError as error:
            _LOG.info("click in the scene of %s: %s", recording_id, error)

    def _state(self, recording_id: str) -> ViewState:
        text = self._documents.read(recording_id, DOCUMENT)
        return ViewState() if text is None else ViewState.model_validate_json(text)

    def _compose(self, record: RecordingRecord) -> Composed:
        return self._composer.compose(record, self._state(record.id))

    def _show(self, recording_id: str, composed: Composed) -> None:
        scene = self._open.get(recording_id)
        if scene is not None:
            scene.pickable_m = composed.content.pickable_m
            scene.shown.show(composed.content, dark=composed.view.dark)

    def _record(self, recording_id: str) -> RecordingRecord:
        record = self._recordings.find(recording_id)
        if record is None:
            raise NotFound("recording.not_found", "The recording has been deleted.")
        return record

    def _new_scene(self, recording_id: str) -> ShownScene:
        return ShownScene(
            on_patch=lambda patch: self.click_patch(recording_id, patch),
            on_ray=lambda origin_m, direction, modified: self.click_ray(
                recording_id, origin_m, direction, modified=modified
            ),
        )

    def _make_room(self) -> None:
        while len(self._open) >= self._settings.max_scenes:
            idle = [name for name, scene in self._open.items() if scene.watchers == 0] or list(self._open)
            self.close_scene(min(idle, key=lambda name: self._open[name].used_at_s))

    def _sweep(self) -> None:
        while not self._closed.wait(SWEEP_INTERVAL_S):
            self.close_idle(time.monotonic())
