"""Symmetric matrices as the factors keep them."""

from __future__ import annotations

import numpy as np

from calib_core.types import FloatArray


def triangle(products: FloatArray) -> FloatArray:
    """(.., F (F + 1) / 2) the upper triangle of symmetric products (.., F, F), row by row."""
    rows, columns = np.triu_indices(products.shape[-1])
    return np.ascontiguousarray(products[..., rows, columns])
