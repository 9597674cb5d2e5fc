"""The doctor's report for a terminal: what was found, what a solve would know, and last, where the eye rests, the verdict.

What a terminal still shows when the program has ended is its last screen: there stand the verdict and what to do.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from datetime import UTC, datetime
from math import floor, log10
from pathlib import Path

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.panel import Panel
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from app.cli.terminal import LEVEL_STYLES, bullet, error_bar
from app.weak_limits import WEAK_DEG, WEAK_M, WEAK_S
from calib_core.doctor.report import (
    DoctorReport,
    ExcitationReport,
    FindingReport,
    Forecast,
    ImuNoiseReport,
    ImuReport,
    LidarReport,
    ParameterForecast,
    PlanesReport,
    Span,
    StampReport,
)

_VERDICTS = {
    "good": ("bold green", "Good: this recording can be calibrated."),
    "limited": ("bold yellow", "Usable with limits."),
    "unusable": ("bold red", "Not usable."),
}
_UNITS = {"m_s2": "m/s²", "rad_s": "rad/s", "deg_s": "deg/s"}
_MARKS = {"info": "·", "warning": "▲", "error": "✗"}
_BLOCKS = " ▁▂▃▄▅▆▇█"
_STRIP_CELLS = 60
_SHOWN_TOPICS = 24
#: Beyond so many times what counts as weak, a number would only pretend to be one.
_UNKNOWN_TIMES = 5.0
_FORECAST_ROWS = (
    ("rotation, about the lidar's", ("rx", "ry", "rz"), 1.0, "deg", WEAK_DEG),
    ("lever arm, along the IMU's", ("tx", "ty", "tz"), 1e3, "mm", WEAK_M),
    ("time offset", ("dt",), 1e3, "ms", WEAK_S),
)


def report_block(report: DoctorReport, path: Path | None = None) -> RenderableType:
    """The whole report as one block for a console. path: of the recording, as it was given."""
    parts: list[RenderableType] = [_title(report), _section("Topics"), _topics(report)]
    if report.lidar is not None:
        parts += [_section("Lidar"), _lidar(report.lidar)]
    if report.imu is not None:
        parts += [_section("IMU"), _imu(report.imu, report.clock_offset_s)]
        parts += [_section("Motion"), _motion(report, report.imu)]
    if report.findings:
        parts += [_section("Findings"), _findings(report.findings)]
    if report.planes is not None:
        parts += [_section("Planes to expect"), _planes(report.planes)]
    if report.forecast is not None:
        parts += [_section("Forecast: what a solve would know (1 sigma)"), _forecast(report.forecast)]
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
        lines.append(Text(f"Next: unsweep calibrate {shlex.quote(path)}", style="dim"))
    return Panel(Group(*lines), title="Verdict", title_align="left", border_style=colour, padding=(0, 1))


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


def _lidar(lidar: LidarReport) -> RenderableType:
    facts = _facts()
    facts.add_row("topic", Text(f"{lidar.topic}   frame {lidar.frame_id or '(none)'}"))
    facts.add_row("layout", Text(f"{lidar.layout}   {lidar.rings} rings   {lidar.scans:,} scans"))
    facts.add_row("stamps", _stamps(lidar.stamps))
    if lidar.point_time is None:
        facts.add_row("point time", Text("none: the clouds carry no time for each point", style="red"))
    else:
        time = lidar.point_time
        spread = f"{1e3 * time.first_after_header_s:+.1f} to {1e3 * time.last_after_header_s:+.1f} ms after the header"
        sure = f"{100 * time.confidence:.0f} % sure"
        facts.add_row("point time", Text(f"field {time.field}, {time.unit}, {time.reference}: {spread} ({sure})"))
    if lidar.ranges is not None:
        r = lidar.ranges
        facts.add_row(
            "ranges",
            f"{r.p05_m:.1f} to {r.p95_m:.1f} m, median {r.median_m:.1f} m; {r.points_per_scan:,} points a scan, "
            f"{100 * r.no_return_share:.0f} % without return",
        )
    known = lidar.preset.name if lidar.preset.identified else f"{lidar.preset.name}, as the sensor is not recognised"
    preset = f"{1e3 * lidar.preset.range_std_m:.0f} mm ({known})"
    if lidar.measured_range_std_m is None:
        facts.add_row("range noise", Text(f"preset {preset}; a solve measures it"))
    else:
        measured = Text(f"{1e3 * lidar.measured_range_std_m:.1f} mm", style="bold")
        facts.add_row(
            "range noise", measured.append(f" measured on the planes, used; preset {preset}", style="not bold")
        )
    return facts


def _imu(imu: ImuReport, clock_offset_s: float) -> RenderableType:
    facts = _facts()
    facts.add_row("topic", Text(f"{imu.topic}   frame {imu.frame_id or '(none)'}   {imu.readings:,} readings"))
    facts.add_row("stamps", _stamps(imu.stamps))
    units = " and ".join(_UNITS.get(unit, unit) for unit in (imu.accelerometer_unit, imu.gyroscope_unit))
    facts.add_row("units", Text(f"{units}; at rest it reads {imu.gravity_at_rest_m_s2:.3f} m/s²"))
    if imu.measured_noise is not None:
        facts.add_row("noise, used", _noise(imu.measured_noise, "bold"))
    preset = "noise, preset" if imu.measured_noise is not None else "noise, used"
    facts.add_row(preset, _noise(imu.preset_noise, "dim" if imu.measured_noise is not None else ""))
    peaks = imu.saturation
    clipped = max(peaks.gyroscope_clipped_share, peaks.accelerometer_clipped_share)
    clipping = "nothing clipped" if clipped == 0 else f"{100 * clipped:.2f} % clipped"
    facts.add_row(
        "extremes", f"{peaks.gyroscope_max_rad_s:.2g} rad/s, {peaks.accelerometer_max_m_s2:.3g} m/s²; {clipping}"
    )
    if clock_offset_s:
        facts.add_row("clock", f"{clock_offset_s:+.3f} s between the IMU's clock and the lidar's, coarsely")
    return facts


def _noise(noise: ImuNoiseReport, style: str) -> Text:
    gyro = noise.noise.gyroscope_noise_density_rad_s_sqrt_hz
    accel = noise.noise.accelerometer_noise_density_m_s2_sqrt_hz
    name = "" if noise.origin == "measured" else f"{noise.origin}: "
    return Text.assemble((f"{gyro:.1e} rad/s/√Hz, {accel:.1e} m/s²/√Hz", style), (f"   {name}{noise.source}", "dim"))


def _motion(report: DoctorReport, imu: ImuReport) -> RenderableType:
    parts: list[RenderableType] = []
    timeline = report.timeline
    if timeline.rotation_norm_deg_s:
        peak = max(timeline.rotation_norm_deg_s)
        strip = sparkline(timeline.rotation_norm_deg_s, _STRIP_CELLS)
        parts.append(Text.assemble((f"  0 to {peak:.2g} deg/s".ljust(18), "dim"), (strip, "cyan")))
        still = still_strip(imu.still_spans, report.duration_s)
        parts.append(Text.assemble(("  standing still".ljust(18), "dim"), (still, "green")))
        ends = "0 s" + f"{report.duration_s:.0f} s".rjust(_STRIP_CELLS - 3)
        parts.append(Text(" " * 18 + ends, style="dim"))
    parts.append(_excitation(imu.excitation))
    return Group(*parts)


def _excitation(motion: ExcitationReport) -> RenderableType:
    table = Table(box=None, padding=(0, 2, 0, 2), header_style="dim")
    table.add_column("about the IMU's")
    for axis in "xyz":
        table.add_column(axis, justify="right")
    table.add_column("")
    table.add_row("rate of turn, rms", *_cells(motion.rotation_rms_deg_s, 1), "deg/s")
    table.add_row("rate of turn, peak", *_cells(motion.rotation_peak_deg_s, 1), "deg/s")
    table.add_row("angular acceleration, peak", *_cells(motion.angular_acceleration_peak_deg_s2, 0), "deg/s²")
    table.add_row("acceleration, rms", *_cells(motion.acceleration_rms_m_s2, 2), "m/s²")
    weakest = ", ".join(f"{value:+.2f}" for value in motion.weakest_axis)
    least = f"turned least about [{weakest}]: {motion.weakest_axis_rms_deg_s:.1f} deg/s rms"
    return Group(table, Text(f"  moving for {motion.moving_s:.1f} s; {least}", style="dim"))


def _planes(planes: PlanesReport) -> RenderableType:
    table = Table(box=None, padding=(0, 2, 0, 2), header_style="dim")
    table.add_column("")
    for title in ("area", "distance", "tilt", "roughness"):
        table.add_column(title, justify="right")
    for plane in planes.planes:
        tilt = "" if plane.tilt_deg is None else f"{plane.tilt_deg:.0f}°"
        distance = f"{plane.distance_m:.1f} m"
        table.add_row(Text(plane.name), f"{plane.area_m2:.1f} m²", distance, tilt, f"{1e3 * plane.rms_m:.0f} mm")
    said = Text(f"  {planes.text}", style="green" if planes.determined else "yellow")
    return Group(table, said) if planes.planes else said


def _forecast(forecast: Forecast) -> RenderableType:
    if not forecast.parameters:
        return Text(f"  {forecast.text or forecast.reason}", style="yellow")
    by_name = {parameter.name: parameter for parameter in forecast.parameters}
    table = Table(box=None, padding=(0, 2, 0, 2), header_style="dim")
    table.add_column("")
    for axis in "xyz":
        table.add_column(axis, justify="right", min_width=8)
    table.add_column("")
    table.add_column("")
    for title, names, scale, unit, weak in _FORECAST_ROWS:
        found = [by_name[name] for name in names if name in by_name]
        if found:
            cells = [_known(parameter, scale, weak) for parameter in found]
            blank = [Text("")] * (3 - len(cells))
            table.add_row(title, *cells, *blank, unit, error_bar(max(p.std for p in found), weak))
    limits = f"  weak beyond {WEAK_DEG:g} deg, {1e3 * WEAK_M:g} mm, {1e3 * WEAK_S:g} ms"
    rests = f"; from {len(forecast.planes)} planes" if forecast.planes else ""
    rests += f" and {forecast.covered_s:.0f} s of motion" if forecast.covered_s else ""
    return Group(table, Text(limits + rests, style="dim"))


def _known(parameter: ParameterForecast, scale: float, weak: float) -> Text:
    """One standard deviation with two digits, and whether that is little."""
    if parameter.weak and parameter.std > _UNKNOWN_TIMES * weak:
        return Text("unknown", style="bold yellow")
    value = scale * parameter.std
    digits = max(0, 1 - floor(log10(value))) if value > 0 else 2
    return Text(
        f"{value:.{digits}f}" + (" weak" if parameter.weak else ""), style="yellow" if parameter.weak else "green"
    )


def _findings(findings: Sequence[FindingReport]) -> RenderableType:
    order = {"error": 0, "warning": 1, "info": 2}
    lines: list[RenderableType] = []
    for finding in sorted(findings, key=lambda finding: order[finding.level]):
        style = LEVEL_STYLES[finding.level] if finding.level != "info" else ""
        sure = f" ({100 * finding.confidence:.0f} % sure)" if finding.confidence < 0.995 else ""
        evidence = ", ".join(f"{e.name} {_value(e.value)} {e.unit}".rstrip() for e in finding.evidence)
        override = f"To override: {finding.override}" if finding.override else ""
        details = [evidence, ". ".join(part for part in (_sentence(finding.consequence), override) if part)]
        words = Group(
            Text(f"{finding.text}{sure}", style=style), *(Text(line, style="dim") for line in details if line)
        )
        lines.append(Padding(bullet(_MARKS[finding.level], words, style), (0, 0, 0, 2)))
    return Group(*lines)


def _sentence(words: str) -> str:
    return words[:1].upper() + words[1:].rstrip(".")


def sparkline(values: Sequence[float], cells: int) -> str:
    """The largest of each stretch of `values` as a strip of `cells` blocks, the tallest for the largest of all."""
    top = max(values)
    count = min(cells, len(values))
    strip = ""
    for cell in range(count):
        stretch = values[cell * len(values) // count : (cell + 1) * len(values) // count]
        share = max(stretch) / top if top > 0 else 0.0
        strip += _BLOCKS[round(share * (len(_BLOCKS) - 1))]
    return strip


def still_strip(spans: Sequence[Span], duration_s: float, cells: int = _STRIP_CELLS) -> str:
    """A strip of `cells` over the recording, filled where it stands still."""
    step_s = duration_s / cells
    middles_s = [(cell + 0.5) * step_s for cell in range(cells)]
    return "".join("━" if any(s.start_s <= t <= s.end_s for s in spans) else "·" for t in middles_s)


def _stamps(stamps: StampReport) -> Text:
    text = Text(f"{stamps.rate_hz:.2f} Hz, jitter {1e3 * stamps.jitter_s:.2f} ms")
    faults = (
        (stamps.duplicates, "duplicate", "duplicates"),
        (stamps.rewinds, "rewind", "rewinds"),
        (stamps.gaps, "gap", "gaps"),
        (stamps.dropped, "message missing", "messages missing"),
    )
    said = ", ".join(f"{count:,} {one if count == 1 else many}" for count, one, many in faults if count)
    if said:
        text.append(f"; {said}", style="yellow")
        if stamps.gaps:
            text.append(f", the longest gap {stamps.longest_gap_s:.2f} s", style="yellow")
    else:
        text.append("; no gaps, duplicates or rewinds", style="green")
    return text


def _facts() -> Table:
    table = Table(box=None, padding=(0, 2, 0, 2), show_header=False)
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    return table


def _value(value: float | str) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _size(size_bytes: int) -> str:
    size, unit = float(size_bytes), "B"
    for larger in ("kB", "MB", "GB", "TB"):
        if size < 1000:
            break
        size, unit = size / 1000, larger
    return f"{size:.0f} {unit}" if unit == "B" else f"{size:.1f} {unit}"


def _cells(values: Sequence[float], digits: int) -> list[str]:
    return [f"{value:.{digits}f}" for value in values]
