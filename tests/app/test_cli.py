"""The command line's promises: exit codes, the last line on stderr, what is written and what is not."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from app.cli import commands
from app.cli import main as cli
from app.cli.serving import listen
from calib_core import api
from calib_core.errors import Cancelled, InputError, PointTimeError
from calib_core.events import LogEvent, StageEvent
from calib_core.result import CalibrationResult, Status
from tests.core.exporters.results import make_result


class Library:
    """Stands in for the estimator: remembers what it was asked, gives what it was told to give."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.asked = SimpleNamespace(reading=None, solving=None, planes=None, guess=None)
        self.status: Status = "calibrated"
        self.failure: BaseException | None = None
        monkeypatch.setattr(api, "load", self._load)
        monkeypatch.setattr(api, "calibrate", self._calibrate)

    @property
    def result(self) -> CalibrationResult:
        return make_result(np.eye(3), np.array([0.1, 0.2, 0.3]), 4_000_000, status=self.status)

    def _load(self, path, settings, *, on_event, **_):
        self.asked.reading = settings
        on_event(StageEvent(stage="read", fraction=0.5))
        return "the recording"

    def _calibrate(self, recording, settings, *, planes, initial_guess, on_event, **_):
        assert recording == "the recording"
        self.asked.solving, self.asked.planes, self.asked.guess = settings, planes, initial_guess
        on_event(LogEvent(level="warning", code="x.y", text="A remark."))
        if self.failure is not None:
            raise self.failure
        return SimpleNamespace(result=self.result, trajectory=None)


@pytest.fixture
def library(monkeypatch: pytest.MonkeyPatch) -> Library:
    return Library(monkeypatch)


def last_line(capsys: pytest.CaptureFixture[str]) -> str:
    return capsys.readouterr().err.splitlines()[-1]


def test_calibrated_result_goes_to_stdout(library: Library, capsys: pytest.CaptureFixture[str]) -> None:
    """Fails if anything but the document is on stdout, or the summary is missing on stderr."""
    assert cli.run(["calibrate", "room.bag"]) == 0
    said = capsys.readouterr()
    assert CalibrationResult.model_validate_json(said.out) == library.result
    assert "Calibrated. " in said.err
    assert "100.00" in said.err, "millimetres for people"


def test_output_takes_the_document_and_stdout_the_summary(
    library: Library, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Fails if the document is also printed, or a temporary file is left beside it."""
    out = tmp_path / "result.json"
    assert cli.run(["calibrate", "room.bag", "--output", str(out)]) == 0
    assert json.loads(out.read_text())["T_imu_lidar"]["translation_m"] == [0.1, 0.2, 0.3]
    assert "Calibrated. " in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]


def test_weak_is_success(library: Library, capsys: pytest.CaptureFixture[str]) -> None:
    """Fails if `weak` is taken for a failure."""
    library.status = "weak"
    assert cli.run(["calibrate", "room.bag", "--quiet"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["status"] == "weak"
    assert said.err == ""


def test_refused_writes_its_result_and_exits_3(
    library: Library, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Fails if a refused run leaves no document, or its last line is not the reason."""
    library.status = "refused"
    out = tmp_path / "result.json"
    assert cli.run(["calibrate", "room.bag", "--output", str(out)]) == 3
    assert json.loads(out.read_text())["T_imu_lidar"] is None
    assert last_line(capsys) == "unsweep: The platform never moved; turn it."


def test_input_error_exits_2_with_its_sentence(library: Library, capsys: pytest.CaptureFixture[str]) -> None:
    """Fails if another code is given, or a traceback is shown."""
    library.failure = PointTimeError("The clouds of /points carry no time; record them with it.")
    assert cli.run(["calibrate", "room.bag"]) == 2
    said = capsys.readouterr().err
    assert said.splitlines()[-1] == "unsweep: The clouds of /points carry no time; record them with it."
    assert "Traceback" not in said


def test_defect_exits_4_and_leaves_a_log(
    library: Library, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fails if a traceback reaches the user, or is nowhere to be found."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    library.failure = KeyError("secret")
    assert cli.run(["calibrate", "room.bag"]) == 4
    line = last_line(capsys)
    assert "A defect in unsweep stopped it (KeyError)" in line
    (log,) = tmp_path.glob("unsweep-*.log")
    assert str(log) in line
    assert "Traceback" in log.read_text()


@pytest.mark.parametrize(
    ("failure", "exit_code"),
    [
        (InputError("report.html could not be written; free some space."), 2),
        (KeyError("x"), 4),
        (KeyboardInterrupt(), 130),
    ],
)
def test_a_report_that_fails_leaves_the_result_and_says_where(
    failure: BaseException,
    exit_code: int,
    library: Library,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """On a full disk, on a defect, on Ctrl-C. Mutations: the report before the result; no `_result_kept`; `_with_notes` that
    leaves the notes out; exit 0."""

    def fails(*_: object, **__: object) -> None:
        raise failure

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("app.results.companions.measure_beside", fails)
    out, report = tmp_path / "result.json", tmp_path / "report.html"
    assert cli.run(["calibrate", "room.bag", "--output", str(out), "--report", str(report)]) == exit_code
    assert CalibrationResult.model_validate_json(out.read_text()) == library.result
    assert not report.exists()
    line = last_line(capsys)
    assert f"; there is no report, and the result is in {out}." in line
    assert ".;" not in line


def test_a_reader_of_stdout_that_has_left_still_gets_its_report(
    library: Library, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`unsweep calibrate room.bag --report report.html | head -1`. Mutations: the closed pipe ends the command; where the report
    is is not said."""

    def closed(*_: object) -> None:
        raise BrokenPipeError

    written: list[Path] = []
    monkeypatch.setattr(commands, "_give_result", closed)
    monkeypatch.setattr(commands, "forget_stdout", lambda: None)
    monkeypatch.setattr(commands, "_write_report", lambda *words, **_: written.append(words[-1]))
    assert cli.run(["calibrate", "room.bag", "--report", str(tmp_path / "report.html")]) == 0
    assert written == [tmp_path / "report.html"]
    assert f"Report written to {tmp_path / 'report.html'}\n" in capsys.readouterr().err


@pytest.mark.parametrize("failure", [KeyboardInterrupt(), Cancelled("stopped")])
def test_interrupted_exits_130_and_writes_nothing(library: Library, failure: BaseException, tmp_path: Path) -> None:
    """Fails if an old result is touched or a part of a new one is left."""
    out = tmp_path / "result.json"
    out.write_text("the old one")
    library.failure = failure
    assert cli.run(["calibrate", "room.bag", "--output", str(out)]) == 130
    assert out.read_text() == "the old one"
    assert len(list(tmp_path.iterdir())) == 1


def test_log_json_is_one_object_a_line(library: Library, capsys: pytest.CaptureFixture[str]) -> None:
    """Fails if anything on stderr is not JSON, or the error event is not the last."""
    library.failure = PointTimeError("No time in there.")
    assert cli.run(["calibrate", "room.bag", "--log-json"]) == 2
    events = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert [event["event"] for event in events] == ["stage", "log", "error"]
    assert events[-1] == {"event": "error", "code": "points.no_time", "text": "No time in there."}


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["frobnicate"],
        ["calibrate"],
        ["calibrate", "a.bag", "b.bag"],
        ["calibrate", "a.bag", "--method", "magic"],
        ["calibrate", "a.bag", "--gravity", "moon"],
        ["calibrate", "a.bag", "--lidar", "x"],
        ["calibrate", "a.bag", "--random-seed", "-1"],
        ["calibrate", "a.bag", "--random-seed", str(10**30)],
        ["calibrate", "a.bag", "--prior", "tz=1+-1", "--prior", "tz=1+-1"],
        ["inspect", "a.bag", "--point-time-unit", "h"],
        ["export", "r.json"],
        ["simulate", "paper-normal"],
    ],
)
def test_usage_errors_exit_2_with_one_sentence(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Fails if argparse prints its usage and leaves by itself, or an abbreviation is guessed; with a seed that no generator takes
    (seen: exit code 4), or a prior counted as often as it is given."""
    assert cli.run(words) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
    assert said.err.startswith("unsweep: ")
    assert said.err.endswith(".\n")


def test_unwritable_output_is_told_before_the_work(
    library: Library, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fails if the recording is read first, for any of the places that are named (seen: without `_check_places`; without its
    last two lines, with which the report takes the result's place; HTML written into a .pdf)."""
    for words in (
        ["--output", "/nowhere/at/all/result.json"],
        ["--report", "/nowhere/at/all/report.html"],
        ["--output", "all.html", "--report", "at-all/../all.html"],
        ["--report", "all.pdf"],
        ["--report", "all"],
    ):
        (tmp_path / "at-all").mkdir(exist_ok=True)
        monkeypatch.chdir(tmp_path)
        assert cli.run(["calibrate", "room.bag", *words]) == 2
        assert library.asked.reading is None
        assert "all" in last_line(capsys)


@pytest.mark.parametrize("option", ["--output", "--report"])
def test_nothing_is_written_over_the_recording(
    library: Library, option: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A slip of the shell's completion cost the recording. Mutation: names compared instead of files."""
    monkeypatch.chdir(tmp_path)
    Path("room.bag").write_bytes(b"minutes of work")
    Path("link.bag").symlink_to("room.bag")
    for name in ("room.bag", "./room.bag", "link.bag"):
        assert cli.run(["calibrate", "room.bag", option, name]) == 2
        assert "the recording itself" in last_line(capsys)
    assert library.asked.reading is None
    assert Path("room.bag").read_bytes() == b"minutes of work"


def test_a_pipe_gets_the_result_and_stays_a_pipe(library: Library, tmp_path: Path) -> None:
    """As of a shell's >(...), or of /dev/null: a file was put in its place, which ends a device of the machine's where root
    runs it; behind >(...) the result of minutes was lost.

    Mutation: `_is_stream` says no.
    """
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    end = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    assert cli.run(["calibrate", "room.bag", "--quiet", "--output", str(pipe)]) == 0
    assert pipe.is_fifo()
    assert CalibrationResult.model_validate_json(os.read(end, 1 << 20)) == library.result
    os.close(end)
    reads, writes = os.pipe()
    assert cli.run(["calibrate", "room.bag", "--quiet", "--output", f"/dev/fd/{writes}"]) == 0
    assert CalibrationResult.model_validate_json(os.read(reads, 1 << 20)) == library.result
    for descriptor in (reads, writes):
        os.close(descriptor)


def test_a_link_stays_a_link(library: Library, tmp_path: Path) -> None:
    """`latest.json` led to the run's own file, and was a file of its own afterwards. Mutation: the link's place is written to."""
    (tmp_path / "runs").mkdir()
    (tmp_path / "latest.json").symlink_to("runs/today.json")
    for _ in range(2):
        assert cli.run(["calibrate", "room.bag", "--quiet", "--output", str(tmp_path / "latest.json")]) == 0
    assert (tmp_path / "latest.json").is_symlink()
    assert CalibrationResult.model_validate_json((tmp_path / "runs" / "today.json").read_text()) == library.result
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["today.json"]


def test_options_reach_the_library(library: Library, tmp_path: Path) -> None:
    """Fails if an option is parsed and dropped."""
    planes, guess = tmp_path / "planes.json", tmp_path / "guess.json"
    planes.write_text(
        '{"schema": "unsweep.planes/1", "planes": [{"name": "floor", "normal": [0, 0, 1], "offset_m": 1}]}'
    )
    guess.write_text('{"time_offset_s": -0.02}')
    words = "calibrate room.bag --quiet --lidar-topic /l --imu-topic /i --start-s 2 --end-s 30 --point-time-field t"
    words += " --point-time-unit ns --point-time-reference header-last --synthesise-point-time --points-at-once"
    words += " --accelerometer-unit g"
    words += " --gyroscope-unit deg_s --stamps receive --range-min-m 1 --range-max-m 50 --method paper --gravity 9.81"
    words += " --exclude 2:3 --exclude 12.5:14"
    words += " --prior tz=-0.3+-0.01 --prior rx=0+-1deg --fix-time-offset --fix-planes --bias-model constant"
    words += " --imu-sampling even --cloud as-sent"
    words += f" --random-seed 7 --max-rounds 3 --imu-noise mti-3 --planes {planes} --initial-guess {guess}"
    assert cli.run(words.split()) == 0
    assert library.asked.reading.model_dump(exclude_defaults=True) == {
        "lidar_topic": "/l",
        "imu_topic": "/i",
        "start_s": 2.0,
        "end_s": 30.0,
        "point_time_field": "t",
        "point_time_unit": "ns",
        "point_time_reference": "header-last",
        "synthesise_point_time": True,
        "points_at_once": True,
        "accelerometer_unit": "g",
        "gyroscope_unit": "deg_s",
        "stamps": "receive",
        "range_min_m": 1.0,
        "range_max_m": 50.0,
    }
    solving = library.asked.solving
    assert (solving.method, solving.points_per_plane_per_scan, solving.field_of_view_deg) == ("paper", 100, 45.0)
    assert (solving.estimate_time_offset, solving.estimate_planes, solving.bias_model) == (False, False, "constant")
    assert (solving.random_seed, solving.max_rounds, solving.imu_noise) == (7, 3, "mti-3")
    assert (solving.imu_sampling, solving.cloud) == ("even", "as-sent")
    assert solving.excluded_spans_s == ((2.0, 3.0), (12.5, 14.0))
    assert [(prior.axis, prior.value) for prior in solving.priors] == [("tz", -0.3), ("rx", 0.0)]
    assert [plane.name for plane in library.asked.planes] == ["floor"]
    assert library.asked.guess.time_offset_ns == -20_000_000


def test_every_read_setting_has_an_option() -> None:
    """Fails when a setting is added to ReadSettings and not to the command line."""
    from app.cli.parser import build_parser
    from calib_core.settings import ReadSettings

    words = vars(build_parser().parse_args(["calibrate", "room.bag"]))
    assert set(ReadSettings.model_fields) <= set(words)


def test_negative_lists_are_values(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Fails if `--mounting -0.1,...` is taken for an unknown option (argparse does)."""
    asked = {}
    monkeypatch.setattr(api, "simulate", lambda *words, **named: asked.update(named) or tmp_path / "truth")
    words = ["simulate", "paper-normal", str(tmp_path / "room.bag"), "--mounting", "-0.1,0,0,0,0,0,1"]
    assert cli.run([*words, "--time-offset-s", "-.15", "--noise", "none", "--quiet"]) == 0
    assert asked["mounting"] == (-0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    assert (asked["time_offset_s"], asked["noise"], asked["faults"]) == (-0.15, False, "")


def test_faults_are_asked_for_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Fails if an unknown fault is left out in silence, or the truth beside the recording lacks what was put in."""
    words = ["simulate", "static", str(tmp_path / "room.bag"), "--duration-s", "0.5", "--quiet", "--faults"]
    assert cli.run([*words, "accel-scale=0.5%,clock-rate=40"]) == 0
    truth = json.loads((tmp_path / "room.truth.json").read_text())
    assert truth["clock_rate_ppm"] == 40.0
    assert [each["block"] for each in truth["intrinsics"]] == ["accelerometer_scale"] * 3 + ["clock_rate"]
    assert cli.run([*words, "acel-scale"]) == 2
    assert "'acel-scale'" in last_line(capsys)


def test_export_prints_and_refuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Fails if a refused result, a missing file or a foreign document ends otherwise than in 2 with its sentence."""
    path = tmp_path / "result.json"
    path.write_text(make_result(np.eye(3), np.ones(3)).to_json())
    assert cli.run(["export", str(path), "--format", "glim"]) == 0
    assert "T_lidar_imu" in capsys.readouterr().out
    path.write_text(make_result(np.eye(3), np.ones(3), status="refused").to_json())
    assert cli.run(["export", str(path), "--format", "glim"]) == 2
    assert "refused" in last_line(capsys)
    path.write_text("{}")
    assert cli.run(["export", str(path), "--format", "glim"]) == 2
    assert "unsweep.calibration/1" in last_line(capsys)
    assert cli.run(["export", str(tmp_path / "none.json"), "--format", "glim"]) == 2
    assert "none.json" in last_line(capsys)
    document = json.loads(make_result(np.eye(3), np.ones(3)).to_json())
    for number in (-1.0, 2.0, float("nan")):  # a mirror, a scale, nothing
        document["T_imu_lidar"]["matrix"][2][2] = number
        path.write_text(json.dumps(document))
        assert cli.run(["export", str(path), "--format", "urdf"]) == 2
        assert capsys.readouterr().out == ""


def test_help_and_version_exit_0(capsys: pytest.CaptureFixture[str]) -> None:
    """Fails if help is an error, or a command is missing from it."""
    assert cli.run(["--help"]) == 0
    said = capsys.readouterr().out
    assert all(name in said for name in commands.COMMANDS)
    assert cli.run(["--version"]) == 0
    assert all(cli.run([name, "--help"]) == 0 for name in commands.COMMANDS)


def test_help_needs_no_numerics() -> None:
    """Help within a moment: fails if SciPy, Open3D, FastAPI or viser are imported for it."""
    code = "import sys; from app.cli import main as cli; cli.run(['--help']); "
    code += "print([m for m in ('scipy', 'open3d', 'fastapi', 'viser', 'rosbags') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_closed_pipe_is_no_failure(tmp_path: Path) -> None:
    """`unsweep export ... | head -1`: fails if Python complains about the closed pipe."""
    path = tmp_path / "result.json"
    path.write_text(make_result(np.eye(3), np.ones(3)).to_json())
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "app.cli", "export", str(path), "--format", "matrix"]
    buffered = {**os.environ, "PYTHONUNBUFFERED": ""}
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False, env=buffered)
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("buffered", [True, False])
def test_an_output_that_takes_no_more_is_one_sentence(buffered: bool, tmp_path: Path) -> None:
    """`unsweep export ... > /dev/full`. Oracle: code 2, the caller's. Seen: 4, a defect to report.

    Mutations: it is a defect; what is still to be flushed is tried again at the end.
    """
    path = tmp_path / "result.json"
    path.write_text(make_result(np.eye(3), np.ones(3)).to_json())
    command = [sys.executable, "-m", "app.cli", "export", str(path), "--format", "matrix"]
    environment = {**os.environ, "PYTHONUNBUFFERED": "" if buffered else "1"}
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False, env=environment)
    (line,) = done.stderr.splitlines()
    assert (done.returncode, line[:60]) == (2, "unsweep: Expected room for what is written, but the disk is ")


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), OSError("5 requested and 3 written")])
def test_a_disk_that_fills_is_no_defect(
    library: Library,
    capsys: pytest.CaptureFixture[str],
    error: Exception,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whatever was written to it, as by deskew. Mutation: it is a defect, with a log that has no room either."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    library.failure = error
    assert cli.run(["calibrate", "room.bag", "--log-json"]) == 2
    said = json.loads(last_line(capsys))
    assert (said["code"], "free some space" in said["text"]) == ("disk.full", True)
    assert not list(tmp_path.iterdir())


def test_busy_port_and_missing_folder_are_one_sentence(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Fails if the server dies with a traceback, or serves somewhere else than asked."""
    with socket.create_server(("127.0.0.1", 0)) as busy:
        port = busy.getsockname()[1]
        assert cli.run(["serve", "--port", str(port), "--data-dir", str(tmp_path)]) == 2
        assert f"Port {port} of 127.0.0.1 cannot be used" in last_line(capsys)
    with listen("127.0.0.1", 0) as first, pytest.raises(InputError, match="cannot be used"):
        listen("127.0.0.1", first.getsockname()[1])
    assert cli.run(["serve", "--recordings", str(tmp_path / "none")]) == 2
    assert "--recordings" in last_line(capsys)
    assert cli.run(["serve", "--port", "99999"]) == 2
    assert "--port" in last_line(capsys)


def test_answers_on_a_kept_connection_wait_for_no_acknowledgement() -> None:
    """Oracle: what the kernel is told of an accepted connection. Mutation: a socket of no named protocol, which asyncio leaves
    as it is: head and body go out by themselves, the second 40 ms later.
    """

    async def told() -> int:
        accepted: asyncio.Future[int] = asyncio.get_running_loop().create_future()

        async def meet(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            accepted.set_result(writer.get_extra_info("socket").getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY))
            writer.close()

        bound = listen("127.0.0.1", 0)
        async with await asyncio.start_server(meet, sock=bound):
            _, writer = await asyncio.open_connection("127.0.0.1", bound.getsockname()[1])
            said = await asyncio.wait_for(accepted, 30)
            writer.close()
        return said

    assert asyncio.run(told()) == 1


@pytest.mark.parametrize("stop", [signal.SIGTERM, signal.SIGINT])
def test_server_prints_its_address_and_stops_when_asked(stop: signal.Signals, tmp_path: Path) -> None:
    """Fails if the address is not the one it listens on, a strange address needs no token, or it cannot be ended."""
    command = [
        sys.executable,
        "-m",
        "app.cli",
        "serve",
        "--host",
        "0.0.0.0",
        "--port",
        "0",
        "--data-dir",
        str(tmp_path),
    ]
    environment = {key: value for key, value in os.environ.items() if key != "UNSWEEP_TOKEN"}
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment) as server:
        assert server.stderr is not None
        line = server.stderr.readline()
        assert "?token=" in line
        port = int(line.split("/?token")[0].rsplit(":", 1)[1])
        for _ in range(100):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.05)
        else:
            pytest.fail("nobody listens at the printed address")
        time.sleep(1.0)
        server.send_signal(stop)
        assert server.wait(timeout=30) == 0
        assert "Traceback" not in server.stderr.read()
