"""The table of a fleet, `summary.csv`: a row a recording, added as each is done, so that it is right after a power cut.

A row whose document is there, made of what is asked, is not run again; a row without one is dropped when the fleet is taken up
again.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from app.fleet.orders import FleetOrder, FleetOutcome
from app.fleet.provenance import CHANGED, Stored, differing_options, is_same_recording, stored
from app.results.verdict import told, tone
from app.storage.atomic import write_text
from calib_core.errors import InputError
from calib_core.result import CalibrationResult

NAME = "summary.csv"
Verdict = Literal["calibrated", "weak", "refused", "failed"]


class Row(BaseModel):
    """One recording. Empty where there is no answer; standard deviations of the rotation about the lidar's axes, of the
    translation along the IMU's. The answer is T_imu_lidar, its angles those of R = Rz(yaw) Ry(pitch) Rx(roll).

    code, sentence: why a recording was refused or has no document; sentence also of an answer that anything speaks against.
    asked, recording_bytes, recording_written_ns: what provenance.py compares; empty where nobody knew.
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
    asked: str = ""
    recording_bytes: int | Literal[""] = ""
    recording_written_ns: int | Literal[""] = ""
    roll_deg: float | Literal[""] = ""
    pitch_deg: float | Literal[""] = ""
    yaw_deg: float | Literal[""] = ""
    translation_x_m: float | Literal[""] = ""
    translation_y_m: float | Literal[""] = ""
    translation_z_m: float | Literal[""] = ""
    time_offset_s: float | Literal[""] = ""

    @property
    def has_document(self) -> bool:
        """Whether there is a document to this row."""
        return self.verdict != "failed"

    @property
    def stored(self) -> Stored | None:
        """How the recording lay on the disk before it was read; None where nobody looked."""
        if self.recording_bytes == "" or self.recording_written_ns == "":
            return None
        return Stored(self.recording_bytes, self.recording_written_ns)


COLUMNS = tuple(Row.model_fields)


def row_of(order: FleetOrder, outcome: FleetOutcome, tries: int, lay: Stored | None) -> Row:
    """The row of an outcome.   lay: how the recording lay on the disk before it was read."""
    facts = {"duration_s": round(outcome.duration_s, 3), "tries": tries, **_facts_of_order(order, lay)}
    if outcome.document is None:
        return Row.model_validate(facts | {"verdict": "failed", "code": outcome.code, "sentence": outcome.text})
    return Row.model_validate(facts | _facts_of_result(CalibrationResult.from_json(outcome.document)))


def _facts_of_order(order: FleetOrder, lay: Stored | None) -> dict[str, object]:
    facts: dict[str, object] = {"name": order.name, "recording": str(order.recording), "asked": order.asked}
    return facts if lay is None else facts | {"recording_bytes": lay.size_bytes, "recording_written_ns": lay.written_ns}


def _facts_of_result(result: CalibrationResult) -> dict[str, object]:
    facts: dict[str, object] = {"verdict": result.status, **_answer(result)}
    if result.uncertainty is not None:
        turn, shift = result.uncertainty.rotation_std_deg, result.uncertainty.translation_std_m
        facts |= {f"rotation_std_{axis}_deg": std for axis, std in zip("xyz", turn, strict=True)}
        facts |= {f"translation_std_{axis}_m": std for axis, std in zip("xyz", shift, strict=True)}
        facts["time_offset_std_s"] = result.uncertainty.time_offset_std_s
    if result.status == "refused":
        facts["code"] = next((message.code for message in result.messages if message.level == "error"), "")
    if tone(result) != "good":
        facts["sentence"] = told(result)
    return facts


def _answer(result: CalibrationResult) -> dict[str, object]:
    """What was found, so that one rig that is unlike the others is seen in the table."""
    if result.T_imu_lidar is None or result.time_offset_s is None:
        return {}
    angles = dict(zip(("roll_deg", "pitch_deg", "yaw_deg"), result.T_imu_lidar.euler_xyz_deg, strict=True))
    place = {f"translation_{axis}_m": each for axis, each in zip("xyz", result.T_imu_lidar.translation_m, strict=True)}
    return {**angles, **place, "time_offset_s": result.time_offset_s}


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


def documented(order: FleetOrder, folder: Path, rows: Mapping[str, Row]) -> Row | tuple[str, ...]:
    """The row of a recording whose document is there, made of what is asked. Else it has to be run: what its document was made of
    otherwise; nothing, where it has none.
    """
    result = _document(order.name, folder)
    if result is None:
        return ()
    row = rows.get(order.name)
    if row is None or not row.has_document:
        row = Row.model_validate({"name": order.name, "recording": str(order.recording)} | _facts_of_result(result))
    others = differing_options(order, result.provenance.settings, row.asked)
    if not is_same_recording(order.recording, row.stored, result.provenance.recording.sha256):
        others.append(CHANGED)
    # Where and how the recording lies by now, so that it need not be hashed the next time.
    # A table of an earlier version had no answers in it.
    return tuple(others) or row.model_copy(update=_answer(result) | _facts_of_order(order, stored(order.recording)))


def _document(name: str, folder: Path) -> CalibrationResult | None:
    """The document of that name; None where there is none, or another program's."""
    try:
        return CalibrationResult.from_json((folder / f"{name}.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def moved(recordings: Sequence[Path], rows: Iterable[Row], folder: Path) -> dict[Path, str]:
    """The names of recordings that have a row under another path, by their bytes: folders are moved, and mounted elsewhere."""
    asked = set(recordings)
    elsewhere: dict[str, list[Row]] = {}
    known = set()
    for row in rows:
        known.add(Path(row.recording))
        if Path(row.recording) not in asked:
            elsewhere.setdefault(Path(row.recording).name, []).append(row)
    names = {}
    for path in recordings:
        candidates = elsewhere.get(path.name, []) if path not in known else []
        found = [row for row in candidates if _lies_at(path, row, folder)]
        if found:
            names[path] = found[0].name
            candidates.remove(found[0])
    return names


def _lies_at(path: Path, row: Row, folder: Path) -> bool:
    """Whether the recording of a row is the one that now lies at `path`."""
    if row.stored is None or stored(path) is None:
        return False
    result = _document(row.name, folder)
    return is_same_recording(path, row.stored, "" if result is None else result.provenance.recording.sha256)


def _cells(row: Row) -> list[str]:
    return [str(value) for value in row.model_dump().values()]


def _text(lines: list[list[str]]) -> str:
    written = io.StringIO()
    csv.writer(written, lineterminator="\n").writerows(lines)
    return written.getvalue()
