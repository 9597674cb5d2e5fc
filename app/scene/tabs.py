"""Which screen each tab shows. The scene is shared, so what it shows is no word on what a click in one of the tabs means."""

from __future__ import annotations

import threading
from collections import OrderedDict

from app.schemas.view import Mode

#: More tabs than anybody has open; the ones that were heard of longest ago are forgotten.
REMEMBERED = 1000


class Tabs:
    """The screen of each tab by recording and the name that the tab gave itself. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._modes: OrderedDict[tuple[str, str], Mode] = OrderedDict()

    def entered(self, recording_id: str, tab: str, mode: Mode) -> None:
        """The tab shows that screen now."""
        with self._lock:
            self._modes[recording_id, tab] = mode
            self._modes.move_to_end((recording_id, tab))
            while len(self._modes) > REMEMBERED:
                self._modes.popitem(last=False)

    def edits(self, recording_id: str, tab: str | None) -> bool:
        """Whether what is clicked and drawn there may change planes; of who gives no name, or is not known, the view decides."""
        return tab is None or self._modes.get((recording_id, tab), "planes") == "planes"
