"""Records written down and read again: numbers and texts by the names of the fields, arrays beside them, no pickled objects.

words, arrays = as_written(record)
record = as_read(Kind, words, arrays)

What one run keeps for the next lies in one file, whole or not at all: `keep`, `kept`.
"""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from types import UnionType
from typing import TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

Json = None | bool | int | float | str | list["Json"] | dict[str, "Json"]
Arrays = dict[str, NDArray[np.generic]]
Kind = TypeVar("Kind")
_ARRAY = "array"
_WORDS = "words"


def keep(path: Path, words: Json, arrays: Arrays) -> None:
    """Write words and arrays to one file. Where the folder takes nothing, as on a full disk, nothing is kept: what is kept saves
    time, and no result must be lost for it."""
    new = path.with_suffix(f".{os.getpid()}.tmp")
    with suppress(OSError):
        path.unlink(missing_ok=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        with new.open("wb") as file:
            np.savez(file, allow_pickle=False, **{_WORDS: np.array(json.dumps(words))}, **arrays)
        new.replace(path)
    with suppress(OSError):
        new.unlink(missing_ok=True)


def kept(path: Path) -> tuple[Json, Arrays] | None:
    """What was kept there; None where nothing is, or it cannot be read."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
            words: Json = json.loads(str(arrays.pop(_WORDS)))
            return words, arrays
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile):
        return None


def as_written(record: object) -> tuple[Json, Arrays]:
    """A record as JSON, and its arrays under the names of the fields that lead to them."""
    arrays: Arrays = {}
    return _written(record, "", arrays), arrays


def as_read(kind: type[Kind], words: Json, arrays: Arrays) -> Kind:
    """The record of a kind that was written. Raises TypeError where it was of another."""
    record = _read(kind, words, arrays, {})
    if not isinstance(record, kind):
        raise TypeError(f"expected {kind.__name__}, found {type(record).__name__}")
    return record


def _written(value: object, name: str, arrays: Arrays) -> Json:
    """A value as JSON; its arrays go to `arrays` under the names of the fields that lead to them."""
    if isinstance(value, np.ndarray):
        arrays[name] = value
        return {_ARRAY: name}
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: _written(getattr(value, f.name), f"{name}.{f.name}".lstrip("."), arrays) for f in fields(value)}
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, tuple | list):
        return [_written(item, f"{name}.{place}", arrays) for place, item in enumerate(value)]
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise TypeError(f"expected numbers, texts, arrays or records in a state, found {type(value).__name__} in {name}")


def _read(kind: object, written: Json, arrays: Arrays, known: Mapping[object, object]) -> object:
    """The value of a type that was written. known: what type variables stand for."""
    kind = known.get(kind, kind)
    if written is None or (isinstance(written, dict) and _ARRAY in written):
        return None if written is None else arrays[str(written[_ARRAY])]
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        # Of several kinds all are words: a name of one set or of another reads the same.
        first = next(argument for argument in arguments if argument is not type(None))
        return _read(first, written, arrays, known)
    if origin is tuple and isinstance(written, list):
        each = [arguments[0]] * len(written) if len(arguments) == 2 and arguments[1] is Ellipsis else arguments
        return tuple(_read(a, item, arrays, known) for a, item in zip(each, written, strict=True))
    record = origin or kind
    if isinstance(record, type) and is_dataclass(record) and isinstance(written, dict):
        variables = getattr(record, "__parameters__", ())
        known = {**known, **dict(zip(variables, arguments, strict=False))}
        kinds = get_type_hints(record)
        return record(**{name: _read(kinds[name], part, arrays, known) for name, part in written.items()})
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind[str(written)]
    return float(written) if kind is float and isinstance(written, int) else written
