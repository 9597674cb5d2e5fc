"""A result as one self-contained page that one can print, file and sign: verdict, numbers, evidence, origin.

The template says what stands where; here is what it needs, drawn and worded. Everything that comes from a file is
escaped by the template engine; the page asks for nothing from a network and runs no script.
"""

from __future__ import annotations

import hashlib
import json
import shlex
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from app.results import captions, plot_parts, plots
from app.results.agreement import PLANES, RANGES, STRETCHES
from app.results.companions import Beside
from app.results.sensors import kinds_of
from app.results.verdict import HEADINGS, disagreeing, offset_holds, rests_on, sigma_of_offset, told, tone
from app.schemas.evidence import Evidence
from calib_core.result import CalibrationResult
from calib_core.settings import CalibrateSettings
from calib_core.sigmas import HELD, Unit, std_text, value_text

if TYPE_CHECKING:
    from jinja2 import Template


@dataclass(frozen=True)
class Figure:
    """A picture and the sentence that says what to see in it."""

    title: str
    source: str
    caption: str
    half: bool = False


def report_page(result: CalibrationResult, beside: Beside | None = None) -> str:
    """The page."""
    beside = beside or Beside()
    rig, figures = plots.drawn(lambda: (_rig(result), _figures(result, beside)))
    return _template().render(
        result=result,
        heading=HEADINGS[result.status],
        tone=tone(result),
        verdict=told(result),
        rows=_rows(result),
        rests_on=rests_on(result),
        offset_holds=offset_holds(result),
        matrix=None if result.T_imu_lidar is None else result.T_imu_lidar.matrix,
        rig=rig,
        figures=figures,
        kinds=kinds_of(result),
        messages=_messages(result),
        settings=_settings(result),
        made_at=None if beside.made_at is None else beside.made_at.strftime("%Y-%m-%d %H:%M %Z").strip(),
        command=None if beside.command is None else _in_lines(beside.command),
        document_sha256=hashlib.sha256(result.to_json().encode()).hexdigest(),
    )


@cache
def _template() -> Template:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("app.results"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.jinja")


def _rows(result: CalibrationResult) -> list[tuple[str, str, str]]:
    """Name with the unit, value, one sigma.

    Roll, pitch and yaw have none: the sigmas are of turns about the lidar's axes, and once the lidar lies on its side its x is
    not what it rolls about.
    """
    transform, uncertainty, time_offset_s = result.T_imu_lidar, result.uncertainty, result.time_offset_s
    if transform is None or uncertainty is None or time_offset_s is None:
        return []
    turns = uncertainty.rotation_std_deg
    angles = zip(("Roll", "Pitch", "Yaw"), transform.euler_xyz_deg, strict=True)
    rows = [(f"{name} [deg]", value_text(angle, min(turns), "deg")[0], "") for name, angle in angles]
    rows += [
        (f"Turn about the lidar's {axis} [deg]", "", std_text(std, "deg").removesuffix(" deg"))
        for axis, std in zip("xyz", turns, strict=True)
    ]
    places = zip("xyz", transform.translation_m, uncertainty.translation_std_m, strict=True)
    rows += [_row(f"Position along the IMU's {axis}", v, std, "m") for axis, v, std in places]
    return [*rows, _row("Time offset", time_offset_s, sigma_of_offset(result), "s")]


def _row(name: str, value: float, std: float | None, unit: Unit) -> tuple[str, str, str]:
    text, shown_in = value_text(value, std, unit)
    return f"{name} [{shown_in}]", text, HELD if std is None else std_text(std, unit).removesuffix(f" {shown_in}")


def _in_lines(command: str) -> str:
    """A command with a line for each option: one that is broken at a hyphen is no command any more."""
    lines: list[list[str]] = [[]]
    for word in shlex.split(command):
        if word.startswith("--"):
            lines.append([])
        lines[-1].append(word)
    return " \\\n  ".join(shlex.join(words) for words in lines)


def _rig(result: CalibrationResult) -> str | None:
    if result.T_imu_lidar is None:
        return None
    T, recording = np.array(result.T_imu_lidar.matrix), result.provenance.recording
    return plots.rig(T[:3, :3], T[:3, 3], (recording.imu_frame_id, recording.lidar_frame_id))


def _figures(result: CalibrationResult, beside: Beside) -> list[Figure]:
    """Those for which there is something to draw, in the order of the argument."""
    found: list[Figure] = []
    evidence = beside.evidence or Evidence(steps=[])
    if evidence.room is not None:
        found.append(Figure("The room from above, before and after", plots.room(evidence.room), captions.room(result)))
    if evidence.corner is not None:
        found.append(Figure("A detail of the room", plots.room(evidence.corner), captions.corner(evidence.corner)))
    if beside.walls is not None and beside.walls.walls:
        picture = plots.thickness(beside.walls)
        found.append(Figure("How thick the walls are", picture, captions.thickness(beside.walls), half=True))
    if evidence.by_range is not None:
        caption = captions.by_value(evidence.by_range, "range", " m", ranges=evidence.ranges)
        picture = plots.by_value(evidence.by_range, "range [m]")
        found.append(Figure("Distance from planes by range", picture, caption, half=True))
    if evidence.by_ring is not None:
        caption = captions.by_value(evidence.by_ring, "ring", ranges=evidence.ranges)
        picture = plots.by_value(evidence.by_ring, "ring (laser) number")
        found.append(Figure("Distance from planes by ring", picture, caption, half=True))
    found += _of_parts(result)
    if result.quality.planes:
        picture = plots.planes(result.quality.planes, beside.walls)
        found.append(Figure("Spread of the points on each plane", picture, captions.planes(result)))
    if beside.scans is not None and any(rms is not None for rms in beside.scans.rms_m):
        found.append(
            Figure("Spread of the points scan by scan", plots.over_time(beside.scans), captions.over_time(beside.scans))
        )
    if evidence.imu is not None:
        found.append(
            Figure("The IMU, measured and predicted", plots.imu(evidence.imu), captions.imu(evidence.imu, result))
        )
    if len(evidence.steps) > 1:
        found.append(
            Figure("How the solve converged", plots.convergence(evidence.steps), captions.convergence(evidence.steps))
        )
    return found


def _of_parts(result: CalibrationResult) -> list[Figure]:
    """What the recording's parts and its turning say beside the joint answer."""
    inner = result.evidence
    if inner is None:
        return []
    found: list[Figure] = []
    named = disagreeing(result)
    if inner.time_offset_profile is not None:
        picture = plot_parts.offset_profile(inner.time_offset_profile)
        caption = captions.offset_profile(inner.time_offset_profile)
        found.append(Figure("Match of the rates of turn over the time offset", picture, caption, half=True))
    if inner.parts.time_blocks:
        picture, caption = (
            plot_parts.time_blocks(inner.parts.time_blocks),
            captions.time_blocks(inner.parts.time_blocks, torn=STRETCHES in named),
        )
        found.append(Figure("What each stretch of the recording answers alone", picture, caption))
    if inner.parts.planes:
        parts = (inner.parts.planes, inner.parts.ranges)
        caption = captions.planes_and_ranges(*parts, torn=PLANES in named or RANGES in named)
        found.append(
            Figure("What each plane and each range answers alone", plot_parts.planes_and_ranges(*parts), caption)
        )
    return found


def _messages(result: CalibrationResult) -> list[tuple[str, str]]:
    """Level and text, each said once, what matters most first."""
    order = {"error": 0, "warning": 1, "info": 2}
    said = {_unit_signs(message.text): message.level for message in result.messages}
    # What no word goes before begins a line.
    begun = ((level, text[:1].upper() + text[1:] if level == "info" else text) for text, level in said.items())
    return sorted(begun, key=lambda pair: order[pair[0]])


def _unit_signs(text: str) -> str:
    """A sentence that a terminal takes too, as one prints it."""
    return text.replace("m/s2", "m/s²").replace("/sqrt(Hz)", "/√Hz")


#: What the page calls each setting, and what it means that nothing is given.
SETTINGS: dict[str, tuple[str, str]] = {
    "method": ("method", ""),
    "points_per_plane_per_scan": ("points per plane and scan", "all"),
    "field_of_view_deg": ("field of view, ±°", "all around"),
    "gravity": ("gravity", ""),
    "imu_noise": ("IMU noise", "as measured"),
    "estimate_time_offset": ("estimate the time offset", ""),
    "estimate_planes": ("estimate the planes", ""),
    "bias_model": ("biases", ""),
    "imu_sampling": ("IMU sampling", ""),
    "lidar_sampling": ("lidar sampling", ""),
    "cloud": ("points", ""),
    "intrinsics": ("sensors' own errors", ""),
    "lidar": ("lidar", "as recognised"),
    "priors": ("what is known", "nothing"),
    "random_seed": ("seed of the plane search", ""),
    "max_rounds": ("most rounds", ""),
    "crispness": ("measure how crisp the room is", ""),
    "excluded_spans_s": ("spans left out, s", "none"),
}
#: What the page calls the values that have a word in the document.
VALUES: dict[str, str] = {
    "full": "full",
    "paper": "as published",
    "random-walk": "drift slowly",
    "constant": "constant",
    "detect": "as found",
    "as-stamped": "as stamped",
    "as-sent": "taken as sent",
    "even": "evenly",
    "auto": "where they show",
    "consider": "in the error bars only",
    "off": "taken as none",
}


def _settings(result: CalibrationResult) -> list[tuple[str, str, bool]]:
    """Name, value, and whether it is not the default."""
    defaults = CalibrateSettings().model_dump(mode="json")
    given = result.provenance.settings
    return [
        (name, _value(given[key], absent=absent), given[key] != defaults[key])
        for key, (name, absent) in SETTINGS.items()
        if key in given
    ]


def _value(value: object, *, absent: str) -> str:
    """A setting as people write it.   absent: what it means that nothing is given."""
    match value:
        case None | []:
            return absent
        case True | False:
            return "yes" if value else "no"
        case str():
            return VALUES.get(value, value)
        case {"magnitude_m_s2": magnitude, "std_m_s2": std}:
            return f"{magnitude:g} ± {std:g} m/s²"
    return json.dumps(value)
