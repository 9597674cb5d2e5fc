"""A recording on disk -> DoctorReport. Whatever opens is reported; what hinders a calibration is a reason."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from calib_core.doctor.imu_report import imu_report
from calib_core.doctor.lidar_report import lidar_report
from calib_core.doctor.outlook import forecast_report, foresee, planes_report
from calib_core.doctor.report import (
    DoctorReport,
    EvidenceReport,
    FindingReport,
    Forecast,
    ImuReport,
    LidarReport,
    PlanesReport,
    Timeline,
    TopicReport,
)
from calib_core.doctor.sampling import SampledScans
from calib_core.doctor.timeline import timeline
from calib_core.doctor.verdict import judge
from calib_core.errors import Cancelled, InputError
from calib_core.events import IterationEvent, LogEvent, OnEvent, ShouldCancel, StageEvent, ignore_event, never_cancel
from calib_core.full.forecast import sample_scan
from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.clouds.decoders import CloudDecoder, cloud_decoder
from calib_core.readers.clouds.deskewed import deskew_suspicion
from calib_core.readers.clouds.layouts import Layout, recognise_layout
from calib_core.readers.clouds.packet_models import packet_model
from calib_core.readers.clouds.packets import FOREIGN_PACKET_TYPES, PACKET_TYPES
from calib_core.readers.container.opening import OpenRecording, open_recording
from calib_core.readers.container.storage import TopicSummary
from calib_core.readers.container.wire import MalformedMessage
from calib_core.readers.imu.messages import ImuCollector, RawImu
from calib_core.readers.imu.readings import CleanedImu, clean_imu
from calib_core.readers.reading import damage_findings, sample_clouds, span_ns
from calib_core.readers.scans import ScanCounts, make_scan
from calib_core.readers.timing.clocks import HeaderTimes, examine_clocks
from calib_core.readers.timing.point_time import PointTiming, last_point_after_header_s, scan_period_s
from calib_core.readers.timing.stamps import plausible_stamps
from calib_core.readers.timing.synthesise import point_timing
from calib_core.readers.topics import (
    CLOUD_TYPES,
    choose_imu,
    choose_lidar,
    imu_topics,
    lidar_topics,
)
from calib_core.settings import ReadSettings
from calib_core.types import Finding, ImuData, IntArray, Scan

#: Scans decoded for the statistics, spread evenly; headers are read of all.
EXAMINED_SCANS = 120
#: And of each no more points: a lidar of 128 beams would otherwise fill the memory.
EXAMINED_POINTS = 60_000
#: Share of the work that reading is; the rest is looking ahead.
_READING = 0.4


@dataclass(slots=True)
class _Examination:
    """What is known so far of the recording's lidar and IMU."""

    lidar_topic: TopicSummary | None = None
    imu_topic: TopicSummary | None = None
    decoder: CloudDecoder | None = None
    first: RawCloud | None = None
    layout: Layout | None = None
    timing: PointTiming | None = None
    period_s: float = 0.1
    problems: list[InputError] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    header_ns: list[int] = field(default_factory=list)
    receive_ns: list[int] = field(default_factory=list)
    examined: list[tuple[Scan | None, ScanCounts]] = field(default_factory=list)
    raw_imu: RawImu | None = None
    cleaned: CleanedImu | None = None
    sampled: SampledScans | None = None
    n_malformed: int = 0


def inspect(
    path: Path, settings: ReadSettings, *, on_event: OnEvent = ignore_event, should_cancel: ShouldCancel = never_cancel
) -> DoctorReport:
    """Everything needed to know whether this recording can be calibrated.

    Raises InputError only where the recording cannot be opened or the settings do not fit it.
    """
    on_event(StageEvent(stage="inspect", fraction=0.0, text=f"opening {path.name}"))
    with open_recording(path) as recording:
        state = _Examination()
        span = span_ns(recording, settings) if any(t.count for t in recording.topics) else (None, None)
        _choose(state, recording, settings)
        _detect(state, recording, settings, span)
        _read(state, recording, settings, span, on_event, should_cancel)
        report = _report(state, recording, settings, on_event, should_cancel)
    on_event(StageEvent(stage="inspect", fraction=1.0, text=f"verdict: {report.verdict}"))
    return report


def _choose(state: _Examination, recording: OpenRecording, settings: ReadSettings) -> None:
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


def _detect(
    state: _Examination, recording: OpenRecording, settings: ReadSettings, span: tuple[int | None, int | None]
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
    try:
        state.decoder, state.timing, found = point_timing(
            sample, state.decoder, settings, topic=state.lidar_topic.name, help_text=state.layout.help_text
        )
        state.findings.extend(found)
    except InputError as error:
        state.problems.append(error)


def _read(
    state: _Examination,
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
    state.sampled = SampledScans(n_scans, state.period_s)
    collector = ImuCollector(imu.encoding if imu else "cdr")
    for n_seen, message in enumerate(recording.messages(names, start_ns=span[0], stop_ns=span[1])):
        if n_seen % 500 == 0:
            if should_cancel():
                raise Cancelled("Inspecting was stopped.")
            on_event(
                StageEvent(
                    stage="inspect",
                    fraction=_READING * min(1.0, n_seen / total),
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
    if imu is not None:
        state.raw_imu = collector.finish()
        try:
            state.cleaned = clean_imu(state.raw_imu, settings, imu.name)
            state.findings.extend(state.cleaned.findings)
        except InputError as error:
            state.problems.append(error)


def _take(state: _Examination, cloud: RawCloud, sampled: SampledScans, settings: ReadSettings, every: int) -> None:
    """One cloud: its header, and its points where they are wanted for statistics or for the forecast."""
    position = len(state.header_ns)
    counted = position % every == 0
    if state.timing is not None and (counted or sampled.wants(position)):
        scan, counts = make_scan(cloud, position, state.timing, settings.range_min_m, settings.range_max_m)
        if counted:
            state.examined.append((scan and sample_scan(scan, EXAMINED_POINTS), counts))
        if scan is not None and sampled.wants(position):
            sampled.add(scan)
    state.header_ns.append(cloud.header_ns)
    state.receive_ns.append(cloud.receive_ns)


def _report(
    state: _Examination,
    recording: OpenRecording,
    settings: ReadSettings,
    on_event: OnEvent,
    should_cancel: ShouldCancel,
) -> DoctorReport:
    header_ns, receive_ns = np.array(state.header_ns, np.int64), np.array(state.receive_ns, np.int64)
    offset_ns = _clocks(state, header_ns, receive_ns, settings)
    try:
        state.findings.extend(damage_findings(recording, len(state.header_ns)))
    except InputError as error:
        state.problems.append(error)
    planes, forecast, range_std_m = _look_ahead(state, header_ns, receive_ns, offset_ns, on_event, should_cancel)
    lidar = _lidar(state, header_ns, receive_ns, range_std_m)
    imu = _imu(state, recording)
    drawn = Timeline()
    if state.cleaned is not None and state.raw_imu is not None:
        drawn = timeline(state.cleaned.imu, state.raw_imu, receive_ns, recording.start_ns)
    opinion = judge(
        lidar=lidar,
        imu=imu,
        problems=state.problems,
        findings=state.findings,
        overlap_s=_overlap_s(state.cleaned.imu if state.cleaned else None, header_ns, offset_ns),
        planes=planes,
        forecast=forecast,
    )
    return DoctorReport(
        name=recording.name,
        size_bytes=recording.size_bytes,
        container=recording.kind,
        duration_s=recording.duration_s,
        start_ns=recording.start_ns,
        topics=tuple(_topic(t, recording) for t in recording.topics),
        lidar_candidates=tuple(t.name for t in lidar_topics(recording.topics)),
        imu_candidates=tuple(t.name for t in imu_topics(recording.topics)),
        lidar=lidar,
        imu=imu,
        clock_offset_s=offset_ns * 1e-9,
        timeline=drawn,
        findings=tuple(_finding(f) for f in state.findings),
        verdict=opinion.verdict,
        reasons=opinion.reasons,
        advice=opinion.advice,
        planes=planes,
        forecast=forecast,
    )


def _clocks(state: _Examination, header_ns: IntArray, receive_ns: IntArray, settings: ReadSettings) -> int:
    """The coarse clock offset; what the clocks and the clouds give away joins the findings."""
    raw, topic = state.raw_imu, state.lidar_topic
    if raw is None or topic is None or not header_ns.size or not raw.header_ns.size:
        return 0
    offset_ns = 0
    if settings.stamps == "header":
        offset_ns, found = examine_clocks(
            HeaderTimes(header_ns, receive_ns),
            HeaderTimes(raw.header_ns, raw.receive_ns),
            period_s=state.period_s,
            last_point_s=last_point_after_header_s(state.findings),
            topic=topic.name,
        )
        state.findings.extend(found)
    scans = [scan for scan, _ in state.examined if scan is not None]
    if state.cleaned is not None and scans:
        suspicion = deskew_suspicion(scans, state.cleaned.imu, offset_ns, topic.name)
        state.findings.extend(() if suspicion is None else (suspicion,))
    return offset_ns


def _look_ahead(
    state: _Examination,
    header_ns: IntArray,
    receive_ns: IntArray,
    offset_ns: int,
    on_event: OnEvent,
    should_cancel: ShouldCancel,
) -> tuple[PlanesReport | None, Forecast | None, float | None]:
    """The planes to expect, the forecast and the lidar's range noise, as far as there is something to find them in."""
    sampled = state.sampled
    if sampled is None or not header_ns.size:
        return None, None, None
    sampled.drop(np.flatnonzero(~plausible_stamps(header_ns, receive_ns)))
    if not sampled.scans:
        return None, None, None
    imu = state.cleaned.imu if state.cleaned is not None else None

    def later(event: StageEvent | IterationEvent | LogEvent) -> None:
        if isinstance(event, StageEvent):
            event = event.model_copy(update={"fraction": _READING + (1.0 - _READING) * event.fraction})
        on_event(event)

    outlook = foresee(sampled, imu, offset_ns, on_event=later, should_cancel=should_cancel)
    planes = planes_report(outlook.proposals, outlook.gravity)
    if imu is None:
        return planes, None, None
    return planes, forecast_report(outlook, planes, share=sampled.share), outlook.range_std_m


def _lidar(
    state: _Examination, header_ns: IntArray, receive_ns: IntArray, range_std_m: float | None
) -> LidarReport | None:
    if state.first is None or state.lidar_topic is None or state.layout is None:
        return None
    return lidar_report(
        state.first,
        topic=state.lidar_topic.name,
        layout=state.layout.name,
        timing=state.timing,
        findings=state.findings,
        header_ns=header_ns,
        receive_ns=receive_ns,
        examined=state.examined,
        measured_range_std_m=range_std_m,
    )


def _imu(state: _Examination, recording: OpenRecording) -> ImuReport | None:
    if state.cleaned is None or state.raw_imu is None:
        return None
    return imu_report(
        state.cleaned.imu,
        header_ns=state.raw_imu.header_ns,
        receive_ns=state.raw_imu.receive_ns,
        recording_start_ns=recording.start_ns,
        units=(state.cleaned.accelerometer_unit, state.cleaned.gyroscope_unit),
    )


def _overlap_s(imu: ImuData | None, header_ns: IntArray, offset_ns: int) -> float | None:
    """Seconds that both sensors cover, in the lidar's clock; None where one is missing."""
    if imu is None or not header_ns.size:
        return None
    begin = max(int(header_ns.min()), int(imu.stamps_ns[0]) + offset_ns)
    end = min(int(header_ns.max()), int(imu.stamps_ns[-1]) + offset_ns)
    return max(0, end - begin) * 1e-9


def _topic(topic: TopicSummary, recording: OpenRecording) -> TopicReport:
    rate = (topic.count - 1) / recording.duration_s if topic.count > 1 and recording.duration_s > 0 else 0.0
    return TopicReport(
        name=topic.name,
        type=topic.type,
        messages=topic.count,
        rate_hz=round(rate, 3),
        role="lidar"
        if topic.type in CLOUD_TYPES
        else "imu"
        if topic.type == "sensor_msgs/msg/Imu"
        else "packets"
        if topic.type in (*PACKET_TYPES, *FOREIGN_PACKET_TYPES)
        else "other",
    )


def _finding(finding: Finding) -> FindingReport:
    return FindingReport(
        code=finding.code,
        level=finding.level,
        text=finding.text,
        evidence=tuple(EvidenceReport(name=e.name, value=e.value, unit=e.unit) for e in finding.evidence),
        confidence=finding.confidence,
        consequence=finding.consequence,
        override=finding.override,
    )
