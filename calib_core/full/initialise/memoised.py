"""Memoised functions of arrays: whoever judges a track, and whoever finds its start values, asks for the same rotation."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import wraps
from typing import ParamSpec, TypeVar

import numpy as np

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
        digest = hashlib.blake2b()
        for value in (*args, *kwargs.values()):
            _add(digest, value)
        key = digest.digest()
        if key in known:
            return known[key]
        answer = function(*args, **kwargs)
        for old in list(known)[: max(0, len(known) + 1 - _KEPT)]:
            known.pop(old, None)
        known[key] = answer
        return answer

    return told


def _add(digest: hashlib.blake2b, value: object) -> None:
    if is_dataclass(value):
        for each in fields(value):
            _add(digest, getattr(value, each.name))
    else:
        array = np.ascontiguousarray(value)
        digest.update(f"{array.dtype} {array.shape}".encode())
        digest.update(array.data)
