"""Errors that every room may raise, and what each tells a person.

ApiError                      anything refused on purpose
|- NotFound            404    no such record
|- Conflict            409    not in this state, or somebody else was faster
|- Refused             403    wrong origin, wrong host, path outside the folder
|- Unauthorised        401    no token, or a wrong one
|- TooLarge            413    more bytes than the limit
|- HeadTooLarge        431    longer headers than the limit
|- BadRequest          422    understood, and cannot be done as asked
|- TooMany             429    too many tries; later again
|- DiskFull            507    not enough space left
|- Unavailable         503    the store or the data directory cannot be used
calib_core.UnsweepError 422   the library's own tree: its code and sentence pass through
a write without room    507   whoever says so, and in whatever words
everything else         500   a defect: logged with its traceback, told without it
"""

from __future__ import annotations

from app.schemas.common import ErrorDetails, ErrorFacts
from calib_core.errors import TopicError, UnsweepError, is_for_want_of_room

FULL_TEXT = "The server's disk is full: delete recordings that are not needed, then try again."
DEFECT_TEXT = "The program itself failed here; the server's log has the details. Please report it and try again."


class ApiError(Exception):
    """Anything refused on purpose. `code` is stable and dotted; str() is one sentence for a person."""

    status = 400

    def __init__(self, code: str, text: str, *, details: ErrorDetails | None = None) -> None:
        super().__init__(text)
        self.code = code
        self.details = details


class NotFound(ApiError):
    """No such record."""

    status = 404


class Conflict(ApiError):
    """Not in this state, or somebody else was faster."""

    status = 409


class Refused(ApiError):
    """Wrong origin, wrong host, or a path outside the folder."""

    status = 403


class Unauthorised(ApiError):
    """No token, or a wrong one."""

    status = 401


class TooLarge(ApiError):
    """More bytes than the limit."""

    status = 413


class HeadTooLarge(ApiError):
    """Longer headers than the limit."""

    status = 431


class BadRequest(ApiError):
    """Understood, and cannot be done as asked."""

    status = 422


class TooMany(ApiError):
    """Too many tries in a short time."""

    status = 429

    def __init__(self, code: str, text: str, *, retry_after_s: int = 60) -> None:
        super().__init__(code, text)
        self.retry_after_s = retry_after_s


class DiskFull(ApiError):
    """Not enough space left."""

    status = 507


class Unavailable(ApiError):
    """The store or the data directory cannot be used."""

    status = 503


def facts_of(error: Exception) -> tuple[int, ErrorFacts]:
    """HTTP status and facts of any exception, without a traceback."""
    if isinstance(error, ApiError):
        return error.status, ErrorFacts(code=error.code, text=str(error), details=error.details)
    if isinstance(error, TopicError):
        details = ErrorDetails(candidates=list(error.candidates))
        return 422, ErrorFacts(code=error.code, text=str(error), details=details)
    if isinstance(error, UnsweepError):
        return 422, ErrorFacts(code=error.code, text=str(error))
    if is_for_want_of_room(error):
        return DiskFull.status, ErrorFacts(code="disk.full", text=FULL_TEXT)
    return 500, ErrorFacts(code="defect", text=DEFECT_TEXT)
