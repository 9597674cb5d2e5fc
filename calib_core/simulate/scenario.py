"""One recording to make: a scene, a motion, sensors and a mounting joined, and a caller's wishes applied to it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from calib_core.errors import SettingsError
from calib_core.simulate import sensors
from calib_core.simulate.lidar import Outliers
from calib_core.simulate.motion import Motion, Pose, Vector
from calib_core.simulate.scene import Scene
from calib_core.simulate.sensors import NO_FAULTS, HeaderAt, Imu, ImuFaults, Lidar
from calib_core.simulate.wishes import Mounting
from calib_core.types import FloatArray


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
    imu_faults: ImuFaults = NO_FAULTS

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
        """The scenario with a caller's `Changes`. Raises SettingsError for the impossible."""
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
                    f"expected a duration between 0.5 and 3600 s for the simulation, found {duration_s:g}; "
                    "give one in that range",
                    code="simulate.duration",
                )
            changed = replace(changed, duration_s=duration_s)
        if header_at is not None:
            _check_has_packets(self)
            changed = replace(changed, lidar=replace(changed.lidar, header_at=header_at))
        return changed if noise else replace(changed, noise=False)


def _check_has_packets(scenario: Scenario) -> None:
    """Only a Velodyne driver's clouds are stamped by a packet that can be chosen: of others the wish would be passed over."""
    if scenario.lidar.layout != "velodyne":
        raise SettingsError(
            f"expected a scenario with a Velodyne cloud for a choice of the packet that stamps it, found {scenario.slug}, "
            f"whose clouds are {scenario.lidar.layout}'s; leave --header-at out, or choose another scenario",
            code="simulate.header_at",
        )


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


def mounting_from(translation_m: Vector, *, angle_deg: float, axis: Vector) -> Mounting:
    """A mounting from a translation and a rotation by an angle about an axis of any length."""
    unit = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    return _mounting(translation_m, Rotation.from_rotvec(angle_deg * unit, degrees=True))


def mounting_from_rpy(translation_m: Vector, rpy_deg: Vector) -> Mounting:
    """A mounting from a translation and (roll, pitch, yaw) in degrees, R = Rz Ry Rx."""
    return _mounting(translation_m, Rotation.from_euler("ZYX", rpy_deg[::-1], degrees=True))


def _mounting(translation_m: Vector, rotation: Rotation) -> Mounting:
    qx, qy, qz, qw = (float(q) for q in rotation.as_quat())
    return (*translation_m, qx, qy, qz, qw)
