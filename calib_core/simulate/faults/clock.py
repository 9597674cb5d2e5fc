"""Clocks that run apart, and stamps that a busy host takes late.

t_lidar = t_imu + time_offset + rate 1e-6 (t_lidar - middle)
"""

from __future__ import annotations

import numpy as np

from calib_core.types import IntArray

#: One message in a hundred waits for the host, up to this long, and those behind it arrive with it.
_STALLED, _STALL_S = 0.01, (0.005, 0.02)
#: Messages that waited together are stamped this far apart.
_IN_A_ROW_NS = 20_000


def rate_error_ns(true_ns: IntArray, rate_ppm: float, middle_ns: float) -> IntArray:
    """How much less the IMU's stamp is than with clocks at one rate. true_ns: (Q,) lidar clock, as is middle_ns."""
    return np.rint(rate_ppm * 1e-6 * (true_ns - middle_ns)).astype(np.int64)


def latency_ns(true_ns: IntArray, mean_s: float, rng: np.random.Generator) -> IntArray:
    """How late the host stamps each message, less the mean without stalls, which is part of the time offset.

    true_ns: (Q,) increasing.   mean_s: of the exponential law that latencies follow; never early by more than that.
    """
    late_s = rng.exponential(mean_s, true_ns.shape)
    late_s += np.where(rng.random(true_ns.shape) < _STALLED, rng.uniform(*_STALL_S, true_ns.shape), 0.0)
    arrived = true_ns + np.rint((late_s - mean_s) * 1e9).astype(np.int64)
    place = _IN_A_ROW_NS * np.arange(len(arrived))
    return np.asarray(np.maximum.accumulate(arrived - place) + place - true_ns, dtype=np.int64)


def bundle_ns(true_ns: IntArray, every_s: float, rng: np.random.Generator) -> IntArray:
    """How late a driver stamps each message that empties a buffer so often, less how long the newest of its bundle waited, mean
    over all messages.

    true_ns: (Q,) increasing. All of a bundle are stamped in a row when it is read.
    """
    every_ns = every_s * 1e9
    phase_ns = rng.uniform(0.0, every_ns)
    emptied = np.ceil((true_ns - phase_ns) / every_ns)
    arrived_ns = phase_ns + every_ns * emptied
    newest_ns = true_ns[np.searchsorted(emptied, emptied, side="right") - 1]
    arrived_ns -= np.mean(arrived_ns - newest_ns)
    place = np.arange(len(true_ns)) - np.searchsorted(emptied, emptied)
    return np.asarray(np.rint(arrived_ns).astype(np.int64) + _IN_A_ROW_NS * place - true_ns, dtype=np.int64)


def ticked_ns(stamps_ns: IntArray, step_s: float) -> IntArray:
    """Stamps (Q,) by a clock that ticks so often: its last tick before them."""
    step_ns = round(step_s * 1e9)
    return np.asarray(stamps_ns // step_ns * step_ns, dtype=np.int64)


def unbundled_ns(stamps_ns: IntArray, true_ns: IntArray) -> IntArray:
    """Stamps as a reader that knew the samples' times would spread a driver's bundles: the newest at the first stamp.

    stamps_ns, true_ns: (Q,) increasing.
    """
    begins = np.concatenate([[True], np.diff(stamps_ns) > 2 * _IN_A_ROW_NS])
    first = np.flatnonzero(begins)
    bundle = np.cumsum(begins) - 1
    newest_ns = true_ns[np.append(first[1:], len(true_ns)) - 1]
    return np.asarray(stamps_ns[first][bundle] - (newest_ns[bundle] - true_ns), dtype=np.int64)
