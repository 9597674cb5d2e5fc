"""Whatever comes through the scene's websocket, well-formed or not: nothing changes, nothing breaks, nobody is shut out."""

from __future__ import annotations

import math
import os
import socket
import struct
from contextlib import suppress

import msgspec
import viser._messages
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from app.scene.messages import LONGEST_BYTES, admitted
from bench.fuzz_scene import CAMERA, CLICK, POINTER
from tests.bench.fuzz_counts import SCENE_FRAMES

KINDS = {"ViewerCameraMessage", "SceneNodeClickMessage", "ScenePointerMessage"}
ODD = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**63), 2**64 - 1),
    st.floats(),
    st.text(max_size=20),
    st.binary(max_size=20),
    st.lists(st.floats(), max_size=5),
    st.sampled_from([*sorted(KINDS), "ShareUrlRequest", "RunJavascriptMessage"]),
)
#: One of the three with a few fields replaced, removed or added, or anything at all that msgpack can say.
SPOILT = st.builds(
    lambda base, changes, gone: {k: v for k, v in (base | changes).items() if k not in gone},
    st.sampled_from([CAMERA, CLICK, POINTER]),
    st.dictionaries(st.sampled_from([*CAMERA, *CLICK, *POINTER, "extra"]), ODD, max_size=3),
    st.sets(st.sampled_from([*CAMERA, *CLICK, *POINTER]), max_size=1),
)
ANYTHING = st.recursive(
    ODD,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=20,
)
MESSAGES = st.one_of(
    SPOILT.map(msgspec.msgpack.encode),
    ANYTHING.map(msgspec.msgpack.encode),
    st.binary(max_size=300),
    st.builds(lambda raw, at: raw[: at % len(raw)], SPOILT.map(msgspec.msgpack.encode), st.integers(0, 10**6)),
)


def numbers(value):
    """All numbers somewhere in a value."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, (list, tuple)):
        return [number for inner in value for number in numbers(inner)]
    return [value] if isinstance(value, (int, float)) and not isinstance(value, bool) else []


@settings(max_examples=SCENE_FRAMES, deadline=None)
@given(MESSAGES)
@example(msgspec.msgpack.encode(CAMERA | {"position": (math.inf, 0.0, 0.0)}))
@example(msgspec.msgpack.encode(CLICK | {"owner": "somebody"}))
@example(b"\x81\xa4type\xa2\xff\xfe")
def test_what_passes_is_one_of_three_and_finite(raw):
    """Oracle: msgspec without types, and viser's own decoder. Mutations: bounds left off; anything decoded passed on."""
    passed = admitted(raw)
    if passed is None:
        return
    said = msgspec.msgpack.decode(passed)
    assert said["type"] in KINDS
    assert len(passed) <= 2 * LONGEST_BYTES
    assert all(math.isfinite(number) for number in numbers(said))
    assert type(viser._messages.Message.deserialize(passed)).__name__ == said["type"]


def frame(payload, *, opcode=2, final=True, reserved=0, masked=True, declared=None):
    """A websocket frame by hand, as RFC 6455 has it, or as it has not.   declared: a length that is not the payload's."""
    length = len(payload) if declared is None else declared
    head = bytes([final << 7 | reserved << 4 | opcode])
    if length < 126:
        head += bytes([masked << 7 | length])
    elif length < 2**16:
        head += bytes([masked << 7 | 126]) + struct.pack(">H", length)
    else:
        head += bytes([masked << 7 | 127]) + struct.pack(">Q", length)
    mask = os.urandom(4)
    if not masked:
        return head + payload
    return head + mask + bytes(byte ^ mask[place % 4] for place, byte in enumerate(payload))


FRAMES = st.builds(
    frame,
    MESSAGES,
    opcode=st.sampled_from([2, 2, 2, 1, 0, 8, 9, 10, 3, 15]),
    final=st.sampled_from([True, True, False]),
    reserved=st.sampled_from([0, 0, 0, 1, 4, 7]),
    masked=st.sampled_from([True, True, True, False]),
    declared=st.sampled_from([None, None, None, 0, 200, 2**16 + 1, 2**40, 2**63 - 1, 2**64 - 1]),
)


def test_frames_of_any_kind_leave_the_scene_as_it_was(shared_live, caplog):
    """Oracle: the planes, the server's log, and a browser that opens the scene afterwards.

    Clicks are left out of what may be well-formed by the view, in which they do nothing. Mutations: a message decoded
    without a net (`msgspec.MsgspecError` not caught); a browser that leaves not counted off; text that is none told in the
    log with its traceback.
    """
    recording_id = shared_live.ready()
    here = f"/api/recordings/{recording_id}"
    shared_live.http.post(f"{here}/view", json={"mode": "inspect"})
    before = shared_live.http.get(f"{here}/planes").json()
    head = [
        f"GET /scene/{recording_id} HTTP/1.1",
        f"Host: 127.0.0.1:{shared_live.port}",
        f"Origin: {shared_live.origin}",
    ]
    head += ["Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13"]
    head += ["Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==", f"Sec-WebSocket-Protocol: viser-v{viser.__version__}"]

    # Text that is none: the web server's own library says so with a traceback, which its log is spared.
    @example([frame(b"\xff\xfe", opcode=1)])
    @settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
    @given(st.lists(FRAMES, min_size=1, max_size=6))
    def send(frames):
        with socket.create_connection(("127.0.0.1", shared_live.port), timeout=30) as page:
            page.sendall("\r\n".join([*head, "", ""]).encode())
            assert page.recv(12) == b"HTTP/1.1 101"
            with suppress(ConnectionError):  # it may have had enough before the last one
                page.sendall(b"".join(frames))

    send()
    hub = shared_live.services.scenes
    shared_live.wait(lambda: hub.open.watchers(recording_id) == 0)
    with shared_live.scene(recording_id) as page:
        assert len(page.recv(timeout=20)) > 16
    assert shared_live.http.get(f"{here}/planes").json() == before
    assert not [record for record in caplog.records if record.levelname == "ERROR" or record.exc_info]
