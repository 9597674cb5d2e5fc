"""A calibration result told to a person: the verdict, the numbers with their error bars, what to do next."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from app.cli.terminal import LEVEL_STYLES, bullet
from app.results.sensors import biggest_of_sensors
from app.results.verdict import offset_holds, rests_on, sigma_of_offset, tone, verdict
from app.schemas.jobs import Tone
from calib_core.result import CalibrationResult, Transform, Uncertainty
from calib_core.sigmas import std_row, value_row

#: Sentences about the sensors; a screen has room for so many, and the result has them all.
_MOST_OF_SENSORS = 3
_TONE_STYLES: dict[Tone, str] = {"good": "bold green", "doubtful": "bold yellow", "bad": "bold red"}


def refusal(result: CalibrationResult) -> str:
    """Why a refused result has no answer, in one sentence."""
    reasons = [message.text for message in result.messages if message.level == "error"]
    return reasons[0] if reasons else "The recording cannot give the answer; record one with turns about all axes."


def result_summary(result: CalibrationResult) -> RenderableType:
    """The whole summary as one block."""
    parts: list[RenderableType] = [Text(verdict(result), style=_TONE_STYLES[tone(result)])]
    if result.T_imu_lidar is not None and result.uncertainty is not None and result.time_offset_s is not None:
        parts.append(_numbers(result.T_imu_lidar, result.uncertainty, result.time_offset_s, sigma_of_offset(result)))
        if holds := offset_holds(result):
            parts.append(Text(holds, style="dim"))
    parts.append(Text(rests_on(result), style="dim"))
    parts += _remarks(result)
    parts += _of_sensors(result)
    return Panel(Group(*parts), title="unsweep", title_align="left", border_style="dim", padding=(0, 1))


def _numbers(
    transform: Transform, uncertainty: Uncertainty, time_offset_s: float, offset_std_s: float | None
) -> RenderableType:
    table = Table(box=None, padding=(0, 1), show_header=True, header_style="dim")
    table.add_column("T_imu_lidar: takes lidar coordinates to IMU coordinates")
    for axis in "xyz":
        table.add_column(axis, justify="right", min_width=10)
    table.add_column("")
    turns, places = uncertainty.rotation_std_deg, uncertainty.translation_std_m
    # None of the three has a sigma of its own: to the digits that the surest turn deserves.
    table.add_row("rotation (roll, pitch, yaw)", *_row(value_row(transform.euler_xyz_deg, [min(turns)] * 3, "deg")))
    table.add_row("  [dim]1 sigma, about the lidar's axes[/]", *_row(std_row(turns, "deg")))
    table.add_row("translation (lidar seen from the IMU)", *_row(value_row(transform.translation_m, places, "m")))
    table.add_row("  [dim]1 sigma, along the IMU's axes[/]", *_row(std_row(places, "m")))
    (offset,), offset_unit = value_row([time_offset_s], [offset_std_s], "s")
    (sigma,), sigma_unit = std_row([offset_std_s], "s")
    table.add_row("time offset (add to IMU stamps)", offset, "", "", offset_unit)
    table.add_row("  [dim]1 sigma[/]", sigma, "", "", sigma_unit)
    return Padding(table, (1, 0))


def _remarks(result: CalibrationResult) -> list[RenderableType]:
    """Messages worth reading, weak directions and advice, each said once."""
    told = verdict(result).casefold()  # where a message begins a sentence
    lines: list[RenderableType] = []
    remarks = [
        (message.text, LEVEL_STYLES[message.level])
        for message in result.messages
        if message.level == "warning" or (message.level == "error" and result.status != "refused")
    ]
    remarks += [(direction.text, "yellow") for direction in result.observability.weak_directions]
    remarks += [(f"Next time: {text}", "cyan") for text in result.observability.advice]
    for text, style in remarks:
        if text.casefold() not in told:
            told += f" {text.casefold()}"
            lines.append(bullet("-", Text(text), style))
    return lines


def _of_sensors(result: CalibrationResult) -> list[RenderableType]:
    """What the sensors themselves add: the first few of the document's sentences, and where the others are."""
    few, more = biggest_of_sensors(result, _MOST_OF_SENSORS)
    if more:
        few.append(
            f"and {more} more of the sensors' own errors: `messages` of the result, its report and its page have them all"
        )
    return [bullet("-", Text(text[:1].upper() + text[1:]), LEVEL_STYLES["info"]) for text in few]


def _row(told: tuple[list[str], str]) -> list[str]:
    cells, unit = told
    return [*cells, unit]
