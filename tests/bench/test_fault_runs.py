"""Campaigns on sensors as they are: rows against hand-made results, statistics against drawn errors, and one real run."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench import fault_runs
from bench.__main__ import main
from bench.fault_bounds import FAULT_BOUNDS, FaultBoundRow
from bench.fault_report import latest, misses, over_bound, parameters_text, summary, write_report
from bench.fault_runs import (
    TABLE,
    Campaign,
    FaultParameter,
    parameters_of,
    read_fault_runs,
    run_of,
    settings_from,
)
from bench.statistics import BIAS_SIGMAS, bias_text
from bench.tables import append_row
from calib_core.result import CalibrationResult
from calib_core.simulate import SCENARIOS, Scenario, Truth, parse_faults, prepare
from tests.bench.fault_draws import ORDER, drawn

CAMPAIGN = Campaign("handheld", "industrial", 30.0, "", "test")


def test_a_bias_shows_that_the_square_hides() -> None:
    """A shift of 0.4 sigma moves the NEES by 0.16 of 7 and the mean of 200 by 5.7 of its sigmas. Mutations: the mean error
    over the sigma of one run; its square alone."""
    honest, shifted, wide = summary(drawn()), summary(drawn(shift=0.4)), summary(drawn(scale=1.6))
    low, high = honest.nees[1:]
    assert low < honest.nees[0] < high
    assert np.abs(honest.bias).max() < BIAS_SIGMAS
    assert "biased" not in bias_text(honest.bias)
    assert shifted.bias[4] == pytest.approx(honest.bias[4] + 0.4 * np.sqrt(200.0))
    assert bias_text(shifted.bias).startswith("ty +")
    assert bias_text(shifted.bias).endswith("**biased**")
    assert wide.nees[0] > high
    assert wide.inside < 0.92
    assert honest.stated[1] == pytest.approx(1e3 * np.sqrt(1e-6 + 4e-6 + 9e-6))


def answer(truth: Truth, **more: object) -> CalibrationResult:
    """A document with the true extrinsic and unit covariance."""
    turn, shift = truth.R_imu_lidar, truth.p_imu_lidar
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turn, shift
    document = truth.to_file()
    return CalibrationResult.model_construct(
        status="calibrated",
        messages=[],
        T_imu_lidar=document.T_imu_lidar,
        time_offset_s=truth.time_offset_s,
        time_offset_ns=truth.time_offset_ns,
        uncertainty=type("Uncertainty", (), {"covariance": np.eye(7).tolist()})(),
        **more,
    )


def test_the_offset_is_compared_at_the_instant_it_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutation: the middle's offset whatever the result says; the rate's sign."""
    truth = prepare("handheld", seed=1, duration_s=10.0, faults=parse_faults("clock-rate=100,laser-offsets=8mm")).truth
    result = answer(truth)
    at_s = truth.time_offset_at_s + 2.0
    stated = [
        {"block": "laser_range_offset", "name": "3", "unit": "m", "value": 0.004, "std": 1e-3, "prior_std": 8e-3,
         "state": "estimated", "significant": True},
        {"block": "incidence", "name": "all", "unit": "m", "value": 1e-4, "std": 1e-3, "prior_std": 2e-3,
         "state": "considered", "significant": False},
    ]  # fmt: skip
    monkeypatch.setattr(
        CalibrationResult, "to_json", lambda _: json.dumps({"time_offset_at_s": at_s, "intrinsics": stated})
    )
    run = run_of(CAMPAIGN, 1, result, truth, 1.0)
    np.testing.assert_allclose(run.errors[:6], 0.0, atol=1e-12)
    assert run.errors[6] == pytest.approx(-200e-6, abs=2e-9)
    laser, incidence = parameters_of(CAMPAIGN, 1, result, truth)
    real = {each.name: each.value for each in truth.intrinsics if each.block == "laser_range_offset"}
    assert (laser.truth, laser.value, laser.prior_std) == (real["3"], 0.004, 8e-3)
    assert (incidence.truth, incidence.state) == (0.0, "considered")


def test_parameters_are_judged_by_block() -> None:
    """Mutation: considered ones judged as well; the std over the truth."""
    made = FaultParameter(*("h", "f", 30.0, "", "l"), 1, "clock_rate", "rate", "estimated", 10.0, 14.0, 2.0, 40.0)
    text = parameters_text([made, replace(made, state="considered", value=1e9)])
    assert text == "clock_rate 2.00 (0.05)"


def test_each_seed_counts_as_it_was_run_last() -> None:
    """Two versions, the second of some seeds. Mutations: the first run of a seed; the last version alone; one version named."""
    first = [replace(run, label="v1", seed=k) for k, run in enumerate(drawn(n=4))]
    second = [replace(run, label="v2", nees=70.0) for run in first[2:]]
    again = [replace(first[3], faults="glass", label="v2")]
    found = latest([*first, *second, *again])
    assert {(each.faults, each.label): [run.label for run in some] for each, some in found.items()} == {
        (first[0].faults, "v1, v2"): ["v1", "v1", "v2", "v2"],
        ("glass", "v2"): ["v2"],
    }
    whole = next(iter(found.values()))
    assert summary(whole).nees[0] == pytest.approx(np.mean([run.nees for run in first[:2]] + [70.0, 70.0]))
    assert summary(whole).campaign.label == "v1, v2"


def test_the_report_names_what_is_biased_or_refused(tmp_path: Path) -> None:
    """Mutation: a campaign without an answer left out of the table."""
    for run in (*drawn(shift=0.5, n=100), replace(drawn(n=1)[0], faults="glass", nees=np.nan, status="refused")):
        append_row(tmp_path / fault_runs.FAULT_RUNS, run, ORDER)
    text = write_report(tmp_path).read_text()
    assert "**biased**" in text
    assert "| glass | 0 of 1 |" in text
    assert len(read_fault_runs(tmp_path)) == 101


def test_what_a_campaign_misses_is_named() -> None:
    """Oracle: errors drawn with the stated sigmas, a factor beside. Mutations: too wide for too narrow; the stated sigmas for the
    bound; answers alone counted."""
    stated_deg, stated_mm, stated_ms = summary(drawn()).stated
    bound = FaultBoundRow("handheld", "industrial", 30.0, stated_deg, stated_mm / 1.6, stated_ms, *[1.0] * 4, "")
    honest, narrow, wide = summary(drawn()), summary(drawn(scale=1.6)), summary(drawn(scale=0.6))
    over = over_bound(honest, bound)
    assert over is not None
    np.testing.assert_allclose(over, [1.0, 1.6, 1.0], rtol=0.1)
    assert misses(honest, over) == [f"translation {over[1]:.2f} of the bound"]
    assert misses(honest, None) == []
    assert misses(narrow, None)[0] == "sigmas too narrow"
    assert misses(wide, over_bound(wide, bound)) == ["sigmas too wide"]
    assert misses(summary([*drawn(n=9), replace(drawn(n=10)[9], status="refused", nees=np.nan)]), None) == [
        "1 without an answer"
    ]
    far = replace(drawn()[0], errors=(6e-4, *drawn()[0].errors[1:]))
    assert misses(summary([far, *drawn()[1:]]), None) == ["6.0 sigmas"]


def test_campaigns_count_together_by_kind(tmp_path: Path) -> None:
    """Mutation: faults of a size of somebody's choice among those that are drawn from their priors."""
    for faults, n in (("industrial", 10), ("consumer", 11), ("glass", 5), ("glass=2m", 3)):
        for run in drawn(n=n):
            append_row(tmp_path / fault_runs.FAULT_RUNS, replace(run, faults=faults), ORDER)
    text = write_report(tmp_path).read_text()
    assert "Both profiles: 21 of 21 runs have an answer; mean NEES" in text
    assert "Single faults: 5 of 5 runs" in text


def test_the_bound_is_of_what_the_solve_was_told(tmp_path: Path) -> None:
    """To a solve that is told of no sensor the faults of cheap ones are unknowns, whichever were drawn.

    Mutations: the bound of the faults drawn for both; of ideal sensors; of another length.
    """
    told = [replace(run, settings="imu_noise=mti-30") for run in drawn(n=2)]
    for run in (*drawn(n=2), *told):
        append_row(tmp_path / fault_runs.FAULT_RUNS, run, ORDER)
    for faults, duration_s, deg in (("industrial", 30.0, 0.2), ("consumer, sensors not named", 30.0, 0.3),
                                    ("consumer, sensors not named", 20.0, 0.4), ("ideal sensors", 30.0, 0.1)):  # fmt: skip
        row = FaultBoundRow("handheld", faults, duration_s, deg, *[1.0] * 6, "")
        append_row(tmp_path / FAULT_BOUNDS, row, ())
    rows = [
        line
        for line in write_report(tmp_path).read_text().splitlines()
        if line.startswith("| handheld, 30 s") and "of 2" in line
    ]
    assert ["; 0.3)" in row for row in rows] == ["imu_noise" not in row for row in rows]
    assert ["; 0.2)" in row for row in rows] == ["imu_noise" in row for row in rows]


def test_a_campaign_runs_once_and_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the command line, the solve replaced. Mutations: seeds that are done run again; faults not passed on; the salt
    left out."""
    asked: list[tuple[str, str]] = []

    def generate(scenario: Scenario, *, seed: int, duration_s: float, faults: object, salt: str) -> tuple[None, Truth]:
        asked.append((str(faults), salt))
        return None, prepare(scenario, seed=seed, duration_s=duration_s).truth

    monkeypatch.setattr(fault_runs, "generate", generate)
    words = [
        "monte-carlo",
        "static",
        "--faults",
        "accel-scale=0.005",
        "--faults",
        "none",
        "--seeds",
        "1-2",
        "--jobs",
        "1",
    ]
    words += ["--duration-s", "1", "--label", "x", "--folder", str(tmp_path)]
    assert main(words) == 0
    assert main(words) == 0
    runs = read_fault_runs(tmp_path)
    assert len(runs) == len(asked) == 4
    assert {run.status for run in runs} == {"crashed"}
    assert asked[0] == (str(parse_faults("accel-scale=0.005")), "static accel-scale=0.005")
    assert asked[1] == ("()", "static none")
    assert settings_from("method=paper").method == "paper"


def test_the_table_is_known() -> None:
    """Every row of the table can be made. Mutation: a fault's name misspelt in it."""
    for name, faults in TABLE:
        assert name in SCENARIOS
        assert faults == fault_runs.NONE or parse_faults(faults)
