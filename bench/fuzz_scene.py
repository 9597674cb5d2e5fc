"""What a browser may say to the scene, and what it may not."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from pathlib import Path

import msgspec

from app.scene.messages import LONGEST_BYTES, admitted
from bench.spoilt import require, spoilt

CAMERA: dict[str, object] = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (0, 0, -3.0),
    "fov": 1.2,
    "near": 0.1,
    "far": 1000,
    "image_height": 600,
    "image_width": 800,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}
CLICK: dict[str, object] = {
    "type": "SceneNodeClickMessage",
    "name": "/patch/0",
    "instance_index": None,
    "ray_origin": (0.0, 0.0, 0.0),
    "ray_direction": (1.0, 0.0, 0.0),
    "screen_pos": (0.5, 0.5),
    "modifier": None,
    "owner": "",
}
POINTER: dict[str, object] = {
    "type": "ScenePointerMessage",
    "event_type": "rect-select",
    "ray_origin": None,
    "ray_direction": None,
    "screen_pos": ((0.1, 0.1), (0.9, 0.9)),
    "modifier": "shift",
}
SAID = (CAMERA, CLICK, POINTER)
ODD: tuple[object, ...] = (
    *(None, True, -1, 2**63, math.nan, math.inf, -math.inf, 1e308, "", "x" * 5000, b"\xff", [], {}, [[]] * 50),
    *("ShareUrlRequest", "RunJavascriptMessage", "ViewerCameraMessage", (math.nan,) * 3, (1e9,) * 3),
)


def said(_: Path, chance: random.Random) -> str:
    """What a browser says to the scene."""
    message = dict(chance.choice(SAID))
    for _turn in range(chance.choice((0, 1, 1, 2))):
        key = chance.choice([*message, "extra", "uuid"])
        message[key] = chance.choice(ODD)
        if chance.random() < 0.2:
            message.pop(key)
    raw = msgspec.msgpack.encode(message)
    passed = admitted(spoilt(raw, chance) if chance.random() < 0.5 else raw)
    if passed is None:
        return "refused"
    kinds = {each["type"] for each in SAID}
    require(msgspec.msgpack.decode(passed)["type"] in kinds, "of another kind")
    require(len(passed) <= 2 * LONGEST_BYTES, "too long")
    require(all(math.isfinite(number) for number in numbers(msgspec.msgpack.decode(passed))), "no number")
    return "taken"


def numbers(value: object) -> Iterator[float]:
    """All numbers somewhere in a value."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, (list, tuple)):
        for inner in value:
            yield from numbers(inner)
    elif isinstance(value, (int, float)):
        yield value
