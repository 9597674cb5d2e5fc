"""The commands that the command line understands, and what each takes beside the options it shares with others."""

from __future__ import annotations

import argparse
from pathlib import Path

from app.cli.shared_options import add_manner, add_reading, add_recording, add_solving
from app.cli.usage import Parser, megabytes, natural, positive, seconds
from calib_core import __version__

EPILOG = (
    "Exit codes: 0 done; 2 something is wrong with the command or its input; 3 the recording cannot give an answer; 4 a defect "
    "of the program; 130 interrupted."
)


AUDIT_EPILOG = (
    "Exit codes: 0 passed; 1 failed; 2 something is wrong with the command or its input; 3 the recording cannot tell; 4 a defect "
    "of the program; 130 interrupted."
)


def build_parser() -> Parser:
    """The parser of the whole command line; `command` in what it returns names the command."""
    parser = Parser(
        prog="unsweep",
        description="Find how a 3D lidar sits on an IMU, and their time offset, from one recording of a place with planes.",
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
    command.add_argument(
        "--token",
        help="secret that every request must carry; better given as UNSWEEP_TOKEN, which others on the machine cannot see",
    )
    group = command.add_argument_group("beyond one machine")
    group.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="address of a dask.distributed scheduler whose workers run the jobs and see DIR under the same path, "
        "e.g. tcp://host:8786",
    )
    group.add_argument(
        "--database",
        metavar="URL",
        help="where records are kept instead of in DIR, e.g. postgresql+psycopg://user@host/unsweep; "
        "UNSWEEP_DATABASE_URL does the same and shows no password to others on the machine",
    )


def _add_inspect(commands: Commands[Parser]) -> None:
    text = "Tell whether a recording can be calibrated: sensors, stamps, units, gaps, motion, expected accuracy."
    command = _command(commands, "inspect", text)
    add_recording(command)
    command.add_argument("--json", action="store_true", help="print the report as JSON")
    add_reading(command)
    add_manner(command)


def _add_calibrate(commands: Commands[Parser]) -> None:
    text = "Find T_imu_lidar and the time offset. Whatever is not set by an option is detected in the recording."
    command = _command(commands, "calibrate", text)
    add_recording(command)
    command.add_argument("--output", type=Path, metavar="FILE", help="where to write the result (stdout)")
    command.add_argument("--report", type=Path, metavar="FILE", help="also write a report to read and print, .html")
    add_solving(command)
    add_reading(command)
    add_manner(command)


def _add_calibrate_many(commands: Commands[Parser]) -> None:
    text = "Calibrate every recording of a folder or a list, on this machine or on a dask.distributed cluster."
    command = _command(commands, "calibrate-many", text)
    command.add_argument(
        "source", type=Path, metavar="FOLDER|LIST", help="a folder of recordings, or a text file with one path per line"
    )
    command.add_argument(
        "--output",
        type=Path,
        required=True,
        metavar="DIR",
        help="folder for one NAME.json per recording and summary.csv, .json and .html; run again, it does what is missing",
    )
    group = command.add_argument_group("where, and how much of it")
    group.add_argument(
        "--workers",
        type=positive,
        metavar="N",
        help="recordings calibrated at the same time on this machine (number of its cores)",
    )
    group.add_argument(
        "--scheduler", metavar="ADDRESS", help="address of a dask.distributed scheduler, e.g. tcp://host:8786"
    )
    group.add_argument("--time-limit-s", type=seconds, metavar="S", help="give up a recording after so many seconds")
    group.add_argument(
        "--memory-limit-mb",
        type=megabytes,
        metavar="MB",
        help="give up a recording whose process fills more memory than this. 20 s by hand (VLP-16) take 350, 40 s from a "
        "quadrotor (OS1) 1050",
    )
    add_solving(command)
    add_reading(command)
    add_manner(command)


def _add_deskew(commands: Commands[Parser]) -> None:
    text = "Remove the motion distortion: every point as seen from where its scan's first point was taken."
    command = _command(commands, "deskew", text)
    add_recording(command)
    command.add_argument(
        "--calibration", type=Path, required=True, metavar="RESULT", help="a result of `unsweep calibrate`"
    )
    command.add_argument(
        "--output",
        type=Path,
        required=True,
        metavar="OUT",
        help="a folder for one cloud per scan, or a recording of the same kind as the input",
    )
    command.add_argument(
        "--cloud-format", choices=("ply", "pcd"), default="ply", help="format of the files in a folder (%(default)s)"
    )
    command.add_argument(
        "--map", type=Path, metavar="FILE", help="also write the map of all scans, one point per 5 cm: .ply or .pcd"
    )
    command.add_argument(
        "--correct-lasers",
        action="store_true",
        help="also correct the ranges and angles of each laser by what the calibration found",
    )
    add_reading(command)
    add_manner(command)


def _add_audit(commands: Commands[Parser]) -> None:
    text = "Check an extrinsic that is in use against a recording: whether it is still right, and how large an error would show."
    command = commands.add_parser("audit", help=text, description=text, epilog=AUDIT_EPILOG, allow_abbrev=False)
    add_recording(command)
    command.add_argument(
        "--extrinsic",
        type=Path,
        required=True,
        metavar="FILE",
        help="a result, a URDF, settings of FAST-LIO or LIO-SAM (YAML), or a 4x4 matrix as text",
    )
    command.add_argument("--json", action="store_true", help="print the report as JSON")
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
        help="direction of a matrix given as text; imu_lidar takes lidar coordinates to IMU coordinates (%(default)s)",
    )
    add_reading(command)
    add_manner(command)


def _add_export(commands: Commands[Parser]) -> None:
    from calib_core.api import export_names

    command = _command(
        commands,
        "export",
        "Print the extrinsic, or the sensors' own parameters, in the form that another program reads.",
    )
    command.add_argument("result", type=Path, metavar="RESULT", help="a result of `unsweep calibrate`")
    command.add_argument("--format", required=True, metavar="NAME", help=f"one of {', '.join(export_names())}")


def _add_simulate(commands: Commands[Parser]) -> None:
    command = _command(commands, "simulate", "Simulate a recording, and write its true extrinsic beside it.")
    command.add_argument(
        "scenario",
        metavar="SCENARIO",
        help="for example paper-normal, or handheld+os1 for the same with another lidar. An unknown name lists all",
    )
    command.add_argument(
        "out", type=Path, metavar="OUT", help="a .bag or .mcap file, or a name without suffix for a ROS 2 folder"
    )
    command.add_argument("--seed", type=natural, default=0, help="seed of the noise (%(default)s)")
    command.add_argument(
        "--mounting", metavar="X,Y,Z,QX,QY,QZ,QW", help="the true T_imu_lidar: metres, and a unit quaternion"
    )
    command.add_argument(
        "--time-offset-s", type=float, metavar="S", help="the true time offset: IMU stamps plus this are lidar stamps"
    )
    command.add_argument("--duration-s", type=float, metavar="S", help="length of the recording")
    command.add_argument("--noise", choices=("none",), help="none: readings without noise")
    command.add_argument(
        "--header-at", choices=("first", "last"), help="which packet's time a Velodyne cloud carries in its header"
    )
    command.add_argument(
        "--faults",
        default="",
        metavar="NAME[=SIZE],...",
        help="errors of real sensors and rooms: the profiles industrial or consumer, or single ones, for example "
        "laser-offsets=8mm,clock-rate. An unknown name lists all",
    )
    add_manner(command)


def _add_compile(commands: Commands[Parser]) -> None:
    text = "Compile the program's loops for this machine now, instead of in the first calibration."
    add_manner(_command(commands, "compile-kernels", text))
