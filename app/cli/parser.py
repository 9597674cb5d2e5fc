"""The words the command line understands: commands, options, and one sentence where they do not fit."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Literal, NoReturn, get_args

from calib_core import __version__
from calib_core.settings import CalibrateSettings, ReadSettings

EPILOG = (
    "Exit codes: 0 done, 2 the call or the input is at fault, 3 the recording cannot give the answer, 4 a defect, "
    "130 interrupted."
)


AUDIT_EPILOG = (
    "Exit codes: 0 passed, 1 failed, 2 the call or the input is at fault, 3 the recording cannot tell, 4 a defect, 130 "
    "interrupted."
)


class UsageError(Exception):
    """The words do not fit; str() is one sentence."""


class Parser(argparse.ArgumentParser):
    """argparse that raises one sentence instead of printing its usage and leaving."""

    def error(self, message: str) -> NoReturn:
        """Called by argparse. message: what does not fit."""
        raise UsageError(f"{message[:1].upper()}{message[1:]}; see `{self.prog} --help`.")


def build_parser() -> Parser:
    """The parser of the whole command line; `command` in what it returns names the command."""
    parser = Parser(
        prog="unsweep",
        description="Lidar-inertial calibration from planes: one recording in, T_imu_lidar and the time offset out.",
        epilog=EPILOG,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"unsweep {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True, parser_class=Parser)
    for add in (
        _add_serve,
        _add_inspect,
        _add_calibrate,
        _add_calibrate_many,
        _add_deskew,
        _add_audit,
        _add_export,
        _add_simulate,
        _add_compile,
    ):
        add(commands)
    return parser


Commands = argparse._SubParsersAction  # noqa: SLF001  argparse has no public name for it


def _command(commands: Commands[Parser], name: str, text: str) -> Parser:
    return commands.add_parser(name, help=text, description=text, epilog=EPILOG, allow_abbrev=False)


def _add_serve(commands: Commands[Parser]) -> None:
    command = _command(commands, "serve", "Start the web application and print its address.")
    command.add_argument(
        "--host", default="127.0.0.1", help="address to listen on (%(default)s); any but loopback needs a token"
    )
    command.add_argument("--port", type=int, default=8080, help="port to listen on (%(default)s); 0: any free one")
    command.add_argument("--data-dir", type=Path, metavar="DIR", help="where uploads and results are kept")
    command.add_argument(
        "--recordings", type=Path, metavar="DIR", help="a folder whose recordings open without an upload"
    )
    command.add_argument("--token", help="what every request must show; UNSWEEP_TOKEN does the same")


def _add_inspect(commands: Commands[Parser]) -> None:
    text = "Tell whether a recording can be calibrated: sensors, stamps, units, gaps, motion, forecast."
    command = _command(commands, "inspect", text)
    _add_recording(command)
    command.add_argument("--json", action="store_true", help="the report as JSON")
    _add_reading(command)
    _add_manner(command)


def _add_calibrate(commands: Commands[Parser]) -> None:
    text = "Find T_imu_lidar and the time offset. Whatever no option names is found in the recording."
    command = _command(commands, "calibrate", text)
    _add_recording(command)
    command.add_argument("--output", type=Path, metavar="FILE", help="where the result goes; without it, to stdout")
    command.add_argument("--report", type=Path, metavar="FILE", help="a page to print and sign too, .html")
    _add_solving(command)
    _add_reading(command)
    _add_manner(command)


def _add_calibrate_many(commands: Commands[Parser]) -> None:
    text = "Calibrate every recording of a folder or a list, on this machine or on a dask.distributed cluster."
    command = _command(commands, "calibrate-many", text)
    command.add_argument("source", type=Path, metavar="FOLDER|LIST", help="a list has a path a line")
    command.add_argument(
        "--output", type=Path, required=True, metavar="DIR", help="gets NAME.json each and summary.csv; goes on, too"
    )
    group = command.add_argument_group("where, and how much of it")
    group.add_argument(
        "--workers", type=_positive, metavar="N", help="recordings at a time on this machine (its cores)"
    )
    group.add_argument("--scheduler", metavar="ADDRESS", help="of a dask.distributed cluster, e.g. tcp://host:8786")
    group.add_argument("--time-limit-s", type=_seconds, metavar="S", help="most seconds for one recording")
    group.add_argument("--memory-limit-mb", type=_positive, metavar="MB", help="most memory for one recording")
    _add_solving(command)
    _add_reading(command)
    _add_manner(command)


def _add_deskew(commands: Commands[Parser]) -> None:
    text = "Remove the motion from every scan: points as seen from where the scan's first point was taken."
    command = _command(commands, "deskew", text)
    _add_recording(command)
    command.add_argument(
        "--calibration", type=Path, required=True, metavar="RESULT", help="a result of `unsweep calibrate`"
    )
    command.add_argument(
        "--output", type=Path, required=True, metavar="OUT", help="a folder for clouds, or a bag of the same kind"
    )
    command.add_argument(
        "--cloud-format", choices=("ply", "pcd"), default="ply", help="of the files in a folder (%(default)s)"
    )
    command.add_argument(
        "--map", type=Path, metavar="FILE", help="write the accumulated map too, voxels of 5 cm: .ply or .pcd"
    )
    command.add_argument(
        "--correct-lasers",
        action="store_true",
        help="take out what the calibration found of the lasers, too: offsets and scales of ranges, angles",
    )
    _add_reading(command)
    _add_manner(command)


def _add_audit(commands: Commands[Parser]) -> None:
    text = "Hold an extrinsic that is in use against a recording: is it still right, and would an error have shown."
    command = commands.add_parser("audit", help=text, description=text, epilog=AUDIT_EPILOG, allow_abbrev=False)
    _add_recording(command)
    command.add_argument(
        "--extrinsic",
        type=Path,
        required=True,
        metavar="FILE",
        help="a result, a URDF, settings of FAST-LIO or LIO-SAM (YAML), or a 4x4 matrix as text",
    )
    command.add_argument("--json", action="store_true", help="the report as JSON")
    command.add_argument(
        "--limits",
        type=Path,
        metavar="FILE",
        help='JSON, e.g. {"rotation_deg": 0.5, "translation_mm": [20, 20, 40], "time_offset_ms": null}',
    )
    command.add_argument(
        "--matrix-direction",
        choices=("imu_lidar", "lidar_imu"),
        default="imu_lidar",
        help="of a bare matrix; imu_lidar takes lidar coordinates to the IMU's (%(default)s)",
    )
    command.add_argument(
        "--correct-lasers",
        action="store_true",
        help="take out what the calibration found of the lasers, too: offsets and scales of ranges, angles",
    )
    _add_reading(command)
    _add_manner(command)


def _add_export(commands: Commands[Parser]) -> None:
    from calib_core.api import export_names

    command = _command(
        commands, "export", "Print the extrinsic, or what was found of the sensors, as another program wants it."
    )
    command.add_argument("result", type=Path, metavar="RESULT", help="a result of `unsweep calibrate`")
    command.add_argument("--format", required=True, metavar="NAME", help=f"one of {', '.join(export_names())}")


def _add_simulate(commands: Commands[Parser]) -> None:
    command = _command(commands, "simulate", "Write a recording whose truth is known, and the truth beside it.")
    command.add_argument(
        "scenario", metavar="SCENARIO", help="for example paper-normal; an unknown name lists them all"
    )
    command.add_argument("out", type=Path, metavar="OUT", help=".bag, .mcap, or without suffix a ROS 2 folder")
    command.add_argument("--seed", type=_natural, default=0, help="seed of the noise (%(default)s)")
    command.add_argument("--mounting", metavar="X,Y,Z,QX,QY,QZ,QW", help="T_imu_lidar, metres and a unit quaternion")
    command.add_argument(
        "--time-offset-s", type=float, metavar="S", help="added to IMU stamps it gives the lidar's clock"
    )
    command.add_argument("--duration-s", type=float, metavar="S", help="length of the recording")
    command.add_argument("--noise", choices=("none",), help="exact readings")
    command.add_argument("--header-at", choices=("first", "last"), help="the packet that stamps a Velodyne cloud")
    command.add_argument(
        "--faults",
        default="",
        metavar="NAME[=SIZE],...",
        help="what real sensors and rooms do: industrial, consumer, or for example laser-offsets=8mm,clock-rate; "
        "an unknown name lists them all",
    )
    _add_manner(command)


def _add_compile(commands: Commands[Parser]) -> None:
    text = "Compile the program's loops for this machine now, instead of in the first calibration."
    _add_manner(_command(commands, "compile-kernels", text))


def _add_recording(command: Parser) -> None:
    text = "a .bag, a ROS 2 folder, a lone .mcap or .db3, or a .zip or .tar.gz of a folder"
    command.add_argument("recording", type=Path, metavar="RECORDING", help=text)


def _add_solving(command: Parser) -> None:
    defaults = CalibrateSettings()
    group = command.add_argument_group("how it is solved")
    add = group.add_argument
    add(
        "--method",
        choices=("full", "paper"),
        default=defaults.method,
        help="paper: the published algorithm as it stands",
    )
    add("--points-per-plane-per-scan", metavar="N|all", help="points used of a plane in a scan (all; paper: 100)")
    add("--field-of-view-deg", type=float, metavar="A", help="keep azimuths within plus and minus A (all; paper: 45)")
    add("--planes", type=Path, metavar="FILE", help="the planes to use, instead of those found")
    add(
        "--initial-guess",
        type=Path,
        metavar="FILE",
        help="where to start: any of a result's T_imu_lidar and time_offset_s",
    )
    add(
        "--gravity",
        default="free",
        metavar="VALUE|latitude:DEG|free",
        help="its magnitude in m/s2 (free: 9.807 +- 0.02)",
    )
    add("--imu-noise", metavar="PRESET|FILE", help="noise densities, instead of those measured while standing still")
    add(
        "--intrinsics",
        default=defaults.intrinsics,
        metavar="auto|consider|off|NAME,...",
        help="the sensors' own parameters: estimated with priors, counted in the error bars alone, taken for ideal, or "
        "only those named are estimated (%(default)s); an unknown name lists them all",
    )
    add(
        "--lidar",
        metavar="PRESET",
        help="the lidar, for what to expect of its lasers (as recognised); an unknown name lists them all",
    )
    add(
        "--prior",
        action="append",
        default=[],
        metavar="AXIS=VALUE+-STD",
        help="something known, e.g. tz=0.31+-0.005 or rx=0+-0.5deg; may come often",
    )
    add(
        "--exclude",
        action="append",
        default=[],
        metavar="START:END",
        help="leave out the scans of this span, in seconds after the first scan; may come often",
    )
    add("--fix-time-offset", action="store_true", help="keep the time offset at its start value")
    add("--fix-planes", action="store_true", help="keep the planes as given or as first seen")
    add(
        "--bias-model",
        choices=("constant", "random-walk"),
        default=defaults.bias_model,
        help="how the IMU's biases behave (%(default)s)",
    )
    add(
        "--imu-sampling",
        choices=("detect", "as-stamped", "even"),
        default=defaults.imu_sampling,
        help="when the IMU's readings were taken: when stamped, evenly, or what they themselves tell (%(default)s)",
    )
    add("--random-seed", type=_natural, default=defaults.random_seed, help="seed of the plane search (%(default)s)")
    add(
        "--max-rounds",
        type=_positive,
        default=defaults.max_rounds,
        help="most rounds of association and solve (%(default)s)",
    )


def _add_reading(command: Parser) -> None:
    """One option for each field of ReadSettings, by the field's own name."""
    defaults = ReadSettings()
    topics = command.add_argument_group("what is read")
    topics.add_argument("--lidar-topic", metavar="TOPIC", help="needed where several fit")
    topics.add_argument("--imu-topic", metavar="TOPIC", help="needed where several fit")
    topics.add_argument(
        "--start-s", type=float, metavar="S", help="leave out what comes before, in seconds after the start"
    )
    topics.add_argument("--end-s", type=float, metavar="S", help="leave out what comes after")
    topics.add_argument(
        "--range-min-m",
        type=float,
        default=defaults.range_min_m,
        metavar="M",
        help="nearer points are left out (%(default)s)",
    )
    topics.add_argument(
        "--range-max-m",
        type=float,
        default=defaults.range_max_m,
        metavar="M",
        help="farther points are left out (%(default)s)",
    )
    group = command.add_argument_group("instead of what is detected")
    group.add_argument("--point-time-field", metavar="NAME", help="field of the cloud with each point's time")
    group.add_argument("--point-time-unit", choices=_choices("point_time_unit"), help="its unit")
    group.add_argument("--point-time-reference", choices=_choices("point_time_reference"), help="what it counts from")
    group.add_argument(
        "--synthesise-point-time",
        action="store_true",
        help="make up the times of clouds that have none; degrades the result",
    )
    group.add_argument("--accelerometer-unit", choices=_choices("accelerometer_unit"), help="unit of the accelerations")
    group.add_argument("--gyroscope-unit", choices=_choices("gyroscope_unit"), help="unit of the rates of turn")
    group.add_argument(
        "--stamps", choices=_choices("stamps"), default=defaults.stamps, help="which stamps to believe (%(default)s)"
    )


def _add_manner(command: Parser) -> None:
    group = command.add_argument_group("what is told on the way")
    group.add_argument("--quiet", action="store_true", help="nothing but errors on stderr")
    group.add_argument("--log-json", action="store_true", help="one JSON object a line on stderr")


def _choices(field: str) -> tuple[str, ...]:
    """The words that a Literal field of ReadSettings allows."""
    annotation = ReadSettings.model_fields[field].annotation
    words: list[str] = []
    for member in get_args(annotation):
        words += [member] if isinstance(member, str) else [w for w in get_args(member) if isinstance(w, str)]
    return tuple(words)


def _natural(text: str) -> int:
    return _whole(text, 0)


def _positive(text: str) -> int:
    return _whole(text, 1)


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not 0.0 < seconds < math.inf:
        raise argparse.ArgumentTypeError(f"expected seconds above 0, but found `{text}`")
    return seconds


def _whole(text: str, least: Literal[0, 1]) -> int:
    if not text.isdecimal() or int(text) < least:
        raise argparse.ArgumentTypeError(f"expected a whole number from {least} on, but found `{text}`")
    return int(text)
