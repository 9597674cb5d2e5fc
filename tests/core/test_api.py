"""The library as its README shows it."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from calib_core import api

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
