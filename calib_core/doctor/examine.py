"""A recording on disk -> DoctorReport. Whatever opens is reported; what hinders a calibration is a reason."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib_core.doctor.examination import READING, Examination, choose, detect, read
from calib_core.doctor.imu_report import imu_report
from calib_core.doctor.lidar_report import lidar_report
from calib_core.doctor.report import (
    DoctorReport,
    EvidenceReport,
    FindingReport,
    Forecast,
    ImuReport,
    LidarReport,
    OnReport,
    PlanesReport,
    Timeline,
)
from calib_core.doctor.timeline import timeline
from calib_core.doctor.topics import counted_rates, topic_report
from calib_core.doctor.verdict import judge
from calib_core.doctor.whole_scans import WholeScans
from calib_core.errors import InputError
from calib_core.events import (
    Event,
    OnEvent,
    ShouldCancel,
    StageEvent,
    ignore_event,
    never_cancel,
)
from calib_core.readers.clouds.deskewed import deskew_suspicion
from calib_core.readers.container.opening import OpenRecording, open_recording
from calib_core.readers.reading import damage_findings, span_ns
from calib_core.readers.timing.clocks import HeaderTimes, examine_clocks
from calib_core.readers.timing.point_time import last_point_after_header_s
from calib_core.readers.topics import imu_topics, lidar_topics
from calib_core.settings import ReadSettings
from calib_core.types import Finding, ImuData, IntArray

if TYPE_CHECKING:
    from calib_core.full.forecast_by_choice import Foresight


def inspect(
    path: Path,
    settings: ReadSettings,
    *,
    on_event: OnEvent = ignore_event,
    on_report: OnReport | None = None,
    cache_dir: Path | None = None,
    should_cancel: ShouldCancel = never_cancel,
) -> DoctorReport:
    """Everything needed to know whether this recording can be calibrated.

    on_report: told what is known on the way: once some clouds are looked at, and once all is read, before the forecast is made.
    cache_dir: folder for what tells how the forecast changes with the choice of planes (full/forecast_by_choice.py).
    Raises InputError only where the recording cannot be opened or the settings do not fit it.
    """
    on_event(StageEvent(stage="inspect", fraction=0.0, text=f"opening {path.name}"))
    with open_recording(path) as recording:
        state = Examination()
        span = span_ns(recording, settings) if any(t.count for t in recording.topics) else (None, None)
        choose(state, recording, settings)
        chosen = [topic.name for topic in (state.lidar_topic, state.imu_topic) if topic is not None]
        state.counted_rates = counted_rates(recording, chosen)
        detect(state, recording, settings, span)
        if on_report is not None:
            on_report(_report(state, recording, Sensors(), final=False))
        read(state, recording, settings, span, on_event, should_cancel)
        headers = HeaderTimes(np.array(state.header_ns, np.int64), np.array(state.receive_ns, np.int64))
        offset_ns = _clocks(state, headers, settings)
        try:
            state.findings.extend(damage_findings(recording, len(state.header_ns)))
        except InputError as error:
            state.problems.append(error)
        sensors = _sensors(state, recording, headers, offset_ns)
        if on_report is not None:
            on_report(_report(state, recording, sensors, final=False))
        ahead = _look_ahead(state, recording, settings, offset_ns, on_event, should_cancel)
        if cache_dir is not None:
            from calib_core.full.forecast_by_choice import keep_foresight

            keep_foresight(cache_dir, ahead.foresight)
        report = _report(state, recording, sensors, ahead)
    on_event(StageEvent(stage="inspect", fraction=1.0, text=f"verdict: {report.verdict}"))
    return report


@dataclass(frozen=True, slots=True)
class Sensors:
    """What the whole recording says of both sensors. overlap_s: that both cover, None where one is missing."""

    lidar: LidarReport | None = None
    imu: ImuReport | None = None
    drawn: Timeline = Timeline()  # noqa: RUF009  frozen
    offset_ns: int = 0
    overlap_s: float | None = None


@dataclass(frozen=True, slots=True)
class Ahead:
    """What a solve would find. range_std_m: the lidar's noise, seen on the planes.   foresight: as the outlook has it."""

    planes: PlanesReport | None = None
    forecast: Forecast | None = None
    range_std_m: float | None = None
    foresight: Foresight | None = None


NOTHING_AHEAD = Ahead()


def _report(
    state: Examination,
    recording: OpenRecording,
    sensors: Sensors,
    ahead: Ahead = NOTHING_AHEAD,
    *,
    final: bool = True,
) -> DoctorReport:
    lidar = sensors.lidar
    if lidar is not None:
        lidar = lidar.model_copy(update={"measured_range_std_m": ahead.range_std_m})
    opinion = judge(
        lidar=lidar,
        imu=sensors.imu,
        problems=state.problems,
        findings=state.findings,
        overlap_s=sensors.overlap_s,
        planes=ahead.planes,
        forecast=ahead.forecast,
    )
    return DoctorReport(
        name=recording.name,
        size_bytes=recording.size_bytes,
        container=recording.kind,
        duration_s=recording.duration_s,
        start_ns=recording.start_ns,
        topics=tuple(topic_report(t, state, (lidar, sensors.imu)) for t in recording.topics),
        lidar_candidates=tuple(t.name for t in lidar_topics(recording.topics)),
        imu_candidates=tuple(t.name for t in imu_topics(recording.topics)),
        lidar=lidar,
        imu=sensors.imu,
        clock_offset_s=sensors.offset_ns * 1e-9,
        timeline=sensors.drawn,
        findings=tuple(_finding(f) for f in state.findings),
        verdict=opinion.verdict,
        reasons=opinion.reasons,
        advice=opinion.advice,
        planes=ahead.planes,
        forecast=ahead.forecast,
        final=final,
    )


def _sensors(state: Examination, recording: OpenRecording, headers: HeaderTimes, offset_ns: int) -> Sensors:
    drawn = Timeline()
    if state.cleaned is not None:
        drawn = timeline(state.cleaned, headers.receive_ns, recording.start_ns)
    return Sensors(
        _lidar(state, headers),
        None if state.cleaned is None else imu_report(state.cleaned, recording_start_ns=recording.start_ns),
        drawn,
        offset_ns,
        _overlap_s(state.cleaned.imu if state.cleaned else None, headers.header_ns, offset_ns),
    )


def _clocks(state: Examination, headers: HeaderTimes, settings: ReadSettings) -> int:
    """The coarse clock offset; what the clocks and the clouds give away joins the findings."""
    cleaned, topic = state.cleaned, state.lidar_topic
    if cleaned is None or topic is None or not headers.header_ns.size:
        return 0
    offset_ns = 0
    if settings.stamps == "header":
        offset_ns, found = examine_clocks(
            headers,
            cleaned.headers,
            period_s=state.period_s,
            last_point_s=last_point_after_header_s(state.findings),
            topic=topic.name,
        )
        state.findings.extend(found)
    scans = [scan for scan, _ in state.examined if scan is not None]
    if scans:
        suspicion = deskew_suspicion(scans, cleaned.imu, offset_ns, topic.name)
        state.findings.extend(() if suspicion is None else (suspicion,))
    return offset_ns


def _look_ahead(
    state: Examination,
    recording: OpenRecording,
    settings: ReadSettings,
    offset_ns: int,
    on_event: OnEvent,
    should_cancel: ShouldCancel,
) -> Ahead:
    """The planes to expect and the forecast, as far as there is something to find them in."""
    # They bring the estimator, which is imported while the recording is read.
    from calib_core.doctor.outlook import doubts_settled, forecast_report, foresee, planes_report

    sampled = state.sampled
    if sampled is None or not sampled.scans:
        return NOTHING_AHEAD
    imu = state.cleaned.imu if state.cleaned is not None else None

    def later(event: Event) -> None:
        if isinstance(event, StageEvent):
            event = event.model_copy(update={"fraction": READING + (1.0 - READING) * event.fraction})
        on_event(event)

    whole = WholeScans(state, sampled, recording, settings)
    outlook = foresee(sampled, imu, offset_ns, whole=whole, on_event=later, should_cancel=should_cancel)
    planes = planes_report(outlook.proposals, outlook.gravity, outlook.faults)
    if imu is None:
        return Ahead(planes)
    forecast = forecast_report(outlook, planes, share=sampled.share)
    state.findings = doubts_settled(state.findings, forecast)
    return Ahead(planes, forecast, outlook.range_std_m, outlook.foresight)


def _lidar(state: Examination, headers: HeaderTimes) -> LidarReport | None:
    if state.first is None or state.lidar_topic is None or state.layout is None:
        return None
    return lidar_report(
        state.first,
        topic=state.lidar_topic.name,
        layout=state.layout.name,
        timing=state.timing,
        findings=state.findings,
        header_ns=headers.header_ns,
        receive_ns=headers.receive_ns,
        examined=state.examined,
    )


def _overlap_s(imu: ImuData | None, header_ns: IntArray, offset_ns: int) -> float | None:
    """Seconds that both sensors cover, in the lidar's clock; None where one is missing."""
    if imu is None or not header_ns.size:
        return None
    begin = max(int(header_ns.min()), int(imu.stamps_ns[0]) + offset_ns)
    end = min(int(header_ns.max()), int(imu.stamps_ns[-1]) + offset_ns)
    return max(0, end - begin) * 1e-9


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
