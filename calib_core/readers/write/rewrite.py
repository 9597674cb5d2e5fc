"""A recording written again with its points moved: a bag of the same kind, or a folder of .ply or .pcd files.

Everything but the coordinates of valid points stays as it was: fields, invalid points, stamps, order, other topics.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from calib_core.errors import Cancelled
from calib_core.events import LogEvent, OnEvent, ShouldCancel, StageEvent, ignore_event, never_cancel
from calib_core.maps.files import write_cloud
from calib_core.phrasing import counted
from calib_core.readers.clouds.decoders import UNDECODABLE, CloudDecoder, cloud_decoder
from calib_core.readers.clouds.layouts import recognise_layout
from calib_core.readers.clouds.livox import TYPES as LIVOX_TYPES
from calib_core.readers.clouds.pointcloud2 import TYPE as POINTCLOUD2
from calib_core.readers.container.opening import OpenRecording, open_recording
from calib_core.readers.container.storage import RawMessage, TopicSummary
from calib_core.readers.reading import sample_clouds, span_ns
from calib_core.readers.ring_by_elevation import by_rows
from calib_core.readers.scans import select_points
from calib_core.readers.timing.synthesise import point_timing
from calib_core.readers.topics import choose_lidar
from calib_core.readers.write.bag_writer import BagWriter, ros1_writer, ros2_writer
from calib_core.readers.write.output import check_fits, check_types, filled_last
from calib_core.readers.write.patch import MovedPoints, moved_copy, patched_payload, pointcloud2_payload
from calib_core.settings import ReadSettings
from calib_core.types import Float32Array, FloatArray, Scan

#: New coordinates (N, 3) of a scan's points in the lidar frame, in their order; None leaves the scan as it is.
Transform = Callable[[Scan], FloatArray | Float32Array | None]
#: Files of one cloud each.
CloudFormat = Literal["ply", "pcd"]
#: Every return is moved, however near or far: the range limits of a calibration are not the recording's.
_NEAREST_M, _FARTHEST_M = 1e-4, 1e6
_EVENT_EVERY = 10


def rewrite_clouds(
    path: Path,
    topic: str | None,
    out: Path,
    transform: Transform,
    *,
    settings: ReadSettings | None = None,
    cloud_format: CloudFormat = "ply",
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> int:
    """Number of scans written to `out`, whose suffix says what it becomes: .bag, .mcap, .db3; none, a folder of clouds.

    topic: the lidar topic, None where only one fits.   cloud_format: of the files in a folder.
    transform: gets every scan with all its returns.
    Raises SettingsError where `out` does not fit the recording or exists; nothing is left behind on failure.
    """
    with open_recording(path) as recording:
        lidar = choose_lidar(recording.topics, topic, recording.name)
        rewriter = _Rewriter(recording, lidar, transform, settings or ReadSettings(), on_event, should_cancel)
        check_fits(out, "ros1" if lidar.encoding == "ros1" else "ros2", recording.name)
        out.parent.mkdir(parents=True, exist_ok=True)
        with filled_last(out) as made:
            return rewriter.write_clouds(made, cloud_format) if out.suffix == "" else rewriter.write_bag(made)


class _Rewriter:
    """One pass over the recording, moving the points of one topic."""

    def __init__(
        self,
        recording: OpenRecording,
        lidar: TopicSummary,
        transform: Transform,
        settings: ReadSettings,
        on_event: OnEvent,
        should_cancel: ShouldCancel,
    ) -> None:
        self._recording, self._lidar, self._transform = recording, lidar, transform
        self._settings, self._on_event, self._should_cancel = settings, on_event, should_cancel
        self._span = span_ns(recording, settings)
        # Headers and fields are written as they came; the decoder that makes up times, or takes the recorder's, is asked for them
        # alone: when the motion was, whoever solved it was told by the same.
        self._plain: CloudDecoder = cloud_decoder(lidar)
        stamped = cloud_decoder(lidar, settings.stamps)
        sample = sample_clouds(recording, lidar, stamped, self._span)
        help_text = recognise_layout(sample[0], lidar.name).help_text
        self._timed, self._timing, _ = point_timing(sample, stamped, settings, topic=lidar.name, help_text=help_text)
        self._timed, _ = by_rows(sample, self._timed, lidar.name)
        self._count, self._undecodable = 0, 0

    def write_clouds(self, folder: Path, cloud_format: CloudFormat) -> int:
        """One file per scan, numbered in input order: all points, invalid ones included, with all fields."""
        folder.mkdir()
        for message in self._messages((self._lidar.name,)):
            try:
                cloud = self._plain(message)
            except UNDECODABLE:
                self._undecodable += 1
                continue
            write_cloud(folder / f"{self._count:06d}.{cloud_format}", moved_copy(cloud, self._moved(message)))
            self._advance(message)
        self._say_done()
        self._say_what_was_left("left out, or left as they were")
        return self._count

    def write_bag(self, file: Path) -> int:
        """All topics, the lidar's with its points moved. Packets become PointCloud2: they cannot hold moved points."""
        is_packets = self._lidar.type not in (POINTCLOUD2, *LIVOX_TYPES)
        check_types(self._recording.topics, self._recording.name)
        told = [t for t in self._heard() if t.foreign == "" and t.encoding == self._lidar.encoding]
        topics = [
            replace(t, type=POINTCLOUD2, definition="", digest="") if t == self._lidar and is_packets else t
            for t in told
        ]
        self._say_what_no_bag_holds([t.name for t in self._heard() if t not in told])
        writer: BagWriter
        with ros1_writer(file, topics) if file.suffix == ".bag" else ros2_writer(file, topics) as writer:
            for message in self._messages(tuple(t.name for t in topics)):
                if message.topic == self._lidar.name:
                    payload = self._moved_payload(message, is_packets)
                    if payload is not None:
                        writer.write(message.topic, message.receive_ns, payload)
                    self._advance(message)
                else:
                    writer.write(message.topic, message.receive_ns, message.payload)
        self._say_done()
        self._say_what_was_left("left out" if is_packets else "left as they were")
        return self._count

    def _heard(self) -> list[TopicSummary]:
        """The topics, but for types of one that has its messages by another type: a message is known by its topic."""
        heard = {topic.name for topic in self._recording.topics if topic.count}
        return [topic for topic in self._recording.topics if topic.count or topic.name not in heard]

    def _say_what_was_left(self, how: str) -> None:
        if self._undecodable:
            text = f"{counted(self._undecodable, 'message')} on {self._lidar.name} cannot be decoded: {how}."
            self._on_event(LogEvent(level="warning", code="points.malformed", text=text))

    def _say_what_no_bag_holds(self, names: list[str]) -> None:
        if names:
            text = f"{', '.join(names)} of {self._recording.name} hold no messages of ROS and are left out of the bag."
            self._on_event(LogEvent(level="warning", code="deskew.left_out", text=text))

    def _messages(self, topics: tuple[str, ...]) -> Iterator[RawMessage]:
        return self._recording.messages(topics, start_ns=self._span[0], stop_ns=self._span[1])

    def _moved_payload(self, message: RawMessage, is_packets: bool) -> bytes | None:
        """None where packets that cannot be decoded would have to become a cloud."""
        before, xyz = self._undecodable, self._moved(message)
        if is_packets:
            decodable = self._undecodable == before
            return pointcloud2_payload(self._plain(message), xyz, self._lidar.encoding) if decodable else None
        return message.payload if xyz is None else patched_payload(message, self._lidar, xyz)

    def _moved(self, message: RawMessage) -> MovedPoints | None:
        """The coordinates to be written, and of which points; None where the scan stays as it is."""
        try:
            selection = select_points(self._timed(message), self._timing, _NEAREST_M, _FARTHEST_M)
        except UNDECODABLE:
            self._undecodable += 1
            return None
        scan = selection.scan(self._count)
        moved = None if scan is None else self._transform(scan)
        if scan is None or moved is None:
            return None
        if moved.shape != (scan.points.size, 3):  # a defect of the caller's, not of the recording
            raise ValueError(f"transform gave {moved.shape} for {scan.points.size} points")
        return MovedPoints(np.flatnonzero(selection.keep), np.asarray(moved, np.float64))

    def _advance(self, message: RawMessage) -> None:
        """One scan more. How much is left is known by the time: a span holds nobody knows how many of the scans."""
        self._count += 1
        if self._count % _EVENT_EVERY == 0:
            if self._should_cancel():
                raise Cancelled("Rewriting was stopped.")
            start_ns, stop_ns = self._span
            first_ns = self._recording.start_ns if start_ns is None else start_ns
            last_ns = self._recording.end_ns if stop_ns is None else min(stop_ns, self._recording.end_ns)
            share = (message.receive_ns - first_ns) / max(last_ns - first_ns, 1)
            of_all = f" of {self._lidar.count}" if self._span == (None, None) else ""
            text = f"{self._count}{of_all} scans"
            self._on_event(StageEvent(stage="deskew", fraction=min(max(share, 0.0), 1.0), text=text))

    def _say_done(self) -> None:
        self._on_event(StageEvent(stage="deskew", fraction=1.0, text=counted(self._count, "scan")))
