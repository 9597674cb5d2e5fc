"""A second solve takes the lidar's motion from the first where nothing that it depends on has changed."""

from __future__ import annotations

import errno
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest

from calib_core.events import Event, LogEvent, StageEvent, ignore_event, never_cancel
from calib_core.full.initialise import kept_track
from calib_core.full.initialise.kept_track import follow_or_recall
from calib_core.full.odometry.reference import Followed
from calib_core.full.odometry.register import ScanMotion
from calib_core.full.prepare.prepare import prepare
from calib_core.full.run import Run
from calib_core.settings import CalibrateSettings, Prior
from calib_core.simulate import Truth
from calib_core.types import Plane, PlanePatch, PlaneProposals, Recording

WALL, FLOOR = Plane("wall", np.array([1.0, 0.0, 0.0]), 2.0), Plane("floor", np.array([0.0, 0.0, 1.0]), 1.5)
DOOR = Plane("door", np.array([0.0, 1.0, 0.0]), 4.0)


@dataclass
class Following:
    """Stands for the way to a track. times: how often it was gone.   leaves: whether it ends at another reference scan."""

    leaves: bool = False
    times: int = 0
    heard: list[Event] = field(default_factory=list)

    def propose(self, *_: object, **__: object) -> PlaneProposals:
        patches = tuple(PlanePatch(plane, np.zeros((0, 3)), 0.0, 9, True) for plane in (WALL, FLOOR))
        none = np.zeros(0, np.int16)
        return PlaneProposals(patches, np.zeros((0, 3), np.float32), none, np.zeros(0, np.float32), (3,), False)

    def begin(self, run: Run, given: Sequence[Plane] | None, _: PlaneProposals) -> Followed:
        self.times += 1
        run.say("info", "track.aided", "the gyroscope helped")
        rng = np.random.default_rng(self.times)
        motions = [
            ScanMotion(
                k, *(rng.normal(size=s) for s in ((3, 3), 3, 3, 3)), *rng.random(4), unseen=rng.normal(size=(3, 3))
            )
            for k in (3, 4)
        ]
        planes, proposals = [WALL, FLOOR, *(given or [])], (WALL, FLOOR)
        if self.leaves:
            return Followed(7, planes, motions, away=True)
        return Followed(3, planes, motions, proposals=proposals, of_proposal=(0, 1, *(-1 for _ in given or [])))


@pytest.fixture
def following(monkeypatch: pytest.MonkeyPatch) -> Following:
    made = Following()
    monkeypatch.setattr(kept_track, "propose_planes", made.propose)
    monkeypatch.setattr(kept_track, "begin", made.begin)
    return made


@pytest.fixture
def run(clean: tuple[Recording, Truth], following: Following) -> Run:
    return prepare(clean[0], CalibrateSettings(), following.heard.append, never_cancel)


def test_what_was_followed_once_is_recalled_to_the_last_bit(run: Run, following: Following, tmp_path: Path) -> None:
    """Sentences too, which are part of the result, and that nothing had to be done.

    Mutations: what was said forgotten; rates and velocities exchanged; the stage left out, or told of what was followed.
    """
    first, second = (follow_or_recall(run, None, tmp_path) for _ in range(2))
    assert following.times == 1
    assert [event.code for event in following.heard if isinstance(event, LogEvent)].count("track.aided") == 2
    stages = [event for event in following.heard if isinstance(event, StageEvent) and event.stage == "track"]
    assert [(event.fraction, event.kept) for event in stages] == [(1.0, True)]
    assert second.reference == first.reference
    assert [plane.name for plane in second.planes] == ["wall", "floor"]
    for one, other in zip(first.motions, second.motions, strict=True):
        for name in ("R", "p", "omega_rad_s", "v_m_s", "position", "share", "rms_m", "std_rad", "std_m", "unseen"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize(
    ("given", "times"), [([WALL], 1), ([replace(FLOOR, name="mine")], 1), ([], 1), ([WALL, DOOR], 2)]
)
def test_a_choice_of_the_planes_found_follows_nothing_anew(
    run: Run, following: Following, tmp_path: Path, given: list[Plane], times: int
) -> None:
    """A plane that nobody found does: it is followed too. Mutation: extra planes not compared."""
    follow_or_recall(run, None, tmp_path)
    follow_or_recall(run, given, tmp_path)
    assert following.times == times


def test_a_track_that_began_elsewhere_is_not_recalled(run: Run, following: Following, tmp_path: Path) -> None:
    """Planes of the first scan may have told it to begin there. Mutations: where it began not written; not compared."""
    follow_or_recall(run, [WALL], tmp_path, 0)
    follow_or_recall(run, [WALL], tmp_path, 0)
    assert following.times == 1
    follow_or_recall(run, [WALL], tmp_path)
    assert following.times == 2


def test_a_map_of_another_scan_is_not_that_of_a_choice(run: Run, following: Following, tmp_path: Path) -> None:
    """Nor is an untouched suggestion one. Mutations: `left` not looked at; all that is given a choice."""
    following.leaves = True
    follow_or_recall(run, None, tmp_path)
    follow_or_recall(run, [replace(plane, suggested=True) for plane in (WALL, FLOOR)], tmp_path)
    assert following.times == 1
    follow_or_recall(run, [WALL], tmp_path)
    assert following.times == 2


def test_only_what_comes_after_may_have_changed(run: Run, following: Following, tmp_path: Path) -> None:
    """Mutations: the readings or the settings left out of the key; a damaged file taken for an error."""
    follow_or_recall(run, None, tmp_path)
    later = CalibrateSettings(intrinsics="off", max_rounds=9, priors=(Prior(axis="tx", value=0.0, std=1.0),))
    follow_or_recall(replace(run, settings=later), None, tmp_path)
    assert following.times == 1
    other = replace(run, settings=CalibrateSettings(random_seed=1))
    follow_or_recall(other, None, tmp_path)
    assert following.times == 2
    shorter = replace(other, clocks=replace(run.clocks, scan_s=run.clocks.scan_s[:-1]))
    follow_or_recall(shorter, None, tmp_path)
    follow_or_recall(shorter, None, tmp_path)
    assert following.times == 3
    for times, torn in ((4, b"PK\x03\x04 torn"), (5, b"")):
        (tmp_path / "track.npz").write_bytes(torn)
        follow_or_recall(shorter, None, tmp_path)
        assert following.times == times
        follow_or_recall(shorter, None, tmp_path)
        assert following.times == times


def test_a_full_disk_takes_no_solve_away(
    run: Run, following: Following, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Mutations: what cannot be written raised; half a file left behind."""

    def full(file: BinaryIO, **_: object) -> None:
        file.write(b"half")
        raise OSError(errno.ENOSPC, "no space left")

    monkeypatch.setattr(np, "savez", full)
    assert follow_or_recall(run, None, tmp_path).planes
    assert following.times == 1
    assert not list(tmp_path.iterdir())


def test_without_a_folder_nothing_is_kept(run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Mutation: a folder of its own choice."""
    monkeypatch.chdir(tmp_path)
    moved = Following().begin(run, None, Following().propose())
    monkeypatch.setattr(kept_track, "begin", lambda *_: replace(moved, planes=[WALL]))
    assert follow_or_recall(replace(run, on_event=ignore_event), None, None).planes == [WALL]
    assert list(tmp_path.iterdir()) == []
