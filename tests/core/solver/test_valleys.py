"""Descents along valleys, where only what is hardly known bends or is found."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.solver.levenberg import Outcome, _Damping, minimise
from calib_core.solver.system import ArrowSystem
from calib_core.types import FloatArray
from tests.core.solver.descended import Trade, Valley


class Street(Trade):
    """What two unknowns trade, with a million-millionth: metres along a street that hardly a point tells."""

    stiff, bend = 1e6, 3.0


def test_a_valley_is_gone_along_where_next_to_nothing_holds() -> None:
    """Mutation: the least damping of others, with which as many steps end before the middle."""
    start = np.zeros(2)
    end = minimise(Street(), start, max_iterations=25, along_valleys=True)
    assert end.estimate[0] == pytest.approx(2.0, abs=1e-3)
    assert end.outcome is not Outcome.EXHAUSTED
    other = minimise(Street(), start, max_iterations=25)
    assert other.estimate[0] < 1.0


class Drift(Valley):
    """A street: every step predicts as much along it, and finds nothing."""

    def cost(self, estimate: FloatArray) -> float:
        return 5.0

    def linearise(self, estimate: FloatArray) -> ArrowSystem:
        H, g = np.array([[2.0, 1.0], [1.0, 3.0]]), np.array([0.01, 0.01])
        return ArrowSystem(H[:1, :1][None], np.zeros((0, 1, 1)), H[:1, 1:][None], H[1:, 1:], g[:1][None], g[1:])


def test_steps_that_find_nothing_down_a_street_end_soon() -> None:
    """Mutations: damped steps only; gone on with to the last; so from afar as well."""
    steps: list[float] = []
    end = minimise(Drift(), np.zeros(2), along_valleys=True, on_step=lambda _, cost, __: steps.append(cost))
    assert (end.outcome, len(steps)) == (Outcome.CREEPING, 3)
    assert minimise(Drift(), np.zeros(2), max_iterations=9).outcome is Outcome.EXHAUSTED


@pytest.mark.parametrize(
    ("damped", "found", "predicted", "ends"),
    [
        (True, [1e-4, 1e-4, 1e-4], 1e-4, [False, False, True]),
        (True, [1e-4, 1e-2, 1e-4, 1e-4, 1e-4], 1e-4, [False, False, False, False, True]),
        (False, [1e-4, 1e-4, 1e-4, 1e-4], 1e-4, [False] * 4),
        (False, [1e-4, 1e-4, 1e-4], 1e-3, [False, False, True]),
    ],
)
def test_what_creeps_is_damped_or_finds_less_than_it_says(
    damped: bool, found: list[float], predicted: float, ends: list[bool]
) -> None:
    """Three in a row. Mutations: three in all; undamped steps that find what they predict."""
    damping = _Damping(along_valleys=True)
    for each, last in zip(found, ends, strict=True):
        damping.now = 1e-5 if damped else 0.0
        assert damping.accepted(each, predicted) is (Outcome.CREEPING if last else None)


def test_along_valleys_damping_soon_grows_faster(eliminations: list[float]) -> None:
    """From next to nothing to what bends far as quickly as others. Mutations: tenfold each time; a step's refusals counted for
    the next one; damping that stays.
    """
    minimise(Valley(), np.array([0.0, 0.2]), max_iterations=4, along_valleys=True)
    grown, sunk, again, information = [0.0, 1e-14, 1e-12, 1e-9, 1e-6, 1e-3, 1.0], [1e-1, 1e-2, 1e-3], [1e-2], [0.0]
    assert eliminations == pytest.approx([*grown, *sunk, *again, *information])
