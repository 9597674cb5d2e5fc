"""A second solve goes on from the motion that the first has told, and gives the numbers of one from scratch."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib_core.calibrate import Calibration, calibrate
from calib_core.full import attempts
from calib_core.full.initialise.start import LidarTrack
from calib_core.full.joint.estimation import COUNTING, Estimation, MapPlane
from calib_core.full.joint.kept_motion import KeptMotion, called_as
from calib_core.full.odometry.reference import Followed
from calib_core.full.odometry.reference_cloud import propose_planes
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import InitialGuess, Plane, Recording
from tests.core.full.joint.conftest import Half

PLANES = [Plane("wall 1", np.array([1.0, 0.0, 0.0]), 2.0), Plane("floor", np.array([0.0, 0.0, 1.0]), 1.5)]
TRACK = LidarTrack(*(np.full(shape, 0.5) for shape in ((4,), (4,), (4, 3, 3), (4, 3), (4, 3), (4, 3), (4, 3, 3))))


def _of(half: Half, folder: Path | None, **changes: Any) -> KeptMotion:
    given: dict[str, Any] = {
        "track_key": "a track",
        "run": half.data.run,
        "followed": Followed(3, PLANES, []),
        "lidar": TRACK,
        "guess": None,
    }
    return KeptMotion.of(folder, **given | changes)


def _hearing(half: Half, kept: KeptMotion) -> tuple[list[str], Callable[[], Estimation | None]]:
    """What is said to a run, and how it asks for what is kept."""
    said: list[str] = []
    run = replace(half.data.run, on_event=lambda event: said.append(getattr(event, "text", "")))
    return said, lambda: kept.recall(run)


def test_what_was_told_once_is_recalled_to_the_last_bit(half: Half, tmp_path: Path) -> None:
    """The state before the planes count, and what was said until then. Mutations: the state before another step; said nothing;
    what was said afterwards, too; who listens before forgotten.
    """
    kept = _of(half, tmp_path / "not yet")
    said, recall = _hearing(half, kept)
    assert recall() is None
    told: list[str] = []
    run = replace(half.data.run, on_event=lambda event: told.append(getattr(event, "text", "")))
    steps: list[str] = []
    data = kept.keeping(replace(half.data, run=run, on_state=lambda name, _: steps.append(name)))
    shifted = replace(half.state.estimate, time_offset_s=0.25)
    data.on_state("coarse", replace(half.state, estimate=shifted))
    data.run.say("info", "a", "on the way")
    data.on_state(COUNTING, half.state)
    data.run.say("info", "b", "afterwards")
    data.on_state("settle", replace(half.state, estimate=shifted))
    assert steps == ["coarse", COUNTING, "settle"]
    assert told == ["on the way", "afterwards"]
    state = recall()
    assert state is not None
    assert said == ["on the way"]
    e, there = half.state.estimate, state.estimate
    for name in ("R_imu_lidar", "p_imu_lidar", "gravity", "gyro_bias", "normals", "offsets_m"):
        np.testing.assert_array_equal(getattr(there, name), getattr(e, name))
    for name in ("R", "p", "v"):
        np.testing.assert_array_equal(getattr(there.states, name), getattr(e.states, name))
    assert there.time_offset_s == e.time_offset_s
    assert state.planes == half.state.planes
    assert (state.rounds, state.iterations) == (half.state.rounds, half.state.iterations)
    assert state.observations is None


def test_nothing_is_recalled_of_what_has_changed_or_is_spoilt(half: Half, tmp_path: Path) -> None:
    """Settings, but for those that come later; names and places of planes; the track; the guess. Mutations: each left out of the
    key; a file that is cut ends the solve.
    """
    kept = _of(half, tmp_path)
    kept.keeping(half.data).on_state(COUNTING, half.state)

    def found(**changes: Any) -> bool:
        run = half.data.run
        if "settings" in changes:
            run = replace(run, settings=run.settings.model_copy(update=changes.pop("settings")))
        return _of(half, tmp_path, run=run, **changes).recall(run) is not None

    assert found()
    assert found(settings={"crispness": False})
    assert found(settings={"estimate_planes": False})
    assert not found(settings={"bias_model": "constant"})
    assert not found(settings={"intrinsics": "off"})
    assert not found(track_key="another")
    assert not found(followed=Followed(4, PLANES, []))
    assert not found(followed=Followed(3, PLANES, [], late=(False, True)))
    assert not found(followed=Followed(3, [replace(PLANES[0], name="door"), PLANES[1]], []))
    assert not found(followed=Followed(3, [replace(PLANES[0], offset_m=2.1), PLANES[1]], []))
    assert not found(lidar=replace(TRACK, p=TRACK.p + 1e-9))
    assert not found(guess=InitialGuess(time_offset_ns=5))
    assert _of(half, None).recall(half.data.run) is None
    assert _of(half, None).keeping(half.data) is half.data
    assert kept.path is not None
    whole = kept.path.read_bytes()
    for spoilt in (whole[: len(whole) // 2], b"", b"no archive at all"):
        kept.path.write_bytes(spoilt)
        assert not found()


def test_planes_are_called_as_the_person_calls_them(half: Half) -> None:
    """And those that came into view on the way as if they had come beside them.

    Mutations: the names of before; two of one name.
    """
    e = half.state.estimate
    up = np.array([0.0, 0.0, 1.0])
    normals = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    names = ("wall 1", "floor", "wall 2", "wall 3")
    planes = tuple(MapPlane(name, late=k > 1) for k, name in enumerate(names))
    state = replace(half.state, estimate=replace(e, normals=normals, offsets_m=np.full(4, 2.0)), planes=planes)
    mine = [replace(PLANES[0], name="wall 2"), replace(PLANES[1], name="the ground")]
    called = called_as(state, mine, up)
    assert [plane.name for plane in called.planes] == ["wall 2", "the ground", "wall", "wall 3"]
    assert [plane.late for plane in called.planes] == [False, False, True, True]


def _document(calibration: Calibration) -> dict[str, Any]:
    """All but the time it took."""
    document: dict[str, Any] = json.loads(calibration.result.to_json())
    document["quality"].pop("duration_s")
    return document


def test_a_second_solve_is_the_one_from_scratch_to_the_last_digit(
    noisy: tuple[Recording, Truth], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever came first. Mutations: rounds counted anew; the motion told anew; planes' names forgotten."""
    recording, settings = noisy[0], CalibrateSettings(intrinsics="off", crispness=False)
    proposed = [patch.plane for patch in propose_planes(recording, settings).patches]
    choice = proposed[1:]
    alone = calibrate(recording, settings, planes=choice)
    for name, before in (("untouched", None), ("another choice", proposed[:-1])):
        calibrate(recording, settings, planes=before, cache_dir=tmp_path / name)

    def again(*_: object) -> None:
        raise AssertionError("the motion was told once more")

    monkeypatch.setattr(attempts, "motion_by_all", again)
    for name in ("untouched", "another choice"):
        second = calibrate(recording, settings, planes=choice, cache_dir=tmp_path / name)
        assert _document(second) == _document(alone)
