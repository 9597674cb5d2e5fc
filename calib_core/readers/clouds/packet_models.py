"""Which sensor raw packets come from, for the sentence that refuses them: from their own bytes or their metadata."""

from __future__ import annotations

import json

from calib_core.readers.container.opening import OpenRecording
from calib_core.readers.container.storage import TopicSummary
from calib_core.readers.container.wire import MalformedMessage, Wire

_HESAI_MAGIC = b"\xee\xff"
#: (protocol major version, lasers) of a Hesai packet -> model.
_HESAI_MODELS = {
    (6, 32): "PandarXT32",
    (6, 16): "PandarXT16",
    (1, 128): "Pandar128",
    (3, 128): "QT128 or Pandar128",
    (4, 128): "AT128",
    (1, 64): "PandarQT64",
}


def packet_model(recording: OpenRecording, topic: TopicSummary) -> str:
    """The model's name as far as the recording tells it, "" where it does not."""
    try:
        if "pandar" in topic.type or "hesai" in topic.type:
            return _hesai(recording, topic)
        if "ouster" in topic.type:
            return _ouster(recording)
    except (MalformedMessage, ValueError):
        pass
    return ""


def _hesai(recording: OpenRecording, topic: TopicSummary) -> str:
    """From the first packet's head: EE FF, major and minor version, two reserved bytes, number of lasers."""
    message = next(iter(recording.messages((topic.name,))), None)
    if message is None:
        return ""
    wire = Wire(message.payload, topic.encoding)
    wire.header()
    start = message.payload.find(_HESAI_MAGIC, wire.pos, wire.pos + 64)
    if start < 0 or start + 8 > len(message.payload):
        return ""
    major, lasers = message.payload[start + 2], message.payload[start + 6]
    return _HESAI_MODELS.get((major, lasers), f"with {lasers} lasers (protocol {major})")


def _ouster(recording: OpenRecording) -> str:
    """From the sensor's metadata, which the driver records as a string topic."""
    for topic in recording.topics:
        if topic.type == "std_msgs/msg/String" and "metadata" in topic.name:
            for message in recording.messages((topic.name,)):
                wire = Wire(message.payload, topic.encoding)
                text = bytes(wire.view(wire.u32())).rstrip(b"\0").decode("utf-8", "replace")
                product = _find_key(json.loads(text), "prod_line")
                return product or ""
    return ""


def _find_key(tree: object, key: str) -> str | None:
    """The first string under `key` at any depth of a JSON document."""
    if isinstance(tree, dict):
        if isinstance(tree.get(key), str):
            return str(tree[key])
        for branch in tree.values():
            found = _find_key(branch, key)
            if found is not None:
                return found
    return None
