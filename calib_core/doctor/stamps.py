"""How regular a topic's stamps are: counted against the even row behind them, as a solve takes it.

Step by step, a stamp that comes late looks like one that is missing: a step of 1.7 periods, and 0.3 after it. Lines through all
of them (`imu/sample_rows.py`) know which sample each stamp is of, and what is left of it is the jitter.
"""

from __future__ import annotations

import numpy as np

from calib_core.doctor.report import StampReport
from calib_core.imu.sampling import study_sampling
from calib_core.readers.imu.readings import stamp_statistics
from calib_core.stamp_rate import rate_hz
from calib_core.types import IntArray

#: A step of so many periods has lost a message: what is on no line may jitter by a half.
_LOST = 1.6


def stamp_report(header_ns: IntArray, receive_ns: IntArray, *, taken_ns: IntArray | None = None) -> StampReport:
    """Regularity of stamps given in receive order. taken_ns: increasing, those that are used where they are others."""
    statistics = stamp_statistics(header_ns, receive_ns, taken_ns=taken_ns)
    stamps_ns = np.unique(header_ns) if taken_ns is None else taken_ns
    row = study_sampling(stamps_ns, np.zeros((len(stamps_ns), 0)))  # of the row the readings know nothing
    # A step is as uneven as two stamps are.
    jitter_s = statistics.jitter_s / np.sqrt(2.0) if row is None else row.jitter_s
    return StampReport(
        rate_hz=rate_hz(stamps_ns),
        period_s=statistics.period_s,
        jitter_s=float(jitter_s),
        duplicates=statistics.n_duplicates,
        rewinds=statistics.n_rewinds,
        gaps=statistics.n_gaps,
        longest_gap_s=statistics.longest_gap_s,
        dropped=missing(stamps_ns if row is None else row.even_ns, statistics.period_s * 1e9),
    )


def missing(stamps_ns: IntArray, period_ns: float) -> int:
    """Samples that no stamp is of: a step of k periods hides k - 1, in a gap too.   stamps_ns: (Q,) increasing."""
    if period_ns <= 0.0:
        return 0
    steps = np.diff(stamps_ns).astype(np.float64) / period_ns
    return int(np.sum(np.maximum(np.rint(steps) - 1.0, 0.0)[steps > _LOST]))
