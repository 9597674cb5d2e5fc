"""Memoised functions: whoever judges a track, and whoever finds its start values, asks for the same rotation; a second solve of a
recording asks for what the first one was told of its scans and readings.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass
from functools import wraps
from typing import Concatenate, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from calib_core.types import KeptScans, Scan

_Asked = ParamSpec("_Asked")
_Told = TypeVar("_Told")
#: Answers that are kept: those of a track and of the one before it.
_KEPT = 2


def memoised(function: Callable[_Asked, _Told]) -> Callable[_Asked, _Told]:
    """A function of arrays, numbers and records of them that keeps its last answers, by a digest of its arguments.

    Answers are shared between callers, who must not change them.
    """
    known: dict[bytes, _Told] = {}

    @wraps(function)
    def told(*args: _Asked.args, **kwargs: _Asked.kwargs) -> _Told:
        return _known_or_told(known, (*args, *kwargs, *kwargs.values()), lambda: function(*args, **kwargs))

    return told


def told_once(
    function: Callable[Concatenate[Sequence[Scan], _Asked], _Told],
) -> Callable[Concatenate[Sequence[Scan], _Asked], _Told]:
    """A function of a recording's scans, and of arrays and numbers, that keeps its last answers for as long as these scans are
    there. Of scans in a list, which anybody may change, it is asked each time.

    Answers are shared between callers, who must not change them.
    """
    of_scans: WeakKeyDictionary[KeptScans, dict[bytes, _Told]] = WeakKeyDictionary()

    @wraps(function)
    def told(scans: Sequence[Scan], /, *args: _Asked.args, **kwargs: _Asked.kwargs) -> _Told:
        if not isinstance(scans, KeptScans):
            return function(scans, *args, **kwargs)
        known = of_scans.setdefault(scans, {})
        return _known_or_told(known, (*args, *kwargs, *kwargs.values()), lambda: function(scans, *args, **kwargs))

    return told


def _known_or_told(known: dict[bytes, _Told], asked: Sequence[object], tell: Callable[[], _Told]) -> _Told:
    digest = hashlib.blake2b()
    for value in asked:
        _add(digest, value)
    key = digest.digest()
    if key in known:
        return known[key]
    answer = tell()
    for old in list(known)[: max(0, len(known) + 1 - _KEPT)]:
        known.pop(old, None)
    known[key] = answer
    return answer


def _add(digest: hashlib.blake2b, value: object) -> None:
    if is_dataclass(value):
        for each in fields(value):
            _add(digest, getattr(value, each.name))
    else:
        array = np.ascontiguousarray("nothing" if value is None else value)
        if array.dtype.hasobject:
            raise TypeError(f"expected arrays, numbers and records of them, but found {type(value).__name__}")
        digest.update(f"{array.dtype} {array.shape}".encode())
        digest.update(array.tobytes())
