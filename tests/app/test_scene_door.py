"""The scene has no door of its own: nothing listens but the server, and what a browser says to it is checked."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import psutil
import pytest
import viser
import viser._viser

from app.scene.aim import Stand
from app.scene.messages import admitted
from bench.fuzz_scene import CAMERA, CLICK, POINTER

#: What viser's client can say besides; read in the sources of the version that is pinned.
FORBIDDEN = (
    {"type": "ShareUrlRequest"},
    {"type": "ShareUrlDisconnect"},
    {"type": "RunJavascriptMessage", "source": "1"},
    {"type": "GuiUpdateMessage", "uuid": "a", "updates": {}},
    {"type": "FileTransferStartUpload", "source_component_uuid": "a", "transfer_uuid": "b", "filename": "c"},
    {"type": "GetRenderResponseMessage", "render_id": 0, "payload": b""},
    {"type": "LocalStorageGetItemResponseMessage", "request_uuid": "a", "value": "b"},
    {"type": "CommandTriggerMessage", "uuid": "a"},
    {"type": "Message"},
    {},
)


def listening():
    """Addresses on which this process accepts connections, of any family."""
    own = psutil.Process()
    inet = {(found.laddr.ip, found.laddr.port) for found in own.net_connections("inet") if found.status == "LISTEN"}
    return inet | {found.laddr for found in own.net_connections("unix") if found.laddr}


def test_an_open_scene_listens_nowhere(shared_live):
    """Oracle: the system's own list of this process's sockets, TCP and Unix.

    Mutation: viser's own `serve`, on a free port of 127.0.0.1, which any page and any user of the machine may speak to.
    """
    recording_id = shared_live.ready()
    before = listening()
    with shared_live.scene(recording_id) as socket:
        assert len(socket.recv(timeout=20)) > 16  # the scene is really open and really sends
        assert listening() == before
    shared_live.services.scenes.open.close(recording_id)
    assert listening() == before


def test_no_browser_can_have_the_scene_published(shared_live, monkeypatch):
    """Asked through our proxy and behind it, nothing ever tries to open a tunnel. Oracle: the class that would open one.

    Mutations: the proxy passing on what it does not know; viser's handlers left in place.
    """
    opened = []
    monkeypatch.setattr(viser._viser, "ViserTunnel", lambda *where: opened.append(where))
    recording_id = shared_live.ready()
    with shared_live.scene(recording_id) as socket:
        socket.send(msgspec.msgpack.encode(CAMERA))
        for message in FORBIDDEN:
            socket.send(msgspec.msgpack.encode(message))
        socket.send(msgspec.msgpack.encode(CAMERA | {"position": (1.0, 2.0, 3.0)}))
        hub = shared_live.services.scenes
        # What came last has arrived, so all before has been judged, and the connection has outlived it.
        shared_live.wait(lambda: (seen := hub.camera(recording_id)) is not None and seen.p_scene_camera[1] == 2.0)
    shown = hub.open.find(recording_id).shown
    assert shown._server.request_share_url() is None
    handled = {kind.__name__ for kind in shown._server._connection._incoming_handlers}
    assert not handled & {"ShareUrlRequest", "ShareUrlDisconnect"}
    assert opened == []


def test_a_browser_that_leaves_while_it_is_turned_is_no_matter(shared_live, monkeypatch):
    """The camera of a browser that is gone is aimed, as when it left meanwhile; warnings are errors here.

    Oracle: viser's own list of clients. Mutation: the camera set as for one that stays.
    """
    recording_id = shared_live.ready()
    hub = shared_live.services.scenes
    with shared_live.scene(recording_id) as socket:
        socket.send(msgspec.msgpack.encode(CAMERA))
        shown = hub.open.find(recording_id).shown
        shared_live.wait(lambda: len(shown._server.get_clients()) == 1)
        (client,) = shown._server.get_clients().values()
    shared_live.wait(lambda: not shown._server.get_clients())
    assert not np.allclose(client.camera.position, (7.0, 8.0, 9.0))
    monkeypatch.setattr(shown, "_stand", lambda **_: Stand(np.array([7.0, 8.0, 9.0]), np.zeros(3)))
    shown._turn(client)
    np.testing.assert_allclose(client.camera.position, (7.0, 8.0, 9.0))


@pytest.mark.parametrize("message", [CAMERA, CLICK, POINTER], ids=lambda message: message["type"])
def test_what_the_scene_needs_passes_as_it_was_meant(message):
    """Oracle: viser's own decoder on both sides. Mutation: a field lost on the way."""
    decode = viser._messages.Message.deserialize
    raw = msgspec.msgpack.encode(message)
    passed = admitted(raw)
    assert passed is not None
    assert decode(passed) == decode(raw)


@pytest.mark.parametrize(
    "change",
    [
        {"wxyz": (0.0, 0.0, 0.0, 0.0)},
        {"wxyz": (1.0, 0.0, 0.0)},
        {"position": (math.nan, 0.0, 0.0)},
        {"look_at": (math.inf, 0.0, 0.0)},
        {"fov": 0.0},
        {"fov": 4.0},
        {"image_height": 0},
        {"image_width": "800"},
        {"extra": 1},
        {"far": None},
    ],
)
def test_a_camera_that_is_none_is_dropped(change):
    """Mutations: no bounds (a NaN reaches the cut of the clouds); unknown fields passed on."""
    assert admitted(msgspec.msgpack.encode(CAMERA | change)) is None


@pytest.mark.parametrize("message", FORBIDDEN, ids=lambda message: str(message.get("type")))
def test_everything_else_is_dropped(message):
    """Mutation: a list of what is forbidden in the place of one of what is allowed."""
    assert admitted(msgspec.msgpack.encode(message)) is None


@pytest.mark.parametrize("raw", [b"", b"\xc1", b"\xdd\xff\xff\xff\xff", b"\x91" * 5000, "text", b"\x00" * 70_000])
def test_what_is_no_message_at_all_is_dropped(raw):
    """Headers of arrays of 2^32, 5,000 levels, text, too long. Mutation: catching only ValidationError."""
    assert admitted(raw) is None
