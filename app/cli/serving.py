"""`unsweep serve`: check what can go wrong before the server starts, say where it is, serve until stopped."""

from __future__ import annotations

import ipaddress
import os
import secrets
import socket
import subprocess
import sys
from contextlib import suppress
from functools import partial
from pathlib import Path
from urllib.parse import quote

from pydantic import ValidationError

from app.application import make_server
from app.kernels import compile_in_background, end
from app.logs import log_to_stderr
from app.settings import AppSettings
from calib_core.errors import InputError
from calib_core.validation_messages import misfit

#: Randomness of a token that nobody gave.
MADE_TOKEN_BYTES = 24


def serve_until_stopped(
    *,
    host: str,
    port: int,
    data_dir: Path | None,
    recordings_dir: Path | None,
    token: str | None,
    scheduler: str | None,
    database: str | None,
) -> None:
    """Serve the web application until Ctrl-C or SIGTERM. Prints one line with the address, token included."""
    settings = server_settings(
        host=host,
        port=port,
        data_dir=data_dir,
        recordings_dir=recordings_dir,
        token=token,
        scheduler=scheduler,
        database=database,
    )
    listening = listen(settings.host, settings.port)
    with listening:
        compiling: list[subprocess.Popen[bytes]] = []
        # The server stops in order and then raises the Ctrl-C again; it was what the person wanted.
        log_to_stderr(as_json=settings.log_json)
        where = address(settings, listening.getsockname()[1])
        server = make_server(settings, on_started=partial(_tell_started, where, compiling))
        try:
            with suppress(KeyboardInterrupt):
                server.run(sockets=[listening])
        finally:
            for process in compiling:
                end(process)
            if server.startup_error is not None:
                raise InputError(str(server.startup_error), code=server.startup_error.code) from None


def _tell_started(where: str, compiling: list[subprocess.Popen[bytes]]) -> None:
    """Say that the server can be used, and where; only now: until then it may turn out that its data directory cannot be.

    compiling: gets the process that compiles the loops, where that is still to do.
    """
    sys.stderr.write(f"unsweep is at {where} (Ctrl-C stops it)\n")
    begun = compile_in_background()
    if begun is not None:
        compiling.append(begun)
        sys.stderr.write("Compiling for this machine in the background, once; until it is done, jobs take longer\n")
    sys.stderr.flush()


def server_settings(
    *,
    host: str,
    port: int,
    data_dir: Path | None = None,
    recordings_dir: Path | None = None,
    token: str | None = None,
    scheduler: str | None = None,
    database: str | None = None,
) -> AppSettings:
    """The settings that options and environment give; with a token where the address is not loopback."""
    if recordings_dir is not None and not recordings_dir.is_dir():
        raise InputError(
            f"Expected a folder for --recordings, but {recordings_dir} is none; make it or correct the name."
        )
    try:
        # An empty UNSWEEP_TOKEN, as a compose file passes it on, is no token.
        settings = AppSettings(host=host, port=port, token=token or os.environ.get("UNSWEEP_TOKEN") or None)
    except ValidationError as error:
        first = error.errors()[0]
        option = "--" + "-".join(str(part) for part in first["loc"]).replace("_", "-")
        raise InputError(f"The option {option} does not fit: {misfit(first)}; correct it.") from error
    given = {
        "data_dir": data_dir,
        "recordings_dir": recordings_dir,
        "scheduler": scheduler,
        "database_url": database,
    }
    changes: dict[str, object] = {name: value for name, value in given.items() if value is not None}
    if settings.token is None and not settings.is_loopback():
        changes["token"] = secrets.token_urlsafe(MADE_TOKEN_BYTES)
    return settings.model_copy(update=changes)


def listen(host: str, port: int) -> socket.socket:
    """A socket bound to the address, or one sentence why not."""
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        # By its name: asyncio turns Nagle's algorithm off for such alone, and every answer on a kept connection waited 40 ms.
        bound = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    except OSError as error:
        raise InputError(
            f"The address {host} of --host is not known ({error.strerror}); give one of this machine's."
        ) from error
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind((host, port))
        # Taken now, so that a second server is refused here with its sentence and not later.
        bound.listen(2048)
    except OSError as error:
        bound.close()
        raise InputError(
            f"Port {port} of {host} cannot be used ({error.strerror}); "
            "stop the program that uses it, or choose another with --port."
        ) from error
    return bound


def address(settings: AppSettings, port: int) -> str:
    """What to open in a browser."""
    host = settings.host
    try:
        where = ipaddress.ip_address(host)
        if where.is_unspecified:
            host = socket.gethostname()
        elif where.version == 6:
            host = f"[{host}]"
    except ValueError:
        pass  # a name, good as it is
    # A token may hold any character, and some of them end a query or mean another one.
    query = f"/?token={quote(settings.token, safe='')}" if settings.token else "/"
    return f"http://{host}:{port}{query}"
