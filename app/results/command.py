"""The command line that gives the same answer without a browser, and the files it needs.

Only what differs from the defaults is said, except for the topics: they may have been a choice.
"""

from __future__ import annotations

import json
import shlex
from dataclasses import dataclass

from app.jobs.orders import SAMPLE_SEED, OrderedPlane, StoredRequest
from app.schemas.jobs import InitialGuess
from app.schemas.results import Command, CommandFile
from app.storage.records import RecordingRecord
from calib_core.result import CalibrationResult
from calib_core.settings import (
    LATITUDE_GRAVITY_STD_M_S2,
    LEAST_GRAVITY_M_S2,
    MOST_GRAVITY_M_S2,
    CalibrateSettings,
    Gravity,
    ImuNoise,
    ReadSettings,
    gravity_at_latitude_m_s2,
)

PLANES_FILE = "planes.json"
GUESS_FILE = "guess.json"
NOISE_FILE = "noise.json"


@dataclass(frozen=True)
class Found:
    """The recording as who runs the command finds it. word: its name or path.   note: where that is, if it has to be said."""

    word: str
    note: str | None = None


def found_by(recording: RecordingRecord, below: str | None) -> Found:
    """What the recording's file is called where it came from; where the server keeps things is told to nobody.

    below: its path in the server's folder of recordings; None where it is not in one that is offered.
    """
    word = recording.file_name or recording.name
    if recording.origin == "sample":
        make = shlex.join(["unsweep", "simulate", recording.scenario, word, "--seed", str(SAMPLE_SEED)])
        return Found(word, f"The sample is made by: {make}")
    if recording.origin == "folder":
        if below is None:
            return Found(word, "The server does not offer this recording's folder now: put its path before the name.")
        return Found(below, "The path is that in the server's folder of recordings: run the command there.")
    if not recording.file_name:
        return Found(word, "What the file was called when it came is not known any more: put its own name there.")
    return Found(word)


def command_of(
    result: CalibrationResult, reading: ReadSettings, request: StoredRequest, *, found: Found | None = None
) -> Command:
    """The command, and the files to save beside the recording.   found: None for the name that the result has."""
    settings, files, notes = request.settings, [], []
    provenance = result.provenance.recording
    found = found or Found(provenance.name)
    if found.note is not None:
        notes.append(found.note)
    # A name that begins with a dash would be an option.
    words = ["unsweep", "calibrate", f"./{found.word}" if found.word.startswith("-") else found.word]
    words += ["--lidar-topic", provenance.lidar_topic, "--imu-topic", provenance.imu_topic]
    words += _reading_words(reading)
    words += _solving_words(settings)
    if request.planes is not None:
        files.append(CommandFile(name=PLANES_FILE, text=_planes_text(request.planes)))
        words += ["--planes", PLANES_FILE]
    if request.initial_guess is not None:
        files.append(CommandFile(name=GUESS_FILE, text=_guess_text(request.initial_guess)))
        words += ["--initial-guess", GUESS_FILE]
    if isinstance(settings.imu_noise, ImuNoise):
        files.append(CommandFile(name=NOISE_FILE, text=settings.imu_noise.model_dump_json(indent=2) + "\n"))
        words += ["--imu-noise", NOISE_FILE]
    elif settings.imu_noise is not None:
        words += ["--imu-noise", settings.imu_noise]
    gravity = _gravity_word(settings.gravity)
    if gravity is None:
        notes.append("The command line has no option for this prior of gravity; it uses 9.807 +- 0.02 m/s².")
    elif gravity != "free":
        words += ["--gravity", gravity]
    words += ["--output", "result.json"]
    return Command(text=shlex.join(words), files=files, notes=notes)


def _reading_words(reading: ReadSettings) -> list[str]:
    """One option for each field, by the field's own name; the topics are named already."""
    words: list[str] = []
    for name, value in reading.model_dump(exclude_defaults=True, exclude={"lidar_topic", "imu_topic"}).items():
        option = "--" + name.replace("_", "-")
        words += [option] if value is True else [option, f"{value:.10g}" if isinstance(value, float) else str(value)]
    return words


def _solving_words(settings: CalibrateSettings) -> list[str]:
    defaults = CalibrateSettings(method=settings.method)
    words = ["--method", "paper"] if settings.method == "paper" else []
    points, angle_deg = settings.points_per_plane_per_scan, settings.field_of_view_deg
    if points != defaults.points_per_plane_per_scan:
        words += ["--points-per-plane-per-scan", "all" if points is None else str(points)]
    if angle_deg != defaults.field_of_view_deg:
        words += ["--field-of-view-deg", "180" if angle_deg is None else f"{angle_deg:.10g}"]
    words += _sensor_words(settings)
    for start_s, end_s in settings.excluded_spans_s:
        words.append(f"--exclude={start_s:.10g}:{end_s:.10g}")
    for prior in settings.priors:
        words.append(f"--prior={prior.axis}={prior.value!r}+-{prior.std!r}")
    if not settings.estimate_time_offset:
        words.append("--fix-time-offset")
    if not settings.estimate_planes:
        words.append("--fix-planes")
    if settings.bias_model != defaults.bias_model:
        words += ["--bias-model", settings.bias_model]
    if settings.imu_sampling != defaults.imu_sampling:
        words += ["--imu-sampling", settings.imu_sampling]
    if settings.lidar_sampling != defaults.lidar_sampling:
        words += ["--lidar-sampling", settings.lidar_sampling]
    if settings.random_seed != defaults.random_seed:
        words += ["--random-seed", str(settings.random_seed)]
    if settings.max_rounds != defaults.max_rounds:
        words += ["--max-rounds", str(settings.max_rounds)]
    return words


def _sensor_words(settings: CalibrateSettings) -> list[str]:
    """The sensors' own parameters, no block at all is the same as `off`; and whose points they are."""
    named = settings.intrinsics if isinstance(settings.intrinsics, str) else ",".join(settings.intrinsics) or "off"
    words = [] if named == CalibrateSettings().intrinsics else ["--intrinsics", named]
    words += [] if settings.cloud == CalibrateSettings().cloud else ["--cloud", settings.cloud]
    return words if settings.lidar is None else [*words, "--lidar", settings.lidar]


def _gravity_word(gravity: Gravity) -> str | None:
    if gravity == Gravity():
        return "free"
    if gravity.std_m_s2 == 0.0 and LEAST_GRAVITY_M_S2 < gravity.magnitude_m_s2 < MOST_GRAVITY_M_S2:
        return repr(gravity.magnitude_m_s2)
    if gravity.std_m_s2 == LATITUDE_GRAVITY_STD_M_S2:
        latitude_deg = _latitude_deg(gravity.magnitude_m_s2)
        return None if latitude_deg is None else f"latitude:{latitude_deg:.6f}"
    return None


def _latitude_deg(magnitude_m_s2: float) -> float | None:
    """Where on the northern half gravity is so strong, by bisection of the closed formula."""
    low, high = 0.0, 90.0
    if not gravity_at_latitude_m_s2(low) <= magnitude_m_s2 <= gravity_at_latitude_m_s2(high):
        return None
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if gravity_at_latitude_m_s2(middle) < magnitude_m_s2 else (low, middle)
    return low


def _planes_text(planes: tuple[OrderedPlane, ...]) -> str:
    entries = [plane.model_dump(mode="json", exclude={"color"}, exclude_defaults=True) for plane in planes]
    return json.dumps({"schema": "unsweep.planes/1", "planes": entries}, indent=2) + "\n"


def _guess_text(guess: InitialGuess) -> str:
    document: dict[str, object] = {}
    if guess.matrix is not None:
        document["T_imu_lidar"] = {"matrix": guess.matrix}
    if guess.time_offset_s is not None:
        document["time_offset_s"] = guess.time_offset_s
    return json.dumps(document, indent=2) + "\n"
