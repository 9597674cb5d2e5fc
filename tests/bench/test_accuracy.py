"""Campaigns, their table and the report made of it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench import campaign, starts
from bench.__main__ import main
from bench.accuracy import by_scenario, latest, write_report
from bench.bounds import BOUNDS, BoundRow
from bench.runs import PARAMETERS, Run, rms, run_of, solve_once
from bench.starts import StartRun, drawn
from bench.statistics import accuracy, consistency, paired, seeds_text
from bench.tables import append_row, read_rows
from calib_core.api import calibrate
from calib_core.simulate import generate

STDS = np.array([1e-4, 2e-4, 1e-4, 3e-4, 5e-4, 3e-4, 1e-5])


def run_with(
    errors: object, *, scenario: str = "paper-normal", seed: int = 1, label: str = "v1", std: float = 1.0
) -> Run:
    """A run with these errors in units of STDS, whose stated sigmas are `std` of those."""
    scaled = np.asarray(errors, dtype=np.float64)
    nees = float(np.sum((scaled / std) ** 2))
    values = tuple((scaled * STDS).tolist()), tuple((std * STDS).tolist())
    return Run(scenario, seed, label, "full", "calibrated", "", *values, nees, 190, 200, 5_000_000, 8.5, 30.25, 0.5)


def refused(scenario: str, seed: int) -> Run:
    """A run without an answer."""
    none = (math.nan,) * 7
    return Run(scenario, seed, "v1", "full", "refused", "planes.none", none, none, math.nan, 0, 200, 0, 1.0, 1.0, 0.5)


def drawn_runs(scenario: str, count: int = 100, std: float = 1.0, scale: float = 1.0) -> list[Run]:
    """Runs whose errors follow STDS."""
    errors = np.random.default_rng(7).standard_normal((count, 7))
    return [run_with(scale * e, scenario=scenario, seed=k + 1, std=std) for k, e in enumerate(errors)]


def test_rows_survive_the_table(tmp_path: Path) -> None:
    """Fails if a field is lost, a tuple's order turns, or the header is written twice (seen)."""
    path = tmp_path / "sub" / "runs.csv"
    written = [run_with(np.arange(7.0)), refused("handheld", 3)]
    for run in written:
        append_row(path, run, PARAMETERS)
    first, second = read_rows(path, Run, PARAMETERS)
    assert first.errors == pytest.approx(written[0].errors, rel=1e-8)
    assert replace(first, errors=written[0].errors) == written[0]
    assert (second.scenario, second.status, second.code, second.is_solved) == (
        "handheld",
        "refused",
        "planes.none",
        False,
    )
    assert list(read_rows(tmp_path / "none.csv", Run, PARAMETERS)) == []


def test_seeds_are_read_and_written_alike() -> None:
    """Fails if a range's last seed is left out (seen)."""
    assert campaign.seeds_of("1-3,7,2") == (1, 2, 3, 7)
    assert seeds_text([7, 2, 1, 3]) == "1-3, 7"
    assert not set(campaign.seeds_of("1-100")) - set(range(1, 101))
    assert seeds_text([]) == "none"


def test_a_campaign_goes_on_where_it_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fails if a seed that is there runs again, or another version's row counts as done (seen: label ignored)."""
    asked: list[tuple[str, int, str]] = []

    def solve(task: tuple[str, int, str]) -> Run:
        asked.append(task)
        scenario, seed, label = task
        return run_with(np.ones(7), scenario=scenario, seed=seed, label=label)

    monkeypatch.setattr(campaign, "_solve", solve)
    campaign.monte_carlo(["a"], [1, 2], jobs=1, label="v1", folder=tmp_path)
    campaign.monte_carlo(["a", "b"], [1, 2, 3], jobs=1, label="v1", folder=tmp_path)
    campaign.monte_carlo(["a"], [1], jobs=1, label="v2", folder=tmp_path)
    assert asked == [
        ("a", 1, "v1"), ("a", 2, "v1"), ("b", 1, "v1"), ("b", 2, "v1"), ("a", 3, "v1"), ("b", 3, "v1"), ("a", 1, "v2"),
    ]  # fmt: skip
    assert len(campaign.read_runs(tmp_path)) == 7


def test_a_crash_is_a_failure_of_its_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fails if an exception of the estimator ends the campaign or counts as solved."""

    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("calib_core.simulate.generate", lambda scenario, seed, salt: (None, None))
    monkeypatch.setattr("calib_core.api.calibrate", broken)
    run = solve_once("paper-normal", 4, label="v")
    assert (run.status, run.code, run.seed, run.is_solved) == ("crashed", "ZeroDivisionError", 4, False)


def test_a_run_is_held_against_the_truth() -> None:
    """A real result moved by a known turn, shift and delay. Fails on a turn taken about the wrong frame (seen: R R^T
    swapped) or an offset in the wrong unit."""
    recording, truth = generate("paper-fast", seed=1, duration_s=0.5)
    result = calibrate(recording).result  # too short: refused, and a document all the same
    turn, shift = np.array([1e-3, -2e-3, 3e-3]), np.array([0.01, -0.02, 0.03])
    T = truth.T_imu_lidar.copy()
    T[:3, :3] = T[:3, :3] @ Rotation.from_rotvec(turn).as_matrix()
    T[:3, 3] += shift
    stated = {
        "rotation_std_deg": [1.0] * 3,
        "translation_std_m": [1.0] * 3,
        "time_offset_std_s": 1.0,
        "gravity_std_m_s2": 1.0,
        "covariance": np.diag(STDS**2).tolist(),
    }
    moved = type(result).model_validate(
        result.model_dump(by_alias=True)
        | {
            "status": "calibrated",
            "T_imu_lidar": {
                "matrix": T.tolist(),
                "translation_m": T[:3, 3].tolist(),
                "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0],
                "euler_xyz_deg": [0.0, 0.0, 0.0],
            },
            "time_offset_s": 0.0,
            "time_offset_ns": truth.time_offset_ns + 1500,
            "uncertainty": stated,
        }
    )
    run = run_of(moved, truth, scenario="s", seed=1, label="v", method="full", solve_s=1.0, cpu_s=1.0)
    np.testing.assert_allclose(run.errors, [*turn, *shift, 1.5e-6], rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(run.stds, STDS)
    assert run.nees == pytest.approx(np.sum((np.array(run.errors) / STDS) ** 2), rel=1e-9)
    assert run.e_p_mm == pytest.approx(1e3 * np.linalg.norm(shift))


def test_honest_runs_are_consistent_and_others_are_not() -> None:
    """Fails if the interval is that of one draw, or coverage is counted in the wrong unit (seen: one sigma)."""
    honest = consistency(drawn_runs("a", 400))
    assert honest.nees_holds
    assert honest.coverage_holds
    assert honest.pooled == pytest.approx(0.95, abs=0.012)
    assert honest.high - honest.low == pytest.approx(2 * 2.576 * math.sqrt(14 / 400), rel=0.02)
    for std in (0.75, 1.35):
        wrong = consistency(drawn_runs("a", 100, std=std))
        assert not wrong.nees_holds
        assert not wrong.coverage_holds


def test_accuracy_is_the_rms_of_the_norms() -> None:
    """Fails if refused runs spoil the rms, or norms are averaged before they are squared."""
    found = accuracy([run_with([0, 0, 0, 0, 0, 0, 3]), run_with([0, 0, 0, 2, 0, 0, -4]), refused("paper-normal", 9)])
    assert found.offset_ms == pytest.approx(1e-2 * math.sqrt(12.5))
    assert found.translation_mm == pytest.approx(0.6 / math.sqrt(2))
    assert math.isnan(rms([]))


def test_pairs_share_their_seeds() -> None:
    """Fails if runs are paired by place: the third of one list is not the third of the other."""
    spoiled = [run_with(np.ones(7), seed=s) for s in (4, 1, 3)]
    clean = [run_with(np.ones(7), seed=s) for s in (1, 2, 3)] + [refused("paper-normal", 4)]
    a, b = paired(spoiled, clean)
    assert [run.seed for run in a] == [run.seed for run in b] == [1, 3]


def test_recordings_with_noise_of_their_own_are_no_pairs(tmp_path: Path) -> None:
    """Every run of either counts, and the draw's own error is not compared. Mutation: paired all the same (20 of 30 here)."""
    own = [replace(run, label="v1-independent") for run in drawn_runs("paper-normal", 30)]
    own += [replace(run, label="v1-independent", seed=run.seed + 10) for run in drawn_runs("outliers", 30, scale=1.4)]
    for run in own:
        append_row(tmp_path / campaign.MONTE_CARLO, run, PARAMETERS)
    text = write_report(tmp_path).read_text(encoding="utf-8")
    assert "| outliers | paper-normal | 30 | 1.40 / 1.40 / 1.40 |" in text
    assert "noise of its own" in text
    assert "Pairs share" not in text


def test_latest_version_only() -> None:
    """Fails if versions are mixed in one figure."""
    rows = [run_with(np.ones(7), seed=s, label=v) for v in ("v1", "v2") for s in (2, 1)]
    assert [(run.label, run.seed) for run in latest(rows)] == [("v2", 1), ("v2", 2)]
    assert {run.label for run in latest(rows, "v1")} == {"v1"}
    assert list(by_scenario([*rows, replace(rows[0], scenario="aaa"), replace(rows[0], scenario="handheld")])) == [
        "paper-normal",
        "handheld",
        "aaa",
    ]


def test_the_report_judges(tmp_path: Path) -> None:
    """Good runs hold, bad ones do not, refusals are listed by seed. Fails if a ratio beyond its figure passes (seen: <=
    turned round), a spoiled recording is compared with all its twin's runs, or versions of starts are mixed."""
    bound = BoundRow(
        "paper-normal", 1, *(float(v) for v in (np.degrees(np.linalg.norm(STDS[:3])), 1e3 * np.linalg.norm(STDS[3:6]), 1e-2)),
        tuple(STDS.tolist()), 6, 10**6, 10.0,
    )  # fmt: skip
    append_row(tmp_path / BOUNDS, bound, PARAMETERS)
    append_row(tmp_path / BOUNDS, replace(bound, scenario="handheld", rotation_deg=1e-9), PARAMETERS)
    rows = drawn_runs("paper-normal") + drawn_runs("handheld", 20)
    rows += drawn_runs("outliers", 30, scale=1.4) + drawn_runs("imu-faults", 30, scale=1.6)
    rows += [refused("outliers", 31), refused("outliers", 33)]
    for run in rows:
        append_row(tmp_path / campaign.MONTE_CARLO, run, PARAMETERS)
    start = StartRun(
        "paper-normal", 1, "any", "v1", 120.0, 0.7, 0.3, "calibrated", "calibrated", "", (0.0,) * 7, (1.0,) * 7, 2.5,
        100.0, 100.0, 1e-6, 20.0,
    )  # fmt: skip
    for seed, excess, worst in ((1, 0.0, 2.5), (2, 3e-6, 2.5), (3, 0.0, 6.0), (4, math.nan, math.nan)):
        row = replace(start, seed=seed, cost=100.0 * (1.0 + excess), worst_sigmas=worst)
        append_row(tmp_path / starts.STARTS, row, PARAMETERS)
    append_row(tmp_path / starts.STARTS, replace(start, seed=2, label="v2"), PARAMETERS)
    assert main(["report", "--folder", str(tmp_path)]) == 0
    text = (tmp_path / "accuracy.md").read_text(encoding="utf-8")
    lines = {
        tuple(cell.strip() for cell in line.split("|")[1:-1]) for line in text.splitlines() if line.startswith("| ")
    }

    def row_of(first: str, width: int) -> tuple[str, ...]:
        return next(cells for cells in lines if cells[0] == first and len(cells) == width)

    assert row_of("paper-normal", 9)[-2] == "yes"
    assert row_of("handheld", 9)[-2] == "**no**, 20 of 100 runs"
    assert row_of("paper-normal", 14)[-1] == "yes"
    assert row_of("imu-faults", 7)[-1] == "**no**, 30 of 100 runs"
    assert row_of("outliers", 7)[2:6] == ("30", "1.40 / 1.40 / 1.40", "<= 1.5", "31, 33")
    mended, first = sorted((cells for cells in lines if cells[0] == "any"), key=lambda cells: cells[3])
    assert first[1:] == (
        "v1", "paper-normal", "3 of 4", "6.00", "3.0e-06", "1.0e-06", "3-4", "2, 4", "**no**, 4 of 200 runs"
    )  # fmt: skip
    assert mended[1:] == (
        "v2",
        "paper-normal",
        "1 of 1",
        "2.50",
        "0.0e+00",
        "1.0e-06",
        "none",
        "none",
        "yes, 1 of 200 runs",
    )
    assert row_of("outliers", 4) == ("outliers", "refused", "planes.none", "31, 33")
    assert (tmp_path / "accuracy_nees.png").is_file()
    assert (tmp_path / "accuracy_errors.png").is_file()


def test_a_report_without_runs(tmp_path: Path) -> None:
    """Fails if nothing to show is an exception."""
    assert "Not run yet" in write_report(tmp_path).read_text(encoding="utf-8")


def test_mountings_are_drawn_from_everywhere() -> None:
    """Uniform over SO(3): every element of the matrix is uniform in -1..1; the same seed, the same start.
    Fails if Euler angles are drawn instead (seen), or the offset's bounds are wrong."""
    some = [drawn(seed, "any") for seed in range(1, 2001)]
    R = Rotation.from_quat([mounting[3:] for mounting, _ in some]).as_matrix()
    assert np.abs(np.mean(R**2, axis=0) - 1.0 / 3.0).max() < 0.03
    assert np.abs(np.mean(R, axis=0)).max() < 0.05
    levers = np.linalg.norm([mounting[:3] for mounting, _ in some], axis=1)
    offsets = np.array([offset for _, offset in some])
    assert 0.97 < levers.max() <= 1.0
    assert 0.48 < np.abs(offsets).max() <= 0.5
    assert drawn(3, "any") == drawn(3, "any") != drawn(4, "any")
    assert drawn(3, "minutes")[0] == drawn(3, "any")[0]
    assert all(60 < abs(drawn(seed, "minutes")[1]) < 700 for seed in range(8))
    assert all(8e4 < abs(drawn(seed, "epochs")[1]) < 1.6e9 for seed in range(8))
