"""The table of a fleet for programs and for people, beside `summary.csv`: `summary.json`, and a page that needs no network.

The CSV is the truth, a line more with each recording. These two are written whole, and therefore seldom: a fleet of ten
thousand spends little of its time on them.
"""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from app.fleet.summary import Row, Verdict
from app.storage.atomic import write_text
from calib_core.result import WEAK_DEG, WEAK_M, WEAK_S
from calib_core.sigmas import Unit, scale_of, std_cell

if TYPE_CHECKING:
    from jinja2 import Template

JSON_NAME, PAGE_NAME = "summary.json", "summary.html"
SCHEMA = "unsweep.fleet/1"
#: So often the page of a fleet under way looks again.
REFRESH_S = 5
#: A writing is followed by so many times its own length without one, and by a second at least.
_PAUSE, _LEAST_PAUSE_S = 30.0, 1.0
#: Signs that tell verdicts apart without their colours.
MARKS: dict[Verdict, str] = {"calibrated": "✓", "weak": "~", "refused": "✕", "failed": "!"}


class Overview:
    """Both files of one run.   rows: what was there before.   total: recordings in all.

    where: it runs, for people; known once there is something to run.
    """

    def __init__(self, folder: Path, rows: Iterable[Row], *, total: int, where: str = "") -> None:
        self._folder = folder
        self._rows = {row.name: row for row in rows}
        self._total = total
        self.where = where
        self._next_s = 0.0

    def add(self, row: Row) -> None:
        """Take in one more; written at once, or with one of the next."""
        self._rows[row.name] = row
        if time.monotonic() >= self._next_s:
            self.write(is_running=True)

    def write(self, *, is_running: bool) -> None:
        """Write both as they stand. Raises InputError on a full disk.   is_running: more will come of this run."""
        start_s = time.monotonic()
        rows = sorted(self._rows.values(), key=lambda row: row.name.casefold())
        write_text(self._folder / JSON_NAME, as_json(rows, total=self._total, is_running=is_running))
        write_text(self._folder / PAGE_NAME, as_page(rows, total=self._total, where=self.where, is_running=is_running))
        end_s = time.monotonic()
        self._next_s = end_s + max(_LEAST_PAUSE_S, _PAUSE * (end_s - start_s))


def as_json(rows: list[Row], *, total: int, is_running: bool) -> str:
    """The table as one JSON object; what a row has not is null."""
    recordings = [{name: None if value == "" else value for name, value in row.model_dump().items()} for row in rows]
    facts = {"schema": SCHEMA, "total": total, "done": len(rows), "is_running": is_running, "counts": counts_of(rows)}
    return json.dumps(facts | {"recordings": recordings}, ensure_ascii=False, indent=1) + "\n"


def as_page(rows: list[Row], *, total: int, where: str, is_running: bool) -> str:
    """The table as a page."""
    counts = counts_of(rows)
    return _template().render(
        rows=rows,
        total=total,
        where=where,
        is_running=is_running,
        refresh_s=REFRESH_S,
        counts=counts,
        counts_text=", ".join(f"{count} {verdict}" for verdict, count in counts.items() if count) or "none yet",
        marks=MARKS,
        ranks={verdict: rank for rank, verdict in enumerate(MARKS)},
        sigmas=sigmas_of,
        limits=f"{WEAK_DEG:g} deg, {1e3 * WEAK_M:g} mm, {1e3 * WEAK_S:g} ms",
        written_at=datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S"),
    )


def counts_of(rows: Iterable[Row]) -> dict[Verdict, int]:
    """How many there are of each verdict, none left out."""
    found = Counter(row.verdict for row in rows)
    return {verdict: found[verdict] for verdict in get_args(Verdict)}


@dataclass(frozen=True, slots=True)
class Sigma:
    """A standard deviation as the page shows it. value, text: empty where there is none.   limit: where weak begins."""

    value: float | str
    text: str
    limit: str
    is_weak: bool


def sigmas_of(row: Row) -> tuple[Sigma, Sigma, Sigma]:
    """The largest of rotation [deg] and of translation [mm], and that of the time offset [ms]."""
    turn = (row.rotation_std_x_deg, row.rotation_std_y_deg, row.rotation_std_z_deg)
    shift = (row.translation_std_x_m, row.translation_std_y_m, row.translation_std_z_m)
    return (
        _largest(turn, WEAK_DEG, "deg"),
        _largest(shift, WEAK_M, "m"),
        _largest((row.time_offset_std_s,), WEAK_S, "s"),
    )


def _largest(values: Iterable[float | str], limit: float, unit: Unit) -> Sigma:
    known = [value for value in values if not isinstance(value, str)]
    scale, name = scale_of(limit, unit)
    limit_text = f"{scale * limit:g} {name}"
    if not known:
        return Sigma("", "", limit_text, is_weak=False)
    return Sigma(scale * max(known), std_cell(max(known), unit), limit_text, is_weak=max(known) > limit)


@cache
def _template() -> Template:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    # What a recording is called is somebody else's word.
    environment = Environment(loader=PackageLoader("app.fleet"), autoescape=True, undefined=StrictUndefined)
    return environment.get_template("summary.html.jinja")
