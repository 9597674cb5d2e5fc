"""What can be simulated: a table that joins scenes, sensors, motions and mountings."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from calib_core.errors import SettingsError
from calib_core.simulate import motions, rooms, sensors
from calib_core.simulate.lidar import Outliers
from calib_core.simulate.motion import Motion, Pose, Vector
from calib_core.simulate.scene import Scene
from calib_core.simulate.sensors import HeaderAt, Imu, ImuFaults, Lidar
from calib_core.types import FloatArray

#: x, y, z [m], then the quaternion x, y, z, w: T_imu_lidar.
Mounting = tuple[float, float, float, float, float, float, float]


@dataclass(frozen=True)
class Scenario:
    """One recording to make.

    text: one sentence for a person.   mounting: T_imu_lidar.   rig_lidar: the lidar on the moving body.
    gyro_bias_rad_s, accel_bias_m_s2: at the first sample.
    """

    slug: str
    title: str
    text: str
    scene: Scene
    motion: Motion
    mounting: Mounting
    lidar: Lidar = sensors.VLP_16
    imu: Imu = sensors.MTI_3
    rig_lidar: Pose = field(default_factory=Pose)
    time_offset_s: float = 0.004
    duration_s: float = 20.0
    gravity_m_s2: float = 9.80665
    gyro_bias_rad_s: Vector = (0.0, 0.0, 0.0)
    accel_bias_m_s2: Vector = (0.0, 0.0, 0.0)
    noise: bool = True
    outliers: Outliers | None = None
    imu_faults: ImuFaults = ImuFaults()

    @property
    def R_imu_lidar(self) -> FloatArray:
        """(3, 3)."""
        return np.asarray(Rotation.from_quat(self.mounting[3:]).as_matrix())

    @property
    def p_imu_lidar(self) -> FloatArray:
        """(3,) [m]."""
        return np.asarray(self.mounting[:3], dtype=np.float64)

    def changed(
        self,
        *,
        mounting: Mounting | None = None,
        time_offset_s: float | None = None,
        duration_s: float | None = None,
        noise: bool = True,
        header_at: HeaderAt | None = None,
    ) -> Scenario:
        """The scenario with a caller's wishes; None leaves the scenario's own. Raises SettingsError for the impossible."""
        changed = self
        if mounting is not None:
            changed = replace(changed, mounting=checked_mounting(mounting))
        if time_offset_s is not None:
            if not np.isfinite(time_offset_s) or not -2e9 < time_offset_s < 1.6e9:
                raise SettingsError(
                    f"expected a time offset between -2e9 and 1.6e9 s for the simulation, found {time_offset_s:g}; "
                    "give one that leaves both clocks' stamps positive",
                    code="simulate.time_offset",
                )
            changed = replace(changed, time_offset_s=time_offset_s)
        if duration_s is not None:
            if not np.isfinite(duration_s) or not 0.5 <= duration_s <= 3600.0:
                raise SettingsError(
                    f"expected a duration between 0.5 and 3600 s for the simulation, found {duration_s:g}; give one in that range",
                    code="simulate.duration",
                )
            changed = replace(changed, duration_s=duration_s)
        if header_at is not None:
            changed = replace(changed, lidar=replace(changed.lidar, header_at=header_at))
        return changed if noise else replace(changed, noise=False)


def checked_mounting(mounting: Mounting) -> Mounting:
    """The mounting with its quaternion normalised."""
    values = np.asarray(mounting, dtype=np.float64)
    length = float(np.linalg.norm(values[3:])) if values.shape == (7,) else 0.0
    if values.shape != (7,) or not np.isfinite(values).all() or not 0.9 < length < 1.1:
        raise SettingsError(
            f"expected the mounting as x,y,z,qx,qy,qz,qw with a unit quaternion, found {list(mounting)}; "
            "give seven numbers, metres first, the quaternion's real part last",
            code="simulate.mounting",
        )
    x, y, z, qx, qy, qz, qw = (float(v) for v in values / np.array([1, 1, 1, length, length, length, length]))
    return (x, y, z, qx, qy, qz, qw)


def mounting_from(translation_m: Vector, rotvec_deg: Vector) -> Mounting:
    """A mounting from a translation and a rotation vector in degrees."""
    return _mounting(translation_m, Rotation.from_rotvec(rotvec_deg, degrees=True))


def mounting_from_rpy(translation_m: Vector, rpy_deg: Vector) -> Mounting:
    """A mounting from a translation and (roll, pitch, yaw) in degrees, R = Rz Ry Rx."""
    return _mounting(translation_m, Rotation.from_euler("ZYX", rpy_deg[::-1], degrees=True))


def _mounting(translation_m: Vector, rotation: Rotation) -> Mounting:
    qx, qy, qz, qw = (float(q) for q in rotation.as_quat())
    return (*translation_m, qx, qy, qz, qw)


def _skew(angle_deg: float, axis: Vector) -> Vector:
    x, y, z = (angle_deg * c / float(np.linalg.norm(axis)) for c in axis)
    return (x, y, z)


#: 32 degrees about a skew axis, a lever arm of 0.18 m.
PAPER_LIKE = mounting_from((0.1032, -0.1218, 0.0837), _skew(32.0, (0.5, -0.6, 0.7)))

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
)

SCENARIOS: dict[str, Scenario] = {scenario.slug: scenario for scenario in _TABLE}


def named(slug: str) -> Scenario:
    """The scenario of this name. Raises SettingsError that lists the names."""
    if slug not in SCENARIOS:
        raise SettingsError(
            f"expected the name of a scenario, found {slug!r}; choose one of {', '.join(SCENARIOS)}", code="simulate.scenario"
        )
    return SCENARIOS[slug]
