"""Association and joint solve in rounds, coarse to fine, over as much of the recording as the estimate can carry.

A round lays the current motion under the points (associate), gathers them into factors, preintegrates about the current
biases and descends. The first rounds use the scans that could be tracked by the lidar alone; then the estimate itself
predicts the rest, piece by piece (`extend`): a scan that sees one plane still contributes, one that sees none is
bridged by the IMU. The last rounds use every point within four standard deviations, until nothing moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib_core.errors import Cancelled
from calib_core.factors.lidar_plane import Gate, LidarNoise
from calib_core.factors.support import CELL_M, PlaneExtents, cells_within
from calib_core.full.assess.observability import UNITS, data_information, still_undetermined
from calib_core.full.assess.residuals import iteration_event, moved_in_gate
from calib_core.full.joint.association import Micro, View, associate, gather, measure_noise, survey
from calib_core.full.joint.motion import Motion
from calib_core.full.joint.plane_set import cull, discover
from calib_core.full.joint.priors import Held, Priors
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.propagate import extend
from calib_core.full.joint.state import CALIBRATION, BiasNodes, Bins, Estimate, no_bins
from calib_core.full.run import Context
from calib_core.imu.preintegration import UpsampledImu, preintegrate
from calib_core.solver.arrow import ArrowSolution, NotPositiveDefinite, solve_arrow
from calib_core.solver.levenberg import Minimum, Outcome, minimise
from calib_core.types import BoolArray, FloatArray

#: Points in the coarse rounds and in the survey of the planes' extents, the same ones: in all, but within these bounds a
#: scan. And scans that tell the lidar's noise.
_COARSE = 800_000
_A_SCAN = (800, 4000)
_NOISE_SCANS = 16
#: A coarse round ends where the next step would lower the cost by less than this: a third of a standard deviation.
_COARSE_TOLERANCE = 0.05
#: Points are gated anew where the solve has moved planes by more than this part of a point's own standard deviation:
#: a gate laid about a wrong motion keeps those points that confirm it. Nothing that matters depends on the last of those
#: moves, but whether two starts end at the same cost to a millionth does: a point more or less is a ten-millionth of it.
_SETTLED = 0.3
_UNMOVED = 2e-6
_SETTLING = 12
#: Room in the gates while planes' extents are learnt, and while the motion settles.
_LEARNING_M = 0.02
_SETTLING_M = 0.01
#: What bends the motion hides what bends less: planes are left out in so many turns at the most.
_CULLS = 3
#: Hits nearer to another plane than this are ambiguous, in standard deviations of the range: a point within half of it
#: may be nearer to the wrong plane. And the least and the most of it.
_MARGIN_SIGMAS = 6.0
_MARGINS_M = (0.03, 0.3)


@dataclass(frozen=True)
class Solved:
    """The end of the rounds. map_time_s: of the first used scan, lidar clock. outlines_m: of the planes, in the map."""

    problem: JointProblem
    estimate: Estimate
    minimum: Minimum[Estimate]
    micro: Micro
    lidar_noise: LidarNoise
    extents: PlaneExtents | None
    map_time_s: float
    plane_names: tuple[str, ...]
    outlines_m: tuple[FloatArray | None, ...]
    rounds: int

    @property
    def map_pose(self) -> tuple[FloatArray, FloatArray]:
        """The lidar's pose at the first used scan's time, in the frame of the solve: R (3, 3), p (3,). It defines the map."""
        e = self.estimate
        when = np.array([self.map_time_s - e.time_offset_s])
        pose = self.problem.motion(e).lidar_at(when, e.R_imu_lidar, e.p_imu_lidar)
        return pose.R[0], pose.p[0]


@dataclass
class Rounds:
    """The working state of the rounds.

    readings, nodes: over the whole recording.   first, last: the knots that are estimated so far (last exclusive); the
    estimate's states are theirs.   gauge: the knot that holds the map frame.   positions: scans in play.
    outlines_m: (K, 3) of each plane or None, as given: in the map frame, not in that of the solve, which drifts from it.
    """

    ctx: Context
    readings: UpsampledImu
    nodes: BiasNodes
    priors: Priors
    estimate: Estimate
    first: int
    last: int
    gauge: int
    positions: list[int]
    reference: int
    names: list[str]
    outlines_m: list[FloatArray | None]
    may_add_planes: bool
    may_extend: bool
    lidar_noise: LidarNoise = LidarNoise(0.02, 0.005)  # noqa: RUF009  frozen
    extents: PlaneExtents | None = None
    micro: Micro | None = None
    minimum: Minimum[Estimate] | None = None
    number: int = 0
    _view: View | None = None

    def run(self) -> Solved:
        """Coarse to fine, to the fixed point."""
        within = self.within()
        if within is not None:
            self.extents = PlaneExtents(self.estimate.normals, within)
            self._say_narrow(within)
        # First the motion alone: which directions the data determine is judged before the calibration can wander off
        # along one that they do not.
        self.associate(Gate(extra_m=0.12, margin_m=self.margin_m), stride=self.coarse_stride())
        problem, _ = self.solve_coarse(4, frozen=tuple(range(CALIBRATION)))
        self.hold(problem)
        for extra in (0.12, 0.06):
            self.survey(Gate(extra_m=extra, margin_m=self.margin_m))
            self.associate(Gate(extra_m=extra, margin_m=self.margin_m), stride=self.coarse_stride())
            problem, _ = self.solve_coarse(10)
            self.hold(problem)
        if self.may_extend:
            extend(self)
        if self.may_add_planes and discover(self, self.positions):
            self.survey(Gate(extra_m=0.05, margin_m=self.margin_m))
            self.associate(Gate(extra_m=0.05, margin_m=self.margin_m), stride=self.coarse_stride())
            self.solve_coarse(8)
        if self.may_add_planes:
            cull(self)
        self.settle()
        for _ in range(_CULLS):
            if not (self.may_add_planes and cull(self, settled=True)):
                break
            self.settle()
        gate = Gate(margin_m=self.margin_m)
        for _ in range(_SETTLING):
            self.associate(gate, stride=1)
            before = self.estimate
            problem = self._to_fixed_point()
            if moved_in_gate(problem, before, self.estimate) < _SETTLED:
                break
        assert self.micro is not None
        assert self.minimum is not None
        map_time_s = float(self.ctx.clocks.scan_s[self.reference])
        return Solved(
            problem,
            self.estimate,
            self.minimum,
            self.micro,
            self.lidar_noise,
            self.extents,
            map_time_s,
            tuple(self.names),
            tuple(self.outlines_m),
            self.number,
        )

    def anchor(self) -> None:
        """Lay the map frame on the lidar at the first used scan's time, wherever the estimate has let it drift.

        Planes' cells are counted in the map frame: it must not depend on where the search began.
        """
        self.estimate = self.estimate.seen_from(*self._map_pose())

    def _map_pose(self) -> tuple[FloatArray, FloatArray]:
        """The map frame in that of the solve, by the present estimate: R (3, 3), p (3,)."""
        e = self.estimate
        when = np.array([float(self.ctx.clocks.scan_s[self.reference]) - e.time_offset_s])
        pose = self.motion().lidar_at(when, e.R_imu_lidar, e.p_imu_lidar)
        return pose.R[0], pose.p[0]

    def within(self) -> BoolArray | None:
        """The cells (P, rows, columns) that the given outlines leave to their planes; None where there is no outline."""
        if all(outline_m is None for outline_m in self.outlines_m):
            return None
        # Planes that are held hold the frame too; otherwise it has drifted with the motion, and the outlines with it.
        R, p = self._map_pose() if self.ctx.settings.estimate_planes else (np.eye(3), np.zeros(3))
        here = [None if outline_m is None else outline_m @ R.T + p for outline_m in self.outlines_m]
        return cells_within(self.estimate.normals, here)

    def _say_narrow(self, within: BoolArray) -> None:
        """Name the planes whose outline has no room for a single cell."""
        narrow = [name for name, cells in zip(self.names, within, strict=True) if not cells.any()]
        if narrow:
            self.ctx.say(
                "warning",
                "planes.narrow",
                f"nothing is used of {', '.join(narrow)}: an outline has to be {2 * CELL_M:.1f} m wide at least",
            )

    def settle(self) -> None:
        """With a part of the points, to where planes' extents, noise, gates and motion no longer change one another.

        That place depends on the recording alone, not on the start values: what follows is the same from any start. A cell
        whose own points move the planes just enough to put it out, and in again without them, would swing for ever: it
        stays out.
        """
        cells: list[BoolArray] = []
        for _ in range(_SETTLING):
            if self.ctx.settings.estimate_planes:  # otherwise the frame is that of the planes given
                self.anchor()
            learning = Gate(extra_m=_LEARNING_M, margin_m=self.margin_m)
            if not _swings(cells):
                extents = self.survey(learning)
                cells.append(extents.inside)
                if _swings(cells):
                    self.extents = PlaneExtents(extents.normals, cells[-1] & cells[-2])
            self.measure(learning)
            self.associate(Gate(extra_m=_SETTLING_M, margin_m=self.margin_m), stride=self.coarse_stride())
            before = self.estimate
            problem, _ = self.solve(1)  # what another step would add, the next round's first step does
            if moved_in_gate(problem, before, self.estimate) < _UNMOVED:
                break

    def _to_fixed_point(self) -> JointProblem:
        """Solve, preintegrate about the new biases, solve again, until nothing changes."""
        problem = self.problem()
        for _ in range(self.ctx.settings.max_rounds):
            problem, minimum = self.solve(15)
            if minimum.first_decrease < 1e-3 and minimum.outcome is not Outcome.SINGULAR:
                break
        return problem

    @property
    def margin_m(self) -> float:
        """Hits this near to another plane do not count."""
        return float(np.clip(_MARGIN_SIGMAS * self.lidar_noise.range_std_m, *_MARGINS_M))

    def problem(self, bins: Bins | None = None) -> JointProblem:
        """The joint problem over the knots estimated so far, linked about the present biases."""
        e = self.estimate
        nodes = self.nodes.part(self.first, self.last)
        readings = self.readings.part(self.first, self.last)
        bg, ba = nodes.at_links(e.gyro_bias), nodes.at_links(e.accel_bias)
        links = preintegrate(readings, bg, ba, self.ctx.noise.density)
        lidar = bins if bins is not None else no_bins(e.time_offset_s)
        gauge = self.gauge - self.first
        held = not self.ctx.settings.estimate_planes
        return JointProblem(
            readings, nodes, links, bg, ba, lidar, self.priors, gauge, self._frozen(), planes_hold_frame=held
        )

    def _frozen(self) -> tuple[int, ...]:
        """The shared columns that the settings hold fixed."""
        frozen: list[int] = []
        if not self.ctx.settings.estimate_time_offset:
            frozen.append(6)
        if not self.ctx.settings.estimate_planes:
            start = 10 + 6 * len(self.nodes.times_s)
            frozen.extend(range(start, start + 3 * len(self.estimate.normals)))
        return tuple(frozen)

    def motion(self) -> Motion:
        """The motion that the present estimate describes."""
        e = self.estimate
        nodes = self.nodes.part(self.first, self.last)
        readings = self.readings.part(self.first, self.last)
        return Motion(readings, e.states, nodes.at_knots(e.gyro_bias), nodes.at_knots(e.accel_bias), e.gravity)

    def present_view(self) -> View:
        """The scans under the present estimate; laid out once, however often it is asked for."""
        if self._view is None or self._view.estimate is not self.estimate:
            self._view = self.view(self.motion(), self.estimate)
        return self._view

    def view(self, motion: Motion, estimate: Estimate) -> View:
        ctx = self.ctx
        return View(
            ctx.recording.scans,
            ctx.clocks,
            motion,
            estimate,
            ctx.settings,
            ctx.threads,
        )

    def associate(self, gate: Gate, stride: int) -> None:
        done = [0]

        def count(_: int) -> None:
            done[0] += 1
            if done[0] % 20 == 0:
                self.ctx.stage("associate", done[0] / len(self.positions), f"round {self.number + 1}")

        view = self.present_view()
        self.micro = associate(view, self.positions, self.lidar_noise, gate, self.extents, stride=stride, on_scan=count)

    def survey(self, gate: Gate) -> PlaneExtents:
        """How far each plane reaches."""
        view = self.present_view()
        self.extents = survey(
            view, self.positions, self.lidar_noise, gate, stride=self.coarse_stride(), within=self.within()
        )
        return self.extents

    def learn(self, gate: Gate) -> None:
        """How far each plane reaches and how noisy the lidar is."""
        self.survey(gate)
        self.measure(gate)

    def measure(self, gate: Gate) -> None:
        """How noisy the lidar is, within the extents."""
        view = self.present_view()
        step = max(1, len(self.positions) // _NOISE_SCANS)
        self.lidar_noise = measure_noise(view, self.positions[::step], self.lidar_noise, gate, self.extents)

    def coarse_stride(self) -> int:
        """Every so many-th point is used in the coarse rounds."""
        target = float(np.clip(_COARSE / len(self.positions), *_A_SCAN))
        some = self.positions[:: max(1, len(self.positions) // 20)]
        typical = np.median([len(self.ctx.recording.scans[i].points) for i in some])
        return max(1, int(typical // target))

    def solve_coarse(self, iterations: int, frozen: tuple[int, ...] = ()) -> tuple[JointProblem, Minimum[Estimate]]:
        """A solve that ends where the next step would be of no consequence to the next association."""
        return self.solve(iterations, frozen, _COARSE_TOLERANCE)

    def solve(
        self, iterations: int, frozen: tuple[int, ...] = (), tolerance: float = 1e-6
    ) -> tuple[JointProblem, Minimum[Estimate]]:
        """Preintegrate and gather about the present estimate, then descend. frozen: more shared columns to hold."""
        assert self.micro is not None
        self.number += 1
        problem = self.problem()
        bins = gather(self.micro, problem.motion(self.estimate), self.estimate)
        problem = replace(problem, bins=bins, frozen=problem.frozen + frozen)

        def report(estimate: Estimate, cost: float, solution: ArrowSolution) -> None:
            ctx = self.ctx
            ctx.iterations += 1
            if ctx.should_cancel():
                raise Cancelled("the calibration was cancelled")
            ctx.on_event(iteration_event(ctx, problem, estimate, cost, solution, self.number, self.names))

        self.minimum = minimise(problem, self.estimate, max_iterations=iterations, tolerance=tolerance, on_step=report)
        self.estimate = self.minimum.estimate
        return problem, self.minimum

    def _information(self, problem: JointProblem) -> FloatArray | None:
        """Of the shared unknowns (S, S), from the solve that just ended unless it held more than the settings do."""
        solved = self.minimum.solution if self.minimum is not None else None
        if solved is not None and problem.frozen == self._frozen():
            return solved.information
        try:
            return solve_arrow(replace(problem, frozen=self._frozen()).linearise(self.estimate)).information
        except NotPositiveDefinite:
            return None

    def hold(self, problem: JointProblem) -> None:
        """Hold the directions that the data do not determine: translation at zero, the others where they are.

        What was held is let go only when the data, judged with it held, say clearly more than noise could.
        """
        information = self._information(problem)
        if information is None:
            return
        data = data_information(information, self.priors)
        if not self.ctx.settings.estimate_time_offset:
            data[6, 6] = 1e12
        before = [held.vector * UNITS for held in self.priors.held]
        held = []
        now = self.priors.calibration_vector(self.estimate)
        for direction in still_undetermined(data, before).T:
            vector = direction / UNITS
            only_shift = bool(np.linalg.norm(direction[3:6]) > 0.98)
            held.append(Held(vector, 0.0 if only_shift else float(vector @ now), 0.01))
        self.priors = replace(self.priors, held=tuple(held))


def _swings(cells: Sequence[BoolArray]) -> bool:
    """Whether the surveys have gone to and fro twice. Once may be on the way to rest: noise is still being learnt."""
    if len(cells) < 4:
        return False
    one, other = cells[-2:]
    to_and_fro = np.array_equal(other, cells[-3]) and np.array_equal(one, cells[-4])
    return to_and_fro and not np.array_equal(one, other)
