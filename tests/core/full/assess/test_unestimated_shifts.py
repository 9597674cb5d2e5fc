"""What was not estimated and may move the answer all the same: how far, against steps with it taken for something else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.full.assess.considered import consider
from calib_core.full.assess.unestimated_shifts import shift_of, told_considered
from calib_core.full.joint.state import CALIBRATION
from calib_core.intrinsics import KINDS, UNITS, Block
from calib_core.result import Intrinsic
from calib_core.solver.arrow import solve_arrow
from calib_core.types import FloatArray
from tests.core.full.assess.solved_problem import solved_problem

TURNS, PLACES = np.radians([3e-3, 4e-3, 0.0]), np.array([0.0, 3e-4, 4e-4])


def _one(block: Block, seven: FloatArray, *, prior: float = 1e-3, name: str = "0") -> Intrinsic:
    told = {"block": block, "name": name, "unit": UNITS[block], "value": 0.0, "std": 1.0, "prior_std": prior}
    return Intrinsic.model_validate({**told, "state": "considered", "significant": False, "shift": shift_of(seven)})


def test_an_answer_is_off_by_what_was_taken_for_zero_and_is_not() -> None:
    """With each parameter taken for a thousandth of its sigma more the next step goes the other way.

    Mutations: the sign; without the prior's sigma; in the covariance's units.
    """
    problem, estimate = solved_problem()
    own = problem.layout(estimate).nuisance()
    held = replace(problem, frozen=tuple(range(own.start, own.stop)))
    prior_std = estimate.sensors.blocks.prior_std
    shift = consider(held, estimate, estimate.sensors.blocks).shift
    scale = np.abs(shift).max(axis=1)
    for k in range(0, len(prior_std), 3):
        steps = []
        for size in (-1e-3, 1e-3):
            taken = estimate.sensors.moved(size * prior_std * (np.arange(len(prior_std)) == k))
            steps.append(solve_arrow(held.linearise(replace(estimate, sensors=taken))).step_shared[:CALIBRATION])
        moved = (steps[1] - steps[0]) / 2e-3
        np.testing.assert_allclose(moved / scale, -shift[:, k] / scale, atol=5e-3)


def test_what_counts_is_said_with_its_size_and_what_it_could_do() -> None:
    """Mutations: what does not count said too; another group's amount; the largest member for all; a prior in the wrong unit."""
    seven = np.concatenate([np.zeros(3), PLACES, [0.0]])
    covariance = np.diag(np.array([1e-4, 1e-4, 1e-4, 4e-4, 4e-4, 4e-4, 1e-5]) ** 2)
    ((code, text),) = told_considered([_one("laser_range_scale", seven)], covariance)
    assert code == "sensor.considered"
    assert text == (
        "not estimated, but counted in the error bars: range scales of lasers (0.10 %, 1 sigma) could move the translation by "
        "0.50 mm"
    )
    # Four lasers, each as much: twice as far, and of a covariance that has room for it.
    four = [_one("laser_range_scale", seven, name=str(k)) for k in range(4)]
    ((_, text),) = told_considered(four, 10.0 * covariance)
    assert "(0.10 % each, 1 sigma) could move the translation by 1.0 mm" in text
    assert told_considered([_one("laser_range_scale", seven)], 100.0 * covariance) == []
    turning = np.concatenate([TURNS, np.zeros(3), [0.0]])
    both = [_one("clock_rate", seven, prior=40.0), _one("gyroscope_axes", turning, prior=np.radians(0.3))]
    told = told_considered(both, covariance + np.diag(turning**2))
    assert ["rotation by 0.0050 deg" in text for _, text in told] == [False, True]
    assert [text.split("(")[1].split(",")[0] for _, text in told] == ["40 ppm", "0.30 deg"]


#: A thousandth of each unit, in the words that people use.
SIZES = {
    "1": "0.10 %",
    "rad": "0.057 deg",
    "m": "1.0 mm",
    "s": "1.0 ms",
    "ppm": "0.0010 ppm",
    "rad/s/(m/s2)": "0.56 deg/s per g",
    "1/(m/s2)": "0.0010 1/(m/s²)",
    "s2": "0.0010 s²",
    "s3": "0.0010 s³",
}


@pytest.mark.parametrize("block", KINDS)
def test_every_block_has_words_and_a_size(block: Block) -> None:
    """What widens most comes first. Seen: an accelerometer's bend and a filter's smear in deg/s a g. Mutations: a block without
    words; the least first; any two units' words exchanged.
    """
    seven = np.concatenate([np.zeros(3), PLACES, [0.0]])
    more = _one("range_offset" if block != "range_offset" else "incidence", 2.0 * seven)
    covariance = np.diag(np.full(CALIBRATION, 1e-8) + seven**2 + (2.0 * seven) ** 2)
    told = told_considered([_one(block, seven), more], covariance)
    assert len(told) == 2
    assert "1.0 mm" in told[0][1]
    assert "0.50 mm" in told[1][1]
    assert f"({SIZES[UNITS[block]]}, 1 sigma)" in told[1][1]


def test_a_time_offset_that_was_held_is_moved_by_nothing() -> None:
    """Mutation: divided by its variance of zero."""
    seven = np.concatenate([np.zeros(3), PLACES, [0.0]])
    covariance = np.diag([1e-8, 1e-8, 1e-8, 2e-7, 2e-7, 2e-7, 0.0])
    ((_, text),) = told_considered([_one("range_offset", seven)], covariance)
    assert "time offset" not in text


def test_what_was_estimated_has_no_shift() -> None:
    """Nor has a document that says so a key for it. Mutation: the key always there."""
    told = {"block": "incidence", "name": "all", "unit": "m", "value": 0.0, "std": 1.0, "prior_std": 1.0}
    one = Intrinsic.model_validate({**told, "state": "estimated", "significant": False})
    assert "shift" not in one.model_dump()
    assert told_considered([one], np.eye(CALIBRATION)) == []
