"""Readings of an IMU: exact specific force and angular rate at the sample instants, then noise, bias and faults.

f = R_world_imu^T (a - g) + b_f + noise,     w = w_imu + b_w + noise,     g = (0, 0, -g) in the world.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_core.simulate.motion import Kinematics
from calib_core.simulate.sensors import Imu, ImuFaults
from calib_core.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class ImuMessages:
    """Readings in the order they are sent.

    true_ns: (Q,) when each was taken, lidar clock after the simulation's zero.   stamp_error_ns: (Q,) of its stamp.
    gyro_rad_s, accel_m_s2: (Q, 3).   gyro_bias_rad_s, accel_bias_m_s2: (Q, 3), what of it is bias.
    """

    true_ns: IntArray
    stamp_error_ns: IntArray
    gyro_rad_s: FloatArray
    accel_m_s2: FloatArray
    gyro_bias_rad_s: FloatArray
    accel_bias_m_s2: FloatArray

    def take(self, order: IntArray) -> ImuMessages:
        """The messages at these indices, in this order."""
        return ImuMessages(
            self.true_ns[order],
            self.stamp_error_ns[order],
            self.gyro_rad_s[order],
            self.accel_m_s2[order],
            self.gyro_bias_rad_s[order],
            self.accel_bias_m_s2[order],
        )


def sample_instants_ns(imu: Imu, start_s: float, end_s: float) -> IntArray:
    """Instants of all samples in [start, end], whole nanoseconds after the simulation's zero."""
    first = int(np.ceil((start_s - imu.phase_s) * imu.rate_hz))
    last = int(np.floor((end_s - imu.phase_s) * imu.rate_hz))
    instants = (np.arange(first, last + 1) / imu.rate_hz + imu.phase_s) * 1e9
    return np.rint(instants).astype(np.int64)


def exact_readings(imu_motion: Kinematics, gravity_m_s2: float) -> tuple[FloatArray, FloatArray]:
    """Angular rate and specific force, (Q, 3) each, IMU axes."""
    pull = imu_motion.a_m_s2 + np.array([0.0, 0.0, gravity_m_s2])
    return imu_motion.omega_rad_s, np.einsum("nji,nj->ni", imu_motion.R_world, pull)


def measure(
    imu: Imu,
    instants_ns: IntArray,
    readings: tuple[FloatArray, FloatArray],
    biases: tuple[FloatArray, FloatArray],
    rng: np.random.Generator,
) -> ImuMessages:
    """Readings with white noise of density x sqrt(rate) and biases that walk.

    readings: angular rate and specific force without either, (Q, 3) each.
    biases: of gyroscope and accelerometer at the first sample, (3,) each.
    """
    gyro, accel = readings
    n = instants_ns.shape[0]
    white = rng.standard_normal((2, n, 3))
    steps = rng.standard_normal((2, n, 3)) / np.sqrt(imu.rate_hz)
    walk = np.cumsum(steps, axis=1) - steps[:, :1]
    gyro_bias = biases[0] + imu.gyroscope_random_walk * walk[0]
    accel_bias = biases[1] + imu.accelerometer_random_walk * walk[1]
    return ImuMessages(
        instants_ns,
        np.zeros(n, dtype=np.int64),
        gyro + gyro_bias + imu.gyroscope_std_rad_s * white[0],
        accel + accel_bias + imu.accelerometer_std_m_s2 * white[1],
        gyro_bias,
        accel_bias,
    )


def _some(rng: np.random.Generator, n: int, fraction: float) -> BoolArray:
    return np.less(rng.random(n), fraction)


def spoil(messages: ImuMessages, faults: ImuFaults, rng: np.random.Generator) -> ImuMessages:
    """The messages after gaps, losses, jitter, duplicates and swaps, in the order they are sent."""
    n = messages.true_ns.shape[0]
    jitter = rng.uniform(-faults.jitter_s, faults.jitter_s, n)
    missing, twice, late = (_some(rng, n, part) for part in (faults.missing, faults.duplicated, faults.swapped))
    kept = ~missing
    t_s = messages.true_ns * 1e-9
    for start, length in faults.gaps_s:
        kept &= (t_s < start) | (t_s >= start + length)
    rank = np.arange(n, dtype=np.float64) + np.where(late, 1.5, 0.0)
    order = np.flatnonzero(kept)
    order = np.repeat(order, np.where(twice[order], 2, 1))
    order = order[np.argsort(rank[order], kind="stable")]
    spoiled = ImuMessages(
        messages.true_ns,
        messages.stamp_error_ns + np.rint(jitter * 1e9).astype(np.int64),
        messages.gyro_rad_s,
        messages.accel_m_s2,
        messages.gyro_bias_rad_s,
        messages.accel_bias_m_s2,
    )
    return spoiled.take(order)


def stamped_late(messages: ImuMessages, error_ns: IntArray) -> ImuMessages:
    """The messages with stamps that are off by this much more. error_ns: (Q,)."""
    return replace(messages, stamp_error_ns=messages.stamp_error_ns + error_ns)


def in_steps(messages: ImuMessages, step_rad_s: float) -> ImuMessages:
    """The messages of a gyroscope that tells whole steps, the nearest."""
    return replace(messages, gyro_rad_s=np.rint(messages.gyro_rad_s / step_rad_s) * step_rad_s)


def sent_again(messages: ImuMessages, times: int) -> ImuMessages:
    """The messages of a driver that sends what the sensor reads so many times before it asks for the next."""
    read = np.arange(len(messages.true_ns)) // times * times
    return replace(messages, gyro_rad_s=messages.gyro_rad_s[read], accel_m_s2=messages.accel_m_s2[read])
