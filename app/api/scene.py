"""The 3D scene's page and its websocket, under our own origin: viser itself listens nowhere.

Down to the browser everything passes; up from it only what messages.py admits.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Annotated, cast

import anyio
from anyio import to_thread
from fastapi import APIRouter, Depends, Path, Response, WebSocket
from fastapi.responses import HTMLResponse
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.typing import Subprotocol

from app.errors import ApiError, Unavailable
from app.scene.messages import admitted
from app.scene.page import scene_page
from app.schemas.common import ID_PATTERN
from app.schemas.view import TabName
from app.server.deps import RecordingDep, ServicesDep, get_recording, services_of

router = APIRouter()

RecordingPath = Annotated[str, Path(pattern=ID_PATTERN)]
TabPath = Annotated[TabName, Path()]

#: Close codes of our own: no such recording; the scene could not be opened.
GONE = 4404
TRY_AGAIN = 1013
#: Threads that wait for scenes to be made: a page full of browsers that come at once leaves the others to everybody.
DIALLING = 8
#: Browsers that are given their first picture at once. One costs a fortieth of a second; of twenty that come together, as after
#: a restart, the others wait instead of everybody who asks for anything.
ARRIVING = 2
#: A browser that does not take its first picture within this keeps nobody waiting any longer.
ARRIVING_S = 1.0


@router.get("/scene/{recording_id}/", include_in_schema=False, dependencies=[Depends(get_recording)])
@router.get("/scene/{recording_id}/{tab}/", include_in_schema=False, dependencies=[Depends(get_recording)])
def read_scene_page() -> Response:
    """The scene's page. Never cached: it must be of the very version of viser that serves the websocket."""
    html, policy = scene_page()
    return HTMLResponse(html, headers={"Cache-Control": "no-cache", "Content-Security-Policy": policy})


@router.get("/api/recordings/{recording_id}/scene.html", tags=["view"])
def download_scene(services: ServicesDep, recording: RecordingDep) -> HTMLResponse:
    """The scene as it is shown now, as one self-contained page to share."""
    headers = {"Content-Disposition": 'attachment; filename="scene.html"'}
    return HTMLResponse(services.scenes.export_html(recording.id), headers=headers)


@router.websocket("/scene/{recording_id}")  # viser's client strips the slash of its page's address
@router.websocket("/scene/{recording_id}/")
async def proxy_scene(browser: WebSocket, recording_id: RecordingPath) -> None:
    """Everything the browser and its viser server say to each other. Origin and token were checked before this."""
    await _proxy(browser, recording_id, None)


@router.websocket("/scene/{recording_id}/{tab}")
@router.websocket("/scene/{recording_id}/{tab}/")
async def proxy_scene_of_tab(browser: WebSocket, recording_id: RecordingPath, tab: TabPath) -> None:
    """As `proxy_scene`, for a tab that has told its name: what is clicked there means what the tab's own screen says."""
    await _proxy(browser, recording_id, tab)


async def _proxy(browser: WebSocket, recording_id: str, tab: str | None) -> None:
    services = services_of(browser)
    try:
        line, scene = await to_thread.run_sync(
            services.scenes.dial, recording_id, limiter=_limiter(browser, "dialling", DIALLING)
        )
    except Unavailable:
        await browser.close(TRY_AGAIN)
        return
    except ApiError:
        await browser.close(GONE)
        return
    async with _limiter(browser, "arriving", ARRIVING):
        upstream = await _dialled(browser, line)
        if upstream is None:
            await browser.close(TRY_AGAIN)
            return
        await browser.accept(subprotocol=upstream.subprotocol)
        pictured = asyncio.Event()
        tasks = [
            asyncio.create_task(_downward(upstream, browser, pictured)),
            asyncio.create_task(_upward(browser, upstream, partial(services.scenes.tabs.edits, recording_id, tab))),
        ]
        with anyio.move_on_after(ARRIVING_S):
            await pictured.wait()
    services.scenes.open.watcher_came(scene, +1)
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        services.scenes.open.watcher_came(scene, -1)
        with anyio.CancelScope(shield=True):
            await upstream.close()


async def _dialled(browser: WebSocket, line: socket.socket) -> ClientConnection | None:
    """The far side of the line, greeted; None where it does not answer."""
    wanted = [Subprotocol(name) for name in browser.scope["subprotocols"]]
    with suppress(OSError, TimeoutError, InvalidHandshake):
        return await connect(
            "ws://scene/",
            sock=line,
            subprotocols=wanted or None,
            compression=None,
            max_size=None,
            ping_interval=None,
            open_timeout=5,
            proxy=None,
        )
    return None


async def _downward(upstream: ClientConnection, browser: WebSocket, pictured: asyncio.Event) -> None:
    """pictured: set once the first message has gone, or none will."""
    try:
        async for message in upstream:
            if isinstance(message, bytes):
                await browser.send_bytes(message)
            else:
                await browser.send_text(message)
            pictured.set()
        await browser.close(upstream.close_code or 1000)
    finally:
        pictured.set()


async def _upward(browser: WebSocket, upstream: ClientConnection, edits: Callable[[], bool]) -> None:
    try:
        while (message := await browser.receive())["type"] != "websocket.disconnect":
            said = admitted(message.get("bytes") or "", edits=edits())
            if said is not None:
                await upstream.send(said)
    except ConnectionClosed:
        return


def _limiter(browser: WebSocket, name: str, most: int) -> anyio.CapacityLimiter:
    """The limiter of that name of the application, which belongs to its event loop."""
    state = browser.app.state
    if not hasattr(state, name):
        setattr(state, name, anyio.CapacityLimiter(most))
    return cast(anyio.CapacityLimiter, getattr(state, name))
