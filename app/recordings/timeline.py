"""A recording over time, for the strip on which a span is chosen: pure functions of the decoded arrays."""

from __future__ import annotations

import numpy as np

from app.arrays.recording import CachedScans, relative_s
from app.schemas.recordings import Span, Timeline
from calib_core.types import BoolArray, FloatArray, Recording

#: Readings shown; more would not be seen on a strip.
MAX_READINGS = 2000
#: A window counts as still when neither sensor varies more than this in it, and its rate is no more than a bias.
STILL_WINDOW_S = 0.5
STILL_GYRO_STD_RAD_S = 0.03
STILL_ACCEL_STD_M_S2 = 0.2
STILL_GYRO_MEAN_RAD_S = 0.1
#: Shorter rests are not worth showing.
STILL_LEAST_S = 1.0


def make_timeline(recording: Recording, *, start_s: float) -> Timeline:
    """What the strip shows, in the lidar's clock as far as it is known.

    start_s: where in the whole recording the span that was read begins; all times count from the whole's start.
    """
    scans = recording.scans
    if isinstance(scans, CachedScans):
        stamps_ns, sizes = scans.stamps_ns, np.diff(scans.starts)
    else:
        stamps_ns = np.array([scan.stamp_ns for scan in scans], dtype=np.int64)
        sizes = np.array([len(scan.points) for scan in scans], dtype=np.int64)
    imu_ns = recording.imu.stamps_ns + recording.coarse_offset_ns
    epoch_ns = int(min(stamps_ns[0] if len(stamps_ns) else imu_ns[0], imu_ns[0]))
    t_s = relative_s(imu_ns, epoch_ns) + start_s
    scan_t_s = relative_s(stamps_ns, epoch_ns) + start_s
    still = still_windows(t_s, recording.imu.gyro_rad_s, recording.imu.accel_m_s2)
    step = max(1, -(-len(t_s) // MAX_READINGS))
    gyro_deg_s = np.degrees(_averaged(recording.imu.gyro_rad_s, step))
    accel_m_s2 = _averaged(recording.imu.accel_m_s2, step)
    return Timeline(
        duration_s=float(max(t_s[-1], scan_t_s[-1] if len(scan_t_s) else 0.0)),
        t_s=_averaged(t_s[:, None], step)[:, 0].round(4).tolist(),
        gyro_norm_deg_s=np.linalg.norm(gyro_deg_s, axis=1).round(3).tolist(),
        gyro_x_deg_s=gyro_deg_s[:, 0].round(3).tolist(),
        gyro_y_deg_s=gyro_deg_s[:, 1].round(3).tolist(),
        gyro_z_deg_s=gyro_deg_s[:, 2].round(3).tolist(),
        accel_x_m_s2=accel_m_s2[:, 0].round(4).tolist(),
        accel_y_m_s2=accel_m_s2[:, 1].round(4).tolist(),
        accel_z_m_s2=accel_m_s2[:, 2].round(4).tolist(),
        scan_t_s=scan_t_s.round(4).tolist(),
        scan_points=[int(size) for size in sizes],
        still_spans=still,
    )


def still_windows(t_s: FloatArray, gyro_rad_s: FloatArray, accel_m_s2: FloatArray) -> list[Span]:
    """Spans of at least STILL_LEAST_S in which neither sensor varies.

    t_s: (Q,) ascending.   gyro_rad_s, accel_m_s2: (Q, 3).
    """
    if len(t_s) < 2:
        return []
    window = np.floor((t_s - t_s[0]) / STILL_WINDOW_S).astype(np.int64)
    count = np.bincount(window)
    quiet: BoolArray = count > 1
    for readings, most in ((gyro_rad_s, STILL_GYRO_STD_RAD_S), (accel_m_s2, STILL_ACCEL_STD_M_S2)):
        for axis in range(3):
            mean = np.bincount(window, readings[:, axis]) / np.maximum(count, 1)
            var = np.bincount(window, (readings[:, axis] - mean[window]) ** 2) / np.maximum(count, 1)
            quiet &= var <= most**2
            if readings is gyro_rad_s:
                quiet &= np.abs(mean) <= STILL_GYRO_MEAN_RAD_S
    edges = np.flatnonzero(np.diff(np.concatenate([[0], quiet.astype(np.int8), [0]])))
    spans = [
        Span(start_s=float(t_s[0] + first * STILL_WINDOW_S), end_s=float(min(t_s[0] + last * STILL_WINDOW_S, t_s[-1])))
        for first, last in zip(edges[::2], edges[1::2], strict=True)
    ]
    return [span for span in spans if span.end_s - span.start_s >= STILL_LEAST_S]


def _averaged(values: FloatArray, step: int) -> FloatArray:
    """Means of `step` rows each; a last, shorter group is averaged too.   values: (Q, C)."""
    starts = np.arange(0, len(values), step)
    sums: FloatArray = np.add.reduceat(values, starts, axis=0)
    counts = np.diff(np.append(starts, len(values)))
    averaged: FloatArray = sums / counts[:, None]
    return averaged
