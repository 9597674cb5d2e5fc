"""How the lidar turns by something other than its points: what the tracker may lean on where they say too little."""

from __future__ import annotations

from typing import Protocol

from calib_core.types import FloatArray


class Turning(Protocol):
    """The lidar's turns between instants of its own clock."""

    def between(self, start_ns: int, end_ns: int) -> FloatArray | None:
        """R (3, 3) from the lidar's axes at the end to those at the start; None where nothing is known of that span."""
