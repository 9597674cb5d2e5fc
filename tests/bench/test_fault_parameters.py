"""Whether parameters were found within their sigmas: verdicts against errors that are drawn, alone and with what all share."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench import fault_runs
from bench.fault_parameters import LEVEL, blocks_of, fit_of, section
from bench.fault_runs import Campaign, FaultParameter
from bench.readme import real_table
from bench.tables import append_row
from calib_core.simulate.faults import PROFILES
from calib_core.types import FloatArray
from tests.bench.fault_draws import ORDER, drawn

CAMPAIGN = Campaign("handheld", "industrial", 30.0, "", "test")
STD = 3e-4


def block(errors: FloatArray, *, state: str = "estimated", prior: float = 10.0) -> list[FaultParameter]:
    """A block's parameters, a run a row. errors: (runs, parameters) in stated sigmas."""
    return [
        FaultParameter(
            *("handheld", "industrial", 30.0, "", "test"), seed, "laser_elevation", str(k), state, 0.01,
            0.01 + STD * float(error), STD, prior * STD,
        )
        for seed, row in enumerate(errors)
        for k, error in enumerate(row)
    ]  # fmt: skip


@pytest.mark.parametrize("shared", [0.0, 0.9])
def test_right_sigmas_fail_once_in_a_hundred_at_the_most(shared: float) -> None:
    """Whatever the parameters of a run have in common. Mutations: the worst parameter's chance as it stands; the middle one's
    without its factor; twice the lesser left out."""
    rng = np.random.default_rng(0)
    failed = 0
    for _ in range(300):
        own = rng.standard_normal((20, 16))
        common = rng.standard_normal((20, 1))
        (fit,) = blocks_of(block(np.sqrt(1.0 - shared) * own + np.sqrt(shared) * common))
        failed += fit.verdict != "holds"
    assert failed <= 8  # three expected; more than eight of a Poisson law's 3 four times in a thousand


def test_wrong_sigmas_are_named_by_their_side() -> None:
    """Of one parameter of sixteen, and of all by a common part. Mutations: narrow and wide exchanged; the median alone; the worst
    alone."""
    rng = np.random.default_rng(1)
    errors = rng.standard_normal((20, 16))
    one = errors.copy()
    one[:, 7] *= 3.0
    (fit,) = blocks_of(block(one))
    assert (fit.verdict, fit.worst.name, fit.within) == ("too narrow", "7", 15)
    (wide,) = blocks_of(block(0.2 * errors))
    assert (wide.verdict, wide.within) == ("too wide", 0)
    # All of them a little: no one of sixteen by itself, at a level for sixteen.
    (all_of_them,) = blocks_of(block(np.full((20, 16), 1.51)))
    assert all_of_them.worst.chance * 16 > LEVEL
    assert all_of_them.verdict == "too narrow"


def test_a_parameter_is_judged_by_chi_square() -> None:
    """Of two runs one and three sigmas off the sum is 10, which two degrees of freedom pass once in e^5; both sides count.
    Mutations: the error against nothing instead of the truth; degrees of freedom one less; one side."""
    fit = fit_of(block(np.array([[1.0], [-3.0]])))
    assert fit.runs == 2
    assert fit.nees == pytest.approx(5.0)
    assert fit.chance == pytest.approx(2.0 * np.exp(-5.0))


def test_what_is_only_considered_is_no_estimate() -> None:
    """Mutation: states left unread."""
    assert blocks_of(block(np.ones((3, 2)), state="considered")) == []
    assert section([(CAMPAIGN, block(np.ones((3, 2)), state="considered"))]) == []


def test_profiles_are_listed_block_by_block_and_others_by_what_fails() -> None:
    """Mutations: one for the other; what fails left out; the part of the prior that is left turned over."""
    wrong = block(3.0 * np.random.default_rng(2).standard_normal((20, 3)))
    told = "\n".join(section([(CAMPAIGN, wrong), (replace(CAMPAIGN, faults="glass"), wrong)]))
    assert "| handheld, 30 s | industrial | laser_elevation | 20 |" in told
    assert "| 0 of 3 | 0.10 | **too narrow** |" in told
    assert "| handheld, 30 s | glass | 20 | 0 of 1 | **laser_elevation** (" in told


def test_no_campaign_that_says_anything_is_left_out_of_the_table(tmp_path: Path) -> None:
    """Nor any of whole sensors out of the README's shorter one. Mutations: few runs left out, or unmarked; many marked; one
    without an answer left out; two runs told as a campaign; single faults in the shorter one.
    """
    runs = [*drawn(n=20), *(replace(run, faults="glass") for run in drawn(n=6))]
    runs += [replace(run, faults="skirting") for run in drawn(n=2)]
    runs.append(replace(drawn(n=1)[0], faults="door-ajar", nees=np.nan, status="refused"))
    for run in runs:
        append_row(tmp_path / fault_runs.FAULT_RUNS, run, ORDER)
    table = real_table(tmp_path)
    assert "| handheld, 30 s | industrial | 20 |" in table
    assert "| handheld, 30 s | glass | only 6 |" in table
    assert "skirting" not in table
    assert "| handheld, 30 s | door-ajar | 1, 0 solved |" in table
    assert [line for line in real_table(tmp_path, only=PROFILES).splitlines() if "30 s" in line] == [
        line for line in table.splitlines() if "| industrial |" in line
    ]
