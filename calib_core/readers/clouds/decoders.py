"""One stored message -> RawCloud, by the topic's type."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

from calib_core.readers.clouds import livox, pointcloud2
from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.clouds.livox import read_custom_msg
from calib_core.readers.clouds.packets import PACKET_TYPES, unsupported_packets
from calib_core.readers.clouds.pointcloud2 import read_pointcloud2
from calib_core.readers.container.storage import RawMessage, TopicSummary
from calib_core.readers.container.wire import MalformedMessage

#: Raises MalformedMessage for bytes that are no message of the topic's type.
CloudDecoder = Callable[[RawMessage], RawCloud]

#: What decoding raises at a message that is damaged, or lacks a field that the others have.
UNDECODABLE = (MalformedMessage, ValueError, KeyError)


def cloud_decoder(topic: TopicSummary, stamps: Literal["header", "receive"] = "header") -> CloudDecoder:
    """The decoder for the topic's messages. Raises TopicError for packets that are not decoded here.

    stamps: "receive" puts the recorder's clock in the place of the headers'.
    """
    decoder = _decoder(topic)
    return decoder if stamps == "header" else restamped(decoder)


def restamped(decoder: CloudDecoder) -> CloudDecoder:
    """The same clouds with the recorder's clock in the place of their headers'."""

    def decode(message: RawMessage) -> RawCloud:
        return replace(decoder(message), header_ns=message.receive_ns)

    return decode


def _decoder(topic: TopicSummary) -> CloudDecoder:
    encoding = topic.encoding
    if topic.type == pointcloud2.TYPE:
        return lambda message: read_pointcloud2(message, encoding)
    if topic.type in livox.TYPES:
        return lambda message: read_custom_msg(message, encoding)
    if topic.type in PACKET_TYPES:
        from calib_core.readers.clouds.velodyne import VelodyneDecoder  # its library takes 50 ms to import

        return VelodyneDecoder(encoding)
    raise unsupported_packets(topic)
