"""Arrays for plots: the IMU at about 10 Hz and the scans' instants, in the recording's own seconds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib_core.doctor.report import Timeline
from calib_core.readers.imu.readings import CleanedImu
from calib_core.types import IntArray

_STEP_NS = 100_000_000
#: Longer recordings get longer steps, so that a report stays small.
_MAX_STEPS = 6000


def timeline(cleaned: CleanedImu, scan_receive_ns: IntArray, recording_start_ns: int) -> Timeline:
    """Means of the readings over steps of 0.1 s (longer where the recording is)."""
    imu, headers = cleaned.imu, cleaned.headers
    lag_ns = int(np.median(headers.receive_ns - headers.header_ns))
    elapsed_ns = imu.stamps_ns + lag_ns - recording_start_ns
    step_ns = max(_STEP_NS, int((elapsed_ns[-1] - elapsed_ns[0]) // _MAX_STEPS))
    step = (elapsed_ns - elapsed_ns[0]) // step_ns
    starts = np.flatnonzero(np.diff(step, prepend=-1))
    sizes = np.diff(starts, append=step.size)[:, None]
    rates = np.rad2deg(np.add.reduceat(imu.gyro_rad_s, starts, axis=0) / sizes)
    accel = np.add.reduceat(imu.accel_m_s2, starts, axis=0) / sizes
    norms = np.rad2deg(np.add.reduceat(np.linalg.norm(imu.gyro_rad_s, axis=1), starts)) / sizes[:, 0]
    times_s = elapsed_ns[starts] * 1e-9 + 0.5e-9 * step_ns
    every = max(1, scan_receive_ns.size // _MAX_STEPS)
    return Timeline(
        t_s=_listed(times_s, 3),
        rotation_deg_s=(_listed(rates[:, 0]), _listed(rates[:, 1]), _listed(rates[:, 2])),
        rotation_norm_deg_s=_listed(norms),
        acceleration_m_s2=(_listed(accel[:, 0]), _listed(accel[:, 1]), _listed(accel[:, 2])),
        scan_t_s=_listed((scan_receive_ns[::every] - recording_start_ns) * 1e-9, 3),
    )


def _listed(values: NDArray[np.floating], digits: int = 4) -> tuple[float, ...]:
    return tuple(float(v) for v in np.round(values, digits))
