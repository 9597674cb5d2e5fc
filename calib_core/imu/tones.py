"""Tones in an IMU's readings: shaking faster than it samples, which comes back as a slow sine that nothing has moved by.

A sensor that is shaken at F hertz and read R times a second without a filter before it reads a sine of |F - k R|: 99 Hz at 100
readings a second is one hertz, in the middle of the hand's own motion, and integrates to millimetres. What shakes it goes with
it (an engine on the rig) or stands in the room (a floor that trembles), so that one tone of frequency f is

    reading(t) = truth(t) + (a + R(t)' c) sin(2 pi f (t - t0)) + (b + R(t)' d) cos(2 pi f (t - t0))

with R the IMU's attitude in the map and a, b, c, d of gyroscope and accelerometer each. Taken out of the readings as it is
thought to be; a later change of it is a change of each link's bias, of its value in the middle of the link (imu/intrinsics.py
does the same with scales and axes).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from calib_core.geometry import exp
from calib_core.imu.preintegration import UpsampledImu
from calib_core.types import FloatArray

#: Of one tone: twelve that go with the IMU (a of gyroscope and accelerometer, then b), twelve that stand in the room (c, d)
#: [rad/s, m/s2], and the change of its frequency [Hz].
PARAMETERS = 25
_IN_ROOM, _FREQUENCY = 12, 24
#: Links whose columns are there at a time.
_AT_ONCE = 4096


@dataclass(frozen=True, slots=True)
class Attitudes:
    """The IMU's: at_knots (K, 3, 3), in_links (L, 3, 3) at the middle of each link, map <- imu.

    knots_s, middles_s: when, after the tones' t0.
    """

    at_knots: FloatArray
    in_links: FloatArray
    knots_s: FloatArray
    middles_s: FloatArray

    def part(self, first: int, last: int) -> Attitudes:
        """Of the links first..last (exclusive)."""
        knots, links = slice(first, last + 1), slice(first, last)
        return Attitudes(self.at_knots[knots], self.in_links[links], self.knots_s[knots], self.middles_s[links])


def attitudes(readings: UpsampledImu, R: FloatArray, zero_s: float) -> Attitudes:
    """Of an IMU that is at R (K, 3, 3) at its knots. zero_s: t0, IMU clock."""
    half = 0.5 * readings.spacing_s * readings.knot_gyro[:-1]
    return Attitudes(R, R[:-1] @ exp(half), readings.knots_s - zero_s, readings.middles_s - zero_s)


def tone_readings(hz: float, values: FloatArray, since_s: FloatArray, R: FloatArray) -> FloatArray:
    """What one tone adds to the readings, (..., 6) [rad/s, m/s2]. values: (25,).   since_s: (...) after t0.   R: (..., 3, 3)."""
    phase = (2.0 * np.pi * (hz + values[_FREQUENCY]) * since_s)[..., None]
    sine, cosine = np.sin(phase), np.cos(phase)
    own = sine * values[:6] + cosine * values[6:12]
    room = sine * values[_IN_ROOM : _IN_ROOM + 6] + cosine * values[_IN_ROOM + 6 : _FREQUENCY]
    for part in (slice(3), slice(3, 6)):
        own[..., part] += (room[..., None, part] @ R)[..., 0, :]
    return np.asarray(own)


def tone_columns(hz: float, values: FloatArray, at: Attitudes) -> FloatArray:
    """(L, 6, 25) derivative of `tone_readings` in the middle of each link."""
    since_s, R = at.middles_s, at.in_links
    phase = 2.0 * np.pi * (hz + values[_FREQUENCY]) * since_s
    columns = np.zeros((len(since_s), 6, PARAMETERS))
    for place, wave in ((0, np.sin(phase)), (6, np.cos(phase))):
        for channel in range(6):
            columns[:, channel, place + channel] = wave
        for part in (0, 3):
            turned = wave[:, None, None] * np.swapaxes(R, 1, 2)
            first = _IN_ROOM + place + part
            columns[:, part : part + 3, first : first + 3] = turned
    # A quarter of a turn on: sine becomes cosine, cosine minus sine.
    slope = np.roll(values[:_FREQUENCY].reshape(2, 2, 6), 1, axis=1) * np.array([-1.0, 1.0])[None, :, None]
    ahead = np.append(slope.ravel(), values[_FREQUENCY])
    columns[:, :, _FREQUENCY] = 2.0 * np.pi * since_s[:, None] * tone_readings(hz, ahead, since_s, R)
    return columns


@dataclass(frozen=True, slots=True)
class ToneColumns:
    """What a unit of each tone's parameters is as a bias of each link: made where they are asked for, as together they would be
    many times as large as all else of a long recording.   hz: T of them.   values: (T, 25).   at: None where there is no tone.
    """

    hz: tuple[float, ...] = ()
    values: FloatArray = field(default_factory=lambda: np.zeros((0, PARAMETERS)))
    at: Attitudes | None = None

    def of_links(self, first: int, last: int) -> FloatArray:
        """(.., 6, 25 T) of the links first..last (exclusive)."""
        if self.at is None or not self.hz:
            return np.zeros((last - first, 6, 0))
        here = self.at.part(first, last)
        return np.concatenate(
            [tone_columns(hz, own, here) for hz, own in zip(self.hz, self.values, strict=True)], axis=2
        )

    def times(self, values: FloatArray) -> FloatArray:
        """What values (25 T,) are as biases, (L, 6)."""
        links = 0 if self.at is None else len(self.at.middles_s)
        parts = [self.of_links(first, min(first + _AT_ONCE, links)) @ values for first in range(0, links, _AT_ONCE)]
        return np.concatenate(parts) if parts else np.zeros((0, 6))


def in_other_room(values: FloatArray, R: FloatArray) -> FloatArray:
    """One tone's values (25,) in a map whose axes are those of R (3, 3) in the present one."""
    turned = values.copy()
    turned[_IN_ROOM:_FREQUENCY] = (values[_IN_ROOM:_FREQUENCY].reshape(4, 3) @ R).ravel()
    return turned


def without_tone(readings: UpsampledImu, hz: float, values: FloatArray, at: Attitudes) -> UpsampledImu:
    """The readings with one tone taken out."""
    zero_s = readings.knots_s[0] - at.knots_s[0]
    in_links = np.broadcast_to(at.in_links[:, None], (*readings.gyro.shape[:2], 3, 3))
    at_points = tone_readings(hz, values, readings.gauss_s - zero_s, in_links)
    at_knots = tone_readings(hz, values, at.knots_s, at.at_knots)
    return replace(
        readings,
        gyro=readings.gyro - at_points[..., :3],
        accel=readings.accel - at_points[..., 3:],
        knot_gyro=readings.knot_gyro - at_knots[:, :3],
        knot_accel=readings.knot_accel - at_knots[:, 3:],
    )
