"""`python -m bench.sensitivity`: how far the answer moves where a number that somebody judged had been judged otherwise.

Every number of the settings' records whose reason begins with "judged" (tools/steering.py) is taken a half larger and a half
smaller, one at a time; a share of one or of a hundred beyond its middle is moved from its upper end. Left out are the odometry
and the start values, as the joint estimation ends where it ends from any start (bench/results/starts.csv), the forecast, and
what people are told and shown.

The recording is six seconds of the paper's room with planes out of view, sensors ideal, an eighth of a VLP-16's columns: the
smallest in which the estimate is carried over what the lidar alone could not follow. A row a number in
bench/results/sensitivity.csv: the largest shift among the seven, in their own standard deviations, what became of the answer,
or that nothing in this recording asks for the number. Goes on where it was stopped; a row whose number has another value
since is measured again.

One recording: no shift here says that the number is not on the edge of anything in it, not that it never matters.
"""

from __future__ import annotations

import argparse
import ast
import csv
import gc
import importlib
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path
from types import MemberDescriptorType

import numpy as np

from bench.store import RESULTS
from calib_core import api
from calib_core.geometry import log
from calib_core.result import CalibrationResult
from calib_core.settings import CalibrateSettings
from calib_core.simulate import SCENARIOS, generate
from calib_core.simulate.patterns import Spinning
from tools.steering import RECORDS, Number, numbers

FILE = RESULTS / "sensitivity.csv"
COLUMNS = ("record", "number", "value", "less", "more")
#: How many times as large, one after the other.
FACTORS = (1.0 / 1.5, 1.5)
#: In place of a shift, where no line that ran asks for the number.
UNASKED = "not asked"
#: Where judgements reach the answer.
STAGES = frozenset({"prepare", "planes", "joint", "assess"})
#: Records of what people are told and shown.
TOLD = frozenset({"Stamps", "Patches", "Watching", "Wording"})
#: Read once, when their module is imported: a change in a running program does nothing.
READ_AT_IMPORT = frozenset({"Watching.motion_share", "Holding.open_deg", "Holding.open_m", "Holding.open_s"})


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what is missing; 0."""
    parser = argparse.ArgumentParser(prog="python -m bench.sensitivity", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="RECORD.NUMBER", help="all that are judged where none is named")
    parser.add_argument("--file", type=Path, default=FILE)
    chosen = parser.parse_args(arguments)
    rows = read(chosen.file)
    wanted = [n for n in numbers() if (name_of(n) in chosen.names if chosen.names else is_judged(n))]
    with reads() as asked:
        usual = answer()
    for number in wanted:
        if chosen.names or name_of(number) not in rows or rows[name_of(number)]["value"] != number.value:
            shifts = [told(usual, number, factor) if name_of(number) in asked else UNASKED for factor in FACTORS]
            row = dict(zip(COLUMNS, (number.record, number.name, number.value, *shifts), strict=True))
            rows[name_of(number)] = row
            write(rows, chosen.file)
            print(f"{name_of(number):40}{number.value:>12}  {shifts[0]:>10} {shifts[1]:>10}", flush=True)
    return 0


def name_of(number: Number) -> str:
    """Record and number, which no two share."""
    return f"{number.record}.{number.name}"


def is_judged(number: Number) -> bool:
    """Whether its reason is a judgement that reaches the answer, and it can be changed while the program runs."""
    reaches = number.stage in STAGES and number.record not in TOLD and name_of(number) not in READ_AT_IMPORT
    return reaches and number.reason.startswith("judged") and other(number, 1.5) is not None


def read(path: Path = FILE) -> dict[str, dict[str, str]]:
    """Rows by record and number."""
    if not path.is_file():
        return {}
    with path.open(newline="", encoding="utf-8") as file:
        return {f"{row['record']}.{row['number']}": row for row in csv.DictReader(file)}


def write(rows: dict[str, dict[str, str]], path: Path = FILE) -> None:
    """Those that there are still numbers for, in the order of the records."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        table.writeheader()
        table.writerows(rows[name_of(n)] for n in numbers() if name_of(n) in rows)


def answer() -> CalibrationResult:
    """Of the recording, made anew: nothing is kept from one to the next."""
    lidar = SCENARIOS["partial-views"].lidar
    assert isinstance(lidar.pattern, Spinning)
    pattern = replace(lidar.pattern, column_period_ns=8 * lidar.pattern.column_period_ns)
    scenario = replace(SCENARIOS["partial-views"], lidar=replace(lidar, pattern=pattern), duration_s=6.0)
    recording, _ = generate(scenario, seed=7)
    return api.calibrate(recording, CalibrateSettings(intrinsics="off")).result


def told(usual: CalibrationResult, number: Number, factor: float) -> str:
    """The largest shift of an answer with the number so many times as large, or what became of it."""
    with changed(number, factor):
        try:
            return shift(usual, answer())
        except Exception as error:  # noqa: BLE001  what a wrong number does to the program is what is looked for
            return type(error).__name__


def shift(usual: CalibrationResult, other: CalibrationResult) -> str:
    """The largest of the seven, in standard deviations of the usual answer."""
    assert usual.T_imu_lidar is not None
    assert usual.uncertainty is not None
    assert usual.time_offset_s is not None
    if other.T_imu_lidar is None or other.time_offset_s is None:
        return other.status
    before, after = np.array(usual.T_imu_lidar.matrix), np.array(other.T_imu_lidar.matrix)
    turn = log(before[:3, :3].T @ after[:3, :3])
    moved = np.concatenate([turn, after[:3, 3] - before[:3, 3], [other.time_offset_s - usual.time_offset_s]])
    sigmas = np.sqrt(np.diag(np.array(usual.uncertainty.covariance)))
    return f"{np.max(np.abs(moved) / sigmas):.2g}"


def other(number: Number, factor: float) -> object:
    """The number a factor larger, as it would be written; none where it is no number."""
    return scaled(literal(number.value), factor) if number.value else None


def literal(text: str) -> object:
    """What a record's field is given; none where that is another record."""
    try:
        return ast.literal_eval(text)
    except ValueError:
        return None


def scaled(value: object, factor: float) -> object:
    """A number, or numbers, a factor larger; a whole one by one at the least; a share of its middle or more from its end."""
    match value:
        case bool() | 0:
            return None
        case int():
            return max(round(value * factor), value + 1) if factor > 1.0 else min(round(value * factor), value - 1)
        case float() if 0.5 < value < 1.0:
            return 1.0 - (1.0 - value) / factor
        case float() if 50.0 < value < 100.0:
            return 100.0 - (100.0 - value) / factor
        case float():
            return value * factor
        case tuple():
            each = tuple(scaled(part, factor) for part in value)
            return None if None in each else each
        case _:
            return None


@contextmanager
def reads() -> Iterator[set[str]]:
    """Names of the numbers that are asked for meanwhile."""
    asked: set[str] = set()
    usual = [
        (kind, field.name, vars(kind)[field.name])
        for kind in dict.fromkeys(map(kind_of, numbers()))
        for field in fields(kind)
    ]
    for kind, name, slot in usual:

        def get(record: object, slot: MemberDescriptorType = slot, full: str = f"{kind.__name__}.{name}") -> object:
            asked.add(full)
            return slot.__get__(record)

        setattr(kind, name, property(get, slot.__set__))
    try:
        yield asked
    finally:
        for kind, name, slot in usual:
            setattr(kind, name, slot)


def kind_of(number: Number) -> type:
    """The record that a number is a field of."""
    path = next(path for _, path, record in RECORDS if record == number.record)
    kind = getattr(importlib.import_module(path.removesuffix(".py").replace("/", ".")), number.record)
    assert isinstance(kind, type)
    return kind


@contextmanager
def changed(number: Number, factor: float) -> Iterator[None]:
    """Every record of the number's kind with it, those that are made meanwhile too."""
    kind = kind_of(number)
    alive = [(each, getattr(each, number.name)) for each in gc.get_objects() if type(each) is kind]
    made = vars(kind)["__init__"]
    usual = made.__defaults__ or ()
    given = [field.name for field in fields(kind)][len(fields(kind)) - len(usual) :]
    made.__defaults__ = tuple(
        scaled(value, factor) if name == number.name else value for name, value in zip(given, usual, strict=True)
    )
    for each, value in alive:
        object.__setattr__(each, number.name, scaled(value, factor))
    try:
        yield
    finally:
        made.__defaults__ = usual
        for each, value in alive:
            object.__setattr__(each, number.name, value)


if __name__ == "__main__":
    sys.exit(main())
