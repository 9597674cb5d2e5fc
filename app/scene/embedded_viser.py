"""viser without a door: it listens to nothing, and speaks only over socket pairs that this process makes.

As it comes, viser listens on a TCP port without token, Origin or Host: every page in a browser of the machine and every
user of it could read the cloud and edit the planes. It takes its listening from `websockets.asyncio.server.serve`, by
name; here that name leads to `Doorless`, which makes the same connections over sockets that it is given. The version of
viser is pinned exactly, and a test counts the process's listening sockets.
"""

from __future__ import annotations

import asyncio
import contextlib
import io
import socket
import types
import uuid
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AbstractContextManager
from typing import ClassVar, cast

import viser
import viser._messages as viser_messages
import viser.infra._infra as viser_infra
import websockets
from websockets.asyncio.server import Server, ServerConnection
from websockets.server import ServerProtocol
from websockets.typing import Subprotocol

from app.errors import Unavailable

#: The socket pair's far end is taken over by viser's own thread; it has nothing else to do then.
DIAL_TIMEOUT_S = 5.0
#: What a browser says to the scene is small: a camera, a click. Judged in messages.py before it comes here.
MAX_MESSAGE_BYTES = 2**16

Handler = Callable[[ServerConnection], Awaitable[None]]
Choice = Callable[[ServerConnection, Sequence[Subprotocol]], Subprotocol | None]


class _Taking(Server):
    """A server that takes connections though its own socket does not listen."""

    taking = True

    def is_serving(self) -> bool:
        """Whether a connection is answered."""
        return self.taking


class Doorless:
    """In the place of `websockets.asyncio.server.serve`: connections are given to it, none can be made to it."""

    _made: ClassVar[dict[str, Doorless]] = {}

    def __init__(self, handler: Handler, host: str, _port: int, *, select_subprotocol: Choice, **_: object) -> None:
        self._handler = handler
        self._choose = select_subprotocol
        self._loop = asyncio.get_running_loop()
        self._server: _Taking | None = None
        Doorless._made[host] = self

    @classmethod
    def named(cls, name: str) -> Doorless:
        """The one that a viser server of that host name has made."""
        return cls._made.pop(name)

    async def __aenter__(self) -> Server:
        """What viser expects of a server; its one socket is bound to nothing and never listens."""
        self._server = _Taking(self._handler, server_header=None)
        deaf = await self._loop.create_server(self._connection, sock=socket.socket(), start_serving=False)
        self._server.wrap(deaf)
        return self._server

    async def __aexit__(self, *_: object) -> None:
        """Close all connections."""
        if self._server is not None:
            self._server.taking = False
            self._server.close()
            await self._server.wait_closed()

    def dial(self) -> socket.socket:
        """The near end of a new connection. From any thread but viser's."""
        near, far = socket.socketpair()
        try:
            taking = self._loop.connect_accepted_socket(self._connection, far)
            asyncio.run_coroutine_threadsafe(taking, self._loop).result(DIAL_TIMEOUT_S)
        except (RuntimeError, TimeoutError, OSError) as error:  # it has been stopped meanwhile
            for end in (near, far):
                end.close()
            raise Unavailable("scene.closed", "The 3D view was just closed; open it again.") from error
        return near

    def _connection(self) -> ServerConnection:
        assert self._server is not None

        # A plain function: the library makes it a method of the protocol.
        def select(_: ServerProtocol, offered: Sequence[Subprotocol]) -> Subprotocol | None:
            return self._choose(made, offered)

        protocol = ServerProtocol(select_subprotocol=select, max_size=MAX_MESSAGE_BYTES)
        made = ServerConnection(protocol, self._server, ping_interval=None)
        return made


#: All that viser's server asks of the library, and no more: what else it might listen with is not there.
viser_infra.websockets = cast(  # type: ignore[attr-defined]
    types.ModuleType,
    types.SimpleNamespace(
        asyncio=types.SimpleNamespace(server=types.SimpleNamespace(serve=Doorless)),
        exceptions=websockets.exceptions,
        datastructures=websockets.datastructures,
    ),
)


class DoorlessViser(viser.ViserServer):
    """A viser server that nobody reaches but by `dial`, and that cannot be published."""

    def __init__(self) -> None:
        name = uuid.uuid4().hex
        with contextlib.redirect_stdout(io.StringIO()):  # it greets whoever starts it
            super().__init__(host=name, port=0, verbose=False)
        self._doorless = Doorless.named(name)
        for kind in (viser_messages.ShareUrlRequest, viser_messages.ShareUrlDisconnect):
            self._connection.unregister_handler(kind)

    def dial(self) -> socket.socket:
        """The near end of a new connection to the scene."""
        return self._doorless.dial()

    def request_share_url(self, verbose: bool = True) -> None:
        """Nothing: a recording does not leave the machine."""


def leaving(client: viser.ClientHandle) -> AbstractContextManager[None]:
    """For words to a browser that may be gone before they are said: viser warns of them, though nothing is amiss."""
    return client._websock_connection.get_message_buffer().sanctioned_dead_writes()  # noqa: SLF001 - there is no other door
