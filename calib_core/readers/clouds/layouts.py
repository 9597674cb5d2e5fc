"""What wrote a cloud, from its fields and names: for reports, presets and advice, never for decoding."""

from __future__ import annotations

from dataclasses import dataclass

from calib_core.readers.clouds.cloud import RawCloud

#: What to change in a driver that sends no time, in the words of its own options.
_HELP = {
    "livox-driver1-pointcloud2": "this Livox driver's PointCloud2 has none, so record its CustomMsg (format 1)",
    "robosense-xyzi": "build the RoboSense driver with POINT_TYPE=XYZIRT",
    "ouster-xyzi": "start the Ouster driver with point_type:=original",
    "sick-default": "choose one of the cloud_all_fields_* clouds of the SICK driver",
}


@dataclass(frozen=True, slots=True)
class CloudLayout:
    """How a driver lays out its clouds. name: stable, e.g. "velodyne"."""

    name: str

    @property
    def help_text(self) -> str:
        """What to do where the clouds carry no time: a clause for the sentence that says so, or ""."""
        return _HELP.get(self.name, "")


#: (layout, fields that must all be there), the most particular first.
_BY_FIELDS: tuple[tuple[str, frozenset[str]], ...] = (
    ("livox-custommsg", frozenset({"offset_time", "reflectivity", "tag", "line"})),
    ("livox-driver2-pointcloud2", frozenset({"tag", "line", "timestamp"})),
    ("livox-driver1-pointcloud2", frozenset({"tag", "line"})),
    ("nebula", frozenset({"return_type", "channel", "azimuth", "elevation", "distance", "time_stamp"})),
    ("nebula", frozenset({"ring", "return_type", "azimuth", "distance", "time_stamp"})),
    ("seyond", frozenset({"timestamp", "scan_id", "scan_idx", "is_2nd_return"})),
    ("ouster", frozenset({"t", "reflectivity", "ring", "range"})),
    ("aeva", frozenset({"time_offset_ns", "velocity", "reflectivity"})),
    ("sick-all-fields", frozenset({"i", "lidar_sec", "lidar_nsec"})),
    ("sick-all-fields", frozenset({"i", "t", "layer"})),
    ("sick-all-fields", frozenset({"i", "ts"})),
    ("velodyne", frozenset({"intensity", "ring", "time"})),
    ("xyzirt-absolute", frozenset({"intensity", "ring", "timestamp"})),
)
_VENDOR_NAMES = {
    "velodyne": ("velodyne", "vlp", "hdl", "puck"),
    "ouster": ("ouster", "os_cloud", "os_lidar", "os_sensor", "os0", "os1", "os2"),
    "hesai": ("hesai", "pandar", "xt32", "xt16", "at128", "qt64", "qt128"),
    "livox": ("livox", "mid360", "mid-360", "avia", "horizon"),
    "robosense": ("rslidar", "robosense", "helios", "airy", "bpearl"),
    "seyond": ("seyond", "innovusion", "falcon", "robin"),
    "sick": ("sick", "multiscan", "picoscan"),
    "aeva": ("aeva", "aeries"),
}


def recognise_layout(cloud: RawCloud, topic: str) -> CloudLayout:
    """The layout of a cloud, from its field names, the topic and the frame id."""
    fields = frozenset(cloud.names)
    spoken = vendor_by_name(topic) or vendor_by_name(cloud.frame_id)
    for name, needed in _BY_FIELDS:
        if needed <= fields:
            if name == "xyzirt-absolute" and spoken in ("hesai", "robosense"):
                return CloudLayout(spoken)
            return CloudLayout(name)
    if fields <= {"x", "y", "z", "intensity", "ring"}:
        if spoken == "robosense":
            return CloudLayout("robosense-xyzi")
        if spoken == "ouster":
            return CloudLayout("ouster-xyzi")
    if "i" in fields and fields <= {"x", "y", "z", "i", "layer", "echo", "reflector", "ring"}:
        return CloudLayout("sick-default")
    return CloudLayout("generic")


def vendor_by_name(text: str) -> str:
    """The vendor a topic or frame id names, or ""."""
    lowered = text.lower()
    return next((v for v, words in _VENDOR_NAMES.items() if any(word in lowered for word in words)), "")
