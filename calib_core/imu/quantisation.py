r"""Readings cut to steps that are coarser than their noise.

What cutting to steps of q leaves is uniform, of variance q^2 / 12, and where noise or motion takes a channel over many steps it
is another one at every reading: white noise. A channel that stays on a step says one and the same wrong number as long as it
does, T seconds: an accelerometer of 5 mg at rest is up to 2.5 mg off, and gravity with it by 0.14 deg. The integral over that
time is off by q T / sqrt(12), which is that of noise of the density

    D^2 = q^2 T / 12,      of which      q^2 period / 12      is in a reading's own noise already.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.imu.preintegration import NoiseDensity, UpsampledImu
from calib_core.types import FloatArray, ImuData

#: judged: a channel's step is looked for among so many readings. Time alone depends on it, once there are hundreds.
_LOOKED_AT = 20_000
#: Readings of a step that differ by round-off do so by less.
_SAME = 0.25


def resolution(values: FloatArray) -> FloatArray:
    """(C,) the smallest step that a channel's readings (Q, C) take; 0 where they never change."""
    out = np.zeros(values.shape[1])
    for channel in range(values.shape[1]):
        steps = np.diff(np.unique(values[:_LOOKED_AT, channel]))
        # Readings of float origin differ by round-off: a true resolution is one that most steps are multiples of.
        if len(steps):
            out[channel] = float(np.min(steps))
    return out


def coarse_density2(stamps_s: FloatArray, imu: ImuData) -> FloatArray:
    """(Q, 6), gyro first: the density, squared, that is beyond a reading's own noise as a channel stays on its step.

    stamps_s: (Q,) of the readings.
    """
    values = np.hstack([imu.gyro_rad_s, imu.accel_m_s2])
    out = np.zeros(values.shape)
    for channel, q in enumerate(resolution(values).tolist()):
        moves = np.abs(np.diff(values[:, channel])) > _SAME * q
        begins = np.flatnonzero(np.append(True, moves))
        last = np.append(begins[1:], len(values)) - 1
        beyond_one_s = stamps_s[last] - stamps_s[begins]
        out[:, channel] = np.repeat(q**2 / 12.0 * beyond_one_s, last - begins + 1)
    return out


def allowed_for_steps(up: UpsampledImu, stamps_s: FloatArray, density2: FloatArray) -> UpsampledImu:
    """The links with that, the mean of those of their readings. density2: (Q, 6) of `coarse_density2`."""
    links = len(up.excess_density2)
    link = np.searchsorted(up.knots_s, stamps_s, side="right") - 1
    mine = (link >= 0) & (link < links)
    count = np.maximum(np.bincount(link[mine], minlength=links), 1)
    added = [np.bincount(link[mine], channel, minlength=links) / count for channel in density2[mine].T]
    return replace(up, excess_density2=up.excess_density2 + np.stack(added, axis=1))


def coarse_text(stamps_s: FloatArray, imu: ImuData, noise: NoiseDensity) -> str:
    """To a person: which sensor's steps are coarser than its noise, and what to do; "" for none."""
    added = np.sqrt(coarse_density2(stamps_s, imu).mean(axis=0))
    own = np.concatenate([noise.gyro_rad_s_sqrt_hz, noise.accel_m_s2_sqrt_hz])
    step, beyond = resolution(np.hstack([imu.gyro_rad_s, imu.accel_m_s2])), added > own
    said = [
        f"the {sensor}'s readings come in steps of {size:.2g} {unit}"
        for sensor, unit, size, coarse in (
            ("gyroscope", "deg/s", float(np.degrees(step[:3].max())), beyond[:3].any()),
            ("accelerometer", "m/s²", float(step[3:].max()), beyond[3:].any()),
        )
        if coarse
    ]
    if not said:
        return ""
    return (
        f"{' and '.join(said)}, and stay on one for longer than noise would let them: what lies between is not measured, and the "
        "error bars count it; choose a smaller range in the IMU's driver"
    )
