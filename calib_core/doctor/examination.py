"""What one pass over a recording tells of its lidar and its IMU: topics, layout, point times, every header, some scans."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from calib_core.doctor.sampling import SampledScans
from calib_core.errors import Cancelled, InputError
from calib_core.events import OnEvent, ShouldCancel, StageEvent
from calib_core.full.forecast import sample_scan
from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.clouds.decoders import CloudDecoder, cloud_decoder
from calib_core.readers.clouds.layouts import Layout, recognise_layout
from calib_core.readers.clouds.packet_models import packet_model
from calib_core.readers.container.opening import OpenRecording
from calib_core.readers.container.storage import TopicSummary
from calib_core.readers.container.wire import MalformedMessage
from calib_core.readers.gather import Gathering, gathered_finding, lasting_ns, parts_of_a_scan
from calib_core.readers.imu.messages import ImuCollector, RawImu
from calib_core.readers.imu.readings import CleanedImu, clean_imu
from calib_core.readers.one_clock import longest_stretch, order_findings
from calib_core.readers.reading import sample_clouds
from calib_core.readers.scans import ScanCounts, make_scan
from calib_core.readers.timing.clocks import HeaderTimes
from calib_core.readers.timing.point_time import PointTiming, scan_period_s
from calib_core.readers.timing.stamps import plausible_stamps
from calib_core.readers.timing.synthesise import point_timing
from calib_core.readers.topics import choose_imu, choose_lidar
from calib_core.readers.twice import once_each
from calib_core.settings import ReadSettings
from calib_core.types import Finding, Scan

#: Scans decoded for the statistics, spread evenly; headers are read of all.
EXAMINED_SCANS = 120
#: And of each no more points: a lidar of 128 beams would otherwise fill the memory.
EXAMINED_POINTS = 60_000
#: Share of the work that reading is; the rest is looking ahead.
READING = 0.4


@dataclass(slots=True)
class Examination:
    """What is known so far of the recording's lidar and IMU."""

    lidar_topic: TopicSummary | None = None
    imu_topic: TopicSummary | None = None
    decoder: CloudDecoder | None = None
    first: RawCloud | None = None
    layout: Layout | None = None
    timing: PointTiming | None = None
    period_s: float = 0.1
    parts: int = 1
    problems: list[InputError] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    header_ns: list[int] = field(default_factory=list)
    receive_ns: list[int] = field(default_factory=list)
    positions: list[int] = field(default_factory=list)
    gathering: Gathering | None = None
    examined: list[tuple[Scan | None, ScanCounts]] = field(default_factory=list)
    raw_imu: RawImu | None = None
    cleaned: CleanedImu | None = None
    sampled: SampledScans | None = None
    n_malformed: int = 0


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
    state.first = sample[0]
    state.layout = recognise_layout(sample[0], state.lidar_topic.name)
    state.period_s = scan_period_s(sample)
    state.parts = parts_of_a_scan(state.period_s, sample)
    try:
        state.decoder, state.timing, found = point_timing(
            sample, state.decoder, settings, topic=state.lidar_topic.name, help_text=state.layout.help_text
        )
        state.decoder, twice = once_each(sample, state.decoder, state.timing, settings, state.lidar_topic.name)
        state.findings.extend((*found, *twice))
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
    every = max(1, n_scans // EXAMINED_SCANS)
    parts = state.parts
    if lidar is not None and parts > 1:
        state.gathering = Gathering(lasting_ns(parts, state.period_s))
        state.findings.append(gathered_finding(lidar.name, parts, state.period_s))
    state.sampled = SampledScans(n_scans // parts, state.period_s * parts)
    collector = ImuCollector(imu.encoding if imu else "cdr")
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
            try:
                _take(state, state.decoder(message), state.sampled, settings, every)
            except (MalformedMessage, ValueError, KeyError):
                state.n_malformed += 1
    if state.gathering is not None and (rest := state.gathering.rest()) is not None:
        state.sampled.add(rest)
    if imu is not None:
        state.raw_imu = collector.finish()
        _keep_to_one_clock(state, recording, settings)
        try:
            state.cleaned = clean_imu(state.raw_imu, settings, imu.name)
            state.findings.extend(state.cleaned.findings)
        except InputError as error:
            state.problems.append(error)


def _keep_to_one_clock(state: Examination, recording: OpenRecording, settings: ReadSettings) -> None:
    """What a solve would not use because a clock was set, or because it is there twice, is not looked at either."""
    if state.lidar_topic is None or state.imu_topic is None or state.raw_imu is None or state.sampled is None:
        return
    lidar = HeaderTimes(np.array(state.header_ns, np.int64), np.array(state.receive_ns, np.int64))
    topics = state.lidar_topic.name, state.imu_topic.name
    if settings.stamps == "header":
        stretch = longest_stretch(lidar, state.raw_imu, topics, state.period_s, recording.start_ns)
        state.raw_imu = stretch.imu
        state.findings.extend(stretch.findings)
        state.sampled.drop(np.array(state.positions, np.int64)[~stretch.scans])
        lidar = HeaderTimes(lidar.header_ns[stretch.scans], lidar.receive_ns[stretch.scans])
        state.positions = [at for at, stays in zip(state.positions, stretch.scans, strict=True) if stays]
        state.header_ns, state.receive_ns = lidar.header_ns.tolist(), lidar.receive_ns.tolist()
    n_moved = int(np.count_nonzero(lidar.header_ns < np.maximum.accumulate(lidar.header_ns)))
    n_twice = lidar.header_ns.size - len(np.unique(lidar.header_ns))
    state.findings.extend(order_findings(n_moved, n_twice, topics[0]))
    state.sampled.put_in_order()


def keep_plausible(state: Examination) -> None:
    """Look no more at scans whose stamps are minutes off."""
    good = plausible_stamps(np.array(state.header_ns, np.int64), np.array(state.receive_ns, np.int64))
    if state.sampled is not None:
        state.sampled.drop(np.array(state.positions, np.int64)[~good])
    for kept in (state.positions, state.header_ns, state.receive_ns):
        kept[:] = [value for value, stays in zip(kept, good, strict=True) if stays]


def _take(state: Examination, cloud: RawCloud, sampled: SampledScans, settings: ReadSettings, every: int) -> None:
    """One cloud: its header, and its points where they are wanted for statistics or for the forecast."""
    position = len(state.header_ns)
    counted = position % every == 0
    wanted = sampled.wants(position if state.gathering is None else len(sampled.scans))
    if state.timing is not None and (counted or wanted):
        scan, counts = make_scan(cloud, position, state.timing, settings.range_min_m, settings.range_max_m)
        if counted:
            state.examined.append((scan and sample_scan(scan, EXAMINED_POINTS), counts))
        if scan is not None and wanted and state.gathering is not None:
            scan = state.gathering.add(scan)
        if scan is not None and wanted:
            sampled.add(scan)
    state.positions.append(position)
    state.header_ns.append(cloud.header_ns)
    state.receive_ns.append(cloud.receive_ns)
