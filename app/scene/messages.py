"""What a browser may say to the scene: where its camera is, what was clicked, what rectangle was drawn. Nothing else.

viser's clients can say much more: have the scene published, run code in other browsers, send files. Whatever is not of
one of the kinds below, in every field, is dropped; what passes is written anew from what was understood.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct

#: Metres, and their directions: nobody looks from farther away, and a NaN is in no interval.
_Coordinate = Annotated[float, Meta(ge=-1e7, le=1e7)]
#: Shares of the canvas; a drag may end outside it.
_Share = Annotated[float, Meta(ge=-100.0, le=100.0)]
_Vector = tuple[_Coordinate, _Coordinate, _Coordinate]
_Place = tuple[_Share, _Share]
_Pixels = Annotated[int, Meta(gt=0, le=100_000)]
_Distance = Annotated[float, Meta(gt=0.0, le=1e9)]
_Name = Annotated[str, Meta(max_length=300)]
_Keys = Literal["cmd/ctrl", "alt", "shift", "cmd/ctrl+alt", "cmd/ctrl+shift", "alt+shift", "cmd/ctrl+alt+shift"]
#: More than any message of these kinds has.
LONGEST_BYTES = 4096
#: Shorter quaternions have no direction.
LEAST_NORM = 1e-6


class _Said(Struct, frozen=True, tag_field="type", forbid_unknown_fields=True):
    pass


class _Camera(_Said, frozen=True, tag="ViewerCameraMessage"):
    wxyz: tuple[_Coordinate, _Coordinate, _Coordinate, _Coordinate]
    position: _Vector
    fov: Annotated[float, Meta(gt=0.0, lt=math.pi)]
    near: _Distance
    far: _Distance
    image_height: _Pixels
    image_width: _Pixels
    look_at: _Vector
    up_direction: _Vector

    def __post_init__(self) -> None:
        if math.hypot(*self.wxyz) < LEAST_NORM:
            raise ValueError("no rotation")


class _Click(_Said, frozen=True, tag="SceneNodeClickMessage"):
    name: _Name
    ray_origin: _Vector
    ray_direction: _Vector
    screen_pos: _Place
    instance_index: Annotated[int, Meta(ge=0)] | None = None
    modifier: _Keys | None = None
    owner: Literal[""] = ""


class _Pointer(_Said, frozen=True, tag="ScenePointerMessage"):
    event_type: Literal["click", "rect-select"]
    ray_origin: _Vector | None
    ray_direction: _Vector | None
    screen_pos: Annotated[tuple[_Place, ...], Meta(max_length=2)]
    modifier: _Keys | None = None

    def __post_init__(self) -> None:
        is_click = self.event_type == "click"
        if is_click and (self.ray_origin is None or self.ray_direction is None):
            raise ValueError("no ray")
        if len(self.screen_pos) != (1 if is_click else 2):
            raise ValueError("no place")


_DECODER = msgspec.msgpack.Decoder(_Camera | _Click | _Pointer)


def admitted(raw: bytes | str, *, edits: bool = True) -> bytes | None:
    """The message as the scene may have it; None for any other.   edits: whether clicks and rectangles may change anything."""
    if isinstance(raw, str) or len(raw) > LONGEST_BYTES:
        return None
    try:
        said = _DECODER.decode(raw)
        return msgspec.msgpack.encode(said) if edits or isinstance(said, _Camera) else None
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):  # a text that is none is no MsgspecError
        return None
