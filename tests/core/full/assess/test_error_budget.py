"""The error budget: each part alone, what they come to together, and who tells of which."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.full.assess.budget_sentences import say_clocks, say_disagreement, say_shapes
from calib_core.full.assess.considered import Considered
from calib_core.full.assess.disagreement import Disagreement
from calib_core.full.assess.error_budget import ErrorBudget, in_scaled, in_si
from calib_core.full.assess.observability import Knowledge, assess
from calib_core.full.joint.undetermined import UNITS
from calib_core.types import FloatArray
from tests.core.full.assess.made_information import information_of, priors_of

#: One standard deviation of the noise, SI: 0.02 deg, 0.3 mm, 0.05 ms.
NOISE = np.array([*[np.radians(0.02)] * 3, *[3e-4] * 3, 5e-5])
#: By how much two parameters of sensors that were held would move the answer, a column each; and shapes, SI.
HELD = np.array([[1e-4, 0.0, 0.0, 0.0, 1e-3, 0.0, 0.0], [0.0, 0.0, 2e-4, 0.0, 0.0, 5e-4, 1e-5]]).T
SHIFT = np.array([0.0, 3e-4, 0.0, 0.0, -2e-3, 0.0, 2e-5])
#: A translation along (0, 0, 1) that stretches of time disagree about by 4 mm, and near and far by 1 mm; SI.
TIME_M, RANGE_M, CLOCKS_S = 4e-3, 1e-3, 2e-4
NOTHING: FloatArray = np.zeros((7, 7))


def _of_z(std_m: float) -> FloatArray:
    return np.diag([0.0] * 5 + [(std_m / 0.01) ** 2, 0.0])


def _budget(*names: str) -> ErrorBudget:
    """Noise, and of the others those that are named."""
    scaled = HELD / UNITS[:, None]
    none = np.zeros(0)
    found = [
        Disagreement("time", 5.0, _of_z(TIME_M)),
        Disagreement("range", 2.0, _of_z(RANGE_M)),
        Disagreement("planes", 1.0, NOTHING),
    ]
    return ErrorBudget.of(
        np.diag((NOISE / UNITS) ** 2),
        Considered(scaled @ scaled.T, HELD, none, none) if "considered" in names else None,
        SHIFT if "shapes" in names else np.zeros(7),
        found if "disagreement" in names else found[2:],
        CLOCKS_S if "clocks" in names else 0.0,
    )


#: What each is, by hand, SI.
BY_HAND = {
    "noise": np.diag(NOISE**2),
    "considered": np.outer(HELD[:, 0], HELD[:, 0]) + np.outer(HELD[:, 1], HELD[:, 1]),
    "shapes": np.outer(SHIFT, SHIFT),
    # What stretches of time account for, near and far do not add again.
    "disagreement": np.diag([0.0] * 5 + [TIME_M**2, 0.0]),
    "clocks": np.diag([0.0] * 6 + [CLOCKS_S**2]),
}
OTHERS = tuple(BY_HAND)[1:]


def _same(covariance: FloatArray, expected: FloatArray) -> None:
    np.testing.assert_allclose(in_scaled(covariance), in_scaled(expected), rtol=1e-9, atol=1e-12)


def test_each_part_is_asked_alone_in_si_units() -> None:
    """Against numbers made by hand. Mutations: shapes in metres beside degrees; the clocks' standard deviation for its square; of
    disagreement the sum of all ways; either half of the change of units.
    """
    budget = _budget(*OTHERS)
    assert [part.name for part in budget.parts] == list(BY_HAND)
    for part in budget.parts:
        _same(part.covariance, BY_HAND[part.name])
        assert part.is_there
    assert [part.name for part in _budget().parts if part.is_there] == ["noise"]
    _same(in_si(in_scaled(BY_HAND["shapes"])), BY_HAND["shapes"])


@pytest.mark.parametrize("names", [(), *((name,) for name in OTHERS), OTHERS])
def test_all_parts_together_are_what_the_answer_states(names: tuple[str, ...]) -> None:
    """Where all is known and nothing was given. Oracle: the spread of answers that are off by draws of each.

    Mutations: considered, shapes or disagreement left out of what is beyond noise; one of them twice; the clocks left out of the
    total.
    """
    budget, priors = _budget(*names), priors_of()
    known = assess(
        information_of(NOISE / UNITS, np.eye(7), priors),
        priors,
        added=budget.beyond_noise,
        offset_std_s=budget.clocks_std_s,
    )
    rng, draws = np.random.default_rng(4), 100_000
    off = rng.standard_normal((draws, 7)) * NOISE
    for name, columns in (("considered", HELD.T), ("shapes", SHIFT[None]), ("disagreement", TIME_M * np.eye(7)[5:6])):
        off += (name in names) * rng.standard_normal((draws, len(columns))) @ columns
    off[:, 6] += ("clocks" in names) * CLOCKS_S * rng.standard_normal(draws)
    np.testing.assert_allclose(np.sqrt(np.diag(budget.total)), off.std(axis=0), rtol=0.01)
    _same(budget.total, sum((BY_HAND[name] for name in names), BY_HAND["noise"]))
    np.testing.assert_allclose(in_scaled(known.covariance), in_scaled(budget.total), rtol=1e-4, atol=1e-8)


def test_what_parts_disagree_about_is_told_where_all_else_leaves_something_known() -> None:
    """Along what sensors that were held leave ten metres open, a disagreement is none. Mutation: in units of noise alone."""
    open_z = Considered(_of_z(10.0), np.zeros((7, 0)), np.zeros(0), np.zeros(0))
    found = [Disagreement("time", 5.0, _of_z(TIME_M))]
    for considered, there in ((None, True), (open_z, False)):
        budget = ErrorBudget.of(np.diag((NOISE / UNITS) ** 2), considered, np.zeros(7), found, 0.0)
        assert budget.part("disagreement").is_there is there


def test_a_person_hears_of_each_part_where_it_is_there() -> None:
    """By the codes of the table in error_budget.py. Mutations: two codes exchanged; shapes held against themselves, too; said
    where nothing is there.
    """
    heard: list[str] = []
    step = SimpleNamespace(text="the IMU's stamps are multiples of 1 ms")
    codes = {"shapes": "planes.shape", "disagreement": "solve.disagreement", "clocks": "clock.coarse"}
    for name, code in codes.items():
        heard.clear()
        alone = _budget(name)
        clocks = SimpleNamespace(steps_std_s=alone.clocks_std_s, steps=[step] if alone.clocks_std_s else [])
        run: Any = SimpleNamespace(say=lambda _level, code, _text: heard.append(code), clocks=clocks)
        say_shapes(run, SHIFT if name == "shapes" else np.zeros(7), alone.beside_shapes)
        say_disagreement(run, [Disagreement("time", 5.0, _of_z(TIME_M))], alone.disagreement, is_torn=False)
        say_clocks(run, Knowledge(alone.total, NOISE, (), rotation_known=True))
        assert heard == [code]
