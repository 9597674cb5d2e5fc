"""An audit told to a person: the verdict, each axis with its limit, what would have shown, the room with each."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from app.cli.terminal import bullet
from calib_core.audit.report import AuditReport, AxisAudit, Verdict, in_si
from calib_core.settings import Axis
from calib_core.sigmas import std_cell, std_text, value_text

_STYLES: dict[Verdict, str] = {"passed": "bold green", "failed": "bold red", "unknown": "bold yellow"}
#: So short that a row of the table is one line of a terminal with 80 columns; whose axes they are is said below it.
_NAMES: dict[Axis, str] = {
    "rx": "rotation x",
    "ry": "rotation y",
    "rz": "rotation z",
    "tx": "translation x",
    "ty": "translation y",
    "tz": "translation z",
    "dt": "time offset",
}
_WHOSE_AXES = Text(" rotation about the lidar's axes, translation along the IMU's", style="dim")


def audit_block(report: AuditReport, name: str) -> RenderableType:
    """The whole report as one block.   name: of the file with the extrinsic."""
    parts: list[RenderableType] = [Text(report.text, style=_STYLES[report.verdict])]
    parts.append(Text(f"{name} was read as {report.extrinsic_form}.", style="dim"))
    if report.axes:
        parts.append(Padding(Group(_axes(report.axes), _WHOSE_AXES), (1, 0)))
    if report.crispness is not None:
        parts.append(Text(report.crispness.text))
    parts += [bullet("-", Text(hint), "yellow") for hint in report.hints]
    return Panel(Group(*parts), title="unsweep audit", title_align="left", border_style="dim", padding=(0, 1))


def _axes(axes: list[AxisAudit]) -> Table:
    table = Table(box=None, padding=(0, 1), header_style="dim")
    table.add_column("given minus found")
    for title in ("difference", "1 sigma", "limit", "would have shown"):
        table.add_column(title, justify="right")
    table.add_column("")
    for axis in axes:
        verdict = "not judged" if axis.verdict is None else axis.verdict
        table.add_row(
            _NAMES[axis.axis],
            _difference(axis),
            std_cell(*in_si(axis.difference_std, axis.unit), named=True),
            "-" if axis.limit is None else f"{axis.limit:g} {axis.unit}",
            f"from {_reach(axis)}",
            Text(verdict, style="dim" if axis.verdict is None else _STYLES[axis.verdict]),
        )
    return table


def _difference(axis: AxisAudit) -> str:
    """To the digits that its sigma tells something of, as a sentence has it."""
    if axis.difference is None:
        return "-"
    std, unit = in_si(axis.difference_std, axis.unit)
    text, name = value_text(in_si(axis.difference, axis.unit)[0], std, unit)
    return f"{text if text.startswith('-') else f'+{text}'} {name}"


def _reach(axis: AxisAudit) -> str:
    """What would have shown: the limit as it was given, or three sigmas."""
    if axis.limit is not None and axis.smallest_error <= axis.limit:
        return f"{axis.limit:g} {axis.unit}"
    return std_text(*in_si(axis.smallest_error, axis.unit))
