"""A recording on disk -> Recording: choose the topics, detect what the stamps and units are, read everything once."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from calib_core.events import LogEvent, OnEvent, ShouldCancel, StageEvent, ignore_event, never_cancel
from calib_core.phrasing import counted
from calib_core.presets import find_imu_preset, find_lidar_preset
from calib_core.readers.cloud_reading import cloud_reading
from calib_core.readers.clouds.decoders import cloud_decoder
from calib_core.readers.clouds.deskewed import deskew_suspicion
from calib_core.readers.clouds.layouts import recognise_layout
from calib_core.readers.clouds.packet_models import packet_model
from calib_core.readers.container.fingerprint import recording_sha256
from calib_core.readers.container.opening import OpenRecording, open_recording
from calib_core.readers.imu.readings import clean_imu
from calib_core.readers.mixed_lidars import usual_frame
from calib_core.readers.one_clock import on_one_clock
from calib_core.readers.reading import Reading, damage_findings, sample_clouds, span_ns
from calib_core.readers.scans import StoredScans
from calib_core.readers.sweep_assembly import Gathering, gathered_finding, lasting_ns, parts_of_a_scan
from calib_core.readers.timing.clocks import HeaderTimes, examine_clocks
from calib_core.readers.timing.point_time import last_point_after_header_s, scan_period_s
from calib_core.readers.topics import as_before, choose_imu, choose_lidar
from calib_core.settings import ReadSettings
from calib_core.types import Finding, LidarInfo, Recording


def load(
    path: Path,
    settings: ReadSettings,
    *,
    fingerprint: bool = True,
    topics_before: tuple[str, str] = ("", ""),
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> Recording:
    """One lidar and one IMU of the recording at `path`, decoded, with every detection as a Finding.

    fingerprint: hash all bytes as well; without it `sha256` is empty and a short span is read in a moment.
    topics_before: the lidar's and the IMU's of an earlier run, which are taken where several fit and the settings name none.
    Raises InputError (one sentence) where the recording cannot be read or lacks something, Cancelled where asked to.
    """
    on_event(StageEvent(stage="read", fraction=0.0, text=f"opening {path.name}"))
    # Hashing releases the interpreter lock: it runs beside the decoding. Whoever fails or cancels does not wait for it.
    failed = threading.Event()
    with open_recording(path) as recording, ThreadPoolExecutor(1) as hasher:
        digest = hasher.submit(recording_sha256, path, should_stop=failed.is_set) if fingerprint else None
        try:
            settings = as_before(settings, recording.topics, topics_before)
            loaded = _load_open(recording, settings, on_event, should_cancel)
        except BaseException:
            failed.set()
            raise
        result = loaded if digest is None else replace(loaded, sha256=digest.result())
    for finding in result.findings:
        if finding.level != "info":
            on_event(LogEvent(level=finding.level, code=finding.code, text=finding.text))
    on_event(
        StageEvent(
            stage="read",
            fraction=1.0,
            text=f"{counted(len(result.scans), 'scan')}, {counted(result.imu.stamps_ns.size, 'IMU reading')}",
        )
    )
    return result


def _first_cloud_ns(recording: OpenRecording, topic: str) -> int:
    """When the recorder got the first of the lidar's messages that there are, read or not."""
    return next(recording.messages((topic,))).receive_ns


def _load_open(
    recording: OpenRecording, settings: ReadSettings, on_event: OnEvent, should_cancel: ShouldCancel
) -> Recording:
    lidar_topic = choose_lidar(
        recording.topics, settings.lidar_topic, recording.name, name_model=partial(packet_model, recording)
    )
    imu_topic = choose_imu(recording.topics, settings.imu_topic, recording.name)
    span = span_ns(recording, settings)
    decoder = cloud_decoder(lidar_topic, settings.stamps)
    sample = sample_clouds(recording, lidar_topic, decoder, span)
    layout = recognise_layout(sample[0], lidar_topic.name)
    clouds = cloud_reading(sample, decoder, settings, topic=lidar_topic.name, help_text=layout.help_text)
    findings = clouds.findings
    frame_id = usual_frame(sample)
    preset = find_lidar_preset(lidar_topic.name, frame_id, layout.name)
    model = "" if preset is None else preset.name
    info = LidarInfo(lidar_topic.name, frame_id, layout.name, model, scan_period_s(sample))
    parts, cloud_s = parts_of_a_scan(info.period_s, sample), info.period_s
    scans = StoredScans.sized(lidar_topic.count * sum(cloud.points.size for cloud in sample) // len(sample))
    del sample  # tens of megabytes that the pass below does not need
    gathering = None
    if parts > 1:
        gathering = Gathering(lasting_ns(parts, cloud_s))
        findings = (*findings, gathered_finding(lidar_topic.name, parts, cloud_s))
        info = replace(info, period_s=parts * cloud_s)
    reading = Reading(
        recording, settings, clouds.decoder, clouds.timing, on_event, should_cancel, gathering, scans=scans
    )
    reading.run(lidar_topic, imu_topic, span)
    first_ns = reading.receive_ns[0] if span[0] is None else _first_cloud_ns(recording, lidar_topic.name)
    raw_imu, set_findings = on_one_clock(
        reading, reading.imu.finish(), (lidar_topic.name, imu_topic.name), info.period_s, settings
    )
    cleaned = clean_imu(raw_imu, settings, imu_topic.name, start_ns=recording.start_ns)
    scans.finish()
    skipped_s = max(0, reading.receive_ns[0] - first_ns) * 1e-9
    offset_ns = 0
    clock_findings: tuple[Finding, ...] = ()
    if settings.stamps == "header":
        offset_ns, clock_findings = examine_clocks(
            HeaderTimes(np.array(reading.header_ns, np.int64), np.array(reading.receive_ns, np.int64)),
            cleaned.headers,
            period_s=cloud_s,
            last_point_s=last_point_after_header_s(findings),
            topic=lidar_topic.name,
        )
    suspicion = deskew_suspicion(scans, cleaned.imu, offset_ns, lidar_topic.name)
    imu_preset = find_imu_preset(imu_topic.name, raw_imu.frame_id)
    return Recording(
        name=recording.name,
        imu=cleaned.imu,
        scans=scans,
        lidar=info,
        duration_s=recording.duration_s,
        coarse_offset_ns=offset_ns,
        scans_total=len(reading.header_ns) - reading.n_twice - reading.n_unlike if gathering is None else len(scans),
        findings=(
            *findings,
            *reading.findings(lidar_topic.name),
            *cleaned.findings,
            *set_findings,
            *clock_findings,
            *(() if suspicion is None else (suspicion,)),
            *damage_findings(recording, len(scans)),
        ),
        imu_model="" if imu_preset is None else imu_preset.name,
        skipped_s=skipped_s,
    )
