r"""What readings let one expect of one another: the filter that says best what a reading is from so many on either side.

    e_i = y_i - sum_j c_j y_{i+j},      c by least squares,      j = -SPAN ... SPAN without 0

Of motion it leaves the noise, and of what shakes a sensor much less than is there: engines, rotors and roads shake in lines and
bands, which are their own best forecast, where cubics between neighbours follow nothing above a tenth of the sampling rate.
"""

from __future__ import annotations

import numpy as np

from calib_core.types import FloatArray, IntArray

#: judged: readings on either side by which one is expected: two for each line, and bands take more. Twice as many tell the same.
SPAN = 16
#: derived: of the readings' own squares: keeps the filter finite where lines are fewer than it has numbers.
_RIDGE = 1e-9


def forecast_filter(y: FloatArray, centre: IntArray) -> FloatArray:
    """(2 SPAN + 1,) of a channel y (Q,) without its mean: what it takes of each neighbour, earliest first; of a reading itself
    nothing. centre: (N,) readings by which it is fitted, with SPAN neighbours on either side and none missing.
    """
    steps = np.array([step for step in range(-SPAN, SPAN + 1) if step])
    around = y[centre[:, None] + steps]
    normal = around.T @ around
    # A channel that stands still is expected to by any filter.
    ridge = max(_RIDGE * float(np.trace(normal)), np.finfo(np.float64).tiny)
    normal[np.diag_indices_from(normal)] += ridge
    return np.insert(np.linalg.solve(normal, around.T @ y[centre]), SPAN, 0.0)


def forecast(y: FloatArray, c: FloatArray) -> FloatArray:
    """(Q,) what a filter expects of each reading; at either end by those that there are."""
    return np.convolve(y, c[::-1], mode="same")
