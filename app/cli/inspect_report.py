"""The doctor's report for a terminal: what was found, what a solve would know, and last, where the eye rests, the verdict.

What a terminal still shows when the program has ended is its last screen: there stand the verdict and what to do.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.panel import Panel
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from app.cli.inspect_outlook import forecast_block, planes_block
from app.cli.inspect_sensors import imu_block, lidar_block, motion_block
from app.cli.terminal import LEVEL_STYLES, bullet
from calib_core.doctor.report import DoctorReport, FindingReport

_VERDICTS = {
    "good": ("bold green", "Good: this recording can be calibrated."),
    "limited": ("bold yellow", "Usable with limits."),
    "unusable": ("bold red", "Not usable."),
}
_MARKS = {"info": "·", "warning": "▲", "error": "✗"}
_SHOWN_TOPICS = 24


def report_block(report: DoctorReport, path: Path | None = None) -> RenderableType:
    """The whole report as one block for a console. path: of the recording, as it was given."""
    parts: list[RenderableType] = [_title(report), _section("Topics"), _topics(report)]
    if report.lidar is not None:
        parts += [_section("Lidar"), lidar_block(report.lidar, {finding.code for finding in report.findings})]
    if report.imu is not None:
        parts += [_section("IMU"), imu_block(report.imu, report.clock_offset_s)]
        parts += [_section("Motion"), motion_block(report, report.imu)]
    if report.findings:
        parts += [_section("Findings"), _findings(report.findings)]
    if report.planes is not None:
        parts += [_section("Planes to expect"), planes_block(report.planes)]
    if report.forecast is not None:
        parts += [_section("Forecast: what a solve would know (1 sigma)"), forecast_block(report.forecast)]
    advice = dict.fromkeys((*report.advice, *(report.forecast.advice if report.forecast else ())))
    if advice:
        parts += [_section("What to do"), *(Padding(bullet("→", Text(line), "cyan"), (0, 0, 0, 2)) for line in advice)]
    return Group(*parts, "", _verdict(report, str(path or report.name)))


def _title(report: DoctorReport) -> RenderableType:
    start = datetime.fromtimestamp(report.start_ns / 1e9, UTC)
    facts = f"   {_size(report.size_bytes)}   {report.duration_s:.1f} s   {report.container.upper()}"
    when = f"   starts {start:%Y-%m-%d %H:%M:%S} UTC"
    return Text.assemble((report.name, "bold"), (facts + when, "dim"))


def _verdict(report: DoctorReport, path: str) -> RenderableType:
    style, sentence = _VERDICTS[report.verdict]
    colour = style.removeprefix("bold ")
    lines: list[RenderableType] = [Text(sentence, style=style)]
    lines += [bullet("-", Text(reason), colour) for reason in report.reasons]
    if report.verdict != "unusable":
        lines.append(Text(f"Next: {_next_command(report, path)}", style="dim"))
    return Panel(Group(*lines), title="Verdict", title_align="left", border_style=colour, padding=(0, 1))


def _next_command(report: DoctorReport, path: str) -> str:
    """What calibrates the recording as it was looked at; a word in capitals stands for a topic that is still to be chosen."""
    words = ["unsweep", "calibrate", shlex.quote(path)]
    for sensor, candidates, found in (
        ("lidar", report.lidar_candidates, report.lidar),
        ("imu", report.imu_candidates, report.imu),
    ):
        if len(candidates) > 1:
            words += [f"--{sensor}-topic", "TOPIC" if found is None else shlex.quote(found.topic)]
    return " ".join(words)


def _section(title: str) -> RenderableType:
    return Padding(Rule(Text(title, style="bold"), align="left", style="dim"), (1, 0, 0, 0))


def _topics(report: DoctorReport) -> RenderableType:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    for title in ("", "topic", "type"):
        table.add_column(title, overflow="fold")
    table.add_column("messages", justify="right")
    table.add_column("rate", justify="right")
    chosen = {part.topic for part in (report.lidar, report.imu) if part is not None}
    for topic in report.topics[:_SHOWN_TOPICS]:
        style = "bold" if topic.name in chosen else "" if topic.role in {"lidar", "imu"} else "dim"
        mark = "●" if topic.name in chosen else "○" if topic.role in {"lidar", "imu"} else ""
        rate = f"{topic.rate_hz:.1f} Hz" if topic.rate_hz else ""
        table.add_row(mark, Text(topic.name), Text(topic.type), f"{topic.messages:,}", rate, style=style)
    hidden = len(report.topics) - _SHOWN_TOPICS
    return Group(table, Text(f"  and {hidden} more", style="dim")) if hidden > 0 else table


def _override(finding: FindingReport) -> str:
    """The options that overrule the finding; without values where those are what it has found, which change nothing."""
    if finding.code != "points.time_field":
        return finding.override
    return " ".join(word for word in finding.override.split() if word.startswith("--"))


def _findings(findings: Sequence[FindingReport]) -> RenderableType:
    order = {"error": 0, "warning": 1, "info": 2}
    lines: list[RenderableType] = []
    for finding in sorted(findings, key=lambda finding: order[finding.level]):
        style = LEVEL_STYLES[finding.level] if finding.level != "info" else ""
        sure = f" ({100 * finding.confidence:.0f} % sure)" if finding.confidence < 0.995 else ""
        evidence = ", ".join(f"{e.name} {_value(e.value)} {e.unit}".rstrip() for e in finding.evidence)
        override = f"To override: {_override(finding)}" if finding.override else ""
        details = [evidence, ". ".join(part for part in (_sentence(finding.consequence), override) if part)]
        words = Group(
            Text(f"{finding.text}{sure}", style=style), *(Text(line, style="dim") for line in details if line)
        )
        lines.append(Padding(bullet(_MARKS[finding.level], words, style), (0, 0, 0, 2)))
    return Group(*lines)


def _sentence(words: str) -> str:
    return words[:1].upper() + words[1:].rstrip(".")


def _value(value: float | str) -> str:
    if isinstance(value, str):
        return value
    # What was rounded to nothing from below is no less than nothing.
    return f"{value:,}" if isinstance(value, int) else f"{value + 0.0:.4g}"


def _size(size_bytes: int) -> str:
    size, unit = float(size_bytes), "B"
    for larger in ("kB", "MB", "GB", "TB"):
        if size < 1000:
            break
        size, unit = size / 1000, larger
    return f"{size:.0f} {unit}" if unit == "B" else f"{size:.1f} {unit}"
