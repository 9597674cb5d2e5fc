"""The IMU with its own parameters as Kalibr's imu.yaml, model `scale-misalignment`, or `scale-misalignment-size-effect`.

Kalibr predicts readings as M a + bias of the accelerometer and M C_gyro_i w + A C_gyro_i a + bias of the gyroscope, M lower
triangular, in the frame that the accelerometer defines (IccSensors.py, IccScaledMisalignedImu). That is ours word for word:
M = I + S + N of each, C_gyro_i = Exp(r), and A C_gyro_i = F, what the gyroscope feels of forces. Where accelerometers turned out
to be apart, rx_i, ry_i and rz_i are where they are, about the same middle as the extrinsic's; Kalibr's own have the x axis' at
zero (IccScaledMisalignedSizeEffectImu). Kalibr adds `time_offset` to an
IMU's stamps to have them in the clock of reference, which here is the lidar's.
"""

from __future__ import annotations

import json

import numpy as np

from calib_core.errors import InputError
from calib_core.exporters.extrinsic import (
    FOUND_BESIDE,
    Extrinsic,
    decimal,
    decimals,
    exact_seconds,
    extrinsic_of,
    printable,
)
from calib_core.intrinsics import NAMES, Block
from calib_core.result import CalibrationResult
from calib_core.settings import ImuNoise
from calib_core.types import FloatArray

_BLOCKS: tuple[Block, ...] = (
    "gyroscope_scale",
    "gyroscope_axes",
    "gyroscope_rotation",
    "accelerometer_scale",
    "accelerometer_axes",
    "g_sensitivity",
)


def kalibr_imu(result: CalibrationResult) -> str:
    """A block `imu0`. Raises InputError where the result says nothing of the IMU."""
    recording = result.provenance.recording
    noise, rate_hz = result.imu_noise, recording.imu_rate_hz
    if noise is None or rate_hz is None or not any(each.block in _BLOCKS for each in result.intrinsics):
        raise InputError(
            f"Expected the IMU's own parameters to export, but the result of {recording.name} (status `{result.status}`) "
            "holds none; calibrate again with `--intrinsics auto`.",
            code="export.no_imu",
        )
    scale_gyro, axes_gyro, turn, scale_accel, axes_accel, felt = (_values(result, block) for block in _BLOCKS)
    extrinsic, C_gyro_i = extrinsic_of(result), _rotation(turn)
    apart = [each.value for each in result.intrinsics if each.block == "size_effect"]
    places = [f"    r{axis}_i: [{decimals(r)}]\n" for axis, r in zip("xyz", np.reshape(apart, (-1, 3)), strict=False)]
    return (
        extrinsic.hash_comments(*_remarks(result))
        + "imu0:\n"
        + _matrix("  T_i_b", np.eye(4))
        + _noise(noise)
        + "  accelerometers:\n"
        + _matrix("    M", _lower(scale_accel, axes_accel))
        + "".join(places)
        + "  gyroscopes:\n"
        + _matrix("    M", _lower(scale_gyro, axes_gyro))
        + _matrix("    A", felt.reshape(3, 3) @ C_gyro_i.T)
        + _matrix("    C_gyro_i", C_gyro_i)
        + f"  model: scale-misalignment{'-size-effect' if places else ''}\n"
        + f"  rostopic: {json.dumps(printable(recording.imu_topic))}\n"
        + _time(extrinsic)
        + f"  update_rate: {decimal(rate_hz)}\n"
    )


def _values(result: CalibrationResult, block: Block) -> FloatArray:
    """A block's values; zeros where it was not in play."""
    found = {each.name: each.value for each in result.intrinsics if each.block == block}
    return np.array([found.get(name, 0.0) for name in NAMES[block]])


def _lower(scale: FloatArray, axes: FloatArray) -> FloatArray:
    """(3, 3) I + S + N.   scale: (3,) of x, y, z.   axes: (3,) yx, zx, zy."""
    M = np.diag(1.0 + scale)
    M[1, 0], M[2, 0], M[2, 1] = axes
    return M


def _rotation(turn: FloatArray) -> FloatArray:
    """(3, 3) Exp of a rotation vector (3,)."""
    x, y, z = turn
    angle = float(np.linalg.norm(turn))
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # sin(a)/a and (1 - cos(a))/a^2, the latter by the half angle: both finite at 0.
    first, half = np.sinc(angle / np.pi), np.sinc(angle / (2.0 * np.pi))
    return np.asarray(np.eye(3) + first * cross + 0.5 * half**2 * cross @ cross)


def _matrix(key: str, rows: FloatArray) -> str:
    indent = " " * (len(key) - len(key.lstrip()))
    return f"{key}:\n" + "".join(f"{indent}- [{decimals(row)}]\n" for row in rows)


def _noise(noise: ImuNoise) -> str:
    return (
        f"  accelerometer_noise_density: {decimal(noise.accelerometer_noise_density_m_s2_sqrt_hz)}\n"
        f"  accelerometer_random_walk: {decimal(noise.accelerometer_random_walk)}\n"
        f"  gyroscope_noise_density: {decimal(noise.gyroscope_noise_density_rad_s_sqrt_hz)}\n"
        f"  gyroscope_random_walk: {decimal(noise.gyroscope_random_walk)}\n"
    )


def _time(extrinsic: Extrinsic) -> str:
    return f"  time_offset: {exact_seconds(extrinsic.time_offset_ns)}\n"


def _remarks(result: CalibrationResult) -> list[str]:
    here = [each for each in result.intrinsics if each.block in _BLOCKS]
    ideal = [block for block in _BLOCKS if block not in {each.block for each in here}]
    delays_ms = [each.value * 1e3 for each in result.intrinsics if each.block == "accelerometer_delay"]
    formula = (
        "Readings: accelerometer M a + bias, gyroscope M C_gyro_i w + A C_gyro_i a + bias; the accelerometer's axes "
        "are the frame."
    )
    time = "time_offset is added to the IMU's stamps and gives the lidar's clock; write it in one place only."
    lines = [formula, time]
    lines += [f"Taken for ideal and not estimated: {', '.join(ideal)}."] if ideal else []
    lines += [
        f"The accelerometer is {abs(ms):.3f} ms {'behind' if ms > 0 else 'ahead of'} the gyroscope; Kalibr has no key for it."
        for ms in delays_ms
    ]
    bends = np.array([each.value for each in result.intrinsics if each.block == "accelerometer_quadratic"])
    if bends.any():
        lines.append(
            f"Of squared accelerations [{decimals(bends)}] 1/(m/s²) are read too much; Kalibr has no key for it."
        )
    for block, what, unit in (("low_pass_spread", "spread", "s²"), ("low_pass_skew", "skew", "s³")):
        values = np.array([each.value for each in result.intrinsics if each.block == block])
        if values.any():
            of_both = f"gyroscope's and accelerometer's low-pass filters have a {what} of [{decimals(values)}] {unit}"
            lines.append(f"The {of_both}; Kalibr has no key for it.")
    if any(each.state == "considered" for each in here):
        lines.append(FOUND_BESIDE)
    return lines
