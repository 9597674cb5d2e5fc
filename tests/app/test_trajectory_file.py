"""Files that are whole or absent; of them a result's motion: what is written is what is read, older files too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.arrays.trajectory import read_trajectory, write_trajectory
from app.storage.atomic import whole_file
from tests.app.support import world


def test_how_late_scans_were_stamped_is_kept(tmp_path: Path) -> None:
    """Without it a map made from a kept result lays stalled scans at their stamps. Mutation: left out of the file."""
    motion = replace(world.make_trajectory(), late_ns={1_700_000_004_244_208_149: 20_000_000, 7: -3})
    write_trajectory(tmp_path / "motion.npz", motion)
    again = read_trajectory(tmp_path / "motion.npz")
    assert again.late_ns == motion.late_ns
    np.testing.assert_array_equal(again.times_s, motion.times_s)


def test_a_file_that_was_written_before_there_were_such_scans_has_none(tmp_path: Path) -> None:
    """Mutation: asked for without looking whether it is there."""
    path = tmp_path / "motion.npz"
    write_trajectory(path, world.make_trajectory())
    with np.load(path) as arrays:
        older = {name: arrays[name] for name in arrays.files if name != "late_ns"}
    np.savez(path, **older)
    assert read_trajectory(path).late_ns == {}


def test_a_file_whose_writing_fails_leaves_the_one_before_and_nothing_beside_it(tmp_path: Path) -> None:
    """Mutations: written under its own name; what was begun is left behind; the folder not made."""
    path = tmp_path / "job" / "report.json"
    with whole_file(path) as fresh:
        fresh.write_text("whole", encoding="utf-8")

    def write_half() -> None:
        with whole_file(path) as fresh:
            fresh.write_text("half", encoding="utf-8")
            raise OSError("no room")

    with pytest.raises(OSError, match="no room"):
        write_half()
    assert [file.name for file in path.parent.iterdir()] == ["report.json"]
    assert path.read_text(encoding="utf-8") == "whole"
