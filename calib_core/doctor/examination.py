"""What one pass over a recording tells of its lidar and its IMU: topics, layout, point times, every header, some scans."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from calib_core.doctor.sampling import SampledScans
from calib_core.errors import Cancelled, InputError
from calib_core.events import OnEvent, ShouldCancel, StageEvent
from calib_core.readers.cloud_reading import cloud_reading
from calib_core.readers.clouds.cloud import RawCloud, points_mark
from calib_core.readers.clouds.decoders import CloudDecoder, cloud_decoder
from calib_core.readers.clouds.layouts import CloudLayout, recognise_layout
from calib_core.readers.clouds.packet_models import packet_model
from calib_core.readers.container.opening import OpenRecording
from calib_core.readers.container.storage import RawMessage, TopicSummary
from calib_core.readers.container.wire import MalformedMessage
from calib_core.readers.imu.messages import ImuCollector, RawImu
from calib_core.readers.imu.readings import CleanedImu, clean_imu
from calib_core.readers.mixed_lidars import Sender, require_one_lidar, sender_of, usual_frame
from calib_core.readers.one_clock import longest_stretch, order_findings
from calib_core.readers.reading import impossible_stamp, malformed_finding, sample_clouds
from calib_core.readers.scans import OrderCounts, ScanCounts, make_scan, once_a_stamp
from calib_core.readers.sweep_assembly import Gathering, gathered_finding, lasting_ns, parts_of_a_scan
from calib_core.readers.timing.clocks import HeaderTimes
from calib_core.readers.timing.point_time import PointTiming, scan_period_s
from calib_core.readers.timing.stamps import plausible_stamps
from calib_core.readers.topics import choose_imu, choose_lidar
from calib_core.settings import ReadSettings
from calib_core.threads import MOST_THREADS, workers
from calib_core.types import BoolArray, Finding, Scan

#: Scans decoded for the statistics, spread evenly; headers are read of all.
EXAMINED_SCANS = 120
#: And of each no more points: a lidar of 128 beams would otherwise fill the memory.
EXAMINED_POINTS = 60_000
#: What a cloud that is none is told by.
MALFORMED = (MalformedMessage, ValueError, KeyError)
#: Share of the work that reading is; the rest is looking ahead.
READING = 0.4


@dataclass(slots=True)
class Examination:
    """What is known so far of the recording's lidar and IMU."""

    lidar_topic: TopicSummary | None = None
    imu_topic: TopicSummary | None = None
    decoder: CloudDecoder | None = None
    first: RawCloud | None = None
    layout: CloudLayout | None = None
    timing: PointTiming | None = None
    period_s: float = 0.1
    parts: int = 1
    problems: list[InputError] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    header_ns: list[int] = field(default_factory=list)
    receive_ns: list[int] = field(default_factory=list)
    positions: list[int] = field(default_factory=list)
    marks: list[int] = field(default_factory=list)
    senders: list[Sender] = field(default_factory=list)
    gathering: Gathering | None = None
    examined: list[tuple[Scan | None, ScanCounts]] = field(default_factory=list)
    cleaned: CleanedImu | None = None
    sampled: SampledScans | None = None
    n_malformed: int = 0
    malformed_text: str = ""
    counted_rates: dict[str, float] = field(default_factory=dict)

    def leave_out(self, count: int, example: str) -> None:
        """So many messages of the lidar. example: which is the first, and what is wrong with it."""
        self.n_malformed += count
        self.malformed_text = self.malformed_text or example


def choose(state: Examination, recording: OpenRecording, settings: ReadSettings) -> None:
    """The topics to read; what stands against one is a problem."""
    try:
        state.lidar_topic = choose_lidar(
            recording.topics, settings.lidar_topic, recording.name, name_model=partial(packet_model, recording)
        )
        state.decoder = cloud_decoder(state.lidar_topic, settings.stamps)
    except InputError as error:
        state.problems.append(error)
        state.lidar_topic = None
    try:
        state.imu_topic = choose_imu(recording.topics, settings.imu_topic, recording.name)
    except InputError as error:
        state.problems.append(error)


def detect(
    state: Examination, recording: OpenRecording, settings: ReadSettings, span: tuple[int | None, int | None]
) -> None:
    """Layout and point times from a sample of the clouds."""
    if state.lidar_topic is None or state.decoder is None:
        return
    try:
        sample = sample_clouds(recording, state.lidar_topic, state.decoder, span)
    except InputError as error:
        state.problems.append(error)
        state.lidar_topic = None
        return
    state.first = replace(sample[0], frame_id=usual_frame(sample))
    state.layout = recognise_layout(sample[0], state.lidar_topic.name)
    state.period_s = scan_period_s(sample)
    state.parts = parts_of_a_scan(state.period_s, sample)
    try:
        clouds = cloud_reading(
            sample, state.decoder, settings, topic=state.lidar_topic.name, help_text=state.layout.help_text
        )
        state.decoder, state.timing = clouds.decoder, clouds.timing
        state.findings.extend(clouds.findings)
    except InputError as error:
        state.problems.append(error)


def read(
    state: Examination,
    recording: OpenRecording,
    settings: ReadSettings,
    span: tuple[int | None, int | None],
    on_event: OnEvent,
    should_cancel: ShouldCancel,
) -> None:
    """One pass over both topics: every header, every IMU reading, some scans."""
    lidar, imu = state.lidar_topic, state.imu_topic
    names = [t.name for t in (lidar, imu) if t is not None]
    if not names:
        return
    total = max(1, sum(t.count for t in (lidar, imu) if t is not None))
    n_scans = lidar.count if lidar else 0
    parts = state.parts
    if lidar is not None and parts > 1:
        state.gathering = Gathering(lasting_ns(parts, state.period_s))
        state.findings.append(gathered_finding(lidar.name, parts, state.period_s))
    state.sampled = SampledScans(n_scans // parts, state.period_s * parts)
    collector = ImuCollector(imu.encoding if imu else "cdr")
    taking = Taking(state, state.sampled, settings, every=max(1, n_scans // EXAMINED_SCANS))
    for n_seen, message in enumerate(recording.messages(names, start_ns=span[0], stop_ns=span[1])):
        if n_seen % 500 == 0:
            if should_cancel():
                raise Cancelled("Inspecting was stopped.")
            on_event(
                StageEvent(
                    stage="inspect",
                    fraction=READING * min(1.0, n_seen / total),
                    text=f"{n_seen} of {total} messages",
                )
            )
        if imu is not None and message.topic == imu.name:
            collector.add(message)
        elif state.decoder is not None:
            taking.decode(message, state.decoder)
    taking.finish()
    _require_one_lidar(state)
    if state.gathering is not None and (rest := state.gathering.rest()) is not None:
        state.sampled.add(rest)
    _keep_plausible(state)
    if imu is not None:
        raw_imu = _on_one_clock(state, collector.finish(), recording, settings)
        try:
            state.cleaned = clean_imu(raw_imu, settings, imu.name, start_ns=recording.start_ns)
            state.findings.extend(state.cleaned.findings)
        except InputError as error:
            state.problems.append(error)
    if lidar is not None and state.n_malformed:
        state.findings.append(malformed_finding(lidar.name, state.n_malformed, state.malformed_text))


def _require_one_lidar(state: Examination) -> None:
    """Clouds of several lidars, where the sample had not seen them, are a problem."""
    if state.lidar_topic is None:
        return
    try:
        require_one_lidar(state.senders, state.lidar_topic.name)
    except InputError as error:
        state.problems.append(error)


def _on_one_clock(state: Examination, imu: RawImu, recording: OpenRecording, settings: ReadSettings) -> RawImu:
    """The IMU's messages that a solve would use. What it would not because a clock was set, or because it is there twice, is
    not looked at either.
    """
    if state.lidar_topic is None or state.imu_topic is None or state.sampled is None:
        return imu
    lidar = HeaderTimes(np.array(state.header_ns, np.int64), np.array(state.receive_ns, np.int64))
    topics = state.lidar_topic.name, state.imu_topic.name
    if settings.stamps == "header":
        stretch = longest_stretch([lidar], imu, topics, state.period_s, recording.start_ns)
        imu = stretch.imu
        state.findings.extend(stretch.findings)
        _keep(state, stretch.scans)
        _keep_plausible(state)  # of fewer, others may be the few
    header_ns = np.array(state.header_ns, np.int64)
    n_moved = int(np.count_nonzero(header_ns < np.maximum.accumulate(header_ns)))
    _, twice, unlike = once_a_stamp(state.header_ns, state.marks)
    state.findings.extend(order_findings(OrderCounts(n_moved, len(twice), len(unlike)), topics[0]))
    state.sampled.put_in_order()
    return imu


def _keep_plausible(state: Examination) -> None:
    """Look no more at scans whose stamps are minutes off, and ask nothing of those stamps."""
    good = plausible_stamps(np.array(state.header_ns, np.int64), np.array(state.receive_ns, np.int64))
    if not good.all():
        state.leave_out(int(np.count_nonzero(~good)), impossible_stamp(state.positions[int(np.argmin(good))]))
        _keep(state, good)


def _keep(state: Examination, clouds: BoolArray) -> None:
    """Look at these alone. clouds: (M,) of all that were taken in."""
    if state.sampled is not None:
        state.sampled.drop(np.array(state.positions, np.int64)[~clouds])
    for kept in (state.positions, state.marks, state.header_ns, state.receive_ns):
        kept[:] = [value for value, stays in zip(kept, clouds, strict=True) if stays]


@dataclass(frozen=True, slots=True)
class _Made:
    """A scan, None where no point of it is any good. looked_at, thinned: what stays of it for the statistics and, of so many
    points, for the forecast; None where it is not wanted.
    """

    scan: Scan | None
    counts: ScanCounts
    looked_at: Scan | None
    thinned: Scan | None
    count: int


@dataclass(frozen=True, slots=True)
class _Begun:
    """A cloud whose scan is being made. made: None where nothing is wanted of it but its header."""

    position: int
    cloud: RawCloud
    counted: bool
    wanted: bool
    made: Future[_Made] | None


@dataclass
class Taking:
    """Clouds taken in: headers of all, and points where they are wanted for statistics or for the forecast.

    Scans are made on other threads while the next clouds are read, and come in the clouds' order.   every: one of so many counts
    for the statistics.
    """

    state: Examination
    sampled: SampledScans
    settings: ReadSettings
    every: int
    _begun: deque[_Begun] = field(default_factory=deque)
    _position: int = 0

    def decode(self, message: RawMessage, decoder: CloudDecoder) -> None:
        """The next message."""
        try:
            cloud = decoder(message)
        except MALFORMED as error:
            self.state.leave_out(1, f"message {self._position}: {error}")
        else:
            self.take(cloud)

    def take(self, cloud: RawCloud) -> None:
        """The next one."""
        state, position = self.state, self._position
        self._position += 1
        counted = position % self.every == 0
        wanted = self.sampled.wants(position if state.gathering is None else len(self.sampled.scans))
        made = None
        if state.timing is not None and (counted or wanted):
            count = self.sampled.count(sum(begun.wanted for begun in self._begun))
            made = workers().submit(self._make, cloud, position, state.timing, counted, count if wanted else 0)
        self._begun.append(_Begun(position, cloud, counted, wanted, made))
        # Parts of a sweep: whether the next is wanted depends on how many sweeps there are.
        ahead = 2 * MOST_THREADS if state.gathering is None else 0
        while len(self._begun) > ahead:
            self._end(self._begun.popleft())

    def finish(self) -> None:
        """Those that are still being made."""
        while self._begun:
            self._end(self._begun.popleft())

    def _make(self, cloud: RawCloud, position: int, timing: PointTiming, counted: bool, count: int) -> _Made:
        """count: points wanted for the forecast, 0 for none."""
        from calib_core.planes.sample import sample_scan  # as in SampledScans.add

        scan, counts = make_scan(cloud, position, timing, self.settings.range_min_m, self.settings.range_max_m)
        looked_at = sample_scan(scan, EXAMINED_POINTS) if scan is not None and counted else None
        thin = scan is not None and count > 0 and self.state.gathering is None
        return _Made(scan, counts, looked_at, sample_scan(scan, count) if scan is not None and thin else None, count)

    def _end(self, begun: _Begun) -> None:
        state, gathering = self.state, self.state.gathering
        if begun.made is not None:
            try:
                made = begun.made.result()
            except MALFORMED as error:
                state.leave_out(1, f"message {begun.position}: {error}")
                return
            scan = made.scan
            if begun.counted:
                state.examined.append((made.looked_at, made.counts))
            if scan is not None and begun.wanted and gathering is not None:
                scan = gathering.add(scan)
            if scan is not None and begun.wanted:
                # One that came to nothing makes those after it another number.
                self.sampled.add(scan, made.thinned if made.count == self.sampled.count() else None)
        state.positions.append(begun.position)
        state.marks.append(points_mark(begun.cloud.points))
        state.senders.append(sender_of(begun.cloud))
        state.header_ns.append(begun.cloud.header_ns)
        state.receive_ns.append(begun.cloud.receive_ns)
