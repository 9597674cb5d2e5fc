"""Arithmetic that breaks down somewhere in a solve: a result with a reason, as of any other failure."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.solver.arrow import NotPositiveDefinite
from calib_core.types import Recording


@pytest.mark.parametrize(
    "broken",
    [lambda: np.linalg.cholesky(np.array([[-1.0]])), lambda: _raise(NotPositiveDefinite("block 3")), lambda: 1 // 0],
)
def test_it_is_refused_with_a_reason(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch, broken: Callable[[], object]
) -> None:
    """Mutations: one of the two kinds let through; no reason told."""
    monkeypatch.setattr("calib_core.calibrate.calibrate_full", lambda *_: broken())
    done = calibrate(noisy[0], CalibrateSettings())
    assert done.trajectory is None
    assert done.result.status == "refused"
    last = done.result.messages[-1]
    assert (last.level, last.code) == ("error", "solve.broke_down")
    assert "arithmetic broke down (" in last.text


def _raise(error: Exception) -> None:
    raise error
