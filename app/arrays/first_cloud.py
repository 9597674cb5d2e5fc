"""The cloud that is shown before anything is known of a recording, on disk: one array of points, lidar frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from app.storage.atomic import whole_file
from calib_core.types import PointArray


def first_cloud_file(cache: Path) -> Path:
    """Where it is kept."""
    return cache / "first-cloud.npy"


def write_first_cloud(path: Path, points: PointArray) -> None:
    """Write the points (N,), whole or not at all."""
    with whole_file(path) as fresh:
        np.save(fresh, points, allow_pickle=False)


def read_first_cloud(path: Path) -> PointArray | None:
    """The points as they were written; None where there are none."""
    if not path.is_file():
        return None
    try:
        points: PointArray = np.load(path, allow_pickle=False)
    except (OSError, ValueError):  # half of one: the whole recording is shown when it is read
        return None
    return points if len(points) > 0 else None
