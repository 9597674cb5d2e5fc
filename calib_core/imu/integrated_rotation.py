"""How far a gyroscope has turned: its readings integrated as they are, without noise, knots or covariance."""

from __future__ import annotations

import numpy as np

from calib_core.geometry import exp
from calib_core.types import FloatArray


def turned_since(stamps_s: FloatArray, gyro_rad_s: FloatArray) -> FloatArray:
    """(Q, 3, 3) orientation at every reading, seen from the first. stamps_s: (Q,).   gyro_rad_s: (Q, 3).

    Between two readings the rate is their mean: exact where it changes evenly about one axis.
    """
    steps = exp(np.diff(stamps_s)[:, None] * 0.5 * (gyro_rad_s[1:] + gyro_rad_s[:-1]))
    return np.concatenate([np.eye(3)[None], _running_product(steps)])


def _running_product(steps: FloatArray) -> FloatArray:
    """steps[0] steps[1] ... steps[i] for every i, (N, 3, 3), in log2 N passes over all of them."""
    product = steps.copy()
    reach = 1
    while reach < len(product):
        product[reach:] = product[:-reach] @ product[reach:]
        reach *= 2
    return product
