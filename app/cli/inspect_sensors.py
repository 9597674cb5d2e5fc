"""The terminal's part of a report on what was measured: the lidar, the IMU and the motion, facts and strips."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from calib_core.doctor.report import (
    DoctorReport,
    ExcitationReport,
    ImuNoiseReport,
    ImuReport,
    LidarReport,
    Span,
    StampReport,
)
from calib_core.phrasing import counted

_UNITS = {"m_s2": "m/s²", "rad_s": "rad/s", "deg_s": "deg/s"}
_BLOCKS = " ▁▂▃▄▅▆▇█"
_STRIP_CELLS = 60


#: What stands for point times that a cloud does not have, by the finding that says so.
_NO_TIMES = {
    "points.time_synthesised": "made up, as asked: the clouds carry none",
    "points.at_once": "all points of a cloud at its stamp, as asked",
}


def lidar_block(lidar: LidarReport, found: Collection[str] = ()) -> RenderableType:
    """What is known of the lidar. found: codes of what was found in the recording."""
    facts = _facts()
    facts.add_row("topic", Text(f"{lidar.topic}   frame {lidar.frame_id or '(none)'}"))
    facts.add_row("layout", Text(f"{lidar.layout}   {counted(lidar.rings, 'ring')}   {counted(lidar.scans, 'scan')}"))
    facts.add_row("stamps", _stamps(lidar.stamps))
    if lidar.point_time is None:
        instead = next((text for code, text in _NO_TIMES.items() if code in found), None)
        none = Text("none: the clouds carry no time for each point", style="red")
        facts.add_row("point time", none if instead is None else Text(instead))
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


def imu_block(imu: ImuReport, clock_offset_s: float) -> RenderableType:
    """What is known of the IMU, and of its clock beside the lidar's."""
    facts = _facts()
    facts.add_row("topic", Text(f"{imu.topic}   frame {imu.frame_id or '(none)'}   {imu.readings:,} readings"))
    facts.add_row("stamps", _stamps(imu.stamps))
    units = " and ".join(_UNITS.get(unit, unit) for unit in (imu.accelerometer_unit, imu.gyroscope_unit))
    when = "at rest" if imu.still_spans else "never at rest,"
    facts.add_row("units", Text(f"{units}; {when} it reads {imu.gravity_at_rest_m_s2:.3f} m/s²"))
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
    return Text.assemble((f"{gyro:.2g} rad/s/√Hz, {accel:.2g} m/s²/√Hz", style), (f"   {name}{noise.source}", "dim"))


def motion_block(report: DoctorReport, imu: ImuReport) -> RenderableType:
    """How fast it turned over time, when it stood still, and how much of each axis there was."""
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


def _cells(values: Sequence[float], digits: int) -> list[str]:
    return [f"{value:.{digits}f}" for value in values]
