"""Fixtures for the solver's tests."""

from __future__ import annotations

import pytest

from calib_core.solver.arrow import Eliminated
from calib_core.solver.system import ArrowSystem


@pytest.fixture
def eliminations(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The damping of each that is made from now on."""
    made: list[float] = []
    real = Eliminated.of

    def counting(system: ArrowSystem, *, damping: float = 0.0) -> Eliminated:
        made.append(damping)
        return real(system, damping=damping)

    monkeypatch.setattr(Eliminated, "of", counting)
    return made
