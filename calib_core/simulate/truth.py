"""What a simulated recording really was: the answer, and the exact motion as functions of time."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from scipy.spatial.transform import Rotation

from calib_core.result import Transform
from calib_core.simulate.faults import IDEAL, Drawn
from calib_core.simulate.faults.named import parameters
from calib_core.simulate.motion import Kinematics
from calib_core.simulate.scenario import Scenario
from calib_core.types import FloatArray, Plane


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class TruthPlane(_Model):
    """A plane n . x + w = 0 in the map frame (the lidar frame at the first scan's time)."""

    name: str
    normal: list[float]
    offset_m: float


class TruthNoise(_Model):
    """What was added: the contract's noise keys; all 0 in a noise-free recording."""

    gyroscope_noise_density_rad_s_sqrt_hz: float
    accelerometer_noise_density_m_s2_sqrt_hz: float
    gyroscope_random_walk: float
    accelerometer_random_walk: float
    range_std_m: float


class TruthParameter(_Model):
    """One parameter of a real sensor: the names, units and signs of `calib_core.intrinsics`, and of the simulator's own."""

    block: str
    name: str
    unit: str
    value: float


class TruthFile(_Model):
    """The truth as it lies beside a simulated recording: the result's keys and signs.

    faults: those put in.   intrinsics: of the sensors that have any; what is not listed is 0.   time_offset_s holds at
    time_offset_at_s, seconds after the first scan: the middle of the first and the last scan.
    """

    schema_: str = Field(default="unsweep.truth/1", alias="schema")
    scenario: str
    seed: int
    duration_s: float
    T_imu_lidar: Transform
    time_offset_s: float
    time_offset_ns: int
    gyroscope_bias_rad_s: list[float]
    accelerometer_bias_m_s2: list[float]
    gravity_m_s2: float
    planes: list[TruthPlane]
    noise: TruthNoise
    faults: list[str] = []
    intrinsics: list[TruthParameter] = []
    clock_rate_ppm: float = 0.0
    time_offset_at_s: float = 0.0

    model_config = ConfigDict(extra="forbid", populate_by_name=True, serialize_by_alias=True)

    def to_json(self) -> str:
        """The document as indented JSON text, ending in a newline."""
        return self.model_dump_json(by_alias=True, indent=2) + "\n"


@dataclass(frozen=True)
class Truth:
    """Everything true of one simulated recording.

    World: the scene's, z up, gravity (0, 0, -gravity_m_s2). Times `t_s`: (N,) seconds of the lidar clock after
    `epoch_ns`.   map: the lidar frame at `map_time_ns`, the first scan's time.   Biases: means over the readings.
    faults: what sensors and clocks really are; where clocks run apart, time_offset_s is that of `middle_ns`.
    """

    scenario: Scenario
    seed: int
    epoch_ns: int
    map_time_ns: int
    gyro_bias_rad_s: FloatArray
    accel_bias_m_s2: FloatArray
    faults: Drawn = IDEAL

    @property
    def R_imu_lidar(self) -> FloatArray:
        """(3, 3)."""
        return self.scenario.R_imu_lidar

    @property
    def p_imu_lidar(self) -> FloatArray:
        """(3,) [m]."""
        return self.scenario.p_imu_lidar

    @property
    def T_imu_lidar(self) -> FloatArray:
        """(4, 4)."""
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = self.R_imu_lidar, self.p_imu_lidar
        return T

    @property
    def time_offset_ns(self) -> int:
        """To be added to IMU stamps to express them in the lidar clock."""
        return round(Fraction(self.scenario.time_offset_s) * 1_000_000_000)

    @property
    def time_offset_s(self) -> float:
        """The same in seconds."""
        return self.time_offset_ns / 1e9

    @property
    def middle_ns(self) -> float:
        """Middle of the first and the last scan's first shots, after `epoch_ns`."""
        pattern = self.scenario.lidar.pattern
        last = pattern.count(self.scenario.duration_s) - 1
        return 0.5 * float(sum(int(pattern.firings(index).column_ns[0]) for index in (0, last)))

    @property
    def time_offset_at_s(self) -> float:
        """Lidar time after the first scan at which time_offset_s holds."""
        return (self.middle_ns - (self.map_time_ns - self.epoch_ns)) * 1e-9

    def time_offset_ns_at(self, after_s: float) -> int:
        """The offset at a lidar time [s] after the first scan."""
        rate = self.faults.clock_rate_ppm * 1e-6
        return self.time_offset_ns + round(rate * (after_s - self.time_offset_at_s) * 1e9)

    @property
    def intrinsics(self) -> list[TruthParameter]:
        """What sets the sensors apart from ideal ones."""
        lidar = self.scenario.lidar
        rings = list(range(len(lidar.pattern.ring))) if lidar.layout == "ouster" else lidar.pattern.ring.tolist()
        return [
            TruthParameter(block=block, name=name, unit=unit, value=value)
            for block, name, unit, value in parameters(self.faults, rings)
        ]

    @property
    def gravity_m_s2(self) -> float:
        """Magnitude."""
        return self.scenario.gravity_m_s2

    @property
    def gravity_world_m_s2(self) -> FloatArray:
        """(3,)."""
        return np.array([0.0, 0.0, -self.gravity_m_s2])

    def seconds(self, stamps_ns: np.ndarray[tuple[int], np.dtype[np.int64]]) -> FloatArray:
        """Lidar stamps as `t_s`."""
        return np.asarray(stamps_ns - self.epoch_ns, dtype=np.float64) * 1e-9

    def lidar(self, t_s: FloatArray) -> Kinematics:
        """Exact kinematics of the lidar frame."""
        rig = self.scenario.motion.kinematics(np.atleast_1d(np.asarray(t_s, dtype=np.float64)))
        return rig.at(self.scenario.rig_lidar.R, self.scenario.rig_lidar.p)

    def imu(self, t_s: FloatArray) -> Kinematics:
        """Exact kinematics of the IMU frame: the lidar's, moved by the inverse of T_imu_lidar."""
        R = self.R_imu_lidar
        return self.lidar(t_s).at(R.T, -R.T @ self.p_imu_lidar)

    def map_lidar(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """R_map_lidar (N, 3, 3) and p_map_lidar (N, 3) [m]."""
        home = self.lidar(np.array([(self.map_time_ns - self.epoch_ns) * 1e-9]))
        now = self.lidar(t_s)
        R_home = home.R_world[0]
        return R_home.T @ now.R_world, (now.p_m - home.p_m[0]) @ R_home

    @property
    def planes(self) -> tuple[Plane, ...]:
        """The scene's faces in the map frame: n_map = R^T n, w_map = w + n . p, the lidar being at R, p at its time."""
        home = self.lidar(np.array([(self.map_time_ns - self.epoch_ns) * 1e-9]))
        R, p = home.R_world[0], home.p_m[0]
        return tuple(
            Plane(face.name, R.T @ face.unit_normal, face.offset_m + float(face.unit_normal @ p))
            for face in self.scenario.scene.faces
        )

    def to_file(self) -> TruthFile:
        """The document that lies beside the recording."""
        scenario, imu = self.scenario, self.scenario.imu
        on = 1.0 if scenario.noise else 0.0
        rotation = Rotation.from_quat(scenario.mounting[3:])
        with warnings.catch_warnings():  # pointing straight up, any split of yaw and roll is as right as another
            warnings.filterwarnings("ignore", message="Gimbal lock")
            yaw, pitch, roll = (float(a) for a in rotation.as_euler("ZYX", degrees=True))
        return TruthFile(
            scenario=scenario.slug,
            seed=self.seed,
            duration_s=scenario.duration_s,
            T_imu_lidar=Transform(
                matrix=self.T_imu_lidar.tolist(),
                translation_m=list(scenario.mounting[:3]),
                quaternion_xyzw=list(scenario.mounting[3:]),
                euler_xyz_deg=[roll, pitch, yaw],
            ),
            time_offset_s=self.time_offset_s,
            time_offset_ns=self.time_offset_ns,
            gyroscope_bias_rad_s=self.gyro_bias_rad_s.tolist(),
            accelerometer_bias_m_s2=self.accel_bias_m_s2.tolist(),
            gravity_m_s2=self.gravity_m_s2,
            planes=[TruthPlane(name=p.name, normal=p.normal.tolist(), offset_m=p.offset_m) for p in self.planes],
            noise=TruthNoise(
                gyroscope_noise_density_rad_s_sqrt_hz=on * imu.gyroscope_noise_density_rad_s_sqrt_hz,
                accelerometer_noise_density_m_s2_sqrt_hz=on * imu.accelerometer_noise_density_m_s2_sqrt_hz,
                gyroscope_random_walk=on * imu.gyroscope_random_walk,
                accelerometer_random_walk=on * imu.accelerometer_random_walk,
                range_std_m=on * scenario.lidar.range_std_m,
            ),
            faults=list(self.faults.names),
            intrinsics=self.intrinsics,
            clock_rate_ppm=self.faults.clock_rate_ppm,
            time_offset_at_s=self.time_offset_at_s,
        )
