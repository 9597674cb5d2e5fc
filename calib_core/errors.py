"""Errors of calib_core.

    UnsweepError                  anything we raise on purpose; str() is one sentence for a person
    |- InputError                 the call or the input is at fault (exit code 2)
    |  |- UnreadableRecording     no such file, not a bag, damaged beyond recovery
    |  |- TopicError              no lidar or IMU topic, or several fit
    |  |- PointTimeError          clouds without (usable) per-point time
    |  |- SettingsError           a setting or an auxiliary file (planes, guess, noise) is unusable
    |- Cancelled                  the caller asked to stop (exit code 130)
    |- Refused                    the recording cannot give the answer; never leaves the library

A recording that cannot give the answer is not an error to the caller: `Refused` is caught once (calibrate.py, and
full/forecast.py for what is foretold) and made a result with status `refused`.
Every sentence has four parts: what was expected, what was found, where, what to do.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator

#: An OSError's numbers: the disk is full, or the share of it that this user may have, or the file is as large as it may be.
NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
#: What NumPy says of a write that was cut short, without a number; and Python where no folder takes a temporary file.
_NO_ROOM_WORDS = re.compile(r"\d+ requested and \d+ written|^No usable temporary directory found")


class UnsweepError(Exception):
    """Anything raised on purpose. `code` is stable and dotted; str() is one sentence for a person."""

    code = "error"

    def __init__(self, text: str, *, code: str | None = None) -> None:
        super().__init__(text)
        if code is not None:
            self.code = code


class InputError(UnsweepError):
    """The call or the input is at fault."""

    code = "input"


class UnreadableRecording(InputError):
    """The recording cannot be opened or read."""

    code = "recording.unreadable"


class TopicError(InputError):
    """No topic fits, or several do and none was named."""

    code = "recording.topic"

    def __init__(self, text: str, *, code: str | None = None, candidates: tuple[str, ...] = ()) -> None:
        super().__init__(text, code=code)
        self.candidates = candidates


class PointTimeError(InputError):
    """The clouds carry no usable per-point time."""

    code = "points.no_time"


class SettingsError(InputError):
    """A setting, or a file a setting names, is unusable."""

    code = "settings"


class Cancelled(UnsweepError):
    """The caller asked to stop."""

    code = "cancelled"


class Refused(UnsweepError):
    """The recording cannot give the answer. code: stable and dotted; text: one sentence for a person."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(text, code=code)


def causes_of(error: BaseException) -> Iterator[BaseException]:
    """The error, and what it comes of, back to the first."""
    seen: list[BaseException] = []
    while error not in seen:
        seen.append(error)
        yield error
        error = error.__cause__ or error.__context__ or error


def is_for_want_of_room(error: BaseException) -> bool:
    """Whether it comes of a write for which there was no room. The only place that knows in how many ways libraries say so."""
    return any(
        (isinstance(cause, OSError) and (cause.errno in NO_ROOM or _NO_ROOM_WORDS.search(str(cause.strerror or cause))))
        or getattr(cause, "sqlite_errorname", "") == "SQLITE_FULL"
        for cause in causes_of(error)
    )
