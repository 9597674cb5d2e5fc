"""A few rounds of what `python -m bench.kills` does by the hundred: servers and workers killed at seeded moments."""

from __future__ import annotations

import pytest

from app.arrays.trajectory import write_trajectory
from bench import kills
from tests.app.support import world

WAYS = (("server killed", "writing"), ("worker killed", "solving"))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A recording, and the answer that its solves give."""
    (tmp_path / "room.bag").write_bytes(bytes(range(256)) * 4096)
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "result.json").write_text(world.make_result().to_json(), encoding="utf-8")
    write_trajectory(kept / "trajectory.npz", world.make_trajectory())
    monkeypatch.setenv(kills.KEPT, str(kept))
    return tmp_path


def test_killed_and_starved_jobs_show_nothing_half_made(folder):
    """Oracle: the bytes that were sent, the answer that was kept, and which answers a state allows.

    Mutations: a process that ended without a word taken for one that is done; a start that leaves running what ran before.
    """
    seen, tally = kills.run(WAYS, seed=5, folder=folder, entry="tests.app.support.kill_jobs:run", hurry=0.3)
    assert seen.wrong == []
    assert sum(seen.ways.values()) == len(WAYS)
    assert seen.checked_results >= 1
    assert len(tally.starts_s) == 2  # the first server, and one after it was killed
