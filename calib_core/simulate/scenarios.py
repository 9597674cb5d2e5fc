"""What can be simulated: a table that joins scenes, sensors, motions and mountings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.errors import SettingsError
from calib_core.simulate import motions, rooms, sensors
from calib_core.simulate.lidar import Outliers
from calib_core.simulate.motion import Pose
from calib_core.simulate.scenario import Scenario, checked_mounting, mounting_from, mounting_from_rpy
from calib_core.simulate.sensors import ImuFaults

_HALF_ROOT = float(np.sqrt(0.5))
#: 32 degrees about a skew axis, a lever arm of 0.18 m.
PAPER_LIKE = mounting_from((0.1032, -0.1218, 0.0837), angle_deg=32.0, axis=(0.5, -0.6, 0.7))

PAPER_NORMAL = Scenario(
    slug="paper-normal",
    title="Hand-held in front of a room corner",
    text="A VLP-16 and an IMU moved by sines of 0.2 to 0.53 Hz in front of a room corner for 20 s, as in the paper.",
    scene=rooms.PAPER_ROOM,
    motion=motions.PAPER_NORMAL,
    mounting=PAPER_LIKE,
)

_TABLE: tuple[Scenario, ...] = (
    PAPER_NORMAL,
    replace(
        PAPER_NORMAL,
        slug="paper-normal-last-stamp",
        title="The same with stamps at the sweep's end",
        text="As paper-normal, the clouds stamped at their last packet as the Velodyne driver does by default.",
        lidar=replace(sensors.VLP_16, header_at="last"),
    ),
    replace(
        PAPER_NORMAL,
        slug="paper-fast",
        title="Fast motion",
        text="As paper-normal with all frequencies raised so that the highest is 1.53 Hz.",
        motion=motions.PAPER_FAST,
    ),
    replace(
        PAPER_NORMAL,
        slug="noise-free",
        title="No noise",
        text="As paper-normal with exact ranges and exact inertial readings.",
        noise=False,
    ),
    replace(
        PAPER_NORMAL,
        slug="noise-free-fast",
        title="No noise, fast motion",
        text="As paper-fast with exact ranges and exact inertial readings.",
        motion=motions.PAPER_FAST,
        noise=False,
    ),
    replace(
        PAPER_NORMAL,
        slug="handheld",
        title="A minute by hand, as people record",
        text="60 s by hand in a furnished room, its operator in view, the paper's own mounting, biases and 12.7 ms.",
        scene=rooms.FURNISHED_ROOM,
        motion=motions.HANDHELD,
        mounting=mounting_from_rpy((-0.080, 0.089, -0.053), (2.90, -1.11, 179.9)),
        time_offset_s=0.0127,
        duration_s=60.0,
        gyro_bias_rad_s=(0.0050, -0.0048, 0.0040),
        accel_bias_m_s2=(0.090, -0.100, 0.066),
    ),
    replace(
        PAPER_NORMAL,
        slug="walking-person",
        title="Someone walks through",
        text="As paper-normal while someone walks round the sensor, between it and the walls.",
        scene=rooms.WALKED_ROOM,
    ),
    replace(
        PAPER_NORMAL,
        slug="outliers",
        title="Wrong returns",
        text="As paper-normal with 10 % of the points at a wrong range.",
        outliers=Outliers(fraction=0.1),
    ),
    replace(
        PAPER_NORMAL,
        slug="partial-views",
        title="The corner leaves the view",
        text="A lidar with a 90 degree view turns away from a free-standing corner: two planes, one, none, in turn.",
        scene=rooms.FREE_CORNER,
        motion=motions.TURNING_AWAY,
        lidar=replace(sensors.VLP_16, field_of_view_deg=90.0),
        imu=replace(sensors.MTI_3, gyroscope_random_walk=3e-5, accelerometer_random_walk=3e-4),
        duration_s=40.0,
        gravity_m_s2=9.7967,
        gyro_bias_rad_s=(0.002, -0.0015, 0.001),
        accel_bias_m_s2=(0.03, 0.02, -0.04),
    ),
    replace(
        PAPER_NORMAL,
        slug="outdoor",
        title="A building's corner",
        text="An XT32 in front of a building's outer corner, most rays without a return, for 30 s.",
        scene=rooms.BUILDING_CORNER,
        motion=motions.OUTDOOR,
        mounting=(-0.001, -0.0086, 0.055, _HALF_ROOT, -_HALF_ROOT, 0.0, 0.0),
        lidar=sensors.XT_32,
        imu=sensors.BMI_085_HILTI,
        time_offset_s=-0.0061,
        duration_s=30.0,
        gyro_bias_rad_s=(0.0011, -0.0023, 0.0007),
        accel_bias_m_s2=(0.02, -0.05, 0.03),
    ),
    replace(
        PAPER_NORMAL,
        slug="attic",
        title="Slanted walls",
        text="Under a roof: slanted planes, hardly a right angle.",
        scene=rooms.ATTIC,
        motion=motions.ATTIC,
        duration_s=25.0,
    ),
    replace(
        PAPER_NORMAL,
        slug="ouster",
        title="A 64-beam lidar",
        text="An OS1-64 at 1024 x 10 with an IMU at 200 Hz in a furnished room.",
        scene=rooms.FURNISHED_ROOM,
        motion=motions.OUSTER,
        mounting=checked_mounting((0.0138, -0.0122, -0.0151, 0.00329, -0.00463, -0.00243, 0.99998)),
        lidar=sensors.OS1_64,
        imu=sensors.ICM_20948_OUSTER,
        time_offset_s=-0.0021,
        gyro_bias_rad_s=(-0.0013, 0.0021, 0.0004),
        accel_bias_m_s2=(0.04, 0.01, -0.06),
    ),
    replace(
        PAPER_NORMAL,
        slug="livox",
        title="A solid-state lidar",
        text="The rosette of a solid-state lidar as Livox CustomMsg, its IMU at 200 Hz in g.",
        scene=rooms.ROOM_AHEAD,
        motion=motions.LIVOX,
        mounting=(-0.011, -0.02329, 0.04412, 0.0, 0.0, 0.0, 1.0),
        lidar=sensors.LIVOX,
        imu=sensors.BMI_088_LIVOX,
        time_offset_s=0.0033,
        duration_s=30.0,
        gyro_bias_rad_s=(0.0017, 0.0009, -0.0021),
        accel_bias_m_s2=(-0.03, 0.05, 0.02),
    ),
    replace(
        PAPER_NORMAL,
        slug="vehicle",
        title="A car in a car park",
        text="A figure of eight in a car park, walls some 20 m away: planar motion, 0.15 degrees of pitch and roll.",
        scene=rooms.CAR_PARK,
        motion=motions.CAR_PARK,
        mounting=mounting_from_rpy((0.62, 0.11, 1.05), (1.3, -0.9, 2.4)),
        rig_lidar=Pose((0.4, 0.6, 0.0), (1.35, 0.0, 1.85)),
        duration_s=60.0,
        gyro_bias_rad_s=(0.0008, -0.0012, 0.0021),
        accel_bias_m_s2=(0.03, -0.02, 0.05),
    ),
    replace(
        PAPER_NORMAL,
        slug="one-axis",
        title="Turning about one axis",
        text="Turns about one fixed axis only while moving along all three: the lever arm along it cannot be known.",
        motion=motions.ONE_AXIS,
    ),
    replace(
        PAPER_NORMAL,
        slug="one-axis-in-place",
        title="Turning in place",
        text="Turns about one fixed axis and nothing else: two directions cannot be known.",
        motion=motions.ONE_AXIS_IN_PLACE,
        rig_lidar=Pose(position_m=(0.12, -0.08, 0.05)),
    ),
    replace(
        PAPER_NORMAL,
        slug="no-rotation",
        title="Translation only",
        text="Moves along all axes without turning: the lever arm cannot be known.",
        motion=motions.SHIFTING,
    ),
    replace(
        PAPER_NORMAL,
        slug="static",
        title="Standing still",
        text="Never moves: nothing can be calibrated.",
        motion=motions.STILL,
    ),
    replace(
        PAPER_NORMAL,
        slug="no-static-start",
        title="Moving from the start",
        text="As paper-normal, already moving when the recording begins.",
        motion=motions.MOVING_FROM_THE_START,
    ),
    replace(
        PAPER_NORMAL,
        slug="imu-faults",
        title="A bad IMU link",
        text="As paper-normal with half-second gaps, 1 % of the samples missing, duplicates, swaps and 1 ms jitter.",
        imu_faults=ImuFaults(
            gaps_s=((6.31, 0.5), (13.07, 0.5)), missing=0.01, duplicated=0.005, swapped=0.005, jitter_s=0.001
        ),
    ),
)

SCENARIOS: dict[str, Scenario] = {scenario.slug: scenario for scenario in _TABLE}


#: What a scenario can be made behind: `handheld+os1`.
LIDARS = {"vlp16": sensors.VLP_16, "xt32": sensors.XT_32, "os1": sensors.OS1_64, "livox": sensors.LIVOX}


def named(slug: str) -> Scenario:
    """The scenario of this name, behind another lidar where one follows a plus sign. Raises SettingsError with the names."""
    base, plus, lidar = slug.partition("+")
    if base not in SCENARIOS or (plus and lidar not in LIDARS):
        raise SettingsError(
            f"expected the name of a scenario, found {slug!r}; choose one of {', '.join(SCENARIOS)}, for another lidar with "
            f"{', '.join(f'+{name}' for name in LIDARS)} after it",
            code="simulate.scenario",
        )
    return replace(SCENARIOS[base], slug=slug, lidar=LIDARS[lidar]) if plus else SCENARIOS[base]
