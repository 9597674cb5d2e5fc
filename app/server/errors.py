"""Every error leaves the server in one body, with the sentence that app/errors.py has for it."""

from __future__ import annotations

import http
import logging
import os

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from sqlalchemy.exc import SQLAlchemyError
from starlette.exceptions import HTTPException

from app.errors import ApiError, TooMany, Unavailable, facts_of
from app.schemas.common import ErrorBody, ErrorDetails, ErrorFacts
from app.settings import AppSettings
from calib_core.errors import UnsweepError, is_for_want_of_room
from calib_core.validation_messages import misfit, place_of

_LOG = logging.getLogger("unsweep")


def facts_of_request(error: Exception) -> tuple[int, ErrorFacts]:
    """HTTP status and facts of any exception: those of app/errors.py, of the web framework, of the store and the disk."""
    if isinstance(error, RequestValidationError):
        facts = _invalid_request(error)
        # An id or a name within the address that no thing can have: nothing is there.
        return (404 if all(problem["loc"][0] == "path" for problem in error.errors()) else 422), facts
    if isinstance(error, HTTPException):
        return error.status_code, _http_facts(error)
    if isinstance(error, SQLAlchemyError) and not is_for_want_of_room(error):
        error = Unavailable(
            "store.unusable",
            "The server's record store cannot be read or written just now; whoever runs it finds the cause in its log.",
        )
    return facts_of(error)


def without_paths(text: str, settings: AppSettings) -> str:
    """The sentence without where the server keeps things: names below its folders stay, the way there does not."""
    for folder, name in ((settings.recordings_dir, "the recordings folder"), (settings.data_dir, "of the server")):
        for shown in () if folder is None else {str(folder), str(folder.resolve())}:
            text = text.replace(f"{shown}{os.sep}", "").replace(shown, name)
    return text


def _invalid_request(error: RequestValidationError) -> ErrorFacts:
    places = [place_of(problem) for problem in error.errors()]
    reasons = "; ".join(f"{place}: {misfit(problem)}" for place, problem in zip(places, error.errors(), strict=True))
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


def error_response(error: Exception, settings: AppSettings | None = None) -> JSONResponse:
    """Any exception as the one error body.   settings: of the server, whose folders are not told."""
    status, facts = facts_of_request(error)
    if settings is not None:
        facts = facts.model_copy(update={"text": without_paths(facts.text, settings)})
    headers = dict(error.headers) if isinstance(error, HTTPException) and error.headers else None
    if isinstance(error, TooMany):
        headers = {"Retry-After": str(error.retry_after_s)}
    return JSONResponse(body_of(facts), status_code=status, headers=headers)


async def _handle(request: Request, error: Exception) -> JSONResponse:
    status, facts = facts_of_request(error)
    if status >= 500 and not isinstance(error, ApiError):
        what = "defect" if facts.code == "defect" else facts.code
        _LOG.error("%s in %s %s", what, request.method, request.url.path, exc_info=error)
    return error_response(error, getattr(request.app.state, "settings", None))


def install_error_handler(app: FastAPI) -> None:
    """Send every exception of the application through the one handler."""
    for kind in (ApiError, UnsweepError, RequestValidationError, HTTPException, SQLAlchemyError, OSError, Exception):
        app.add_exception_handler(kind, _handle)
