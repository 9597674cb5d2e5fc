"""The command line as a person uses it: recordings on disk, answers held against the truth. Each command is a process of its own
once; where another of its ends is looked at, it runs in this one, which has loaded already what a process takes seconds to load.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from app.cli import main as cli
from calib_core import api
from calib_core.result import CalibrationResult
from calib_core.simulate import TruthFile

STORE = get_typestore(Stores.ROS1_NOETIC)
ENVIRONMENT = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(Path(__file__).resolve().parents[2])}


def unsweep(*words: object) -> subprocess.CompletedProcess[str]:
    """The command, run to its end."""
    command = [sys.executable, "-m", "app.cli", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=ENVIRONMENT)


Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def here(capsys: pytest.CaptureFixture[str]) -> Run:
    """The same in this process."""

    def run(*words: object) -> subprocess.CompletedProcess[str]:
        capsys.readouterr()
        command = [str(word) for word in words]
        code = cli.run(command)
        return subprocess.CompletedProcess(command, code, *capsys.readouterr())

    return run


def write_bag(path: Path, *, imu: int = 0, clouds: int = 0, fields: tuple[str, ...] = ("x", "y", "z", "time")) -> Path:
    """A ROS 1 bag with so many IMU messages and clouds of float32 fields, written by rosbags."""
    T = STORE.types
    with Writer(path) as writer:

        def header(t_ns: int) -> object:
            stamp = T["builtin_interfaces/msg/Time"](sec=t_ns // 10**9, nanosec=t_ns % 10**9)
            return T["std_msgs/msg/Header"](seq=0, stamp=stamp, frame_id="sensor")

        def write(topic: str, kind: str, t_ns: int, message: object) -> None:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], t_ns, STORE.serialize_ros1(message, kind))

        connections: dict[str, object] = {}
        vector, nine = T["geometry_msgs/msg/Vector3"], np.zeros(9)
        for k in range(imu):
            t_ns, still = 10**18 + k * 10**7, T["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
            rates, gravity = vector(x=0.0, y=0.0, z=0.0), vector(x=0.0, y=0.0, z=9.81)
            message = T["sensor_msgs/msg/Imu"](header(t_ns), still, nine, rates, nine, gravity, nine)
            write("/imu", "sensor_msgs/msg/Imu", t_ns, message)
        for k in range(clouds):
            t_ns, width = 10**18 + k * 10**8, 400
            data = np.random.default_rng(k).uniform(1.0, 5.0, (width, len(fields))).astype("<f4")
            if "time" in fields:
                data[:, fields.index("time")] = np.linspace(0, 0.0999, width)
            described = [
                T["sensor_msgs/msg/PointField"](name=name, offset=4 * i, datatype=7, count=1)
                for i, name in enumerate(fields)
            ]
            step = 4 * len(fields)
            message = T["sensor_msgs/msg/PointCloud2"](
                header(t_ns), 1, width, described, False, step, step * width, data.view(np.uint8).ravel(), True
            )
            write("/points", "sensor_msgs/msg/PointCloud2", t_ns, message)
    return path


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's simulated recording, seed 1, as the README's command writes it."""
    path = tmp_path_factory.mktemp("room") / "room.bag"
    done = unsweep("simulate", "paper-normal", "--seed", 1, path)
    assert done.returncode == 0, done.stderr
    return path


@pytest.fixture(scope="module")
def answer(room: Path) -> Path:
    """What `calibrate` writes without an option."""
    out = room.with_name("result.json")
    done = unsweep("calibrate", room, "--output", out)
    assert done.returncode == 0, done.stderr
    return out


def test_the_whole_path_without_an_option(room: Path, answer: Path, here: Run) -> None:
    """As near to the truth as the document says it is (one in ten thousand is not), which is 0.05 deg, 3 mm and 0.2 ms. Fails
    if a direction or a sign is turned anywhere between the bag and the document.
    """
    out = answer
    result = CalibrationResult.model_validate_json(out.read_text())
    truth = TruthFile.model_validate_json(room.with_suffix(".truth.json").read_text())
    assert result.status == "calibrated"
    assert result.T_imu_lidar is not None
    assert result.time_offset_s is not None
    T, T_true = np.array(result.T_imu_lidar.matrix), np.array(truth.T_imu_lidar.matrix)
    turn_rad = Rotation.from_matrix(T_true[:3, :3].T @ T[:3, :3]).as_rotvec()
    error = np.concatenate([turn_rad, T[:3, 3] - T_true[:3, 3], [result.time_offset_s - truth.time_offset_s]])
    assert result.uncertainty is not None
    covariance = np.array(result.uncertainty.covariance)
    assert error @ np.linalg.solve(covariance, error) < chi2.ppf(0.9999, 7)
    assert (np.sqrt(np.diag(covariance)) < [*3 * [np.radians(0.05)], *3 * [0.003], 0.0002]).all()
    for name in api.export_names():
        assert here("export", out, "--format", name).returncode == 0


def test_inspect_reports_in_words_and_as_json(room: Path, here: Run) -> None:
    """Fails if the two reports differ in their verdict, or JSON shares stdout with anything."""
    words, document = here("inspect", room, "--quiet"), unsweep("inspect", room, "--json")
    assert (words.returncode, document.returncode) == (0, 0)
    assert json.loads(document.stdout)["verdict"] == "good"
    assert "Good: this recording can be calibrated." in words.stdout
    assert words.stderr == ""


def test_interrupt_writes_nothing(room: Path, tmp_path: Path) -> None:
    """Ctrl-C in mid-work: 130, one sentence, no file. Fails if a traceback is shown or a part of the result is left."""
    out = tmp_path / "result.json"
    command = [sys.executable, "-m", "app.cli", "calibrate", str(room), "--output", str(out), "--log-json"]
    # A shell that runs the tests in the background has its children ignore Ctrl-C; this one is to hear it.
    heard = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT, preexec_fn=heard) as process:  # noqa: PLW1509
        assert process.stderr is not None
        while "planes" not in process.stderr.readline():
            assert process.poll() is None
        process.send_signal(signal.SIGINT)
        rest = process.stderr.read()
        assert process.wait(timeout=30) == 130
    last = json.loads(rest.splitlines()[-1])
    assert (last["event"], last["code"]) == ("error", "interrupted")
    assert "Traceback" not in rest
    assert list(tmp_path.iterdir()) == []


def unusable(kind: str, folder: Path) -> Path:
    """A recording that cannot be calibrated, in one of the ways of the contract."""
    path = folder / f"{kind}.bag"
    match kind:
        case "missing":
            pass
        case "empty":
            path.touch()
        case "text":
            path.write_text("no bag at all\n" * 100)
        case "no-lidar":
            write_bag(path, imu=300)
        case "no-imu":
            write_bag(path, clouds=60)
        case "no-point-time":
            write_bag(path, imu=600, clouds=60, fields=("x", "y", "z", "intensity"))
        case _:
            raise ValueError(kind)
    return path


@pytest.mark.parametrize(
    ("kind", "word", "opens"),
    [
        ("missing", "missing.bag", False),
        ("empty", "empty", False),
        ("text", "text.bag", False),
        ("no-lidar", "lidar", True),
        ("no-imu", "IMU", True),
        ("no-point-time", "time", True),
    ],
)
def test_what_cannot_be_calibrated_is_one_sentence(
    kind: str, word: str, opens: bool, tmp_path: Path, here: Run
) -> None:
    """`calibrate` exits 2 with a sentence that names the trouble; `inspect` exits 0 for whatever opens. Fails if any
    ends in a traceback, another code, or an answer."""
    path = unusable(kind, tmp_path)
    done = here("calibrate", path, "--quiet")
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert word in done.stderr
    looked = here("inspect", path, "--json", "--quiet")
    assert looked.returncode == (0 if opens else 2), looked.stderr
    if opens:
        assert json.loads(looked.stdout)["verdict"] == "unusable"


def test_standing_still_is_refused_with_its_result(tmp_path: Path, here: Run) -> None:
    """Exit 3, the reason last, the document written all the same. Fails if standing still gives numbers."""
    bag, out = tmp_path / "static.bag", tmp_path / "result.json"
    assert here("simulate", "static", bag, "--duration-s", 6).returncode == 0
    done = unsweep("calibrate", bag, "--output", out, "--quiet")
    assert done.returncode == 3
    assert len(done.stderr.splitlines()) == 1
    result = json.loads(out.read_text())
    assert (result["status"], result["T_imu_lidar"], result["time_offset_s"], result["uncertainty"]) == (
        "refused",
        *[None] * 3,
    )
    refused = unsweep("export", out, "--format", "tum")
    assert (refused.returncode, refused.stdout) == (2, "")


def test_deskew_keeps_every_scan(room: Path, answer: Path, tmp_path: Path, here: Run) -> None:
    """One file for each scan, all points in it. Fails if scans at the ends, or points without motion, are dropped."""
    out = tmp_path / "deskewed"
    done = unsweep("deskew", room, "--calibration", answer, "--output", out, "--quiet", "--end-s", 8)
    assert done.returncode == 0, done.stderr
    files = sorted(out.iterdir())
    assert [file.name for file in files] == [f"{k:06d}.ply" for k in range(len(files))]
    assert len(files) >= 75
    assert b"element vertex 29184" in files[0].read_bytes()[:400]
    again = here("deskew", room, "--calibration", answer, "--output", out, "--quiet")
    assert again.returncode == 2
    assert "exists already" in again.stderr
