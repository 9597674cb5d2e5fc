"""The library as its README shows it."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from calib_core import api
from calib_core.result import Intrinsic
from calib_core.types import POINT_DTYPE, ImuData, Recording, Scan, Trajectory
from tests.core.exporters.results import make_result
from tests.core.maps.own_readers import ply_columns

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"


def test_the_readmes_lines_run_as_they_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a folder with a room.bag, on a few seconds of it. Mutations: `load` without `Path(path)`; a name of the README's that
    the library does not have.
    """
    found = re.search(r"## As a library\n+```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert found is not None
    monkeypatch.chdir(tmp_path)
    truth = api.simulate("paper-normal", "room.bag", duration_s=6.0)
    exec(compile(found[1], "README.md", "exec"), {})
    told = capsys.readouterr().out
    translation_m = json.loads(truth.read_text(encoding="utf-8"))["T_imu_lidar"]["translation_m"]
    shown = [float(word) for word in re.findall(r"-?\d+\.\d+", told)][3:12:4]
    assert shown == pytest.approx(translation_m, abs=0.05)


@pytest.mark.parametrize("asked", [False, True])
def test_a_map_is_laid_from_scans_whose_lasers_are_corrected_as_asked(
    asked: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A wall four metres ahead that all lasers see 30 mm too far. Mutation: the map laid from the scans as they came."""
    y, z = (axis.ravel() for axis in np.meshgrid(np.linspace(-1.0, 1.0, 60), np.linspace(-1.0, 1.0, 60)))
    true_m = np.column_stack([np.full(y.size, 4.0), y, z])
    xyz_m = true_m * (1.0 + 0.03 / np.linalg.norm(true_m, axis=1))[:, None]
    points = np.zeros(y.size, POINT_DTYPE)
    points["xyz"] = xyz_m
    scan = Scan(0, 10**9, points)
    times_s = np.array([0.0, 1.0])
    still = Trajectory(10**9, times_s, np.stack([np.eye(3)] * 2), np.zeros((2, 3)), np.ones(2, dtype=bool))
    recording = Recording(
        name="x", imu=ImuData(np.zeros(2, np.int64), np.zeros((2, 3)), np.zeros((2, 3))), scans=(scan,)
    )
    result = make_result(np.eye(3), np.zeros(3))
    rest = {"unit": "m", "std": 1e-3, "prior_std": 1e-2, "state": "estimated", "significant": True}
    result.intrinsics = [Intrinsic.model_validate({"block": "range_offset", "name": "all", "value": 0.03, **rest})]
    monkeypatch.setattr("calib_core.full.known_extrinsic._solved_motion", lambda *_: still)
    monkeypatch.setattr("calib_core.readers.load.load", lambda *_, **__: recording)
    monkeypatch.setattr("calib_core.readers.write.rewrite.rewrite_clouds", lambda *_, **__: 1)
    (tmp_path / "room.bag").touch()
    api.deskew(tmp_path / "room.bag", result, tmp_path / "out", map_out=tmp_path / "map.ply", correct_lasers=asked)
    laid = ply_columns(tmp_path / "map.ply")
    assert len(laid["x"]) > 1000
    off_m = np.array(laid["x"]) - 4.0
    assert np.abs(off_m).max() < 1e-5 if asked else off_m.min() > 0.02


READY = """
import gc, sys, threading
from calib_core import api
import calib_core.readers.load
late = {"numba", "scipy.linalg", "rosbags"} & set(sys.modules)
import calib_core.calibrate
later = set(api._LATER) & set(sys.modules)
before = gc.isenabled()
api.get_ready()
for thread in threading.enumerate():
    if thread is not threading.main_thread():
        thread.join()
print(late or "", later or "", before, gc.isenabled(), set(api._LATER) <= set(sys.modules), gc.get_freeze_count() > 10_000)
"""


def test_reading_begins_before_what_only_solving_needs_is_imported() -> None:
    """Mutations: the loops imported above `readers/scans.py`; one of SciPy's parts imported above `planes/segment.py`; the
    collector off for good; nothing frozen.
    """
    done = subprocess.run([sys.executable, "-c", READY], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True"] * 4
