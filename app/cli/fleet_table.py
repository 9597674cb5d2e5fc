"""What `calibrate-many` shows while it works, in the manners of terminal.py: a live table, a line each, or JSON."""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from time import monotonic

from rich.console import Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from app.cli.terminal import Manner, stderr_console
from app.fleet.campaign import OnRow
from app.fleet.summary import Row, Verdict
from calib_core.sigmas import Unit, std_cell, std_text

_STYLES: dict[Verdict, str] = {"calibrated": "green", "weak": "yellow", "refused": "red", "failed": "bold red"}
#: So many of the latest rows are shown: more would push the counts off a small terminal.
_SHOWN = 12


@contextmanager
def fleet_listener(manner: Manner, total: int, done: Sequence[Row], where: str) -> Iterator[OnRow]:
    """What to call with each new row, alive within the context.   total: recordings in all.   done: found finished."""
    if manner is Manner.live:
        table = FleetTable(total, done, where)
        with Live(get_renderable=table.render, console=stderr_console(), refresh_per_second=2):
            yield table.add
    elif manner is Manner.plain:
        kept = f", {len(done)} done already" if done else ""
        sys.stderr.write(f"{recordings(total)}{kept}; {where}\n")
        yield lambda row: _write(row_line(row))
    elif manner is Manner.json:
        yield lambda row: _write(json_line(row))
    else:
        yield lambda _: None


def recordings(count: int) -> str:
    """So many, in words."""
    return f"{count} recording{'' if count == 1 else 's'}"


def row_line(row: Row) -> str:
    """A row for a log."""
    return f"{row.name}: {row.verdict} in {row.duration_s:.1f} s{_after(row)}"


def json_line(row: Row) -> str:
    """A row as an event of --log-json."""
    return json.dumps({"event": "recording", **row.model_dump()})


def counts(rows: Sequence[Row]) -> str:
    """How many there are of each verdict."""
    found = Counter(row.verdict for row in rows)
    return ", ".join(f"{found[verdict]} {verdict}" for verdict in _STYLES if found[verdict]) or "none yet"


class FleetTable:
    """The latest rows, and below them how many are done."""

    def __init__(self, total: int, done: Sequence[Row], where: str) -> None:
        self._total = total
        self._rows = list(done)
        self._fresh = 0
        self._where = where
        self._start_s = monotonic()

    def add(self, row: Row) -> None:
        """Show one more."""
        self._rows.append(row)
        self._fresh += 1

    def render(self) -> RenderableType:
        """The table as it stands."""
        table = Table(box=None, padding=(0, 1), header_style="dim")
        for title, justify in (("recording", "left"), ("verdict", "left"), ("deg", "right"), ("mm", "right")):
            table.add_column(title, justify="right" if justify == "right" else "left", overflow="fold")
        table.add_column("ms", justify="right")
        table.add_column("took", justify="right")
        table.add_column("why", overflow="fold")
        for row in self._rows[-_SHOWN:]:
            verdict = Text(row.verdict, style=_STYLES[row.verdict])
            cells = ("" if sigma is None else std_cell(*sigma) for sigma in _largest(row))
            table.add_row(Text(row.name), verdict, *cells, f"{row.duration_s:.1f} s", Text(row.sentence))
        told = f"{len(self._rows)} of {self._total} done ({counts(self._rows)}); {self._where}{self._left()}"
        return Group(table, Text(told, style="bold"))

    def _left(self) -> str:
        ahead = self._total - len(self._rows)
        if not self._fresh or not ahead:
            return ""
        return f"; about {ahead * (monotonic() - self._start_s) / self._fresh / 60.0:.0f} min left"


def _largest(row: Row) -> list[tuple[float, Unit] | None]:
    """The largest sigma of each kind with its unit; None where the row has none."""
    turn = [v for v in (row.rotation_std_x_deg, row.rotation_std_y_deg, row.rotation_std_z_deg) if v != ""]
    shift = [v for v in (row.translation_std_x_m, row.translation_std_y_m, row.translation_std_z_m) if v != ""]
    offset = row.time_offset_std_s
    return [
        (max(turn), "deg") if turn else None,
        (max(shift), "m") if shift else None,
        None if offset == "" else (offset, "s"),
    ]


def _after(row: Row) -> str:
    known = [std_text(std, unit) for std, unit in filter(None, _largest(row))]
    sigmas = f", 1 sigma up to {', '.join(known)}" if known else ""
    return f"{sigmas}: {row.sentence}" if row.sentence else sigmas


def _write(line: str) -> None:
    sys.stderr.write(line + "\n")
    sys.stderr.flush()
