"""Options that several commands share: the recording, how it is read and solved, what is told on the way."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

from app.cli.usage import Parser, natural, positive
from calib_core.settings import CalibrateSettings, ReadSettings


def add_recording(command: Parser) -> None:
    """What is read."""
    text = "a ROS 1 .bag, a ROS 2 folder, a single .mcap or .db3 file, or a .zip or .tar.gz of a folder"
    command.add_argument("recording", type=Path, metavar="RECORDING", help=text)


def add_solving(command: Parser) -> None:
    """How it is solved."""
    defaults = CalibrateSettings()
    group = command.add_argument_group("how it is solved")
    add = group.add_argument
    add(
        "--method",
        choices=("full", "paper"),
        default=defaults.method,
        help="full: this program's estimator; paper: the algorithm exactly as published (%(default)s)",
    )
    add(
        "--points-per-plane-per-scan",
        metavar="N|all",
        help="use at most N points of each plane in each scan (all; paper: 100)",
    )
    add(
        "--field-of-view-deg",
        type=float,
        metavar="A",
        help="use only points within A degrees to the left and right of the lidar's x axis (all; paper: 45)",
    )
    add("--planes", type=Path, metavar="FILE", help="JSON file of the planes to use, instead of those that are found")
    add(
        "--initial-guess",
        type=Path,
        metavar="FILE",
        help="JSON file with the values to start from: T_imu_lidar, time_offset_s or both, as in a result",
    )
    add(
        "--gravity",
        default="free",
        metavar="VALUE|latitude:DEG|free",
        help="magnitude of gravity: a value in m/s², the value at a latitude, or free, which estimates it near 9.807 +- 0.02 "
        "(%(default)s)",
    )
    add(
        "--imu-noise",
        metavar="PRESET|FILE",
        help="the IMU's model, from whose data sheet noise and errors are expected, or a file of noise densities; without it, "
        "noise is measured. An unknown name lists the models",
    )
    add(
        "--intrinsics",
        default=defaults.intrinsics,
        metavar="auto|consider|off|NAME,...",
        help="parameters of the sensors themselves, such as lasers' range offsets and the IMU's scale. auto: estimate all; "
        "consider: only widen the error bars; off: take both sensors for ideal; NAME,...: estimate these (%(default)s). An "
        "unknown name lists the names",
    )
    add(
        "--lidar",
        metavar="PRESET",
        help="the lidar's model, from whose data sheet the errors of its lasers are expected (recognised from the recording). "
        "An unknown name lists the models",
    )
    add(
        "--prior",
        action="append",
        default=[],
        metavar="AXIS=VALUE+-STD",
        help="something measured by other means, e.g. tz=0.31+-0.005 in metres. rx=0+-0.5deg is a turn about the lidar's x axis "
        "from the rotation of --initial-guess, which it needs. May be given several times",
    )
    add(
        "--exclude",
        action="append",
        default=[],
        metavar="START:END",
        help="leave out the scans of this span, in seconds after the first scan. May be given several times",
    )
    add(
        "--fix-time-offset",
        action="store_true",
        help="do not estimate the time offset: hold it at the value of --initial-guess, or at 0",
    )
    add(
        "--fix-planes",
        action="store_true",
        help="do not estimate where the planes are: hold them as given, or as first seen",
    )
    add(
        "--bias-model",
        choices=("constant", "random-walk"),
        default=defaults.bias_model,
        help="how the biases of the IMU change over time (%(default)s)",
    )
    add(
        "--imu-sampling",
        choices=("detect", "as-stamped", "even"),
        default=defaults.imu_sampling,
        help="when the IMU's readings were taken: at their stamps, at even intervals, or whichever the readings themselves show "
        "(%(default)s)",
    )
    add(
        "--lidar-sampling",
        choices=("detect", "as-stamped"),
        default=defaults.lidar_sampling,
        help="when sweeps began: at their stamps, or, where these are a host's and jitter, as evenly as the rotor turns "
        "(%(default)s)",
    )
    add(
        "--cloud",
        choices=("detect", "as-sent"),
        default=defaults.cloud,
        help="whether clouds were thinned to one point per cell of a grid: detect it, or take them as the lidar's own "
        "(%(default)s)",
    )
    add(
        "--random-seed",
        type=natural,
        default=defaults.random_seed,
        metavar="N",
        help="seed of the random search for planes (%(default)s)",
    )
    add(
        "--max-rounds",
        type=positive,
        default=defaults.max_rounds,
        metavar="N",
        help="stop after so many rounds of assigning points to planes and solving (%(default)s)",
    )


def add_reading(command: Parser) -> None:
    """One option for each field of ReadSettings, by the field's own name."""
    defaults = ReadSettings()
    topics = command.add_argument_group("what is read")
    topics.add_argument("--lidar-topic", metavar="TOPIC", help="the lidar's topic; needed only where there are several")
    topics.add_argument("--imu-topic", metavar="TOPIC", help="the IMU's topic; needed only where there are several")
    topics.add_argument(
        "--start-s", type=float, metavar="S", help="leave out everything before, in seconds after the recording's start"
    )
    topics.add_argument(
        "--end-s", type=float, metavar="S", help="leave out everything after, in seconds after the recording's start"
    )
    topics.add_argument(
        "--range-min-m",
        type=float,
        default=defaults.range_min_m,
        metavar="M",
        help="leave out points nearer than this (%(default)s)",
    )
    topics.add_argument(
        "--range-max-m",
        type=float,
        default=defaults.range_max_m,
        metavar="M",
        help="leave out points farther than this (%(default)s)",
    )
    group = command.add_argument_group("instead of what is detected")
    group.add_argument(
        "--point-time-field", metavar="NAME", help="name of the cloud's field that holds each point's time"
    )
    group.add_argument("--point-time-unit", choices=_choices("point_time_unit"), help="unit of that field")
    group.add_argument(
        "--point-time-reference",
        choices=_choices("point_time_reference"),
        help="what these times count from: the header's stamp at the first or at the last point, or nothing, being absolute",
    )
    group.add_argument(
        "--synthesise-point-time",
        action="store_true",
        help="where clouds hold no point times, compute them from the points' azimuth or order; the result is less accurate",
    )
    group.add_argument(
        "--points-at-once",
        action="store_true",
        help="all points of a scan were taken at its stamp, as by a flash lidar or a depth camera",
    )
    group.add_argument(
        "--accelerometer-unit", choices=_choices("accelerometer_unit"), help="unit of the recorded accelerations"
    )
    group.add_argument(
        "--gyroscope-unit", choices=_choices("gyroscope_unit"), help="unit of the recorded rates of turn"
    )
    group.add_argument(
        "--stamps",
        choices=_choices("stamps"),
        default=defaults.stamps,
        help="stamps to use: those in message headers, or when messages were received (%(default)s)",
    )
    group.add_argument(
        "--imu-bundles",
        choices=_choices("imu_bundles"),
        default=defaults.imu_bundles,
        help="what to do with IMU readings that a driver stamped alike or sent twice: spread them evenly and count each once, or "
        "take them as stamped (%(default)s)",
    )
    group.add_argument(
        "--repeated-returns",
        choices=_choices("repeated_returns"),
        default=defaults.repeated_returns,
        help="what to do with returns that a cloud holds twice, as from a lidar in dual-return mode: count each once, or take "
        "them as sent (%(default)s)",
    )


def add_manner(command: Parser) -> None:
    """What is told on the way."""
    group = command.add_argument_group("what is told on the way")
    group.add_argument("--quiet", action="store_true", help="write nothing but errors to stderr")
    group.add_argument("--log-json", action="store_true", help="write progress to stderr as JSON, one object per line")


def _choices(field: str) -> tuple[str, ...]:
    """The words that a Literal field of ReadSettings allows."""
    annotation = ReadSettings.model_fields[field].annotation
    words: list[str] = []
    for member in get_args(annotation):
        words += [member] if isinstance(member, str) else [w for w in get_args(member) if isinstance(w, str)]
    return tuple(words)
