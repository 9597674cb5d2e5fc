"""The estimate carried by the IMU over the rest of the recording, plane by plane as they come and go.

Piece by piece: predict the knots, gate the points of each plane by how far the motion may have strayed along its normal
(pipeline/drift.py), solve the last second jointly. A scan that sees one plane is corrected along that plane; one that sees
none is bridged. A plane that comes back after the motion has strayed too far for a gate is known again by its normal: the
gyroscope keeps directions long after positions are lost. The whole is solved again each time its span has doubled, and
where a lost plane came back.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from calib_core.factors.imu import KnotStates
from calib_core.factors.lidar_plane import Gate, collapse, find_hits, select
from calib_core.factors.support import CELL_M, HALF_CELLS, PlaneExtents, reach_around
from calib_core.full.joint.association import Micro, associate, gather
from calib_core.full.joint.drift import Drift
from calib_core.full.joint.plane_set import discover
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.state import Estimate, no_bins
from calib_core.geometry import exp, plane_axes
from calib_core.imu.preintegration import Links, UpsampledImu, preintegrate
from calib_core.planes.segment import SegmentSettings, segment_planes
from calib_core.solver.levenberg import minimise
from calib_core.types import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from calib_core.full.joint.schedule import Rounds

_UPPER_CENTRE = np.array([3, 7, 10])  # of a packed scatter: sum w x, and sum w
_UPPER_44 = 12
_CHUNK_S = 0.3
_WINDOW_S = 1.2
#: A gate wider than this could take clutter for the plane: the plane then has to be known again by its normal.
_WIDEST_GATE_M = 0.2
_GATE_M = 0.05
#: With no plane in view for so long, even directions are lost.
_BLIND_LIMIT_S = 40.0
_FEWEST_POINTS = 20
#: A plane may go on so far beyond what was seen of it.
_JOIN_ON_M = 0.6
#: A carried scan is looked at anew for planes where the known ones explain less than this share of what they did at first.
_EXPLAINED = 0.6
_FRESH_LOOK_S = 1.5
#: The whole is solved again when so many times as much of it is carried; at its end even for a little more.
_DOUBLED = 2.0
_LITTLE_MORE = 1.05


def extend(rounds: Rounds) -> None:
    """Carry the estimate to the recording's end."""
    total = len(rounds.readings.knots_s)
    if rounds.last < total:
        Carrier(rounds).run(total)


class Carrier:
    """The state of the carrying: how far the motion may have strayed, and at which knot each plane was last in view."""

    def __init__(self, rounds: Rounds) -> None:
        self.rounds = rounds
        self.spacing_s = rounds.readings.spacing_s
        self.seen_at = np.full(len(rounds.estimate.normals), rounds.last)
        self.drift = self._new_drift()
        self.solved_span = rounds.last - rounds.first
        self.within: BoolArray | None = None
        self.reach = self._new_reach()
        self.share_at_first = 0.0
        self.looked_at = rounds.last

    def run(self, total: int) -> None:
        """All pieces."""
        r = self.rounds
        chunk = max(2, round(_CHUNK_S / self.spacing_s))
        while r.last < total:
            end = min(r.last + chunk, total)
            if total - end < chunk // 2:
                end = total
            before = self.seen_at.copy()
            share = self._extend_to(end)
            self._take_scans()
            r.ctx.stage("associate", r.last / total, "carrying the estimate through the recording")
            blind_s = (r.last - self.seen_at.max()) * self.spacing_s
            if blind_s > _BLIND_LIMIT_S:
                break
            came_back = (self.seen_at == r.last) & (r.last - before > 1.5 / self.spacing_s)
            if self._should_look_again(share):
                self.looked_at = r.last
                self._look_again()
            grown = (r.last - r.first) / self.solved_span
            if came_back.any() or grown >= _DOUBLED or (r.last == total and grown > _LITTLE_MORE):
                self._solve_all()
        self._let_go()

    def _solve_all(self) -> None:
        r = self.rounds
        self.solved_span = r.last - r.first
        for extra in (2 * _GATE_M, _GATE_M) if self.drift.farthest_m() > _GATE_M else (_GATE_M,):
            # A plane goes on for ever, the floor under things does not: what merely lies near it pulls the motion.
            r.survey(Gate(extra_m=extra, margin_m=r.margin_m))
            r.associate(Gate(extra_m=extra, margin_m=r.margin_m), stride=r.coarse_stride())
            problem, _ = r.solve_coarse(6)
            r.hold(problem)
        self.drift = self._new_drift()
        self.reach = self._new_reach()

    def _new_reach(self) -> PlaneExtents:
        """After a solve of the whole: the cells of the planes seen so far, and what may join on to them."""
        r = self.rounds
        reach = reach_around(r.survey(Gate(extra_m=_GATE_M, margin_m=r.margin_m)), _JOIN_ON_M)
        self.within = r.within()
        if self.within is not None:
            reach.inside[~self.within] = False
        return reach

    def _spread(self, micro: Micro, window: Estimate, problem: JointProblem) -> None:
        """Let the planes reach on from where their points lie now. micro: of the fresh scans."""
        poses = problem.motion(window).lidar_at(
            micro.time_s - window.time_offset_s, window.R_imu_lidar, window.p_imu_lidar
        )
        weight = np.maximum(micro.scatter[:, _UPPER_44], 1e-30)
        centre = micro.scatter[:, _UPPER_CENTRE] / weight[:, None]
        there = (poses.R @ centre[..., None])[..., 0] + poses.p
        axes = plane_axes(self.reach.normals)[micro.plane]
        cell = np.floor(np.einsum("bai,bi->ba", axes, there) / CELL_M).astype(np.int64) + HALF_CELLS
        cells = round(_JOIN_ON_M / CELL_M)
        for plane, (row, column) in zip(micro.plane, cell, strict=True):
            self.reach.inside[
                plane, max(row - cells, 0) : row + cells + 1, max(column - cells, 0) : column + cells + 1
            ] = True
        if self.within is not None:
            self.reach.inside[~self.within] = False

    def _new_drift(self) -> Drift:
        """After a solve of the whole: what its information leaves open of the acceleration at the last knot.

        The error of R (f - b) + g: bias and gravity, which a motion without turning cannot tell apart.
        """
        r = self.rounds
        noise = float(r.ctx.noise.density.accel_m_s2_sqrt_hz.max())
        cov = np.eye(3) * 0.1**2
        solution = r.minimum.solution if r.minimum is not None else None
        if solution is not None:
            node = int(r.nodes.node[min(r.last, len(r.nodes.node)) - 1])
            start = 10 + 3 * len(r.nodes.times_s) + 3 * node
            every = np.linalg.pinv(solution.information, rcond=1e-15, hermitian=True)
            pick = np.r_[start : start + 3, 7:10]
            J = np.hstack([-r.estimate.states.R[-1], np.eye(3)])
            # Never below what a wrong scale or axis of a good sensor would make of gravity itself.
            cov = J @ every[np.ix_(pick, pick)] @ J.T + np.eye(3) * 0.005**2
        return Drift(cov, noise)

    def _take_scans(self) -> None:
        """The scans that the knots now reach join those in play."""
        r = self.rounds
        now = r.readings.knots_s[r.last - 1] + r.estimate.time_offset_s
        ends = r.ctx.clocks.scan_s + 0.5 * r.ctx.clocks.sweep_s
        newest = max(r.positions)
        r.positions += [int(i) for i in np.flatnonzero(ends < now) if i > newest]

    def _should_look_again(self, share: float) -> bool:
        self.share_at_first = max(self.share_at_first, share)
        waited_s = (self.rounds.last - self.looked_at) * self.spacing_s
        steady = self.drift.farthest_m() < _GATE_M
        return share < _EXPLAINED * self.share_at_first and waited_s > _FRESH_LOOK_S and steady

    def _look_again(self) -> None:
        """Planes that have come into view lately."""
        r = self.rounds
        recent = max(5, round(_FRESH_LOOK_S / max(float(np.median(np.diff(r.ctx.clocks.scan_s))), 1e-3)))
        if r.may_add_planes and discover(r, r.positions[-recent:]):
            added = len(r.estimate.normals) - len(self.seen_at)
            self.seen_at = np.append(self.seen_at, np.full(added, r.last))
            self.reach = self._new_reach()

    def _let_go(self) -> None:
        """Cut off what was carried on after the last plane went out of sight for good."""
        r = self.rounds
        keep = min(int(self.seen_at.max()) + round(0.5 / self.spacing_s), r.last)
        if (r.last - keep) * self.spacing_s < _WINDOW_S:
            return
        now_s = r.readings.knots_s[keep - 1] + r.estimate.time_offset_s
        r.ctx.say(
            "warning",
            "planes.lost",
            f"the planes went out of sight {now_s:.0f} s after the first scan and were not seen again: what follows is not used",
        )
        r.last = keep
        r.estimate = replace(r.estimate, states=r.estimate.states.part(0, keep - r.first))
        ends = r.ctx.clocks.scan_s + 0.5 * r.ctx.clocks.sweep_s
        r.positions = [i for i in r.positions if ends[i] < now_s]

    def _extend_to(self, end: int) -> float:
        """Predict the knots up to `end`, then let the points there correct them. The share of points on known planes."""
        r = self.rounds
        self.drift.wait((end - r.last) * self.spacing_s)
        window, problem, start = self._window(r.last - round(_WINDOW_S / self.spacing_s), end)
        normals = window.normals
        fresh_s = float(r.readings.knots_s[r.last - 1] + window.time_offset_s)
        straying = self.drift.along(normals)
        lost = 3.0 * straying + _GATE_M > _WIDEST_GATE_M
        inside = self._scans_over(problem, window)
        known_again = self._know_again(problem, window, [i for i in inside if i > max(r.positions)], lost, straying)
        if known_again is not None:
            back_to = int(self.seen_at[np.unique(known_again.plane)].min())
            window, problem, start = self._window(back_to - round(_WINDOW_S / self.spacing_s), end)
            problem = replace(problem, bins=gather(known_again, problem.motion(window), window))
            window = minimise(problem, window, max_iterations=10, tolerance=1e-3).estimate
            self.drift.see(normals[np.unique(known_again.plane)])
            straying = self.drift.along(normals)
        count: FloatArray = np.zeros(len(normals))
        returns = 1
        settled: Micro | None = None
        for extra in (_GATE_M, 0.8 * _GATE_M):
            gates = np.where(3.0 * straying + _GATE_M > _WIDEST_GATE_M, -1.0, extra + 3.0 * straying)
            view = r.view(problem.motion(window), window)
            gate = Gate(extra_m=extra, margin_m=r.margin_m, extra_of_plane_m=gates)
            micro = associate(view, inside, r.lidar_noise, gate, self.reach, stride=r.coarse_stride())
            if len(micro.count) == 0:
                break
            problem = replace(problem, bins=gather(micro, problem.motion(window), window))
            window = minimise(problem, window, max_iterations=6, tolerance=1e-3).estimate
            fresh = micro.time_s > fresh_s
            count = np.bincount(micro.plane[fresh], micro.count[fresh], len(normals)).astype(np.float64)
            returns = sum(
                len(r.ctx.recording.scans[i].points) for i in inside if r.ctx.clocks.scan_s[i] > fresh_s - 0.05
            )
            self.drift.see(normals[count > _FEWEST_POINTS])
            straying = self.drift.along(normals)
            settled = micro.part(fresh & (count > _FEWEST_POINTS)[micro.plane])
        if settled is not None:
            self._spread(settled, window, problem)
        keep = r.estimate.states.part(0, start - r.first)
        r.estimate = replace(r.estimate, states=KnotStates.joined(keep, window.states))
        r.last = end
        self.seen_at[count > _FEWEST_POINTS] = end
        return float(count.sum()) * r.coarse_stride() / max(returns, 1)

    def _window(self, start: int, end: int) -> tuple[Estimate, JointProblem, int]:
        """The knots from `start` (not before the first) to `end`, all shared held fixed; those beyond the last predicted."""
        r = self.rounds
        start = max(r.first, start)
        e = r.estimate
        nodes, readings = r.nodes.part(start, end), r.readings.part(start, end)
        bg, ba = nodes.at_links(e.gyro_bias), nodes.at_links(e.accel_bias)
        links = preintegrate(readings, bg, ba, r.ctx.noise.density)
        states = predicted(e.states.part(start - r.first, r.last - r.first), links, readings, r.last - start, e.gravity)
        layout = 10 + 6 * len(nodes.times_s) + 3 * len(e.normals)
        bins = no_bins(e.time_offset_s)
        frozen = tuple(range(layout))
        problem = JointProblem(readings, nodes, links, bg, ba, bins, r.priors, 0, frozen, hold_velocity=True)
        return replace(e, states=states), problem, start

    def _scans_over(self, problem: JointProblem, window: Estimate) -> list[int]:
        clocks, knots_s = self.rounds.ctx.clocks, problem.readings.knots_s
        low, high = knots_s[0] + window.time_offset_s, knots_s[-1] + window.time_offset_s
        return [int(i) for i in np.flatnonzero((clocks.scan_s + clocks.sweep_s > low) & (clocks.scan_s < high))]

    def _know_again(
        self, problem: JointProblem, window: Estimate, fresh: list[int], lost: BoolArray, straying: FloatArray
    ) -> Micro | None:
        """Points of lost planes in the newest whole scan, told by their plane's normal; None where there are none."""
        r = self.rounds
        if not lost.any() or not fresh:
            return None
        position = fresh[len(fresh) // 2]
        view = r.view(problem.motion(window), window)
        cloud, index = view.cloud(position, 4000)
        if len(index) < 200:
            return None
        eye = view.slice_poses(position).p
        middle = eye[len(eye) // 2]
        settings = SegmentSettings(min_points=100, min_share=0.03)
        parts: list[tuple[int, IntArray]] = []
        for fit in segment_planes(cloud, viewpoint_m=middle, settings=settings):
            alike = lost & (window.normals @ fit.normal > np.cos(np.radians(3.0)))
            centre = cloud[fit.inliers].mean(axis=0)
            off = np.abs(window.normals @ centre + window.offsets_m)
            alike &= off < 3.0 * straying + 0.1
            if not alike.any():
                continue
            plane = int(np.flatnonzero(alike)[np.argmin(off[alike])])
            parts.append((plane, index[fit.inliers]))
        if not parts:
            return None
        scan = r.ctx.recording.scans[position]
        micro = []
        for plane, mine in parts:
            points = scan.points[np.sort(mine)]
            only = slice(plane, plane + 1)  # told by its normal: no other plane is asked
            gate = Gate(extra_m=3.0 * float(straying[plane]) + 0.3)
            hits = find_hits(
                points["xyz"], points["offset_ns"] * 1e-9, view.slice_poses(position), window.normals[only],
                window.offsets_m[only], gate,
            )  # fmt: skip
            outlined = None if self.within is None else PlaneExtents(self.reach.normals[only], self.within[only])
            keep, weight = select(hits, r.lidar_noise, gate, outlined)
            bins = collapse(hits, keep, weight, 1)
            micro.append(view.micro([position], replace(bins, plane=np.full(len(bins.plane), plane))))
        return Micro.joined(micro)


def predicted(known: KnotStates, links: Links, readings: UpsampledImu, count: int, gravity: FloatArray) -> KnotStates:
    """States continued over the links beyond the first `count` knots; where the IMU was silent, at constant velocity and rate."""
    R, p, v = [*known.R], [*known.p], [*known.v]
    h = links.h_s
    for k in range(count - 1, len(links.DR)):
        turn, Dv, Dp = links.DR[k], links.Dv[k], links.Dp[k]
        if not readings.linked[k]:
            turn = exp(readings.knot_gyro[k] * h)
            Dv, Dp = -R[-1].T @ gravity * h, -R[-1].T @ gravity * (0.5 * h**2)
        p.append(p[-1] + v[-1] * h + 0.5 * h**2 * gravity + R[-1] @ Dp)
        v.append(v[-1] + h * gravity + R[-1] @ Dv)
        R.append(R[-1] @ turn)
    return KnotStates(np.array(R), np.array(p), np.array(v))
