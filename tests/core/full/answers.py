"""How far answers are from the truth."""

from __future__ import annotations

import numpy as np

from calib_core.geometry import log
from calib_core.result import CalibrationResult
from calib_core.simulate import Truth
from calib_core.types import FloatArray


def errors_of(result: CalibrationResult, truth: Truth) -> FloatArray:
    """(7,) in the contract's order: rad, m, s."""
    assert result.T_imu_lidar is not None
    assert result.time_offset_ns is not None
    T = np.array(result.T_imu_lidar.matrix)
    late = (result.time_offset_ns - truth.time_offset_ns) * 1e-9
    return np.concatenate([log(truth.R_imu_lidar.T @ T[:3, :3]), T[:3, 3] - truth.p_imu_lidar, [late]])
