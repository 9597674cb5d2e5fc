"""A scenario made into sensor messages, scan by scan, with their truth.

Two clocks: the lidar's is the reference, an IMU message taken at lidar time t is stamped t - time_offset; where the clocks
run apart, with the offset of that time. Simulated time 0 is `EPOCH_NS` of the lidar clock. Every stream of random numbers
has its own seed (recording, stream, sweep), so a sweep's noise depends neither on the recording's length nor on the order
in which sweeps are made. Two scenarios with one seed share their noise, so that they can be compared; a salt gives a
recording numbers that no other one has.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Unpack

import numpy as np

from calib_core.errors import SettingsError
from calib_core.presets import find_imu_prior, find_lidar_prior
from calib_core.simulate import imu as imu_module
from calib_core.simulate import lidar as lidar_module
from calib_core.simulate import scenarios
from calib_core.simulate.faults import IDEAL, Drawn, Fault, clock
from calib_core.simulate.faults.draw import Draws, draw, world
from calib_core.simulate.imu import ImuMessages
from calib_core.simulate.layouts import Cloud, encode, first_of_cells, scan_of
from calib_core.simulate.lidar import Sweep
from calib_core.simulate.motion import seconds
from calib_core.simulate.patterns import Spinning
from calib_core.simulate.scenario import Scenario
from calib_core.simulate.sensors import Imu
from calib_core.simulate.truth import Truth
from calib_core.simulate.wishes import Changes
from calib_core.types import FloatArray, IntArray

#: Lidar clock at simulated time 0.
EPOCH_NS = 1_700_000_000_123_456_789
#: The IMU is recorded this long before the first sweep and after the last.
IMU_MARGIN_S = 0.2
STANDARD_GRAVITY_M_S2 = 9.80665
#: Whose points bear times since the header's.
_STAMPED_BY_HEADER = frozenset({"velodyne", "ouster"})
_LIDAR_STREAM, _IMU_STREAM, _FAULT_STREAM, _LATENCY_STREAM, _DRAW_STREAM, _STAMP_STREAM = range(6)


@dataclass(frozen=True, slots=True)
class ImuRecords:
    """IMU messages as published, in the order they arrive.

    stamps_ns: (Q,) IMU clock.   received_ns: (Q,) the recorder's clock, which is the lidar's.
    gyro_rad_s: (Q, 3).   accel: (Q, 3) in the driver's unit.
    """

    stamps_ns: IntArray
    received_ns: IntArray
    gyro_rad_s: FloatArray
    accel: FloatArray


@dataclass(frozen=True)
class Simulation:
    """One scenario with one seed. faults: as drawn.   salt: empty, or what sets its random numbers apart from others'."""

    scenario: Scenario
    seed: int
    faults: Drawn = IDEAL
    salt: str = ""

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise SettingsError(
                f"expected a seed of 0 or more for the simulation, found {self.seed}; give a whole number of 0 or more",
                code="simulate.seed",
            )

    @property
    def n_scans(self) -> int:
        """Sweeps in the recording."""
        return self.scenario.lidar.pattern.count(self.scenario.duration_s)

    def sweep(self, index: int) -> Sweep:
        """Sweep number `index` before the driver rounds it."""
        scenario = self.scenario
        lidar = scenario.lidar if scenario.noise else lidar_module.noise_free(scenario.lidar)
        firings = lidar.pattern.firings(index)
        columns = self._motion.lidar(seconds(firings.column_ns))
        rays = lidar_module.firings_rays(self.faults.lidar.fired(firings), columns, self.home_m)
        rng = self._rng(_LIDAR_STREAM, index)
        return lidar_module.measure(
            lidar, scenario.scene, firings, rays, index, rng, scenario.outliers, self.faults.lidar
        )

    def cloud(self, index: int) -> Cloud:
        """Sweep number `index` as the lidar's driver publishes it."""
        cloud = encode(self.sweep(index), self.scenario.lidar, EPOCH_NS)
        if self.faults.voxel_grid_m:
            cloud = first_of_cells(cloud, self.faults.voxel_grid_m)
        # Points that bear the sensor's own time are as they are, whenever the host gets them.
        if self.scenario.lidar.layout not in _STAMPED_BY_HEADER:
            return cloud
        late_ns = int(self._scans_late_ns[index]) if self.faults.scan_latency_s else 0
        if self.faults.stamp_step_s:
            stamp_ns = cloud.stamp_ns + late_ns
            late_ns += int(clock.ticked_ns(np.array([stamp_ns]), self.faults.stamp_step_s)[0]) - stamp_ns
        return (
            cloud
            if late_ns == 0
            else replace(cloud, stamp_ns=cloud.stamp_ns + late_ns, time_ns=cloud.time_ns + late_ns)
        )

    @cached_property
    def _scans_late_ns(self) -> IntArray:
        """(M,) how late the host stamps each scan."""
        nominal_ns = np.arange(self.n_scans, dtype=np.int64) * round(self.scenario.lidar.pattern.period_s * 1e9)
        return clock.latency_ns(nominal_ns, self.faults.scan_latency_s, self._rng(_STAMP_STREAM, 1))

    def received_ns(self, cloud: Cloud) -> int:
        """When the recorder got the cloud: when the sweep was over and the driver had packed it."""
        latency_s = 0.0015 + 0.0003 * float(self._rng(_LATENCY_STREAM, cloud.index).exponential())
        return cloud.end_ns + round(latency_s * 1e9)

    @cached_property
    def imu_messages(self) -> ImuMessages:
        """What the IMU measured, in the order it is sent."""
        scenario = self.scenario
        imu = scenario.imu if scenario.noise else _silent(scenario)
        instants = imu_module.sample_instants_ns(imu, -IMU_MARGIN_S, scenario.duration_s + IMU_MARGIN_S)
        messages = imu_module.measure(
            imu,
            instants,
            self.faults.imu.readings(self._exact_readings, seconds(instants)),
            (np.asarray(scenario.gyro_bias_rad_s), np.asarray(scenario.accel_bias_m_s2)),
            self._rng(_IMU_STREAM),
        )
        if self.faults.gyro_step_rad_s:
            messages = imu_module.in_steps(messages, self.faults.gyro_step_rad_s)
        if self.faults.stamp_latency_s:
            late_ns = clock.latency_ns(instants, self.faults.stamp_latency_s, self._rng(_STAMP_STREAM))
            messages = imu_module.stamped_late(messages, late_ns)
        if self.faults.stamp_bundles_s:
            late_ns = clock.bundle_ns(instants, self.faults.stamp_bundles_s, self._rng(_STAMP_STREAM))
            messages = imu_module.stamped_late(messages, late_ns)
        if self.faults.imu_repeats > 1:
            messages = imu_module.sent_again(messages, self.faults.imu_repeats)
        return imu_module.spoil(messages, scenario.imu_faults, self._rng(_FAULT_STREAM))

    @cached_property
    def imu_records(self) -> ImuRecords:
        """The same as published."""
        messages, truth = self.imu_messages, self.truth
        in_g = self.scenario.imu.accelerometer_unit == "g"
        latency_s = 0.0008 + 0.0002 * self._rng(_LATENCY_STREAM, 1 << 30).exponential(size=messages.true_ns.shape)
        received = EPOCH_NS + messages.true_ns + np.rint(latency_s * 1e9).astype(np.int64)
        apart_ns = clock.rate_error_ns(messages.true_ns, truth.faults.clock_rate_ppm, truth.middle_ns)
        stamps_ns = EPOCH_NS + messages.true_ns - truth.time_offset_ns - apart_ns + messages.stamp_error_ns
        return ImuRecords(
            clock.ticked_ns(stamps_ns, truth.faults.stamp_step_s) if truth.faults.stamp_step_s else stamps_ns,
            np.maximum.accumulate(received),
            messages.gyro_rad_s,
            messages.accel_m_s2 / STANDARD_GRAVITY_M_S2 if in_g else messages.accel_m_s2,
        )

    @cached_property
    def truth(self) -> Truth:
        """The answer."""
        first = scan_of(self.cloud(0))
        messages = self.imu_messages
        return replace(
            self._motion,
            map_time_ns=first.stamp_ns,
            gyro_bias_rad_s=messages.gyro_bias_rad_s.mean(axis=0),
            accel_bias_m_s2=messages.accel_bias_m_s2.mean(axis=0),
        )

    @cached_property
    def _motion(self) -> Truth:
        """The truth as far as it is known before anything is measured."""
        return Truth(self.scenario, self.seed, EPOCH_NS, EPOCH_NS, np.zeros(3), np.zeros(3), self.faults)

    def _exact_readings(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        return imu_module.exact_readings(self._motion.imu(t_s), self.scenario.gravity_m_s2)

    @cached_property
    def home_m(self) -> FloatArray:
        """(3,) where the lidar is at first."""
        home: FloatArray = self._motion.lidar(np.zeros(1)).p_m[0]
        return home

    def _rng(self, stream: int, index: int = 0) -> np.random.Generator:
        return np.random.Generator(
            np.random.SFC64(np.random.SeedSequence([self.seed, stream, index, *_salted(self.salt)]))
        )


def _salted(salt: str) -> tuple[int, ...]:
    return (zlib.crc32(salt.encode()),) if salt else ()


def _silent(scenario: Scenario) -> Imu:
    return replace(
        scenario.imu,
        gyroscope_noise_density_rad_s_sqrt_hz=0.0,
        accelerometer_noise_density_m_s2_sqrt_hz=0.0,
        gyroscope_random_walk=0.0,
        accelerometer_random_walk=0.0,
    )


def prepare(
    scenario: str | Scenario,
    *,
    seed: int = 0,
    faults: Sequence[Fault] = (),
    salt: str = "",
    **changes: Unpack[Changes],
) -> Simulation:
    """A simulation ready to be run. Raises SettingsError for an unknown name or an impossible wish."""
    chosen = scenarios.named(scenario) if isinstance(scenario, str) else scenario
    changed = chosen.changed(**changes)
    plain = Simulation(changed, seed, salt=salt)
    if not faults:
        return plain
    lidar, imu = changed.lidar, changed.imu
    draws = Draws(
        (seed, _DRAW_STREAM, *_salted(salt)),
        len(lidar.pattern.ring),
        find_imu_prior(imu.topic, imu.frame_id),
        find_lidar_prior(lidar.topic, lidar.frame_id, lidar.layout),
        isinstance(lidar.pattern, Spinning),
    )
    scene, motion = world(changed.scene, changed.motion, faults, draws, plain.home_m)
    return replace(plain, scenario=replace(changed, scene=scene, motion=motion), faults=draw(faults, draws))
