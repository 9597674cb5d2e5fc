"""The 3D scene's page and its websocket, under our own origin: viser itself listens nowhere.

Down to the browser everything passes; up from it only what messages.py admits.
"""

from __future__ import annotations

import asyncio
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
from app.server.deps import RecordingDep, ServicesDep, get_recording, services_of

router = APIRouter(include_in_schema=False)

#: Close codes of our own: no such recording; the scene could not be opened.
GONE = 4404
TRY_AGAIN = 1013
#: Threads that wait for scenes to be made: a page full of browsers that come at once leaves the others to everybody.
DIALLING = 8


@router.get("/scene/{recording_id}/", dependencies=[Depends(get_recording)])
def read_scene_page() -> Response:
    """The scene's page. Never cached: it must be of the very version of viser that serves the websocket."""
    html, policy = scene_page()
    return HTMLResponse(html, headers={"Cache-Control": "no-cache", "Content-Security-Policy": policy})


@router.get("/api/recordings/{recording_id}/scene.html", include_in_schema=True, tags=["view"])
def download_scene(services: ServicesDep, recording: RecordingDep) -> HTMLResponse:
    """The scene as it is shown now, as one self-contained page to share."""
    headers = {"Content-Disposition": 'attachment; filename="scene.html"'}
    return HTMLResponse(services.scenes.export_html(recording.id), headers=headers)


@router.websocket("/scene/{recording_id}")  # viser's client strips the slash of its page's address
@router.websocket("/scene/{recording_id}/")
async def proxy_scene(browser: WebSocket, recording_id: Annotated[str, Path(pattern="^[0-9a-f]{32}$")]) -> None:
    """Everything the browser and its viser server say to each other. Origin and token were checked before this."""
    services = services_of(browser)
    try:
        line = await to_thread.run_sync(services.scenes.dial, recording_id, limiter=_dialling(browser))
    except Unavailable:
        await browser.close(TRY_AGAIN)
        return
    except ApiError:
        await browser.close(GONE)
        return
    wanted = [Subprotocol(name) for name in browser.scope["subprotocols"]]
    try:
        upstream = await connect(
            "ws://scene/",
            sock=line,
            subprotocols=wanted or None,
            compression=None,
            max_size=None,
            ping_interval=None,
            open_timeout=5,
            proxy=None,
        )
    except (OSError, TimeoutError, InvalidHandshake):
        await browser.close(TRY_AGAIN)
        return
    await browser.accept(subprotocol=upstream.subprotocol)
    # In a thread: whoever composes this scene anew holds its lock, and everybody else's requests would wait as well.
    await to_thread.run_sync(services.scenes.open.watcher_came, recording_id, +1)
    tasks = [asyncio.create_task(_downward(upstream, browser)), asyncio.create_task(_upward(browser, upstream))]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        with anyio.CancelScope(shield=True):
            await to_thread.run_sync(services.scenes.open.watcher_came, recording_id, -1)
            await upstream.close()


async def _downward(upstream: ClientConnection, browser: WebSocket) -> None:
    async for message in upstream:
        if isinstance(message, bytes):
            await browser.send_bytes(message)
        else:
            await browser.send_text(message)
    await browser.close(upstream.close_code or 1000)


async def _upward(browser: WebSocket, upstream: ClientConnection) -> None:
    try:
        while (message := await browser.receive())["type"] != "websocket.disconnect":
            said = admitted(message.get("bytes") or "")
            if said is not None:
                await upstream.send(said)
    except ConnectionClosed:
        return


def _dialling(browser: WebSocket) -> anyio.CapacityLimiter:
    """The limiter of the application, which belongs to its event loop."""
    state = browser.app.state
    if not hasattr(state, "dialling"):
        state.dialling = anyio.CapacityLimiter(DIALLING)
    return cast(anyio.CapacityLimiter, state.dialling)
