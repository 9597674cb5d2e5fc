"""Raw packets of lidars: those that are decoded here, and those that are recognised and refused with a sentence."""

from __future__ import annotations

from calib_core.errors import TopicError
from calib_core.readers.container.storage import TopicSummary

#: Raw packets that are decoded here.
PACKET_TYPES = ("velodyne_msgs/msg/VelodyneScan",)
#: Raw packets that are recognised and refused with a sentence.
FOREIGN_PACKET_TYPES = {
    "pandar_msgs/msg/PandarScan": "Hesai",
    "hesai_ros_driver/msg/UdpFrame": "Hesai",
    "nebula_msgs/msg/NebulaPackets": "Nebula",
    "ouster_ros/msg/PacketMsg": "Ouster",
    "ouster_sensor_msgs/msg/PacketMsg": "Ouster",
    "rslidar_msg/msg/RslidarPacket": "RoboSense",
    "rslidar_msgs/msg/rslidarScan": "RoboSense",
    "seyond/msg/SeyondScan": "Seyond",
}


def unsupported_packets(topic: TopicSummary, model: str = "") -> TopicError:
    """The sentence for raw packets that are not decoded."""
    vendor = FOREIGN_PACKET_TYPES[topic.type]
    sensor = f"{vendor} {model}".strip()
    return TopicError(
        f"The topic {topic.name} holds raw {sensor} packets ({topic.type}), which are not decoded here;"
        f" replay them through the {vendor} driver and record its point cloud.",
        code="recording.packets",
    )
