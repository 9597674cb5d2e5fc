"""Arithmetic that breaks down is a refusal with a reason, so that what goes on from a refusal goes on from it, too."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from calib_core.errors import Refused

_LOG = logging.getLogger(__name__)
#: The refusal's code.
BROKE_DOWN = "solve.broke_down"


@contextmanager
def arithmetic_or_refused() -> Iterator[None]:
    """Raises Refused where numbers came to no number: a factor of what is not positive, eigenvalues of what is not finite."""
    try:
        yield
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        _LOG.info("the arithmetic of a calibration broke down", exc_info=True)
        raise Refused(
            BROKE_DOWN,
            f"the solve's arithmetic broke down ({str(error).rstrip('.')}), so there is no answer; the planes or the motion "
            "determine too little: choose other planes, give an initial guess, or record with more turning about different axes",
        ) from error
