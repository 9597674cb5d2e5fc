"""The passes over a recording: a small sample for the detections, then everything once."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from calib_core.errors import Cancelled, InputError, UnreadableRecording, is_for_want_of_room
from calib_core.events import OnEvent, ShouldCancel, StageEvent
from calib_core.phrasing import counted
from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.clouds.decoders import UNDECODABLE, CloudDecoder
from calib_core.readers.container.names import some_of
from calib_core.readers.container.opening import OpenRecording
from calib_core.readers.container.storage import DamageKind, RawMessage, TopicSummary
from calib_core.readers.imu.messages import ImuCollector
from calib_core.readers.mixed_lidars import Sender, require_one_lidar, sender_of
from calib_core.readers.point_unit import require_metres
from calib_core.readers.scans import ScanCounts, StoredScans, Written, make_scan
from calib_core.readers.sweep_assembly import Gathering
from calib_core.readers.timing.clocks import HeaderTimes
from calib_core.readers.timing.point_time import PointTiming
from calib_core.readers.timing.stamps import plausible_stamps, unevenness_ns
from calib_core.settings import ReadSettings
from calib_core.threads import usable_cores
from calib_core.types import BoolArray, Clue, Finding, Scan

#: Scans that the detection of the point times looks at.
SAMPLED_SCANS = 60
#: Scans of the sample are held at once: fewer of them where each is big.
_SAMPLE_BYTES = 400 * (1 << 20)
#: Less than this, of a recording that is damaged, is too little to calibrate from.
MIN_SCANS_OF_DAMAGED = 20
_EVENT_EVERY = 20
#: The finding of each kind of damage.
_DAMAGE_CODES: dict[DamageKind, str] = {
    "index": "recording.damaged",
    "holes": "recording.damaged",
    "cut": "recording.truncated",
    "missing": "recording.incomplete",
}
#: Threads that decode, one core being left to whoever reads: more of them than cores only take turns.
_DECODERS = max(1, min(3, usable_cores() - 1))


class _Decoded(NamedTuple):
    """One cloud. scan: None where no point is left.   written: it, where it was put away already."""

    header_ns: int
    receive_ns: int
    sender: Sender
    scan: Scan | None
    counts: ScanCounts
    written: Written | None = None


def span_ns(recording: OpenRecording, settings: ReadSettings) -> tuple[int | None, int | None]:
    """Receive times between which messages are read; None where unbounded. Raises InputError for an empty span."""
    start_ns = None if settings.start_s is None else recording.start_ns + round(settings.start_s * 1e9)
    stop_ns = None if settings.end_s is None else recording.start_ns + round(settings.end_s * 1e9) + 1
    if (start_ns or recording.start_ns) >= (recording.end_ns if stop_ns is None else min(stop_ns, recording.end_ns)):
        raise InputError(
            f"Nothing of {recording.name} lies between {settings.start_s or 0:g} s and"
            f" {recording.duration_s if settings.end_s is None else settings.end_s:g} s;"
            f" it lasts {recording.duration_s:.1f} s, choose a span inside.",
            code="recording.span",
        )
    return start_ns, stop_ns


def sample_clouds(
    recording: OpenRecording, topic: TopicSummary, decoder: CloudDecoder, span: tuple[int | None, int | None]
) -> list[RawCloud]:
    """The first SAMPLED_SCANS clouds of the span.

    Raises UnreadableRecording where not one can be decoded, InputError where they have no coordinates, or not in metres, or are
    of several lidars.
    """
    clouds: list[RawCloud] = []
    senders: list[Sender] = []  # of clouds with other fields too, as another lidar's may be
    n_bytes, failure = 0, "it holds no message in the chosen span"
    messages = recording.messages((topic.name,), start_ns=span[0], stop_ns=span[1])
    for message in itertools.islice(messages, 3 * SAMPLED_SCANS):
        try:
            cloud = decoder(message)
        except UNDECODABLE as error:
            failure = str(error)
            continue
        if not {"x", "y", "z"} <= set(cloud.names):
            raise InputError(
                f"The clouds on {topic.name} have no x, y and z (fields: {', '.join(cloud.names)});"
                f" choose a lidar's topic.",
                code="points.no_xyz",
            )
        senders.append(sender_of(cloud))
        if not clouds or cloud.points.dtype == clouds[0].points.dtype:
            clouds.append(cloud)
            n_bytes += cloud.points.nbytes
        if len(clouds) == SAMPLED_SCANS or n_bytes > _SAMPLE_BYTES:
            break
    if not clouds:
        raise UnreadableRecording(
            f"Not one message on {topic.name} of {recording.name} can be decoded ({failure}); record or copy it again."
        )
    require_one_lidar(senders, topic.name)
    require_metres(clouds, topic.name)
    return clouds


@dataclass(slots=True)
class Reading:
    """The pass that reads everything; its fields are what it gathered."""

    recording: OpenRecording
    settings: ReadSettings
    decoder: CloudDecoder
    timing: PointTiming
    on_event: OnEvent
    should_cancel: ShouldCancel
    gathering: Gathering | None = None
    imu: ImuCollector = field(default_factory=lambda: ImuCollector("cdr"))
    scans: StoredScans = field(default_factory=StoredScans)
    indices: list[int] = field(default_factory=list)
    header_ns: list[int] = field(default_factory=list)
    receive_ns: list[int] = field(default_factory=list)
    counts: list[ScanCounts] = field(default_factory=list)
    senders: list[Sender] = field(default_factory=list)
    n_twice: int = 0
    n_unlike: int = 0
    n_malformed: int = 0
    malformed_text: str = ""

    def run(self, lidar: TopicSummary, imu: TopicSummary, span: tuple[int | None, int | None]) -> None:
        """Read both topics over the span."""
        self.imu = ImuCollector(imu.encoding)
        n_seen = 0
        pending: deque[tuple[int, Future[_Decoded]]] = deque()
        # NumPy lets the interpreter go while it decodes: scans are decoded while the next are read.
        with ThreadPoolExecutor(_DECODERS) as pool:
            for message in self.recording.messages((lidar.name, imu.name), start_ns=span[0], stop_ns=span[1]):
                if message.topic == imu.name:
                    self.imu.add(message)
                    continue
                pending.append((n_seen, pool.submit(self._decode, message, n_seen)))
                n_seen += 1
                if len(pending) > 2 * _DECODERS:
                    self._take(*pending.popleft())
                if n_seen % _EVENT_EVERY == 0:
                    self._report(n_seen, lidar.count)
            while pending:
                self._take(*pending.popleft())
        require_one_lidar(self.senders, lidar.name)
        rest = None if self.gathering is None else self.gathering.rest()
        if rest is not None:
            self._add(self._written(rest))
        self.drop_impossible_stamps()
        if not len(self.scans):
            raise InputError(
                f"No scan on {lidar.name} holds a point between {self.settings.range_min_m:g} m and"
                f" {self.settings.range_max_m:g} m inside its sweep ({counted(n_seen, 'scan')} read); check the"
                f" sensor or the point times.",
                code="points.none_valid",
            )

    def stamped(self) -> tuple[HeaderTimes, ...]:
        """The scans' stamps and when they were received, to tell whether a clock was set: one that was moves all that is given.

        By their headers: when the first return was depends on what is in sight where a sweep begins. By their points only where
        these bear times of their own, which come more evenly than headers do: by the first, and by the last.
        """
        rows = {index: row for row, index in enumerate(self.indices)}
        here = [rows[index] for index in self.scans.message_indices]
        header_ns, receive_ns = np.array(self.header_ns, np.int64)[here], np.array(self.receive_ns, np.int64)[here]
        points_ns = [np.array(ns, np.int64) for ns in (self.scans.stamps_ns, self.scans.ends_ns)]
        unset = header_ns.size > 0 and bool((header_ns == header_ns[0]).all())
        more_even = unset or min(map(unevenness_ns, points_ns)) < unevenness_ns(header_ns)
        by_points = self.timing.reference == "absolute" and more_even
        return tuple(HeaderTimes(ns, receive_ns) for ns in (points_ns if by_points else [header_ns]))

    def keep(self, kept: BoolArray) -> None:
        """Go on with these scans alone. kept: (M,) of `stamped`."""
        left = {index for index, stays in zip(self.scans.message_indices, kept, strict=True) if stays}
        self.scans.without(np.flatnonzero(~kept).tolist())
        self._keep_messages(left)
        self.drop_impossible_stamps()  # of fewer, others may be the few

    def _keep_messages(self, left: set[int]) -> None:
        rows = [row for row, index in enumerate(self.indices) if index in left]
        self.indices = [self.indices[row] for row in rows]
        self.header_ns = [self.header_ns[row] for row in rows]
        self.receive_ns = [self.receive_ns[row] for row in rows]
        self.counts = [self.counts[row] for row in rows]

    def drop_impossible_stamps(self) -> None:
        """Go on without clouds whose stamps are damaged: whatever is asked of stamps later has none of them."""
        good = plausible_stamps(np.array(self.header_ns, np.int64), np.array(self.receive_ns, np.int64))
        bad = {int(index) for index in np.array(self.indices, np.int64)[~good]}
        if bad:
            self.n_malformed += len(bad)
            self.malformed_text = self.malformed_text or impossible_stamp(min(bad))
            self.scans.without([k for k, index in enumerate(self.scans.message_indices) if index in bad])
            self._keep_messages(set(self.indices) - bad)

    def _report(self, n_seen: int, n_total: int) -> None:
        if self.should_cancel():
            raise Cancelled("Reading was stopped.")
        fraction = min(1.0, n_seen / max(n_total, 1))
        self.on_event(StageEvent(stage="read", fraction=fraction, text=f"{n_seen} of {n_total} scans"))

    def _decode(self, message: RawMessage, index: int) -> _Decoded:
        cloud = self.decoder(message)
        scan, counts = make_scan(cloud, index, self.timing, self.settings.range_min_m, self.settings.range_max_m)
        if scan is None or self.gathering is not None:
            return _Decoded(cloud.header_ns, cloud.receive_ns, sender_of(cloud), scan, counts)
        # Written by the thread that decoded it: whoever reads the recording goes on reading.
        return _Decoded(cloud.header_ns, cloud.receive_ns, sender_of(cloud), None, counts, self._written(scan))

    def _take(self, index: int, decoded: Future[_Decoded]) -> None:
        try:
            taken = decoded.result()
        except UNDECODABLE as error:
            self.n_malformed += 1
            self.malformed_text = self.malformed_text or f"message {index}: {error}"
            return
        self.indices.append(index)
        self.senders.append(taken.sender)
        self.header_ns.append(taken.header_ns)
        self.receive_ns.append(taken.receive_ns)
        self.counts.append(taken.counts)
        if taken.written is not None:
            self._add(taken.written)
        elif taken.scan is not None and self.gathering is not None:
            scan = self.gathering.add(taken.scan)
            if scan is not None:
                self._add(self._written(scan))

    def _written(self, scan: Scan) -> Written:
        with self._room_on_disk(scan.index):
            return self.scans.write(scan)

    def _add(self, written: Written) -> None:
        with self._room_on_disk(written.entry.message):
            self.scans.add(written)

    @contextmanager
    def _room_on_disk(self, index: int) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if not is_for_want_of_room(error):
                raise
            raise InputError(
                f"The disk that holds temporary files is full after {counted(index, 'scan')} of {self.recording.name};"
                " point TMPDIR at a disk with room for the recording.",
                code="disk.full",
            ) from error

    def findings(self, topic: str) -> tuple[Finding, ...]:
        """What the pass found out about the points."""
        found: list[Finding] = []
        sent = sum(c.sent for c in self.counts)
        out_of_time = sum(c.out_of_time for c in self.counts)
        no_return = sum(c.no_return for c in self.counts)
        if self.n_malformed:
            found.append(malformed_finding(topic, self.n_malformed, self.malformed_text))
        if out_of_time:
            found.append(
                Finding(
                    "points.out_of_sweep",
                    "warning" if out_of_time > 0.001 * sent else "info",
                    f"{out_of_time:,} of {sent:,} points on {topic} had a time outside of their sweep and were left out.",
                    (Clue("points outside the sweep", out_of_time), Clue("points", sent)),
                )
            )
        if no_return:
            found.append(
                Finding(
                    "points.no_return",
                    "info",
                    f"{no_return:,} of {sent:,} points on {topic} had no return, or one outside of"
                    f" {self.settings.range_min_m:g} to {self.settings.range_max_m:g} m, and were left out.",
                    (Clue("points left out", no_return), Clue("points", sent)),
                )
            )
        return tuple(found)


def malformed_finding(topic: str, n_malformed: int, example: str) -> Finding:
    """What is said of clouds that are left out. example: which was the first, and what is wrong with it."""
    return Finding(
        "points.malformed",
        "warning",
        f"{counted(n_malformed, 'message')} on {topic} cannot be decoded and "
        f"{'was' if n_malformed == 1 else 'were'} left out ({example}).",
        (Clue("malformed messages", n_malformed),),
    )


def impossible_stamp(index: int) -> str:
    """What is wrong with a message whose stamp is damaged. index: which of its topic it is."""
    return f"message {index}: its stamp is minutes off"


def damage_findings(recording: OpenRecording, n_scans: int) -> tuple[Finding, ...]:
    """One finding per damaged file, and for files that are missing or were left out.

    Raises UnreadableRecording where too little of the recording is left.
    """
    found: list[Finding] = []
    for damage in recording.damages:
        after = ""
        if damage.kind == "cut":
            after = f" after {max(0, damage.lost_from_ns - recording.start_ns) * 1e-9:.1f} s"
        what = f"The file {damage.file} is {damage.text}{after}"
        if damage.kind == "missing":
            what = f"The recording {damage.file} lacks {damage.text}"
        if damage.kind != "index" and n_scans < MIN_SCANS_OF_DAMAGED:
            raise UnreadableRecording(
                f"{what}, and {counted(n_scans, 'scan')} left of it, "
                f"where {MIN_SCANS_OF_DAMAGED} are needed; record or copy it again.",
                code="recording.truncated",
            )
        found.append(
            Finding(
                code=_DAMAGE_CODES[damage.kind],
                level="info" if damage.kind == "index" else "warning",
                text=f"{what}; what {'is there' if damage.kind == 'missing' else 'could be recovered'} is used"
                f" ({counted(n_scans, 'scan')}).",
                evidence=(Clue("scans recovered", n_scans), Clue("file", damage.file)),
                consequence="" if damage.kind == "index" else "the result rests on the recovered part only",
            )
        )
    if recording.beside:
        lie = "lies" if len(recording.beside) == 1 else "lie"
        text = f"{some_of(recording.beside)} {lie} in the folder of {recording.name} without being in its metadata.yaml"
        found.append(Finding("recording.beside", "info", f"{text}, and {'is' if lie == 'lies' else 'are'} left out."))
    return tuple(found)
