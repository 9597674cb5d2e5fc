"""Firing patterns: where a lidar looks, and when.

A pattern is given column by column: one instant per column, one delay per channel within the column, all in whole
nanoseconds. Directions are in the lidar frame as the driver publishes it (azimuth = atan2(y, x)).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from calib_core.types import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Firings:
    """One sweep's worth of shots.

    column_ns: (C,) after the simulation's zero.   channel_ns: (K,) after the column's instant.
    directions: (3, C, K) unit.   origin_m: (3, C, K) or None where every ray starts in the lidar's origin.
    """

    column_ns: IntArray
    channel_ns: IntArray
    directions: FloatArray
    origin_m: FloatArray | None = None


class Pattern(Protocol):
    """Where a lidar looks, and when."""

    @property
    def ring(self) -> NDArray[np.uint16]:
        """Ring (line) number of each channel, (K,)."""

    @property
    def period_s(self) -> float:
        """Mean time from one sweep to the next."""

    def firings(self, index: int) -> Firings:
        """Sweep number `index`, from 0."""

    def count(self, duration_s: float) -> int:
        """How many whole sweeps fit into a recording of this length."""


@dataclass(frozen=True, slots=True)
class Spinning:
    """A column of channels on a rotor.

    elevations_deg: per channel in firing order.   azimuths_deg: per channel, added to the rotor's angle.
    channel_ns: delay of each channel within a column.   columns_per_packet: sweeps are cut between packets, after the
    rotor has passed the cut.   clockwise: seen from above.   origin_radius_m: of the optics about the rotor's axis.
    """

    elevations_deg: tuple[float, ...]
    channel_ns: tuple[int, ...]
    column_period_ns: float
    columns_per_packet: int
    azimuths_deg: tuple[float, ...] = (0.0,)
    rate_hz: float = 10.0
    clockwise: bool = True
    cut_deg: float = 180.0
    origin_radius_m: float = 0.0
    start_ns: int = 0

    @property
    def ring(self) -> NDArray[np.uint16]:
        """Channels numbered from the lowest up."""
        return np.argsort(np.argsort(np.asarray(self.elevations_deg), kind="stable")).astype(np.uint16)

    @property
    def period_s(self) -> float:
        """One turn of the rotor."""
        return 1.0 / self.rate_hz

    def _first_column(self, index: int) -> int:
        packet_ns = self.column_period_ns * self.columns_per_packet
        packets = int(np.ceil(index * 1e9 / self.rate_hz / packet_ns - 1e-9))
        return packets * self.columns_per_packet

    def count(self, duration_s: float) -> int:
        """Whole turns within the duration."""
        return int(np.floor(duration_s * self.rate_hz + 1e-9))

    def firings(self, index: int) -> Firings:
        """From the first packet after the rotor passed the cut for the index-th time to the packet before the next."""
        columns = np.arange(self._first_column(index), self._first_column(index + 1), dtype=np.int64)
        column_ns = self.start_ns + np.rint(columns * self.column_period_ns).astype(np.int64)
        channel_ns = np.asarray(self.channel_ns, dtype=np.int64)
        turn = (-1.0 if self.clockwise else 1.0) * 2.0 * np.pi * self.rate_hz * 1e-9
        rotor = np.deg2rad(self.cut_deg) + turn * (column_ns - self.start_ns)
        skew = np.deg2rad(np.broadcast_to(self.azimuths_deg, channel_ns.shape)) + turn * channel_ns
        elevation = np.deg2rad(self.elevations_deg)
        azimuth = np.exp(1j * rotor)[:, None] * np.exp(1j * skew)[None, :]
        level = np.cos(elevation)
        directions = np.stack(
            [azimuth.real * level, azimuth.imag * level, np.broadcast_to(np.sin(elevation), azimuth.shape)]
        )
        origin: FloatArray | None = None
        if self.origin_radius_m:
            bearing = np.broadcast_to(np.exp(1j * rotor)[:, None], azimuth.shape) * self.origin_radius_m
            origin = np.stack([bearing.real, bearing.imag, np.zeros(azimuth.shape)])
        return Firings(column_ns, channel_ns, directions, origin)


@dataclass(frozen=True, slots=True)
class Rosette:
    """A solid-state lidar that looks through two prisms turning against each other: a rosette that never repeats.

    The pattern fills a cone about +x of `half_angle_deg`; `lines` lasers side by side, `line_step_deg` apart.
    """

    half_angle_deg: float
    prism_hz: tuple[float, float]
    lines: int
    line_step_deg: float
    shots_per_s: float
    rate_hz: float = 10.0
    start_ns: int = 0

    @property
    def ring(self) -> NDArray[np.uint16]:
        """Laser numbers."""
        return np.arange(self.lines, dtype=np.uint16)

    @property
    def period_s(self) -> float:
        """One published frame."""
        return 1.0 / self.rate_hz

    def count(self, duration_s: float) -> int:
        """Whole frames within the duration."""
        return int(np.floor(duration_s * self.rate_hz + 1e-9))

    def firings(self, index: int) -> Firings:
        """The frame's stretch of the endless rosette."""
        per_frame = round(self.shots_per_s / self.lines / self.rate_hz)
        columns = index * per_frame + np.arange(per_frame, dtype=np.int64)
        shot_ns = 1e9 / self.shots_per_s
        column_ns = self.start_ns + np.rint(columns * shot_ns * self.lines).astype(np.int64)
        channel_ns = np.rint(np.arange(self.lines) * shot_ns).astype(np.int64)
        t_s = (column_ns[:, None] - self.start_ns + channel_ns[None, :]) * 1e-9
        reach = np.deg2rad(self.half_angle_deg - self.line_step_deg * (self.lines - 1) / 2.0) / 2.0
        first, second = (2.0 * np.pi * hz * t_s for hz in self.prism_hz)
        fan = np.deg2rad(self.line_step_deg) * (np.arange(self.lines) - (self.lines - 1) / 2.0)
        across = reach * (np.cos(first) + np.cos(second))
        up = reach * (np.sin(first) + np.sin(second)) + fan
        off_axis = np.hypot(across, up)
        spread = np.sinc(off_axis / np.pi)
        directions = np.stack([np.cos(off_axis), across * spread, up * spread])
        return Firings(column_ns, channel_ns, directions)
