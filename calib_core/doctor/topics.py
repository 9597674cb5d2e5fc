"""The topics of a recording: what each could serve as, and how often it comes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection

import numpy as np

from calib_core.doctor.examination import Examination
from calib_core.doctor.report import ImuReport, LidarReport, TopicReport
from calib_core.readers.clouds.packets import FOREIGN_PACKET_TYPES, PACKET_TYPES
from calib_core.readers.container.opening import OpenRecording
from calib_core.readers.container.storage import TopicSummary
from calib_core.readers.topics import CLOUD_TYPES, imu_topics, lidar_topics
from calib_core.stamp_rate import rate_hz

#: So many seconds tell a rate to a third of a per cent where messages are received 10 ms late now and then.
WATCHED_S = 3.0


def counted_rates(recording: OpenRecording, read: Collection[str]) -> dict[str, float]:
    """Messages a second by topic. read: topics that are read anyhow, whose stamps will tell.

    By how many came in the recording's time, which may have begun without them; where a topic could serve as lidar or IMU, by
    when they were received over some seconds in the recording's middle: of two lidars one is to be chosen.
    """
    rates = {
        topic.name: topic.count / recording.duration_s if topic.count > 1 and recording.duration_s > 0 else 0.0
        for topic in recording.topics
    }
    may_serve = {topic.name for topic in (*lidar_topics(recording.topics), *imu_topics(recording.topics))} - set(read)
    if not may_serve:
        return rates
    middle_ns, half_ns = (recording.start_ns + recording.end_ns) // 2, round(0.5e9 * WATCHED_S)
    received_ns: dict[str, list[int]] = defaultdict(list)
    for message in recording.messages(may_serve, start_ns=middle_ns - half_ns, stop_ns=middle_ns + half_ns):
        received_ns[message.topic].append(message.receive_ns)
    for name, times_ns in received_ns.items():
        rates[name] = rate_hz(np.unique(np.array(times_ns, dtype=np.int64))) or rates[name]
    return rates


def topic_report(
    topic: TopicSummary,
    state: Examination,
    read: tuple[LidarReport | None, ImuReport | None],
) -> TopicReport:
    """One topic. read: what was read of those that are calibrated, whose stamps tell the rate."""
    rates = {part.topic: part.stamps.rate_hz for part in read if part is not None}
    chosen = (part.name for part in (state.lidar_topic, state.imu_topic) if part is not None)
    rates = state.counted_rates | dict.fromkeys(chosen, 0.0) | rates
    return TopicReport(
        name=topic.name,
        type=topic.type,
        messages=topic.count,
        rate_hz=rates[topic.name],
        role="lidar"
        if topic.type in CLOUD_TYPES
        else "imu"
        if topic.type == "sensor_msgs/msg/Imu"
        else "packets"
        if topic.type in (*PACKET_TYPES, *FOREIGN_PACKET_TYPES)
        else "other",
    )
