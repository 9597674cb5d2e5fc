"""The efficient estimate beside the estimator: what of an error is the draw's, on errors made by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from bench.draw import DRAWS, Draw, read_draws, section, shares
from bench.runs import PARAMETERS, Run
from bench.tables import append_row

STDS = (1e-4, 2e-4, 2e-4, 3e-4, 5e-4, 3e-4, 1e-5)


def _run(seed: int, sigmas: float, *, solved: bool = True) -> Run:
    errors = tuple(sigmas * std for std in STDS) if solved else (math.nan,) * 7
    nees = 7.0 if solved else math.nan
    return Run("room", seed, "v1", "full", "calibrated", "", errors, STDS, nees, 190, 200, 5, 8.5, 30.0, 0.5)


def _draw(seed: int, sigmas: float) -> Draw:
    return Draw("room", seed, tuple(sigmas * std for std in STDS), STDS)


def test_what_the_estimator_adds_is_told_from_the_draw() -> None:
    """Three sigmas drawn and three made are nothing of its own. Mutations: pair by place instead of by seed (8 and 9 differ);
    the difference of the rms instead of the rms of the difference (0 for a wrong sign).
    """
    found = shares(
        [_run(9, -4.0), _run(8, 3.0), _run(7, 1.0, solved=False)], [_draw(8, 3.0), _draw(9, 4.0), _draw(1, 9.0)]
    )
    assert found is not None
    assert found.seeds == (8, 9)
    assert found.efficient == pytest.approx([math.sqrt(12.5)] * 3)
    assert found.estimator == pytest.approx([math.sqrt(12.5)] * 3)
    assert found.beyond == pytest.approx([math.sqrt(32.0)] * 3)
    assert shares([_run(2, 1.0)], [_draw(3, 1.0)]) is None


def test_draws_come_back_and_are_shown(tmp_path: Path) -> None:
    """Mutation: show a scenario that was not drawn, or the blocks in another order."""
    for seed in (1, 2):
        append_row(tmp_path / DRAWS, _draw(seed, 1.0), PARAMETERS)
    draws = read_draws(tmp_path)
    np.testing.assert_allclose([draw.errors for draw in draws["room"]], [STDS, STDS], rtol=1e-8)
    turned = _run(1, 1.0)
    run = Run(**{name: getattr(turned, name) for name in turned.__slots__} | {"errors": (*turned.errors[:6], 3e-5)})
    lines = section({"room": [run], "hall": [run]}, draws)
    assert lines[-1] == "| room | 1 | 1.00 / 1.00 / 1.00 | 1.00 / 1.00 / 3.00 | 0.00 / 0.00 / 2.00 |"
    assert section({"hall": [run]}, draws) == []
