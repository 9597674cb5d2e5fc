"""The terminal's part of a report on what is ahead: the planes to expect, and what a solve would know."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from app.cli.terminal import error_bar
from calib_core.doctor.report import (
    Forecast,
    ParameterForecast,
    PlanesReport,
)
from calib_core.phrasing import counted
from calib_core.result import WEAK_DEG, WEAK_M, WEAK_S
from calib_core.sigmas import std_cell, tells_nothing

_FORECAST_ROWS = (
    ("rotation", ("rx", "ry", "rz"), "deg", WEAK_DEG),
    ("translation", ("tx", "ty", "tz"), "mm", WEAK_M),
    ("time offset", ("dt",), "ms", WEAK_S),
)


def planes_block(planes: PlanesReport) -> RenderableType:
    """The planes that a solve would find."""
    table = Table(box=None, padding=(0, 2, 0, 2), header_style="dim")
    table.add_column("")
    for title in ("area", "distance", "tilt", "spread"):
        table.add_column(title, justify="right")
    for plane in planes.planes:
        tilt = "" if plane.tilt_deg is None else f"{plane.tilt_deg:.0f}°"
        distance = f"{plane.distance_m:.1f} m"
        table.add_row(Text(plane.name), f"{plane.area_m2:.1f} m²", distance, tilt, f"{1e3 * plane.rms_m:.0f} mm")
    said = _indented(planes.text, "green" if planes.determined else "yellow")
    return Group(table, said) if planes.planes else said


def forecast_block(forecast: Forecast) -> RenderableType:
    """Of each parameter one standard deviation, beside what counts as weak."""
    if not forecast.parameters:
        return _indented(forecast.text or forecast.reason, "yellow")
    by_name = {parameter.name: parameter for parameter in forecast.parameters}
    table = Table(box=None, padding=(0, 2, 0, 2), header_style="dim")
    table.add_column("")
    for axis in "xyz":
        table.add_column(axis, justify="right", min_width=8)
    table.add_column("")
    table.add_column("")
    for title, names, unit, weak in _FORECAST_ROWS:
        found = [by_name[name] for name in names if name in by_name]
        if found:
            cells = [_known(parameter) for parameter in found]
            blank = [Text("")] * (3 - len(cells))
            table.add_row(title, *cells, *blank, unit, error_bar(max(p.std for p in found), weak))
    limits = f"weak beyond {WEAK_DEG:g} deg, {1e3 * WEAK_M:g} mm, {1e3 * WEAK_S:g} ms"
    # Followed is what stands still too, so that it may be longer than the rig is said to move.
    followed = f"{forecast.covered_s:.0f} s that could be followed" if forecast.covered_s else ""
    rests = " and ".join(filter(None, [counted(len(forecast.planes), "plane") if forecast.planes else "", followed]))
    rests = f"; from {rests}" if rests else ""
    axes = "rotation about the lidar's axes, translation along the IMU's"
    return Group(table, _indented(axes, "dim"), _indented(limits + rests, "dim"))


def _indented(words: str, style: str) -> RenderableType:
    """A sentence below a table, all of its lines as far in as the table."""
    return Padding(Text(words, style=style), (0, 0, 0, 2))


def _known(parameter: ParameterForecast) -> Text:
    """One standard deviation with two digits, and whether that is little: a prior's metre is no forecast."""
    if parameter.weak and tells_nothing(parameter.std, parameter.unit):
        return Text("unknown", style="bold yellow")
    said = std_cell(parameter.std, parameter.unit) + (" weak" if parameter.weak else "")
    return Text(said, style="yellow" if parameter.weak else "green")
