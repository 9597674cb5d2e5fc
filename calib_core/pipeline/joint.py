"""The joint problem: knots, calibration, biases, gravity and planes, their factors, and one step of their estimate.

State (perturbations in the order of the shared columns): R_imu_lidar Exp(theta), p_imu_lidar, time offset, gravity in the
map frame, gyro and accelerometer bias at nodes every few seconds (linear in between), each plane's normal n + B eta in its
own two axes and its offset; and per knot the IMU's R Exp(phi), p, v.

Lidar factor of a bin (factors/bins.py) at knot k on plane j, with m = R_k' n:

    n_lidar = R_c' m,    w_lidar = m . p_c + n . p_k + w
    d n_lidar = R_c' hat(m) phi + hat(n_lidar) theta + R_c' R_k' B eta
    d w_lidar = (p_c x m) . phi + n . dp + m . dp_c + (R_k p_c + p_k) . B eta + dw

and a later time offset by delta looks the pose up earlier: phi = -omega delta, dp = -v delta.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.factors.knots import KnotStates, link_factors, link_residuals
from calib_core.geometry import exp, hat, log, plane_axes
from calib_core.imu.links import Links, UpsampledImu
from calib_core.pipeline.motion import Motion
from calib_core.solver.arrow import ArrowSolution, ArrowSystem
from calib_core.types import FloatArray, IntArray

CALIBRATION = 7
GRAVITY = slice(7, 10)
_BIAS_START = 10


@dataclass(frozen=True)
class BiasNodes:
    """Where the biases are states: linear interpolation between nodes. node: (L,) left node of each link; fraction: (L,)."""

    times_s: FloatArray
    node: IntArray
    fraction: FloatArray

    @staticmethod
    def spread(knots_s: FloatArray, spacing_s: float | None) -> BiasNodes:
        """Nodes at about the spacing over the knots; a single one where spacing_s is None."""
        start, end = float(knots_s[0]), float(knots_s[-1])
        middle = 0.5 * (knots_s[:-1] + knots_s[1:])
        if spacing_s is None or end - start < 1.5 * spacing_s:
            return BiasNodes(np.array([start]), np.zeros(len(middle), np.int64), np.zeros(len(middle)))
        count = int(np.ceil((end - start) / spacing_s)) + 1
        times = np.linspace(start, end, count)
        node = np.clip(np.searchsorted(times, middle, side="right") - 1, 0, count - 2)
        return BiasNodes(times, node, (middle - times[node]) / (times[node + 1] - times[node]))

    def part(self, first: int, last: int) -> BiasNodes:
        """The same nodes as seen by the links among knots first..last (exclusive)."""
        return BiasNodes(self.times_s, self.node[first : last - 1], self.fraction[first : last - 1])

    def at_links(self, values: FloatArray) -> FloatArray:
        """Bias of every link. values: (N, 3) at the nodes. Returns (L, 3)."""
        if len(self.times_s) == 1:
            return np.repeat(values, len(self.node), axis=0)
        f = self.fraction[:, None]
        return (1 - f) * values[self.node] + f * values[self.node + 1]

    def at_knots(self, values: FloatArray) -> FloatArray:
        """Bias at every knot, (L + 1, 3)."""
        links = self.at_links(values)
        return np.vstack([links[:1], 0.5 * (links[1:] + links[:-1]), links[-1:]])


@dataclass(frozen=True)
class Estimate:
    """Everything estimated. gyro_bias, accel_bias: (N, 3) at the nodes. normals: (P, 3), offsets_m: (P,), map frame.

    time_offset_s: between the two clocks' own epochs (small); gravity: (3,) map [m/s2].
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


@dataclass(frozen=True)
class Bins:
    """Lidar factors: one a knot and plane. knot, plane: (B,). scatter: (B, 5, 5). count: (B,). time_offset_s: of their making."""

    knot: IntArray
    plane: IntArray
    scatter: FloatArray
    count: IntArray
    time_offset_s: float


def no_bins(time_offset_s: float) -> Bins:
    """No lidar factors at all."""
    none = np.zeros(0, np.int64)
    return Bins(none, none, np.zeros((0, 5, 5)), none, time_offset_s)


@dataclass(frozen=True)
class PriorRow:
    """One Gaussian statement about the shared state: column, value (of the quantity itself), std."""

    column: int
    value: float
    std: float


@dataclass(frozen=True)
class Held:
    """A direction of the calibration that the data do not determine, held where it is said to be.

    vector: (7,) over [turn from R_reference, translation, time offset], SI.   value: of vector . that.   std: small.
    """

    vector: FloatArray
    value: float
    std: float


@dataclass(frozen=True)
class Priors:
    """Statements that are not measurements of this recording.

    R_reference: rotation priors are turns away from it.   gravity_m_s2, gravity_std_m_s2: std 0 fixes the magnitude.
    rows: on calibration columns 0..6.   bias walk densities: per sqrt(s); 0 with a single node.
    """

    R_reference: FloatArray
    rows: tuple[PriorRow, ...]
    gravity_m_s2: float
    gravity_std_m_s2: float
    gyro_bias_std_rad_s: float = 0.2
    accel_bias_std_m_s2: float = 1.0
    gyro_walk: float = 1e-5
    accel_walk: float = 1e-4
    held: tuple[Held, ...] = ()

    def calibration_vector(self, estimate: Estimate) -> FloatArray:
        """(7,): turn from R_reference [rad], translation [m], time offset [s]: what the prior rows speak of."""
        turn = log(self.R_reference.T @ estimate.R_imu_lidar)
        return np.concatenate([turn, estimate.p_imu_lidar, [estimate.time_offset_s]])

    def calibration_information(self) -> FloatArray:
        """(7, 7) that the rows and the held directions add to the calibration's information."""
        total = np.zeros((CALIBRATION, CALIBRATION))
        for row in self.rows:
            total[row.column, row.column] += 1.0 / row.std**2
        for held in self.held:
            total += np.outer(held.vector, held.vector) / held.std**2
        return total


@dataclass(frozen=True)
class Layout:
    """Shared columns by name."""

    nodes: int
    planes: int

    @property
    def size(self) -> int:
        """Number of shared unknowns."""
        return _BIAS_START + 6 * self.nodes + 3 * self.planes

    def gyro_bias(self) -> slice:
        """Columns of the gyro bias nodes, node by node."""
        return slice(_BIAS_START, _BIAS_START + 3 * self.nodes)

    def accel_bias(self) -> slice:
        """Columns of the accelerometer bias nodes."""
        return slice(_BIAS_START + 3 * self.nodes, _BIAS_START + 6 * self.nodes)

    def plane(self, j: int) -> slice:
        """Columns of plane j: two turns and the offset."""
        start = _BIAS_START + 6 * self.nodes + 3 * j
        return slice(start, start + 3)


@dataclass(frozen=True)
class JointProblem:
    """Factors at one linearisation: links about their biases, bins about their time offset.

    gauge_knot: whose pose defines the map frame while solving, its velocity too where hold_velocity.   frozen: shared
    columns held fixed.   planes_hold_frame: frozen planes define the map frame, and no knot may.
    """

    readings: UpsampledImu
    nodes: BiasNodes
    links: Links
    links_gyro_bias: FloatArray
    links_accel_bias: FloatArray
    bins: Bins
    priors: Priors
    gauge_knot: int
    frozen: tuple[int, ...] = ()
    hold_velocity: bool = False
    planes_hold_frame: bool = False

    def layout(self, estimate: Estimate) -> Layout:
        """The shared columns for this number of nodes and planes."""
        return Layout(len(self.nodes.times_s), len(estimate.normals))

    def motion(self, estimate: Estimate) -> Motion:
        """The motion an estimate describes."""
        return Motion(
            self.readings,
            estimate.states,
            self.nodes.at_knots(estimate.gyro_bias),
            self.nodes.at_knots(estimate.accel_bias),
            estimate.gravity,
        )

    def cost(self, estimate: Estimate) -> float:
        """Half the sum of squares of everything."""
        residual = link_residuals(self.links, estimate.states, estimate.gravity, *self._bias_changes(estimate))
        a, _ = self.planes_seen(estimate)
        lidar = np.einsum("bi,bij,bj->", a, self.bins.scatter, a, optimize=True)
        prior, _ = prior_rows(self.priors, self.nodes, estimate, self.layout(estimate))
        return 0.5 * float(np.sum(residual**2) + lidar + np.sum(prior**2))

    def linearise(self, estimate: Estimate) -> ArrowSystem:
        """The normal equations at an estimate."""
        layout = self.layout(estimate)
        system = ArrowSystem.zeros(len(self.readings.knots_s), 9, layout.size)
        self._add_links(system, estimate, layout)
        self._add_bins(system, estimate, layout)
        residual, jacobian = prior_rows(self.priors, self.nodes, estimate, layout)
        system.corner += jacobian.T @ jacobian
        system.gradient_shared += jacobian.T @ residual
        system.cost += 0.5 * float(residual @ residual)
        # The map frame is free to move as a whole: the gauge knot's pose stays where it is. Velocity that nothing
        # constrains (a knot between two silences) stays put as well.
        index = np.arange(9 if self.hold_velocity else 6)
        if self.hold_velocity or not self.planes_hold_frame:
            system.diagonal[self.gauge_knot, index, index] += 1e8
        vel = np.arange(6, 9)
        system.diagonal[:, vel, vel] += 1e-6
        pose = np.arange(6)
        system.diagonal[:, pose, pose] += 1e-6
        planes = np.arange(_BIAS_START + 6 * layout.nodes, layout.size)
        system.corner[planes, planes] += 1e-4  # a plane that no point sees stays where it is
        for column in self.frozen:
            system.border[:, :, column] = 0.0
            system.corner[column, :] = 0.0
            system.corner[:, column] = 0.0
            system.corner[column, column] = 1e12
            system.gradient_shared[column] = 0.0
        return system

    def moved(self, estimate: Estimate, solution: ArrowSolution) -> Estimate:
        """The estimate after a step."""
        s = solution.step_shared
        layout = self.layout(estimate)
        planes = s[layout.plane(0).start :].reshape(-1, 3)
        axes = plane_axes(estimate.normals)
        normals = estimate.normals + np.einsum("pi,pij->pj", planes[:, :2], axes)
        # Turning a normal about the origin and renormalising: the offset follows the same scale.
        length = np.linalg.norm(normals, axis=1)
        return Estimate(
            states=estimate.states.moved(solution.step),
            R_imu_lidar=estimate.R_imu_lidar @ exp(s[0:3]),
            p_imu_lidar=estimate.p_imu_lidar + s[3:6],
            time_offset_s=estimate.time_offset_s + float(s[6]),
            gravity=estimate.gravity + s[GRAVITY],
            gyro_bias=estimate.gyro_bias + s[layout.gyro_bias()].reshape(-1, 3),
            accel_bias=estimate.accel_bias + s[layout.accel_bias()].reshape(-1, 3),
            normals=normals / length[:, None],
            offsets_m=(estimate.offsets_m + planes[:, 2]),
        )

    def _bias_changes(self, estimate: Estimate) -> tuple[FloatArray, FloatArray]:
        return (
            self.nodes.at_links(estimate.gyro_bias) - self.links_gyro_bias,
            self.nodes.at_links(estimate.accel_bias) - self.links_accel_bias,
        )

    def _add_links(self, system: ArrowSystem, estimate: Estimate, layout: Layout) -> None:
        f = link_factors(self.links, estimate.states, estimate.gravity, *self._bias_changes(estimate))
        first_t, second_t = np.swapaxes(f.r_D_first, 1, 2), np.swapaxes(f.r_D_second, 1, 2)
        system.diagonal[:-1] += first_t @ f.r_D_first
        system.diagonal[1:] += second_t @ f.r_D_second
        system.lower += second_t @ f.r_D_first
        r = f.residual[..., None]
        system.gradient[:-1] += (first_t @ r)[..., 0]
        system.gradient[1:] += (second_t @ r)[..., 0]
        system.cost += 0.5 * float(np.sum(f.residual**2))
        nodes = layout.nodes
        columns = 3 + 6 * nodes
        shared = np.zeros((len(f.residual), 9, columns))
        shared[:, :, :3] = f.r_D_gravity
        rows = np.arange(len(f.residual))
        for block, jacobian in ((0, f.r_D_gyro_bias), (1, f.r_D_accel_bias)):
            view = shared[:, :, 3 + 3 * nodes * block : 3 + 3 * nodes * (block + 1)].reshape(-1, 9, nodes, 3)
            view[rows, :, self.nodes.node] += (1 - self.nodes.fraction)[:, None, None] * jacobian
            if nodes > 1:
                view[rows, :, self.nodes.node + 1] += self.nodes.fraction[:, None, None] * jacobian
        place = slice(GRAVITY.start, GRAVITY.start + columns)
        system.border[:-1, :, place] += first_t @ shared
        system.border[1:, :, place] += second_t @ shared
        flat = shared.reshape(-1, columns)
        system.corner[place, place] += flat.T @ flat
        system.gradient_shared[place] += flat.T @ f.residual.ravel()

    def planes_seen(self, estimate: Estimate) -> tuple[FloatArray, dict[str, FloatArray]]:
        """A = [n_lidar, w_lidar, 1] of every bin (B, 5), and what its Jacobian needs."""
        b = self.bins
        delta = estimate.time_offset_s - b.time_offset_s
        omega = (self.readings.knot_gyro - self.nodes.at_knots(estimate.gyro_bias))[b.knot]
        v = estimate.states.v[b.knot]
        R = estimate.states.R[b.knot] @ exp(-omega * delta)
        p = estimate.states.p[b.knot] - v * delta
        n = estimate.normals[b.plane]
        m = np.einsum("bji,bj->bi", R, n)
        a = np.ones((len(n), 5))
        a[:, :3] = m @ estimate.R_imu_lidar
        a[:, 3] = m @ estimate.p_imu_lidar + np.einsum("bi,bi->b", n, p) + estimate.offsets_m[b.plane]
        return a, {"R": R, "p": p, "v": v, "omega": omega, "n": n, "m": m}

    def _add_bins(self, system: ArrowSystem, estimate: Estimate, layout: Layout) -> None:
        b = self.bins
        a, part = self.planes_seen(estimate)
        J = bin_jacobian(a, part, estimate, b.plane, estimate.time_offset_s - b.time_offset_s)
        weighted = b.scatter[:, :4, :4] @ J
        H = np.swapaxes(J, 1, 2) @ weighted
        Ma = (b.scatter @ a[..., None])[..., 0]
        g = np.einsum("bij,bi->bj", J, Ma[:, :4])
        system.cost += 0.5 * float(np.einsum("bi,bi->", a, Ma))
        calibration = slice(0, CALIBRATION)
        for j in range(layout.planes):
            rows = np.flatnonzero(b.plane == j)
            knot, Hj, gj = b.knot[rows], H[rows], g[rows]
            place = layout.plane(j)
            # A bin a knot and plane: no index repeats within one plane.
            system.diagonal[knot] += Hj[:, :9, :9]
            system.border[knot, :, calibration] += Hj[:, :9, 9:16]
            system.border[knot, :, place] += Hj[:, :9, 16:]
            system.gradient[knot] += gj[:, :9]
            total, total_g = Hj.sum(axis=0), gj.sum(axis=0)
            system.corner[calibration, calibration] += total[9:16, 9:16]
            system.corner[calibration, place] += total[9:16, 16:]
            system.corner[place, calibration] += total[16:, 9:16]
            system.corner[place, place] += total[16:, 16:]
            system.gradient_shared[calibration] += total_g[9:16]
            system.gradient_shared[place] += total_g[16:]


def bin_jacobian(
    a: FloatArray, part: dict[str, FloatArray], estimate: Estimate, plane: IntArray, delta_s: float
) -> FloatArray:
    """Jacobian of [n_lidar, w_lidar] of every bin, (B, 4, 19): knot phi p v | theta p_c offset | plane."""
    Rc, pc = estimate.R_imu_lidar, estimate.p_imu_lidar
    R, n, m, omega = part["R"], part["n"], part["m"], part["omega"]
    axes = plane_axes(estimate.normals)[plane]
    J = np.zeros((len(a), 4, 19))
    J[:, :3, 0:3] = Rc.T @ hat(m)
    J[:, 3, 0:3] = np.cross(pc, m)
    J[:, 3, 3:6] = n
    J[:, 3, 6:9] = -delta_s * n
    J[:, :3, 9:12] = hat(a[:, :3])
    J[:, 3, 12:15] = m
    J[:, :3, 15] = -(J[:, :3, 0:3] @ omega[..., None])[..., 0]
    J[:, 3, 15] = -np.einsum("bi,bi->b", J[:, 3, 0:3], omega) - np.einsum("bi,bi->b", n, part["v"])
    # phi turns the knot, the bin sits at Exp(-omega delta) from it.
    J[:, :, 0:3] = J[:, :, 0:3] @ exp(omega * delta_s)
    in_imu = np.einsum("bji,bkj->bik", R, axes)
    J[:, :3, 16:18] = Rc.T @ in_imu
    where = (R @ pc[:, None])[..., 0] + part["p"]
    J[:, 3, 16:18] = np.einsum("bki,bi->bk", axes, where)
    J[:, 3, 18] = 1.0
    return J


def prior_rows(priors: Priors, nodes: BiasNodes, estimate: Estimate, layout: Layout) -> tuple[FloatArray, FloatArray]:
    """Whitened residuals of the priors (M,) and their Jacobian over the shared columns (M, S)."""
    residuals: list[float] = []
    rows: list[FloatArray] = []

    def add(residual: float, columns: list[int], values: FloatArray) -> None:
        row = np.zeros(layout.size)
        row[columns] = values
        residuals.append(residual)
        rows.append(row)

    now = priors.calibration_vector(estimate)
    for row in priors.rows:
        add((float(now[row.column]) - row.value) / row.std, [row.column], np.array([1.0 / row.std]))
    for held in priors.held:
        add((float(held.vector @ now) - held.value) / held.std, list(range(CALIBRATION)), held.vector / held.std)
    magnitude = float(np.linalg.norm(estimate.gravity))
    std = max(priors.gravity_std_m_s2, 1e-7)
    add((magnitude - priors.gravity_m_s2) / std, [7, 8, 9], estimate.gravity / magnitude / std)
    for place, values, initial, walk in (
        (layout.gyro_bias().start, estimate.gyro_bias, priors.gyro_bias_std_rad_s, priors.gyro_walk),
        (layout.accel_bias().start, estimate.accel_bias, priors.accel_bias_std_m_s2, priors.accel_walk),
    ):
        for axis in range(3):
            add(values[0, axis] / initial, [place + axis], np.array([1.0 / initial]))
            for k in range(layout.nodes - 1):
                step_std = max(walk * np.sqrt(nodes.times_s[k + 1] - nodes.times_s[k]), 1e-9)
                columns = [place + 3 * k + axis, place + 3 * (k + 1) + axis]
                add((values[k + 1, axis] - values[k, axis]) / step_std, columns, np.array([-1.0, 1.0]) / step_std)
    return np.array(residuals), np.array(rows)
