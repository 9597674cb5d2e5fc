"""The paper's experiments: which runs a row is made of, and what the table says of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.paper_report import _mean, write_report
from bench.paper_runs import Experiment, Outcome, _scenario, experiments


def test_rows_that_are_solved_alike_share_their_runs_and_no_others_do() -> None:
    """Mutations: a key without the step, the labels or the stand-off."""
    rows = list(experiments())
    assert len({(row.table, row.variant) for row in rows}) == len(rows)
    told = {row.key: replace(row, table="", variant="", paper_says=None, methods=()) for row in rows}
    assert all(told[row.key] == replace(row, table="", variant="", paper_says=None, methods=()) for row in rows)
    assert Experiment("t", "v", "paper-normal").key == (
        "paper-normal, range 20 mm, IMU noisy, poses estimated, sweep upsampled"
    )


def test_the_stand_off_is_the_distance_from_the_corner() -> None:
    """Of the lidar's rig while it stands still. Mutation: the shift along the floor alone."""
    near, far = (_scenario(Experiment("t", "v", "paper-normal", stand_off_m=m)) for m in (None, 3.6))
    at = [scenario.motion.kinematics(np.zeros(1)).p_m[0] for scenario in (near, far)]
    assert np.linalg.norm(at[0]) == pytest.approx(1.92, abs=0.01)
    assert np.linalg.norm(at[1]) == pytest.approx(3.6)
    np.testing.assert_allclose(np.cross(*at), 0.0, atol=1e-12)


def test_a_mean_has_its_standard_error_and_exact_recordings_are_one() -> None:
    """Mutations: the runs' own scatter for the mean's; ten copies of one recording for ten."""
    runs = [Outcome("e", "paper", seed, 0.1 * seed, 1e-3 * seed, -0.5, 100, 1.0) for seed in (1, 2, 3, 4)]
    mean = _mean([*runs, Outcome("e", "paper", 5, np.nan, np.nan, 0.0, 0, 1.0)])
    assert mean is not None
    assert mean.runs == 4
    assert mean.e_R_deg == pytest.approx(0.25)
    assert mean.e_R_error_deg == pytest.approx(np.std([0.1, 0.2, 0.3, 0.4], ddof=1) / 2.0)
    assert mean.e_dt_ms == pytest.approx(0.5)
    one = _mean([replace(runs[0], seed=seed) for seed in (1, 2, 3)], is_one=True)
    assert one is not None
    assert one.runs == 1
    assert np.isnan(one.e_p_error_m)


def test_the_report_has_every_row_and_what_is_left_open(tmp_path) -> None:  # type: ignore[no-untyped-def]
    """Mutation: copies of one recording told with a standard error."""
    rows = list(experiments())
    runs = [
        Outcome(row.key, method, seed, 0.01 * seed, 1e-3 * seed, 0.1, 100, 1.0)
        for row in {row.key: row for row in rows}.values()
        for method in ("paper", "full")
        for seed in (1, 2)
    ]
    write_report(rows, runs, tmp_path)
    text = (tmp_path / "paper.md").read_text(encoding="utf-8")
    for row in rows:
        assert f"| {row.variant} | " in text
    assert "| normal motion, poses estimated too | full | 1.5 | 0.015 | " in text  # one recording: no standard error
    assert "| 1.5 ± 0.5 | 0.015 ± 0.005 |" in text
    assert "MLESAC" in text
    assert (tmp_path / "paper_figure7.png").stat().st_size > 5000
