"""A server of one's own that runs no job: for whoever tries its requests."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from app.application import Server, make_server
from app.cli.serving import listen
from app.jobs.orders import Order, Parcel, Stopped
from app.settings import AppSettings


class StillLauncher:
    """Runs no process: every job ends at once, having done nothing. The requests are what is tried here."""

    def launch(self, _: Order) -> StillLauncher:
        """A job that has ended."""
        return self

    def parcels(self) -> Iterator[Parcel]:
        """Its end."""
        yield Stopped()

    def ask_to_stop(self) -> None:
        """It has."""

    def terminate(self) -> None:
        """It has."""

    def slots(self) -> None:
        """As many as the settings say."""

    def prepare(self) -> None:
        """Nothing to prepare."""

    def close(self) -> None:
        """Nothing to close."""


@contextmanager
def server_of_its_own(folder: Path) -> Iterator[tuple[str, Server]]:
    """The address of a server over an empty data directory, and the server."""
    bound = listen("127.0.0.1", 0)
    shared = folder / "recordings"
    shared.mkdir()
    settings = AppSettings(data_dir=folder / "data", recordings_dir=shared, min_free_bytes=0)
    server = make_server(settings, launcher=StillLauncher())
    thread = threading.Thread(target=server.run, kwargs={"sockets": [bound]}, daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    try:
        yield f"http://127.0.0.1:{bound.getsockname()[1]}", server
    finally:
        server.should_exit = True
        thread.join(30)
        bound.close()
