"""Options that several commands share: the recording, how it is read and solved, what is told on the way."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

from app.cli.usage import Parser, natural, positive
from calib_core.settings import CalibrateSettings, ReadSettings


def add_recording(command: Parser) -> None:
    """What is read."""
    text = "a .bag, a ROS 2 folder, a lone .mcap or .db3, or a .zip or .tar.gz of a folder"
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
        help="its magnitude in m/s² (free: 9.807 +- 0.02)",
    )
    add(
        "--imu-noise",
        metavar="PRESET|FILE",
        help="the IMU by name: what to expect of it; or a file of noise densities, instead of measured ones; an unknown name "
        "lists them all",
    )
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
        help="something known, e.g. tz=0.31+-0.005, or rx=0+-0.5deg, a turn about the lidar's x from the rotation of the"
        " initial guess, which it needs; may come often",
    )
    add(
        "--exclude",
        action="append",
        default=[],
        metavar="START:END",
        help="leave out the scans of this span, in seconds after the first scan; may come often",
    )
    add(
        "--fix-time-offset",
        action="store_true",
        help="hold the time offset as the initial guess has it, at 0 without one",
    )
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
    add(
        "--lidar-sampling",
        choices=("detect", "as-stamped"),
        default=defaults.lidar_sampling,
        help="when sweeps began: when stamped, or as the rotor turns where a host stamped them (%(default)s)",
    )
    add(
        "--cloud",
        choices=("detect", "as-sent"),
        default=defaults.cloud,
        help="clouds that a grid thinned, one point to a cell: told by their points, or taken as a lidar's own (%(default)s)",
    )
    add("--random-seed", type=natural, default=defaults.random_seed, help="seed of the plane search (%(default)s)")
    add(
        "--max-rounds",
        type=positive,
        default=defaults.max_rounds,
        help="most rounds of association and solve (%(default)s)",
    )


def add_reading(command: Parser) -> None:
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
    group.add_argument(
        "--points-at-once",
        action="store_true",
        help="all points of a scan were taken at its stamp, as by a flash lidar or a depth camera",
    )
    group.add_argument("--accelerometer-unit", choices=_choices("accelerometer_unit"), help="unit of the accelerations")
    group.add_argument("--gyroscope-unit", choices=_choices("gyroscope_unit"), help="unit of the rates of turn")
    group.add_argument(
        "--stamps", choices=_choices("stamps"), default=defaults.stamps, help="which stamps to believe (%(default)s)"
    )
    group.add_argument(
        "--imu-bundles",
        choices=_choices("imu_bundles"),
        default=defaults.imu_bundles,
        help="IMU readings that a driver stamped together or sent again: spread and taken once, or as they came (%(default)s)",
    )
    group.add_argument(
        "--repeated-returns",
        choices=_choices("repeated_returns"),
        default=defaults.repeated_returns,
        help="returns that stand in a cloud twice, as of a lidar in dual mode: counted once, or as they came (%(default)s)",
    )


def add_manner(command: Parser) -> None:
    """What is told on the way."""
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
