"""Lidars: noise of a range, and what their lasers do by themselves.

Data sheets give an accuracy (2 to 3 cm, of everything together) and hardly ever what one laser does; where others have
measured that, they are named, else it is judged from the maker's accuracy and said to be unconfirmed.
"""

from __future__ import annotations

from calib_core.intrinsics import UNKNOWN_LIDAR, LidarPrior
from calib_core.presets.records import LidarPreset

#: Data sheets: rotating lidars reach 300 m, long-range ones 500 m with a few of their points; indoors half of all returns lie
#: within ten. None measures nearer than 5 cm.
FARTHEST_M, NEAREST_M = 300.0, 0.05


def _prior(
    offset_m: float, elevation_rad: float, scale: float, all_m: float = 0.01, incidence_m: float = 0.002
) -> LidarPrior:
    """offset_m, elevation_rad, scale: of each laser.   all_m, incidence_m: of all together."""
    return LidarPrior(
        laser_range_offset_std_m=offset_m,
        laser_elevation_std_rad=elevation_rad,
        laser_range_scale_std=scale,
        range_offset_std_m=all_m,
        incidence_std_m=incidence_m,
    )


#: A pair of analogue receivers a laser. Two VLP-16 on public packets: 5 and 10 mm of sd over the lasers; OA-LICalib's own:
#: -14 to +18 mm, elevations up to 0.24 deg off, scales 0.996 to 1.006.
_ANALOGUE = _prior(0.008, 0.0009, 0.002)
#: An HDL-64E needed 0.22 deg on KITTI (Deschaud); recalibrating took up to 49 % off its residuals (Chen and Chien).
_EARLY_ANALOGUE = _prior(0.012, 0.0015, 0.003, incidence_m=0.004)
#: One chip of detectors behind one lens: the OS1's sheet gives 0.01 deg of sampling accuracy and no bias.
_DIGITAL = _prior(0.004, 0.0002, 0.0005, all_m=0.006)
#: Angles measured for each unit and read from it by the driver.
_CORRECTED = _prior(0.005, 0.0004, 0.001)
#: Few lasers behind common prisms, each with an analogue receiver, taken as a spinning lidar's: the Avia's sheet gives 0.05 deg
#: of angular precision, the HAP's 3 cm of systematic error at 20 m.
_ROSETTE = _prior(0.008, 0.0009, 0.002)

_UNCONFIRMED = "its lasers' own errors unconfirmed"

#: The particular before the general: the first whose words are found wins.
LIDAR_PRESETS: tuple[LidarPreset, ...] = (
    LidarPreset(
        "livox-mid360",
        0.02,
        _ROSETTE,
        f"integrator page quoting the data sheet; {_UNCONFIRMED}",
        ("mid360", "mid-360", "mid_360"),
    ),
    LidarPreset(
        "livox-hap",
        0.02,
        _ROSETTE,
        f"Livox HAP user manual, table 1.2.1: 2 cm at 20 m, 0.1 deg; {_UNCONFIRMED}",
        ("livox_hap", "livox-hap", "livox/hap", "hap_", "hap"),
    ),
    LidarPreset(
        "livox-avia",
        0.02,
        _ROSETTE,
        f"Livox Avia user manual, 20 m; unconfirmed; {_UNCONFIRMED}",
        ("livox", "avia", "horizon"),
    ),
    LidarPreset(
        "velodyne-vlp32c",
        0.02,
        _ANALOGUE,
        f"start value; the sheet gives 3 cm typical accuracy; {_UNCONFIRMED}, taken as the VLP-16's",
        ("vlp32", "vlp-32", "vlp_32", "ultra_puck"),
    ),
    LidarPreset(
        "velodyne-vlp16",
        0.02,
        _ANALOGUE,
        "start value; the sheet gives 3 cm typical accuracy; lasers measured on public packets and by OA-LICalib",
        ("vlp16", "vlp-16", "vlp_16", "puck"),
    ),
    LidarPreset(
        "velodyne-hdl32e",
        0.02,
        _prior(0.008, 0.0009, 0.002, incidence_m=0.004),
        "start value; the sheet gives 2 cm accuracy; range bias at grazing incidence by Laconte et al., arXiv 1810.01619",
        ("hdl32", "hdl-32", "hdl_32"),
    ),
    LidarPreset(
        "velodyne-hdl64e",
        0.02,
        _EARLY_ANALOGUE,
        "start value; the sheet gives 2 cm accuracy; elevations by Deschaud on KITTI",
        ("hdl64", "hdl-64", "hdl_64"),
    ),
    LidarPreset(
        "velodyne",
        0.02,
        _ANALOGUE,
        f"start value for any of the maker's; the sheets give 2 to 3 cm typical accuracy; {_UNCONFIRMED}",
        ("velodyne", "vlp", "hdl", "vls"),
    ),
    LidarPreset(
        "ouster-os0",
        0.015,
        _prior(0.005, 0.0003, 0.0005, all_m=0.006),
        f"OS0: as the OS1's, angles coarser; unconfirmed; {_UNCONFIRMED}",
        ("os0", "os-0"),
    ),
    LidarPreset(
        "ouster-os2",
        0.025,
        _DIGITAL,
        f"OS2: unconfirmed; {_UNCONFIRMED}",
        ("os2", "os-2"),
    ),
    LidarPreset(
        "ouster-os",
        0.015,
        _DIGITAL,
        "OS1 data sheet at high signal: 1.5 cm, 0.01 deg, no bias on matt targets; offsets of single beams unconfirmed",
        ("ouster", "os_lidar", "os_sensor", "os1", "os-1"),
    ),
    LidarPreset(
        "hesai-xt32",
        0.01,
        _CORRECTED,
        f"PandarXT data sheet: accuracy 1 cm, precision 0.5 cm, unconfirmed; {_UNCONFIRMED}",
        ("xt32", "xt16", "xt-32", "xt-16", "pandarxt"),
    ),
    LidarPreset(
        "hesai-pandar40",
        0.02,
        _prior(0.008, 0.0005, 0.0015),
        f"Pandar40, Pandar64, Pandar128 data sheets: accuracy 2 cm, unconfirmed; {_UNCONFIRMED}",
        ("pandar40", "pandar64", "pandar128", "pandarqt"),
    ),
    LidarPreset(
        "hesai",
        0.01,
        _prior(0.008, 0.0005, 0.0015),
        f"any of the maker's: the XT's noise; {_UNCONFIRMED}",
        ("hesai", "pandar"),
    ),
    LidarPreset(
        "robosense-16",
        0.02,
        _prior(0.01, 0.0009, 0.002, incidence_m=0.004),
        "RS-LiDAR-16 manual: accuracy 2 cm, unconfirmed; range bias at grazing incidence by Laconte et al., arXiv 1810.01619",
        ("rs16", "rs-16", "rs_16", "rslidar-16", "rs-lidar-16"),
    ),
    LidarPreset(
        "robosense-32",
        0.03,
        _prior(0.01, 0.0009, 0.002),
        f"RS-LiDAR-32 manual: accuracy 3 cm, unconfirmed; {_UNCONFIRMED}",
        ("rs32", "rs-32", "rs_32", "rslidar-32", "rs-lidar-32"),
    ),
    LidarPreset(
        "robosense-bpearl",
        0.03,
        _prior(0.01, 0.0009, 0.002),
        f"RS-Bpearl manual: accuracy 3 cm, unconfirmed; {_UNCONFIRMED}",
        ("bpearl", "rsbp", "rs-bp"),
    ),
    LidarPreset(
        "robosense",
        0.03,
        _prior(0.01, 0.0009, 0.002),
        f"Airy and Helios; unconfirmed; {_UNCONFIRMED}",
        ("rslidar", "robosense", "airy", "helios"),
    ),
)
#: Words of makers and their drivers, which say nothing of the model.
LIDAR_MAKERS = frozenset(
    {"livox", "velodyne", "vlp", "hdl", "vls", "ouster", "os_lidar", "os_sensor"}
    | {"hesai", "pandar", "rslidar", "robosense"}
)
GENERIC_LIDAR = LidarPreset("generic-lidar", 0.03, UNKNOWN_LIDAR, "middle of common sensors", ())
