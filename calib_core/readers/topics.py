"""Which topics carry the lidar and the IMU. Where several fit nobody is preferred: the caller asks."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from calib_core.errors import TopicError
from calib_core.phrasing import counted
from calib_core.readers.clouds import livox, pointcloud2
from calib_core.readers.clouds.packets import FOREIGN_PACKET_TYPES, PACKET_TYPES, unsupported_packets
from calib_core.readers.container.storage import TopicSummary
from calib_core.readers.imu import messages as imu_messages
from calib_core.settings import ReadSettings

CLOUD_TYPES = (pointcloud2.TYPE, *livox.TYPES)


def lidar_topics(topics: Sequence[TopicSummary]) -> list[TopicSummary]:
    """Topics with messages a scan can be made of. Clouds come before raw packets: a driver decoded the same returns."""
    clouds = [t for t in topics if t.type in CLOUD_TYPES and t.count]
    return clouds or [t for t in topics if t.type in PACKET_TYPES and t.count]


def imu_topics(topics: Sequence[TopicSummary]) -> list[TopicSummary]:
    """Topics with IMU readings."""
    return [t for t in topics if t.type == imu_messages.TYPE and t.count]


def choose_lidar(
    topics: Sequence[TopicSummary],
    wanted: str | None,
    recording: str,
    *,
    name_model: Callable[[TopicSummary], str] = lambda _: "",
) -> TopicSummary:
    """The lidar topic: the one named, or the only one that fits. name_model: the sensor behind raw packets, or ""."""
    fitting = lidar_topics(topics)
    if wanted is not None:
        fitting = [t for t in topics if t.type in (*CLOUD_TYPES, *PACKET_TYPES) and t.count]
    foreign = [t for t in topics if t.type in FOREIGN_PACKET_TYPES and t.count and wanted in (None, t.name)]
    if not fitting and foreign:
        # Vendors send IMU packets under the same type: the lidar's are the many.
        lidar = max(foreign, key=lambda t: ("imu" not in t.name, t.count))
        raise unsupported_packets(lidar, name_model(lidar))
    return _choose(topics, fitting, wanted, recording, "lidar", "--lidar-topic")


def choose_imu(topics: Sequence[TopicSummary], wanted: str | None, recording: str) -> TopicSummary:
    """The IMU topic: the one named, or the only one that fits."""
    return _choose(topics, imu_topics(topics), wanted, recording, "IMU", "--imu-topic")


def as_before(settings: ReadSettings, topics: Sequence[TopicSummary], before: tuple[str, str]) -> ReadSettings:
    """The settings with topics of an earlier run, the lidar's and the IMU's, where the settings name none and these are there.

    A recording's only topic of its kind is taken whatever it is called: rigs rename theirs.
    """
    lidar, imu = before
    named: dict[str, str] = {}
    if settings.lidar_topic is None and lidar in {topic.name for topic in lidar_topics(topics)}:
        named["lidar_topic"] = lidar
    if settings.imu_topic is None and imu in {topic.name for topic in imu_topics(topics)}:
        named["imu_topic"] = imu
    return settings.model_copy(update=named)


def _choose(
    topics: Sequence[TopicSummary],
    fitting: Sequence[TopicSummary],
    wanted: str | None,
    recording: str,
    what: str,
    flag: str,
) -> TopicSummary:
    names = tuple(t.name for t in fitting)
    if wanted is not None:
        chosen = next((t for t in fitting if t.name == wanted), None)
        if chosen is not None:
            return chosen
        present = next((t for t in topics if t.name == wanted), None)
        found = (
            "is not in the recording"
            if present is None
            else f"is of type {present.type} with {counted(present.count, 'message')}"
        )
        raise TopicError(
            f"The topic {wanted} given as {what} topic {found}; {recording} has"
            f" {_listed(names) or f'no {what} topic'}.",
            candidates=names,
        )
    if not fitting:
        types = (*CLOUD_TYPES, *PACKET_TYPES) if what == "lidar" else (imu_messages.TYPE,)
        silent = next((t for t in topics if t.type in types and not t.count), None)
        if silent is not None:
            raise TopicError(
                f"The recording {recording} holds not one whole message of its {what} topic {silent.name} ({silent.type}):"
                " it was cut short, or nothing was published; record or copy it again.",
                code=f"recording.no_{what.lower()}",
            )
        seen = _listed([f"{t.name} ({t.type})" for t in topics][:8]) or "no topics at all"
        raise TopicError(
            f"The recording {recording} has no {what} topic with messages; it holds {seen}; record the {what} too.",
            code=f"recording.no_{what.lower()}",
        )
    if len(fitting) > 1:
        raise TopicError(
            f"The recording {recording} has {len(fitting)} {what} topics, {_listed(names)}; choose one with {flag}.",
            code=f"recording.several_{what.lower()}",
            candidates=names,
        )
    return fitting[0]


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names)
