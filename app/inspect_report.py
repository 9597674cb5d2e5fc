"""The doctor's report for a terminal: verdict first, then what was found, then what to do about it."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.panel import Panel
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from app.terminal import LEVEL_STYLES, WEAK_DEG, WEAK_M, WEAK_S, bullet, error_bar
from calib_core.doctor.report import (
    DoctorReport,
    ExcitationReport,
    FindingReport,
    Forecast,
    ImuReport,
    LidarReport,
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


def report_block(report: DoctorReport) -> RenderableType:
    """The whole report as one block for a console."""
    parts: list[RenderableType] = [_verdict(report), _section("Topics"), _topics(report)]
    if report.lidar is not None:
        parts += [_section("Lidar"), _lidar(report.lidar)]
    if report.imu is not None:
        parts += [_section("IMU"), _imu(report.imu, report.clock_offset_s)]
        parts += [_section("Motion"), _motion(report, report.imu)]
    if report.forecast is not None:
        parts += [_section("Forecast: what a solve would know"), _forecast(report.forecast)]
    if report.findings:
        parts += [_section("Findings"), _findings(report.findings)]
    advice = dict.fromkeys((*report.advice, *(report.forecast.advice if report.forecast else ())))
    if advice:
        parts += [_section("What to do"), *(Padding(bullet("→", Text(line), "cyan"), (0, 0, 0, 2)) for line in advice)]
    return Group(*parts)


def _verdict(report: DoctorReport) -> RenderableType:
    style, sentence = _VERDICTS[report.verdict]
    start = datetime.fromtimestamp(report.start_ns / 1e9, UTC)
    facts = f"{report.name}   {_size(report.size_bytes)}   {report.duration_s:.1f} s   {report.container.upper()}"
    lines: list[RenderableType] = [Text(sentence, style=style)]
    lines += [bullet("-", Text(reason), style.removeprefix("bold ")) for reason in report.reasons]
    lines.append(Text(f"{facts}   starts {start:%Y-%m-%d %H:%M:%S} UTC", style="dim"))
    border = style.removeprefix("bold ")
    return Panel(Group(*lines), title="unsweep inspect", title_align="left", border_style=border, padding=(0, 1))


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
    known = "" if lidar.preset.identified else " (sensor not recognised)"
    facts.add_row("range noise", Text(f"{1e3 * lidar.preset.range_std_m:.0f} mm, {lidar.preset.name}{known}"))
    return facts


def _imu(imu: ImuReport, clock_offset_s: float) -> RenderableType:
    facts = _facts()
    facts.add_row("topic", Text(f"{imu.topic}   frame {imu.frame_id or '(none)'}   {imu.readings:,} readings"))
    facts.add_row("stamps", _stamps(imu.stamps))
    units = " and ".join(_UNITS.get(unit, unit) for unit in (imu.accelerometer_unit, imu.gyroscope_unit))
    facts.add_row("units", Text(f"{units}; at rest it reads {imu.gravity_at_rest_m_s2:.3f} m/s²"))
    for origin, noise in (("measured", imu.measured_noise), ("preset", imu.preset_noise)):
        if noise is not None:
            gyro = noise.noise.gyroscope_noise_density_rad_s_sqrt_hz
            accel = noise.noise.accelerometer_noise_density_m_s2_sqrt_hz
            used = "used" if imu.noise_used == origin else "not used"
            facts.add_row(
                f"noise, {origin}", Text(f"{gyro:.2e} rad/s/√Hz, {accel:.2e} m/s²/√Hz   {noise.source} ({used})")
            )
    peaks = imu.saturation
    clipped = max(peaks.gyroscope_clipped_share, peaks.accelerometer_clipped_share)
    clipping = "nothing clipped" if clipped == 0 else f"{100 * clipped:.2f} % clipped"
    facts.add_row(
        "extremes", f"{peaks.gyroscope_max_rad_s:.1f} rad/s, {peaks.accelerometer_max_m_s2:.1f} m/s²; {clipping}"
    )
    if clock_offset_s:
        facts.add_row("clock", f"{clock_offset_s:+.3f} s between the IMU's clock and the lidar's, coarsely")
    return facts


def _motion(report: DoctorReport, imu: ImuReport) -> RenderableType:
    parts: list[RenderableType] = []
    timeline = report.timeline
    if timeline.rotation_norm_deg_s:
        peak = max(timeline.rotation_norm_deg_s)
        strip = sparkline(timeline.rotation_norm_deg_s, _STRIP_CELLS)
        parts.append(Text.assemble((f"  0 to {peak:.0f} deg/s".ljust(18), "dim"), (strip, "cyan")))
        still = still_strip(imu.still_spans, report.duration_s)
        parts.append(Text.assemble(("  standing still".ljust(18), "dim"), (still, "green")))
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


def _forecast(forecast: Forecast) -> RenderableType:
    table = Table(box=None, padding=(0, 2, 0, 2), show_header=False)
    for justify in ("left", "right", "left", "left"):
        table.add_column(justify="right" if justify == "right" else "left")
    scales = {"deg": (1.0, "deg", WEAK_DEG), "m": (1e3, "mm", WEAK_M), "s": (1e3, "ms", WEAK_S)}
    for parameter in forecast.parameters:
        scale, unit, weak = scales[parameter.unit]
        digits = f"± {scale * parameter.std:.4g} {unit}"
        remark = Text("weak", style="yellow") if parameter.weak else Text("")
        table.add_row(parameter.name, digits, error_bar(parameter.std, weak), remark)
    planes = f"  from {len(forecast.planes)} planes: {', '.join(forecast.planes)}" if forecast.planes else ""
    return Group(table, Text(planes, style="dim")) if planes else table


def _findings(findings: Sequence[FindingReport]) -> RenderableType:
    order = {"error": 0, "warning": 1, "info": 2}
    lines: list[RenderableType] = []
    for finding in sorted(findings, key=lambda finding: order[finding.level]):
        style = LEVEL_STYLES[finding.level] if finding.level != "info" else ""
        sure = f" ({100 * finding.confidence:.0f} % sure)" if finding.confidence < 0.995 else ""
        evidence = ", ".join(f"{e.name} {_value(e.value)} {e.unit}".rstrip() for e in finding.evidence)
        details = [finding.consequence, evidence, f"to override: {finding.override}" if finding.override else ""]
        words = Group(
            Text(f"{finding.text}{sure}", style=style), *(Text(line, style="dim") for line in details if line)
        )
        lines.append(Padding(bullet(_MARKS[finding.level], words, style), (0, 0, 0, 2)))
    return Group(*lines)


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
