"""What the command line shows while it works: a live table on a terminal, plain lines in a log, JSON where asked for.

The result goes to stdout; everything here goes to stderr.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from enum import StrEnum
from math import log10
from typing import Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from calib_core.events import Event, IterationEvent, LogEvent, OnEvent, StageEvent, ignore_event
from calib_core.result import WEAK_DEG, WEAK_M, WEAK_S
from calib_core.sigmas import std_row, value_row

STAGE_TITLES = {
    "read": "Reading the recording",
    "inspect": "Examining it",
    "planes": "Finding planes",
    "track": "Following the planes",
    "initialise": "Finding start values",
    "associate": "Assigning points to planes",
    "solve": "Solving",
    "observability": "Weighing the answer",
    "deskew": "Removing the motion",
    "write": "Writing",
}
LEVEL_STYLES = {"info": "dim", "warning": "yellow", "error": "red"}
_BAR_CELLS = 18


class Manner(StrEnum):
    """How much is told on the way."""

    live = "live"
    plain = "plain"
    quiet = "quiet"
    json = "json"


def choose_manner(*, quiet: bool, log_json: bool) -> Manner:
    """The manner that the options and the terminal ask for."""
    if log_json:
        return Manner.json
    if quiet:
        return Manner.quiet
    return Manner.live if sys.stderr.isatty() else Manner.plain


def stderr_console() -> Console:
    """A console on stderr, made when asked for so that a replaced stderr is honoured."""
    return Console(stderr=True, highlight=False)


@contextmanager
def listener(manner: Manner) -> Iterator[OnEvent]:
    """The event listener for `manner`, alive within the context."""
    if manner is Manner.live:
        from app.compiling import compiling_told  # Numba, which help and mistakes do not wait for

        with LiveProgress(stderr_console()) as progress, compiling_told(progress) as told:
            yield told
    elif manner is Manner.plain:
        yield PlainProgress(sys.stderr.write)
    elif manner is Manner.json:
        yield write_json_line
    else:
        yield ignore_event


def write_json_line(event: Event) -> None:
    """One event as one line of JSON on stderr."""
    sys.stderr.write(event.model_dump_json() + "\n")
    sys.stderr.flush()


class PlainProgress:
    """A line for each new stage, each iteration and each remark: for logs and pipes."""

    def __init__(self, write: Callable[[str], object]) -> None:
        self._write = write
        self._last = ""

    def __call__(self, event: Event) -> None:
        match event:
            case StageEvent():
                title = STAGE_TITLES[event.stage]
                if title != self._last:
                    self._write(f"{title} ...\n")
                    self._last = title
            case IterationEvent():
                self._write(f"  iteration {event.iteration}: cost {event.cost:.6g}, {_in_one_line(event)}\n")
            case LogEvent():
                self._write(f"  {event.level}: {event.text}\n")


class LiveProgress:
    """A bar for the running stage and, once the solve runs, the parameters with their shrinking error bars."""

    def __init__(self, console: Console) -> None:
        self._progress = Progress(
            TextColumn("[bold]{task.description:<28}"),
            BarColumn(bar_width=36),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeElapsedColumn(),
            TextColumn("[dim]left[/]"),
            TimeRemainingColumn(),
            console=console,
        )
        self._task: TaskID | None = None
        self._stage = ""
        self._iteration: IterationEvent | None = None
        self._remark = Text()
        self._live = Live(get_renderable=self._render, console=console, refresh_per_second=8, transient=True)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def __call__(self, event: Event) -> None:
        match event:
            case StageEvent():
                self._show_stage(event)
            case IterationEvent():
                self._iteration = event
            case LogEvent():
                self._remark = Text(event.text, style=LEVEL_STYLES[event.level])

    def _show_stage(self, event: StageEvent) -> None:
        if self._task is None or event.stage != self._stage:
            if self._task is not None:
                self._progress.remove_task(self._task)
            self._task = self._progress.add_task(STAGE_TITLES[event.stage], total=1.0)
            self._stage = event.stage
        self._progress.update(self._task, completed=event.fraction)
        if event.text:
            self._remark = Text(event.text, style="dim")

    def _render(self) -> RenderableType:
        parts: list[RenderableType] = [self._progress]
        if self._iteration is not None:
            parts.append(iteration_table(self._iteration))
        parts.append(self._remark)
        return Group(*parts)


def iteration_table(event: IterationEvent) -> Table:
    """The parameters of one iteration with their standard deviations, drawn against what counts as weak.

    No wider than 80 columns: a bar that is cut is as long as any other.
    """
    table = Table(box=None, padding=(0, 1, 0, 0), show_header=True, header_style="dim")
    table.add_column(f"iteration {event.iteration}, cost {event.cost:.6g}", min_width=24)
    for axis in "xyz":
        table.add_column(axis, justify="right", min_width=9)
    table.add_column("")
    table.add_column("error bar, marked where weak", min_width=_BAR_CELLS)
    turns, turn_unit = std_row(event.rotation_std_deg, "deg")
    places, place_unit = std_row(event.translation_std_m, "m")
    clock, clock_unit = std_row([event.time_offset_std_s], "s")
    angles, angle_unit = value_row(event.euler_xyz_deg, event.rotation_std_deg, "deg")
    translation, length_unit = value_row(event.translation_m, event.translation_std_m, "m")
    (offset,), offset_unit = value_row([event.time_offset_s], [event.time_offset_std_s], "s")
    table.add_row("roll, pitch, yaw", *angles, angle_unit, "")
    table.add_row(
        "  [dim]1 sigma, lidar's axes[/]",
        *turns,
        turn_unit,
        _widest_bar(event.rotation_std_deg, WEAK_DEG),
    )
    table.add_row("translation from the IMU", *translation, length_unit, "")
    table.add_row(
        "  [dim]1 sigma[/]",
        *places,
        place_unit,
        _widest_bar(event.translation_std_m, WEAK_M),
    )
    table.add_row("time offset", offset, "", "", offset_unit, "")
    table.add_row(
        "  [dim]1 sigma[/]",
        *clock,
        "",
        "",
        clock_unit,
        _widest_bar([event.time_offset_std_s], WEAK_S),
    )
    return table


def _widest_bar(stds: Sequence[float | None], weak: float) -> Text:
    """The bar of the widest of those that are estimated; none where all are held."""
    estimated = [std for std in stds if std is not None]
    return error_bar(max(estimated), weak) if estimated else Text("")


def error_bar(std: float, weak: float) -> Text:
    """A bar whose length is the logarithm of `std`, from a thousandth of `weak` to ten times it."""
    decades = log10(max(std, 1e-300) / weak)
    cells = round(_BAR_CELLS * min(max((decades + 3.0) / 4.0, 0.02), 1.0))
    bar = "━" * cells + " " * (_BAR_CELLS - cells)
    mark = round(_BAR_CELLS * 3 / 4)
    if bar[mark] == " ":
        bar = bar[:mark] + "│" + bar[mark + 1 :]
    return Text(bar, style="green" if std <= weak else "yellow")


def bullet(mark: str, words: RenderableType, style: str) -> RenderableType:
    """A remark behind a mark, its further lines indented."""
    table = Table.grid(padding=(0, 1))
    table.add_column(style=style)
    table.add_column(style=style, overflow="fold")
    table.add_row(mark, words)
    return table


def _in_one_line(event: IterationEvent) -> str:
    rotation = " ".join(f"{value:.4f}" for value in event.euler_xyz_deg)
    translation = " ".join(f"{1e3 * value:.2f}" for value in event.translation_m)
    return (
        f"roll pitch yaw {rotation} deg, translation {translation} mm, time offset {1e3 * event.time_offset_s:.4f} ms"
    )
