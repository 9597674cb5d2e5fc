"""Every error leaves the server in one body, with the sentence that app/errors.py has for it."""

from __future__ import annotations

import http
import logging

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from app.errors import ApiError, TooMany, facts_of
from app.schemas.common import ErrorBody, ErrorDetails, ErrorFacts
from calib_core.errors import UnsweepError

_LOG = logging.getLogger("unsweep")


def facts_of_request(error: Exception) -> tuple[int, ErrorFacts]:
    """The same for what the web framework raises, too."""
    if isinstance(error, RequestValidationError):
        return 422, _invalid_request(error)
    if isinstance(error, HTTPException):
        return error.status_code, _http_facts(error)
    return facts_of(error)


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
    status, facts = facts_of_request(error)
    headers = dict(error.headers) if isinstance(error, HTTPException) and error.headers else None
    if isinstance(error, TooMany):
        headers = {"Retry-After": str(error.retry_after_s)}
    return JSONResponse(body_of(facts), status_code=status, headers=headers)


async def _handle(request: Request, error: Exception) -> JSONResponse:
    if facts_of_request(error)[0] >= 500 and not isinstance(error, ApiError):
        _LOG.error("defect in %s %s", request.method, request.url.path, exc_info=error)
    return error_response(error)


def install_error_handler(app: FastAPI) -> None:
    """Send every exception of the application through the one handler."""
    for kind in (ApiError, UnsweepError, RequestValidationError, HTTPException, Exception):
        app.add_exception_handler(kind, _handle)
