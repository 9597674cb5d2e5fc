"""The topics of a recording: what each could serve as, and how often it comes."""

from __future__ import annotations

from calib_core.doctor.examination import Examination
from calib_core.doctor.report import ImuReport, LidarReport, TopicReport
from calib_core.readers.clouds.packets import FOREIGN_PACKET_TYPES, PACKET_TYPES
from calib_core.readers.container.opening import OpenRecording
from calib_core.readers.container.storage import TopicSummary
from calib_core.readers.topics import CLOUD_TYPES


def topic_report(
    topic: TopicSummary,
    recording: OpenRecording,
    state: Examination,
    read: tuple[LidarReport | None, ImuReport | None],
) -> TopicReport:
    """One topic. read: what was read of those that are calibrated, whose stamps tell the rate.

    Of the others no message is looked at: what is known is how many came in the recording's time, which may have begun without
    them.
    """
    rates = {part.topic: part.stamps.rate_hz for part in read if part is not None}
    chosen = (part.name for part in (state.lidar_topic, state.imu_topic) if part is not None)
    rates = dict.fromkeys(chosen, 0.0) | rates
    counted = topic.count / recording.duration_s if topic.count > 1 and recording.duration_s > 0 else 0.0
    return TopicReport(
        name=topic.name,
        type=topic.type,
        messages=topic.count,
        rate_hz=rates.get(topic.name, counted),
        role="lidar"
        if topic.type in CLOUD_TYPES
        else "imu"
        if topic.type == "sensor_msgs/msg/Imu"
        else "packets"
        if topic.type in (*PACKET_TYPES, *FOREIGN_PACKET_TYPES)
        else "other",
    )
