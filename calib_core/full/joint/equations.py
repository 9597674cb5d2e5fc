"""The joint problem's normal equations about an estimate, part by part of the chain (solver/system.py).

A part has the links and bins of its knots, and of the shared columns those that they touch. The link into a part's first knot is
another's business but for what it says of that knot; what no knot has a share in, priors above all, is in common to all parts.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from calib_core.factors.assembly import add_links_kernel, links_times_kernel
from calib_core.factors.imu import KNOT, PLACE, TURN, LinkFactors, link_factors
from calib_core.full.joint.lidar_factors import LidarFactors
from calib_core.full.joint.sensors import SensorColumns
from calib_core.full.joint.settings import CHAIN
from calib_core.full.joint.state import CALIBRATION, GRAVITY, ROTATION, TRANSLATION, BiasNodes, Estimate, Layout
from calib_core.full.joint.unseen_directions import Unseen
from calib_core.geometry import hat
from calib_core.imu.preintegration import Links
from calib_core.solver.system import ArrowPart
from calib_core.threads import workers
from calib_core.types import FloatArray


@dataclass(frozen=True, slots=True)
class Datum:
    """What defines the map frame while solving: the lidar's pose at the gauge knot; all of that knot where hold_velocity; or
    frozen planes where planes_hold_frame, and then no knot may.
    """

    gauge_knot: int
    hold_velocity: bool = False
    planes_hold_frame: bool = False

    def hold(self, part: ArrowPart, first: int, estimate: Estimate) -> None:
        """Adds what holds the gauge knot, where it is one of the part's, from `first` on."""
        at, every = self.gauge_knot - first, np.arange(KNOT)
        if not 0 <= at < len(part.diagonal):
            return
        if self.hold_velocity:
            part.diagonal[at, every, every] += CHAIN.gauge
        elif self.planes_hold_frame:
            # Planes that were not all in view leave the chain free to shift: held to a metre, m/s and rad it stays in place.
            part.diagonal[at, every, every] += CHAIN.loose_gauge
        else:
            held = self._frame_held(estimate)
            part.diagonal[at] += held[:KNOT, :KNOT]
            part.border[at, :, :CALIBRATION] += held[:KNOT, KNOT:]
            part.corner[:CALIBRATION, :CALIBRATION] += held[KNOT:, KNOT:]

    def add_times(self, out: FloatArray, estimate: Estimate, shared: FloatArray) -> None:
        """Adds to out (K, 9, m) what `hold` has in the border times columns (S, m)."""
        if not (self.hold_velocity or self.planes_hold_frame):
            out[self.gauge_knot] += self._frame_held(estimate)[:KNOT, KNOT:] @ shared[:CALIBRATION]

    def add_pull(self, shared: FloatArray, estimate: Estimate, along: FloatArray) -> None:
        """Adds to (S,) what `hold` pulls by where the knots have moved by `along` (K, 9)."""
        if not (self.hold_velocity or self.planes_hold_frame):
            shared[:CALIBRATION] += along[self.gauge_knot] @ self._frame_held(estimate)[:KNOT, KNOT:]

    def _frame_held(self, estimate: Estimate) -> FloatArray:
        """The map frame is free to move as a whole: the lidar's pose at the gauge knot stays where it is. (16, 16) of the knot
        and the calibration.

        Not the IMU's: where its axes turn against the lidar, the whole map would have to turn with them, along an arc that a
        step of straight lines leaves by millimetres, and no step would be taken.
        """
        R, R_c, p_c = estimate.states.R[self.gauge_knot], estimate.R_imu_lidar, estimate.p_imu_lidar
        J = np.zeros((6, KNOT + CALIBRATION))
        turned, shifted = J[:3], J[3:]
        turned[:, TURN], turned[:, KNOT:][:, ROTATION] = R_c.T, np.eye(3)
        shifted[:, TURN], shifted[:, PLACE], shifted[:, KNOT:][:, TRANSLATION] = -R @ hat(p_c), np.eye(3), R
        return CHAIN.gauge * J.T @ J


@dataclass(frozen=True)
class JointEquations:
    """As solver/system.py has them. prior: rows of what is known beforehand, residual (R,) and Jacobian (R, S).

    gyro_change, accel_change: (L, 3) of the links' biases since their integration.
    """

    links: Links
    nodes: BiasNodes
    sensors: SensorColumns
    lidar: LidarFactors
    estimate: Estimate
    layout: Layout
    gyro_change: FloatArray
    accel_change: FloatArray
    prior: tuple[FloatArray, FloatArray]
    unseen: Unseen
    datum: Datum
    frozen: tuple[int, ...]

    @property
    def knots(self) -> int:
        """K."""
        return len(self.estimate.states.p)

    @property
    def shared(self) -> int:
        """S."""
        return self.layout.size

    @cached_property
    def _rates(self) -> FloatArray:
        """(K, 3) [rad/s] of the IMU at its knots."""
        return self.lidar.rates(self.estimate)

    def part(self, first: int, last: int) -> ArrowPart:
        """Knots first..last (exclusive)."""
        # With a knot more on either side, for the links to it.
        begin, end = max(first - 1, 0), min(last + 1, self.knots)
        node, width = self.nodes.window(begin, end - 1)
        layout, mine = Layout(width, self.layout.planes, self.layout.nuisances), slice(first - begin, last - begin)
        diagonal, lower = (np.zeros((end - begin, KNOT, KNOT)) for _ in range(2))
        border, gradient = np.zeros((end - begin, KNOT, layout.size)), np.zeros((end - begin, KNOT))
        corner, gradient_shared = np.zeros((layout.size, layout.size)), np.zeros(layout.size)
        f, some = self._links(begin, end), slice(begin, end - 1)
        places = self.sensors.imu_places
        own = np.zeros((len(f.residual), KNOT, len(places)))
        if len(places):
            gyro, accel = self.sensors.of_links(begin, end - 1)
            own = f.r_D_gyro_bias @ gyro + f.r_D_accel_bias @ accel
        add_links_kernel(
            f.r_D_first, f.r_D_second, f.r_D_gravity, f.r_D_gyro_bias, f.r_D_accel_bias, own, f.residual,
            self.nodes.node[some] - node, self.nodes.fraction[some], width, GRAVITY.start,
            layout.nuisance().start + places, first - begin, diagonal, lower[1:], border, corner, gradient, gradient_shared,
        )  # fmt: skip
        part = ArrowPart(
            np.zeros((last - first, KNOT, KNOT)), lower[mine], border[mine], self.layout.with_nodes(node, width),
            corner, np.zeros((last - first, KNOT)), gradient_shared,
        )  # fmt: skip
        self.lidar.add_to(part, first, self.estimate, layout, self._rates)
        part.diagonal += diagonal[mine]
        part.gradient += gradient[mine]
        self.unseen.hold(part, first)
        self.datum.hold(part, first, self.estimate)
        every = np.arange(KNOT)
        part.diagonal[:, every, every] += CHAIN.knot
        return part

    def common(self) -> tuple[FloatArray, FloatArray]:
        """Of the shared unknowns what is no knot's business: priors, lasers among themselves, planes that no point sees."""
        residual, jacobian = self.prior
        corner, gradient_shared = jacobian.T @ jacobian, jacobian.T @ residual
        self.lidar.add_common(corner, gradient_shared, self.estimate, self.layout)
        planes = np.arange(self.layout.every_plane().start, self.layout.every_plane().stop)
        corner[planes, planes] += CHAIN.plane
        self.unseen.hold_level(corner, self.estimate.gravity)
        return corner, gradient_shared

    def pulls(self, along: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """The gradient alone, of the knots (K, 9) and of what is shared (S,), where the knots have moved by `along` (K, 9) and
        factors are linear. What holds knots otherwise pulls at nothing here, and is left out."""
        out, shared = np.zeros((self.knots, KNOT)), self.common()[1]
        edges = [*range(0, self.knots, CHAIN.knots_at_once), self.knots]
        tasks = [workers().submit(self._pull, first, last, along) for first, last in pairwise(edges)]
        for first, task in zip(edges, tasks, strict=False):
            own, theirs = task.result()
            out[first : first + len(own)] += own
            shared += theirs
        if along is not None:
            self.datum.add_pull(shared, self.estimate, along)
        return out, shared

    def _pull(self, first: int, last: int, along: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """Of the links that begin at knots first..last (exclusive), and their bins: as `_times`."""
        end = min(last + 1, self.knots)
        out, shared, some = np.zeros((end - first, KNOT)), np.zeros(self.shared), slice(first, end - 1)
        f, nodes, layout = self._links(first, end), self.nodes.part(first, end), self.layout
        r = f.residual
        if along is not None:
            r = r + _applied(f.r_D_first, along[some]) + _applied(f.r_D_second, along[first + 1 : end])
        gyro, accel = _pulled(f.r_D_gyro_bias, r), _pulled(f.r_D_accel_bias, r)
        shared[GRAVITY] = _pulled(f.r_D_gravity, r).sum(axis=0)
        shared[layout.gyro_bias()] = nodes.from_links(gyro).ravel()
        shared[layout.accel_bias()] = nodes.from_links(accel).ravel()
        places = layout.nuisance().start + self.sensors.imu_places
        if len(places):
            for columns, pull in zip(self.sensors.of_links(first, end - 1), (gyro, accel), strict=True):
                shared[places] += np.einsum("lic,li->c", columns, pull, optimize=True)
        of_lidar = self.lidar.pull(first, last, self.estimate, layout, self._rates, shared, along)
        out[: last - first] = of_lidar
        out[: end - first - 1] += _pulled(f.r_D_first, r)
        out[1:] += _pulled(f.r_D_second, r)
        return out, shared

    def border_times(self, shared: FloatArray) -> FloatArray:
        """(K, n, m) the border times columns (S, m): what factors say of their knots where these columns move."""
        shared = np.ascontiguousarray(shared)
        out = np.zeros((self.knots, KNOT, shared.shape[1]))
        edges = [*range(0, self.knots, CHAIN.knots_at_once), self.knots]
        tasks = [workers().submit(self._times, first, last, shared) for first, last in pairwise(edges)]
        for first, task in zip(edges, tasks, strict=False):
            some = task.result()
            out[first : first + len(some)] += some
        self.datum.add_times(out, self.estimate, shared)
        return out

    def _times(self, first: int, last: int, shared: FloatArray) -> FloatArray:
        """Of the links that begin at knots first..last (exclusive), and their bins: (.., 9, m), a knot more for the last."""
        end, m = min(last + 1, self.knots), shared.shape[1]
        out = np.zeros((end - first, KNOT, m))
        f = self._links(first, end)
        gyro, accel = link_biases(shared, self.layout, self.nodes, self.sensors, (first, end - 1))
        links_times_kernel(
            f.r_D_first, f.r_D_second, f.r_D_gravity, f.r_D_gyro_bias, f.r_D_accel_bias,
            shared[GRAVITY], gyro, accel, out,
        )  # fmt: skip
        self.lidar.add_times(out, first, last, self.estimate, self.layout, self._rates, shared)
        return out

    def _links(self, first: int, last: int) -> LinkFactors:
        """Of the links among knots first..last (exclusive)."""
        some = slice(first, last - 1)
        return link_factors(
            self.links.part(first, last - 1), self.estimate.states.part(first, last), self.estimate.gravity,
            self.gyro_change[some], self.accel_change[some],
        )  # fmt: skip


def link_biases(
    shared: FloatArray, layout: Layout, nodes: BiasNodes, sensors: SensorColumns, links: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """What columns (S, m) of the shared unknowns are as biases of each of the links from one to another (exclusive), gyroscope
    and accelerometer, (.., 3, m) each: those of the nodes beside it, and what the IMU's own parameters act as.
    """
    m, first, last = shared.shape[1], *links
    beside = nodes.part(first, last + 1)
    gyro, accel = (
        beside.at_links(shared[columns].reshape(-1, 3 * m)).reshape(-1, 3, m)
        for columns in (layout.gyro_bias(), layout.accel_bias())
    )
    if len(sensors.imu_places):
        own, (by_gyro, by_accel) = shared[layout.nuisance()][sensors.imu_places], sensors.of_links(first, last)
        gyro, accel = gyro + by_gyro @ own, accel + by_accel @ own
    return gyro, accel


def _applied(J: FloatArray, step: FloatArray) -> FloatArray:
    """J step of each: (F, m, n) and (F, n)."""
    return np.asarray((J @ step[..., None])[..., 0])


def _pulled(J: FloatArray, residual: FloatArray) -> FloatArray:
    """J' residual of each: (F, m, n) and (F, m)."""
    return np.asarray((residual[:, None] @ J)[:, 0])
