"""The table of a fleet, `summary.csv`: a row a recording, added as each is done, so that it is right after a power cut.

A row whose document is there is not run again; a row without one is dropped when the fleet is taken up again.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from app.fleet.orders import FleetOrder, FleetOutcome
from app.results.verdict import told, tone
from app.storage.atomic import write_text
from calib_core.errors import InputError
from calib_core.result import CalibrationResult

NAME = "summary.csv"
Verdict = Literal["calibrated", "weak", "refused", "failed"]


class Row(BaseModel):
    """One recording. Empty where there is no answer; rotation about the lidar's axes, translation along the IMU's.

    code, sentence: why a recording was refused or has no document; sentence also of an answer that anything speaks against.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    name: str
    recording: str
    verdict: Verdict
    rotation_std_x_deg: float | Literal[""] = ""
    rotation_std_y_deg: float | Literal[""] = ""
    rotation_std_z_deg: float | Literal[""] = ""
    translation_std_x_m: float | Literal[""] = ""
    translation_std_y_m: float | Literal[""] = ""
    translation_std_z_m: float | Literal[""] = ""
    time_offset_std_s: float | Literal[""] = ""
    code: str = ""
    sentence: str = ""
    duration_s: float = 0.0
    tries: int = 1

    @property
    def has_document(self) -> bool:
        """Whether there is a document to this row."""
        return self.verdict != "failed"


COLUMNS = tuple(Row.model_fields)


def row_of(name: str, recording: Path, outcome: FleetOutcome, tries: int) -> Row:
    """The row of an outcome."""
    facts = {"name": name, "recording": str(recording), "duration_s": round(outcome.duration_s, 3), "tries": tries}
    if outcome.document is None:
        return Row.model_validate(facts | {"verdict": "failed", "code": outcome.code, "sentence": outcome.text})
    result = CalibrationResult.model_validate_json(outcome.document)
    facts["verdict"] = result.status
    if result.uncertainty is not None:
        turn, shift = result.uncertainty.rotation_std_deg, result.uncertainty.translation_std_m
        facts |= {f"rotation_std_{axis}_deg": std for axis, std in zip("xyz", turn, strict=True)}
        facts |= {f"translation_std_{axis}_m": std for axis, std in zip("xyz", shift, strict=True)}
        facts["time_offset_std_s"] = result.uncertainty.time_offset_std_s
    if result.status == "refused":
        facts["code"] = next((message.code for message in result.messages if message.level == "error"), "")
    if tone(result) != "good":
        facts["sentence"] = told(result)
    return Row.model_validate(facts)


def read_rows(folder: Path) -> list[Row]:
    """The rows of an earlier run; one that was torn by a power cut is left out."""
    path = folder / NAME
    if not path.is_file():
        return []
    rows = []
    with path.open(encoding="utf-8", newline="") as file:
        for words in csv.DictReader(file):
            try:
                rows.append(Row.model_validate({column: word for column, word in words.items() if word is not None}))
            except ValidationError:
                continue
    return rows


def write_rows(folder: Path, rows: Iterable[Row]) -> None:
    """Write the table anew, whole."""
    write_text(folder / NAME, _text([list(COLUMNS), *(_cells(row) for row in rows)]))


def add_row(folder: Path, row: Row) -> None:
    """Add a row, on the disk before this returns."""
    path = folder / NAME
    try:
        with path.open("a", encoding="utf-8", newline="") as file:
            file.write(_text([_cells(row)] if file.tell() else [list(COLUMNS), _cells(row)]))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise InputError(
            f"{path} could not be written ({error.strerror}); free some space, and the same command goes on."
        ) from error


def documented(order: FleetOrder, folder: Path, rows: dict[str, Row]) -> Row | None:
    """The row of a recording whose document is there already; None where it has to be run."""
    path = folder / f"{order.name}.json"
    try:
        document = path.read_text(encoding="utf-8")
        made = row_of(order.name, order.recording, FleetOutcome(document=document), 1)
    except (OSError, ValueError):  # none, or another program's
        return None
    kept = rows.get(order.name)
    return kept if kept is not None and kept.has_document else made


def _cells(row: Row) -> list[str]:
    return [str(value) for value in row.model_dump().values()]


def _text(lines: list[list[str]]) -> str:
    written = io.StringIO()
    csv.writer(written, lineterminator="\n").writerows(lines)
    return written.getvalue()
