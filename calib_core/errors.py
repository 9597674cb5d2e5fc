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

#: An OSError's numbers: the disk is full, or the share of it that this user may have.
DISK_FULL = frozenset({errno.ENOSPC, errno.EDQUOT})
#: The same, or the file is as large as this process may make one.
NO_ROOM = DISK_FULL | {errno.EFBIG}


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
