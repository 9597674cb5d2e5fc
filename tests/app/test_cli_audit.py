"""`unsweep audit`: exit codes for scripts, the report on stdout, one sentence where it did not pass."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from app.cli.main import run
from calib_core import api
from calib_core.audit.limits import Limits
from calib_core.audit.pose import GivenExtrinsic
from calib_core.audit.run import report_of
from calib_core.calibrate import Calibration
from calib_core.types import ImuData, LidarInfo, Recording
from tests.core.exporters.results import make_result

R, P = np.eye(3), np.array([0.1, 0.2, 0.3])
URDF_JOINT = '<joint type="fixed"><parent link="imu_link"/><child link="velodyne"/><origin xyz="0.1 0.2 0.3"/></joint>'


@pytest.fixture
def audits(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[GivenExtrinsic]:
    """The solve answered by hand; what was asked to be audited. A time offset of 77 ms means a refused recording."""
    asked: list[GivenExtrinsic] = []
    empty = ImuData(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)), frame_id="imu_link")
    recording = Recording(name="room.bag", imu=empty, scans=(), lidar=LidarInfo(frame_id="velodyne"))
    monkeypatch.setattr(api, "load", lambda *_, **__: recording)
    monkeypatch.setattr(api, "get_ready", lambda: None)

    def audit(_: Recording, given: GivenExtrinsic, *, limits: Limits | None = None, **__: object) -> object:
        asked.append(given)
        refused = given.time_offset_ns == 77_000_000
        found = make_result(R, P, 0, status="refused" if refused else "calibrated")
        return report_of(given, Calibration(found, None), limits or Limits())

    monkeypatch.setattr(api, "audit", audit)
    return asked


def extrinsic(folder: Path, x_m: float = 0.1, offset_s: float = 0.0) -> Path:
    path = folder / "ours.json"
    rows = [*np.c_[R, [x_m, 0.2, 0.3]].tolist(), [0, 0, 0, 1]]
    path.write_text(json.dumps({"T_imu_lidar": {"matrix": rows}, "time_offset_s": offset_s}))
    return path


@pytest.mark.parametrize(("x_m", "offset_s", "code"), [(0.1, 0.0, 0), (0.13, 0.0, 1), (0.1, 0.077, 3)])
def test_the_exit_code_is_the_verdict(
    audits: list[GivenExtrinsic],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    x_m: float,
    offset_s: float,
    code: int,
) -> None:
    """Mutations: exit 0 whatever the verdict; the JSON left out where it failed; the sentence on stdout."""
    words = ["audit", "room.bag", "--extrinsic", str(extrinsic(tmp_path, x_m, offset_s)), "--quiet"]
    assert run([*words, "--json"]) == code
    told = capsys.readouterr()
    report = json.loads(told.out)
    assert report["schema"] == "unsweep.audit/1"
    assert report["verdict"] == {0: "passed", 1: "failed", 3: "unknown"}[code]
    assert len(told.err.splitlines()) == (code != 0)
    assert run(words) == code
    shown = capsys.readouterr().out
    assert report["text"][:40] in shown
    assert "JSON of unsweep" in shown


def test_limits_and_direction_are_asked_for(audits: list[GivenExtrinsic], tmp_path: Path) -> None:
    """Mutations: the limits' file not read; a bare matrix's direction ignored."""
    limits = tmp_path / "limits.json"
    limits.write_text('{"translation_mm": 50}')
    words = ["audit", "room.bag", "--extrinsic", str(extrinsic(tmp_path, 0.13)), "--quiet"]
    assert run([*words, "--limits", str(limits)]) == 0
    matrix = tmp_path / "T.txt"
    matrix.write_text("1 0 0 -0.1\n0 1 0 -0.2\n0 0 1 -0.3\n0 0 0 1\n")
    assert run(["audit", "room.bag", "--extrinsic", str(matrix), "--quiet"]) == 1
    assert run(["audit", "room.bag", "--extrinsic", str(matrix), "--quiet", "--matrix-direction", "lidar_imu"]) == 0


def test_a_urdf_is_read_with_the_recordings_frames(audits: list[GivenExtrinsic], tmp_path: Path) -> None:
    """Two lidars in the URDF. Mutation: frames not handed on."""
    joint = '<joint name="{0}" type="fixed"><parent link="imu_link"/><child link="{0}"/><origin xyz="{1}"/></joint>'
    path = tmp_path / "rig.urdf"
    joints = joint.format("velodyne", "0.1 0.2 0.3") + joint.format("velodyne_rear", "9 9 9")
    path.write_text(f'<robot name="r">{joints}</robot>')
    assert run(["audit", "room.bag", "--extrinsic", str(path), "--quiet"]) == 0
    np.testing.assert_allclose(audits[-1].T_imu_lidar[:3, 3], P)


@pytest.mark.parametrize("name", ["rig.urdf", "rig.txt", "rig", "rig.xacro.out"])
def test_a_urdf_is_one_whatever_its_name(audits: list[GivenExtrinsic], tmp_path: Path, name: str) -> None:
    """Of another name it was read without the recording's frames: another link whose name had the words was taken, in silence.

    Mutation: frames by the file's suffix.
    """
    joint = '<joint name="{0}" type="fixed"><parent link="base"/><child link="{0}"/><origin xyz="{1}"/></joint>'
    joints = joint.format("imu_link", "0 0 0") + joint.format("velodyne", "0.1 0.2 0.3") + joint.format("scan", "9 9 9")
    (tmp_path / name).write_text(f'\ufeff<?xml version="1.0"?>\n<robot name="r">{joints}</robot>')
    assert run(["audit", "room.bag", "--extrinsic", str(tmp_path / name), "--quiet"]) == 0
    np.testing.assert_allclose(audits[-1].T_imu_lidar[:3, 3], P)


def test_an_extrinsic_may_come_through_a_pipe(audits: list[GivenExtrinsic], tmp_path: Path) -> None:
    """As of a shell's <(...), which gives its bytes once. Mutation: the file is read a second time with the frames."""
    reads, writes = os.pipe()
    os.write(writes, f"<robot>{URDF_JOINT}</robot>".encode())
    os.close(writes)
    assert run(["audit", "room.bag", "--extrinsic", f"/dev/fd/{reads}", "--quiet"]) == 0
    os.close(reads)
    np.testing.assert_allclose(audits[-1].T_imu_lidar[:3, 3], P)


@pytest.mark.parametrize("words", [["--extrinsic", "none.json"], ["--extrinsic", "none.urdf"], []])
def test_a_call_at_fault_is_one_sentence(
    audits: list[GivenExtrinsic], capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    """Mutation: the recording read before the extrinsic's file is looked at."""
    assert run(["audit", "room.bag", *words]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert audits == []


def test_each_axis_has_one_line_of_80_columns(
    audits: list[GivenExtrinsic],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Seen: "translation / along the / IMU's x", three lines an axis. Mutation: the axes in the words of a sentence."""
    monkeypatch.setenv("COLUMNS", "80")
    assert run(["audit", "room.bag", "--extrinsic", str(extrinsic(tmp_path, 0.13)), "--quiet"]) == 1
    lines = capsys.readouterr().out.splitlines()
    rows = [line for line in lines if " passed " in line or " failed " in line]
    assert [" ".join(row.split()[1:3]) for row in rows] == [
        *(f"rotation {axis}" for axis in "xyz"),
        *(f"translation {axis}" for axis in "xyz"),
        "time offset",
    ]
    assert lines.index(rows[-1]) - lines.index(rows[0]) == 6
    assert any("about the lidar's axes, translation along the IMU's" in line for line in lines)
