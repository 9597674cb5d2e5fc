"""Which scenes are open: one a recording, each under its recording's lock, those closed first that nobody watches.

No thread ever holds the locks of two recordings.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field

import numpy as np

from app.locks import NamedLocks
from app.scene.apply import ShownScene
from app.scene.throttle import Throttle
from calib_core.types import Float32Array


@dataclass
class OpenScene:
    """A recording's viser server, when it was last of use, and how many browsers are connected to it.

    live: shows a running solve's steps.   cut: cuts the clouds of a wipe anew when a camera has moved.
    """

    shown: ShownScene
    used_at_s: float
    live: Throttle
    cut: Throttle
    watchers: int = 0
    pickable_m: Float32Array = field(default_factory=lambda: np.zeros((0, 3), dtype=np.float32))

    def close(self) -> None:
        """Stop its server and what would still come."""
        self.live.stop()
        self.cut.stop()
        self.shown.close()
        self.pickable_m = np.zeros((0, 3), dtype=np.float32)


class OpenScenes:
    """The open scenes by recording. Thread-safe.

    at_most: so many are open at a time.   idle_s: one that nobody has looked at for so long is closed.
    """

    def __init__(self, *, at_most: int, idle_s: float) -> None:
        self._at_most = at_most
        self._idle_s = idle_s
        self._registry = threading.Lock()
        self._locks = NamedLocks()
        self._open: dict[str, OpenScene] = {}

    def locked(self, recording_id: str) -> AbstractContextManager[None]:
        """The recording's lock held: a slow scene of one keeps nobody waiting who looks at another."""
        return self._locks.hold(recording_id)

    def find(self, recording_id: str) -> OpenScene | None:
        """The recording's scene, if it is open."""
        return self._open.get(recording_id)

    def opened(self, recording_id: str, make: Callable[[], OpenScene]) -> tuple[OpenScene, bool]:
        """The recording's scene, of use now, and whether it had to be made; under its lock."""
        scene = self._open.get(recording_id)
        made = scene is None
        if scene is None:
            scene = make()
            with self._registry:
                self._open[recording_id] = scene
        scene.used_at_s = time.monotonic()
        return scene, made

    def watcher_came(self, scene: OpenScene, change: int) -> None:
        """A browser connected to this scene (+1) or left it (-1), and not the one that the recording has by then. Quick."""
        with self._registry:
            scene.watchers += change
            scene.used_at_s = time.monotonic()

    def watchers(self, recording_id: str) -> int:
        """Browsers connected to the recording's scene now."""
        scene = self._open.get(recording_id)
        return 0 if scene is None else scene.watchers

    def count(self) -> tuple[int, int]:
        """Scenes that are open, and browsers connected to them."""
        with self._registry:
            return len(self._open), sum(scene.watchers for scene in self._open.values())

    def close(self, recording_id: str) -> None:
        """Stop the recording's viser server."""
        with self.locked(recording_id):
            with self._registry:
                scene = self._open.pop(recording_id, None)
            if scene is not None:
                scene.close()

    def close_all(self) -> None:
        """Stop all."""
        for recording_id in self._names():
            self.close(recording_id)

    def close_idle(self, now_s: float) -> None:
        """Stop the scenes that nobody has looked at for the time allowed."""
        for recording_id in self._names():
            scene = self._open.get(recording_id)
            if scene is None:
                continue
            if scene.watchers > 0:
                scene.used_at_s = now_s
            elif now_s - scene.used_at_s > self._idle_s:
                self.close(recording_id)

    def make_room(self, recording_id: str) -> None:
        """Room for the recording's scene: those nobody watches go first, then the one longest out of use.

        Before any lock is held.
        """
        if recording_id in self._open:
            return
        while len(names := self._names()) >= self._at_most:
            idle = [name for name in names if self.watchers(name) == 0] or names
            self.close(min(idle, key=self._used_at_s))

    def _names(self) -> list[str]:
        with self._registry:
            return list(self._open)

    def _used_at_s(self, recording_id: str) -> float:
        scene = self._open.get(recording_id)
        return 0.0 if scene is None else scene.used_at_s
