"""What the joint solve estimates, in which order, how a step moves it, and the lidar factors it is handed.

Perturbations in the order of the shared columns: R_imu_lidar Exp(theta), p_imu_lidar, time offset, gravity in the map frame,
gyro and accelerometer bias at nodes every few seconds (linear in between), each plane's normal n + B eta in its own two axes
and its offset, the sensors' own parameters; and per knot the IMU's R Exp(phi), p, v.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numba
import numpy as np

from calib_core.factors.imu import KnotStates
from calib_core.factors.laser_features import LaserFactors
from calib_core.full.joint.sensor_state import SensorState
from calib_core.full.joint.settings import CHAIN
from calib_core.geometry import exp, plane_axes
from calib_core.types import BoolArray, FloatArray, IntArray

CALIBRATION = 7
#: What the seven are: a turn, a shift and a lateness.
ROTATION, TRANSLATION, TIME_OFFSET = slice(0, 3), slice(3, 6), CALIBRATION - 1
GRAVITY = slice(7, 10)
BIAS_START = 10


@dataclass(frozen=True)
class BiasNodes:
    """Where the biases are states: linear interpolation between nodes. node: (L,) left node of each link; fraction: (L,)."""

    times_s: FloatArray
    node: IntArray
    fraction: FloatArray

    @staticmethod
    def spread(knots_s: FloatArray, spacing_s: float | None) -> BiasNodes:
        """Nodes at about the spacing over the knots, in a long recording further apart; a single one where it is None."""
        start, end = float(knots_s[0]), float(knots_s[-1])
        middle = 0.5 * (knots_s[:-1] + knots_s[1:])
        if spacing_s is None or end - start < CHAIN.one_node * spacing_s:
            return BiasNodes(np.array([start]), np.zeros(len(middle), np.int64), np.zeros(len(middle)))
        count = min(int(np.ceil((end - start) / spacing_s)) + 1, CHAIN.most_nodes)
        times = np.linspace(start, end, count)
        node = np.clip(np.searchsorted(times, middle, side="right") - 1, 0, count - 2)
        return BiasNodes(times, node, (middle - times[node]) / (times[node + 1] - times[node]))

    def part(self, first: int, last: int) -> BiasNodes:
        """The same nodes as seen by the links among knots first..last (exclusive)."""
        return BiasNodes(self.times_s, self.node[first : last - 1], self.fraction[first : last - 1])

    def window(self, first: int, last: int) -> tuple[int, int]:
        """The first of the nodes that links first..last (exclusive) touch, and how many in a row these are."""
        if len(self.times_s) == 1 or first >= last:
            return 0, 1
        touched = self.node[first:last]
        start = int(touched.min())
        return start, int(touched.max()) + 2 - start

    def at_links(self, values: FloatArray) -> FloatArray:
        """Bias of every link. values: (N, 3) at the nodes. Returns (L, 3)."""
        if len(self.times_s) == 1:
            return np.repeat(values, len(self.node), axis=0)
        out = np.empty((len(self.node), values.shape[1]))
        _between_nodes(np.ascontiguousarray(values), self.node, self.fraction, out)
        return out

    def from_links(self, values: FloatArray) -> FloatArray:
        """(N, 3) what links (L, 3) pull the nodes by that they have their biases of: the transpose of `at_links`."""
        out = np.zeros((len(self.times_s), 3))
        f = self.fraction[:, None]
        np.add.at(out, self.node, (1 - f) * values)
        if len(out) > 1:
            np.add.at(out, self.node + 1, f * values)
        return out

    def at_knots(self, values: FloatArray) -> FloatArray:
        """Bias at every knot, (L + 1, 3)."""
        links = self.at_links(values)
        return np.vstack([links[:1], 0.5 * (links[1:] + links[:-1]), links[-1:]])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _between_nodes(values: FloatArray, node: IntArray, fraction: FloatArray, out: FloatArray) -> None:
    """Fills out (L, C) with values (N, C) between each link's node (L,) and the next, by its fraction (L,) of the way."""
    for i in range(node.shape[0]):
        k, f = node[i], fraction[i]
        for c in range(values.shape[1]):
            out[i, c] = (1 - f) * values[k, c] + f * values[k + 1, c]


@dataclass(frozen=True)
class Estimate:
    """Everything estimated. gyro_bias, accel_bias: (N, 3) at the nodes. normals: (P, 3), offsets_m: (P,), map frame.

    time_offset_s: between the two clocks' own epochs (small); gravity: (3,) map [m/s2].   sensors: their own
    parameters, N in play, none where they are taken for ideal.   aside_normals: (A, 3), aside_offsets_m: (A,) planes that
    are no part of it, but there: where they meet a wall, points near by may be theirs.
    """

    states: KnotStates
    R_imu_lidar: FloatArray
    p_imu_lidar: FloatArray
    time_offset_s: float
    gravity: FloatArray
    gyro_bias: FloatArray
    accel_bias: FloatArray
    normals: FloatArray
    offsets_m: FloatArray
    sensors: SensorState = SensorState()  # noqa: RUF009  frozen
    aside_normals: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    aside_offsets_m: FloatArray = field(default_factory=lambda: np.zeros(0))

    def moved(self, step: FloatArray, step_shared: FloatArray, layout: Layout) -> Estimate:
        """The estimate after a step: (K, 9) of its knots, (S,) of what is shared, its columns as laid out."""
        s = step_shared
        planes = s[layout.every_plane()].reshape(-1, 3)
        axes = plane_axes(self.normals)
        normals = self.normals + np.einsum("pi,pij->pj", planes[:, :2], axes)
        # Turned and of unit length again, which is of second order in the step; the offset is an unknown of its own.
        length = np.linalg.norm(normals, axis=1)
        # Gravity turns, and its magnitude changes, each by what the step says: a magnitude that is given to a ten-millionth
        # would let no step pass that adds to its square.
        gravity = self.gravity + s[GRAVITY]
        magnitude = float(np.linalg.norm(self.gravity))
        gravity *= (magnitude + float(self.gravity @ s[GRAVITY]) / magnitude) / float(np.linalg.norm(gravity))
        return replace(
            self,
            states=self.states.moved(step),
            R_imu_lidar=self.R_imu_lidar @ exp(s[ROTATION]),
            p_imu_lidar=self.p_imu_lidar + s[TRANSLATION],
            time_offset_s=self.time_offset_s + float(s[TIME_OFFSET]),
            gravity=gravity,
            gyro_bias=self.gyro_bias + s[layout.gyro_bias()].reshape(-1, 3),
            accel_bias=self.accel_bias + s[layout.accel_bias()].reshape(-1, 3),
            normals=normals / length[:, None],
            offsets_m=self.offsets_m + planes[:, 2],
            sensors=self.sensors.moved(s[layout.nuisance()]),
        )

    def seen_from(self, R: FloatArray, p: FloatArray) -> Estimate:
        """The same estimate with another map frame, whose axes and origin lie at R (3, 3), p (3,) of the present one."""
        s = self.states
        states = KnotStates(R.T @ s.R, (s.p - p) @ R, s.v @ R)
        return replace(
            self,
            states=states,
            gravity=self.gravity @ R,
            normals=self.normals @ R,
            offsets_m=self.offsets_m + self.normals @ p,
            sensors=self.sensors.seen_from(R),
            aside_normals=self.aside_normals @ R,
            aside_offsets_m=self.aside_offsets_m + self.aside_normals @ p,
        )


@dataclass(frozen=True)
class Bins:
    """Lidar factors: one a knot and plane. knot: (B,) ascending. plane: (B,). scatter: (B, 5, 5). count: (B,).

    time_offset_s: of their making.
    lasers: what they share with the lidar's own parameters.   laid_out_at: the sensors as they were thought to be then.
    unseen: how many directions no plane sees, of each run of linked knots, and everywhere (unseen_directions.py); () where nobody
    has asked.
    """

    knot: IntArray
    plane: IntArray
    scatter: FloatArray
    count: IntArray
    time_offset_s: float
    lasers: LaserFactors = field(default_factory=LaserFactors.empty)
    laid_out_at: SensorState = SensorState()  # noqa: RUF009  frozen
    unseen: tuple[int, ...] = ()

    def within(self, first: int, last: int) -> Bins:
        """Those of knots first..last (exclusive), counted from the first."""
        mine = self._where((self.knot >= first) & (self.knot < last))
        return replace(mine, knot=mine.knot - first)

    def but_of(self, plane: int) -> Bins:
        """Those of all other planes."""
        return self._where(self.plane != plane)

    def _where(self, mine: BoolArray) -> Bins:
        return replace(
            self,
            knot=self.knot[mine],
            plane=self.plane[mine],
            scatter=self.scatter[mine],
            count=self.count[mine],
            lasers=self.lasers.within(mine, self.plane),
            unseen=(),
        )


def no_bins(time_offset_s: float) -> Bins:
    """No lidar factors at all."""
    none = np.zeros(0, np.int64)
    return Bins(none, none, np.zeros((0, 5, 5)), none, time_offset_s)


@dataclass(frozen=True)
class Layout:
    """Shared columns by name: calibration, gravity, biases, planes, the sensors' own parameters."""

    nodes: int
    planes: int
    nuisances: int = 0

    @property
    def size(self) -> int:
        """Number of shared unknowns."""
        return BIAS_START + 6 * self.nodes + 3 * self.planes + self.nuisances

    def gyro_bias(self) -> slice:
        """Columns of the gyro bias nodes, node by node."""
        return slice(BIAS_START, BIAS_START + 3 * self.nodes)

    def accel_bias(self) -> slice:
        """Columns of the accelerometer bias nodes."""
        return slice(BIAS_START + 3 * self.nodes, BIAS_START + 6 * self.nodes)

    def plane(self, j: int) -> slice:
        """Columns of plane j: two turns and the offset."""
        start = BIAS_START + 6 * self.nodes + 3 * j
        return slice(start, start + 3)

    def every_plane(self) -> slice:
        """Columns of all planes."""
        start = BIAS_START + 6 * self.nodes
        return slice(start, start + 3 * self.planes)

    def with_nodes(self, first: int, width: int) -> IntArray:
        """(C,) all columns, of the biases those of so many nodes from the first one alone."""
        window = 3 * first + np.arange(3 * width)
        rest = np.arange(self.every_plane().start, self.size)
        return np.concatenate(
            [np.arange(BIAS_START), self.gyro_bias().start + window, self.accel_bias().start + window, rest]
        )

    def nuisance(self) -> slice:
        """Columns of the sensors' own parameters, in the order of nuisance.py."""
        return slice(self.size - self.nuisances, self.size)
