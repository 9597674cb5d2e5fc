"""A solved motion on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from app.storage.atomic import whole_file
from calib_core.types import Trajectory

#: In the folder of its solve.
TRAJECTORY = "trajectory.npz"


def write_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Write the motion to `path` (.npz), whole or not at all."""
    with whole_file(path) as fresh:
        np.savez(
            fresh,
            epoch_ns=np.array(trajectory.epoch_ns, dtype=np.int64),
            times_s=trajectory.times_s,
            R_map_lidar=trajectory.R_map_lidar,
            p_map_lidar=trajectory.p_map_lidar,
            valid=trajectory.valid,
            late_ns=np.array(list(trajectory.late_ns.items()), dtype=np.int64).reshape(-1, 2),
        )


def read_trajectory(path: Path) -> Trajectory:
    """The motion as it was written."""
    with np.load(path, allow_pickle=False) as arrays:
        return Trajectory(
            epoch_ns=int(arrays["epoch_ns"]),
            times_s=arrays["times_s"],
            R_map_lidar=arrays["R_map_lidar"],
            p_map_lidar=arrays["p_map_lidar"],
            valid=arrays["valid"],
            # Those written before there was such a thing have none.
            late_ns=dict(arrays["late_ns"].tolist()) if "late_ns" in arrays else {},
        )
