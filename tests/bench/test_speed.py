"""The page of `python -m bench.speed`, and one turn of it on a short recording."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.speed import Turn, report, timed
from calib_core import api


def test_the_quickest_turn_counts_and_a_broken_limit_is_said() -> None:
    """Fails when the first turn is shown, or a limit that is broken is called held."""
    slow = Turn(41.0, 50.0, 2100.0, (("read", 1.0), ("solve", 20.0)))
    quick = Turn(29.0, 45.0, 2200.0, (("read", 0.9), ("solve", 15.0)))
    page = report([slow, quick], 384.0, 0.1)
    assert "| wall clock | 29.0 s | <= 30 s | yes |" in page
    assert "| memory | 2200 MB | <= 2000 MB | **no** |" in page
    assert "| solve | 15.0 s |" in page
    assert "41.0 s, 29.0 s" in page


@pytest.mark.slow
def test_a_turn_is_a_whole_run_of_the_command_line(tmp_path: Path) -> None:
    """Fails when a refused recording is timed as if it were solved, or the process's own memory is not what is told."""
    bag = tmp_path / "room.bag"
    api.simulate("paper-normal", bag, seed=0, duration_s=8.0)
    turn = timed(bag, tmp_path / "result.json")
    assert (tmp_path / "result.json").is_file()
    assert [name for name, _ in turn.stages][:2] == ["read", "planes"]
    assert 0.0 < turn.stages[0][1] < turn.stages[-1][1] < turn.wall_s
    assert turn.memory_mb > 100.0
    still = tmp_path / "still.bag"
    api.simulate("static", still, seed=0, duration_s=4.0)
    with pytest.raises(SystemExit, match="exit code"):
        timed(still, tmp_path / "none.json")
