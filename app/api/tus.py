"""The class of the routes that speak tus: its version is asked for and told, in refusals too."""

from __future__ import annotations

from collections.abc import Callable, Coroutine

from fastapi import Request, Response
from fastapi.routing import APIRoute

from app.errors import ApiError
from app.server.errors import error_response
from app.uploads.protocol import VERSION, TusError


class TusRoute(APIRoute):
    """A route that asks for the protocol's version and says it in every answer, refusals included."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[object, None, Response]]:
        """The handler, wrapped."""
        handle = super().get_route_handler()

        async def answer(request: Request) -> Response:
            try:
                if request.method != "OPTIONS" and request.headers.get("tus-resumable") != VERSION:
                    raise TusError(
                        412, "upload.version", f"Uploads here speak tus {VERSION}; send Tus-Resumable: {VERSION}."
                    )
                response = await handle(request)
            except ApiError as error:
                response = error_response(error)
            response.headers["Tus-Resumable"] = VERSION
            response.headers["Tus-Version"] = VERSION
            return response

        return answer
