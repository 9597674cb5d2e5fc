"""Frozen records as rows of a CSV file, appended one by one, so that a campaign can be stopped and taken up again."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar, get_type_hints


class Row(Protocol):
    """Any dataclass."""

    __dataclass_fields__: ClassVar[dict[str, Any]]


R = TypeVar("R", bound=Row)


def append_row(path: Path, row: Row, names: Sequence[str]) -> None:
    """Add one record. names: of the parts of its tuples; a field `errors` becomes errors_rx, errors_ry, ..."""
    path.parent.mkdir(parents=True, exist_ok=True)
    cells = dict(_cells(row, names))
    is_new = not path.is_file() or path.stat().st_size == 0
    with path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(cells), lineterminator="\n")
        if is_new:
            writer.writeheader()
        writer.writerow(cells)


def read_rows(path: Path, kind: type[R], names: Sequence[str]) -> Iterator[R]:
    """The records of a file; none where there is no file."""
    if not path.is_file():
        return
    hints = get_type_hints(kind)
    with path.open(encoding="utf-8", newline="") as file:
        for cells in csv.DictReader(file):
            values = {
                field.name: tuple(float(cells[f"{field.name}_{name}"]) for name in names)
                if hints[field.name] == tuple[float, ...]
                else hints[field.name](cells[field.name])
                for field in fields(kind)
            }
            yield kind(**values)


def _cells(row: Row, names: Sequence[str]) -> Iterator[tuple[str, str]]:
    for field in fields(row):
        value = getattr(row, field.name)
        if isinstance(value, tuple):
            yield from ((f"{field.name}_{name}", f"{part:.9g}") for name, part in zip(names, value, strict=True))
        else:
            yield field.name, f"{value:.9g}" if isinstance(value, float) else str(value)
