"""Errors of the application and the one body in which every error leaves it.

ApiError                      anything a route refuses on purpose
|- NotFound            404    no such record
|- Conflict            409    not in this state, or somebody else was faster
|- Refused             403    wrong origin, wrong host, path outside the folder
|- Unauthorised        401    no token, or a wrong one
|- TooLarge            413    more bytes than the limit
|- BadRequest          422    understood, and cannot be done as asked
|- DiskFull            507    not enough space left
|- Unavailable         503    the store or the data directory cannot be used
calib_core.UnsweepError 422   the library's own tree: its code and sentence pass through
everything else         500   a defect: logged with its traceback, told without it
"""

from __future__ import annotations

import http
import logging

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from app.schemas.common import ErrorBody, ErrorDetails, ErrorFacts
from calib_core.errors import TopicError, UnsweepError

_LOG = logging.getLogger("unsweep")

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


class BadRequest(ApiError):
    """Understood, and cannot be done as asked."""

    status = 422


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
    if isinstance(error, RequestValidationError):
        return 422, _invalid_request(error)
    if isinstance(error, HTTPException):
        return error.status_code, _http_facts(error)
    return 500, ErrorFacts(code="defect", text=DEFECT_TEXT)


def _invalid_request(error: RequestValidationError) -> ErrorFacts:
    places = [".".join(str(part) for part in problem["loc"]) for problem in error.errors()]
    reasons = "; ".join(f"{place}: {problem['msg']}" for place, problem in zip(places, error.errors(), strict=True))
    return ErrorFacts(
        code="request.invalid",
        text=f"The request does not fit the API's document: {reasons}.",
        details=ErrorDetails(fields=places),
    )


def _http_facts(error: HTTPException) -> ErrorFacts:
    phrase = http.HTTPStatus(error.status_code).phrase
    text = error.detail if error.detail and error.detail != phrase else f"The server answers: {phrase}."
    return ErrorFacts(code=f"http.{error.status_code}", text=text.rstrip(".") + ".")


def body_of(facts: ErrorFacts) -> dict[str, object]:
    """The one error body, ready for JSON."""
    return ErrorBody(error=facts).model_dump(mode="json")


def error_response(error: Exception) -> JSONResponse:
    """Any exception as the one error body."""
    status, facts = facts_of(error)
    headers = dict(error.headers) if isinstance(error, HTTPException) and error.headers else None
    return JSONResponse(body_of(facts), status_code=status, headers=headers)


async def _handle(request: Request, error: Exception) -> JSONResponse:
    if facts_of(error)[0] >= 500 and not isinstance(error, ApiError):
        _LOG.error("defect in %s %s", request.method, request.url.path, exc_info=error)
    return error_response(error)


def install_error_handler(app: FastAPI) -> None:
    """Send every exception of the application through the one handler."""
    for kind in (ApiError, UnsweepError, RequestValidationError, HTTPException, Exception):
        app.add_exception_handler(kind, _handle)
