"""The estimate propagated by the IMU over the rest of the recording, plane by plane as they come and go.

Piece by piece: predict the knots, gate the points of each plane by how far the motion may have strayed along its normal
(drift.py), solve the last second again. A scan that sees one plane is corrected along that plane; one that sees none is
bridged. A plane that comes back after the motion has strayed too far for a gate is known again by its normal
(plane_reacquisition.py). The whole is solved again, and drift begins anew, each time its span has doubled, and where a lost plane
came back.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_core.factors.support import PlaneExtents
from calib_core.full.joint.association import associate
from calib_core.full.joint.drift import Drift
from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.moments import Micro
from calib_core.full.joint.plane_reach import spread, surveyed_reach
from calib_core.full.joint.plane_reacquisition import regain
from calib_core.full.joint.plane_set import add_planes
from calib_core.full.joint.policies import Propagation, Round
from calib_core.full.joint.propagation_window import Window, predict
from calib_core.full.joint.round import coarse_stride, gate_of, one_round
from calib_core.full.joint.schedule import Schedule
from calib_core.full.joint.settings import STRAYING
from calib_core.full.joint.state import GRAVITY
from calib_core.full.joint.state_views import layout_of
from calib_core.solver.information import covariance
from calib_core.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Propagated:
    """What is known on the way. drift: since the whole was solved.   reach: cells that planes may have points in (P, ...).

    outlined: those that outlines leave them, None without one.   seen_at: (P,) knots at which each plane was last in view.
    solved_knots: how many there were when the whole was solved.   share_at_first: of points on known planes, the largest
    so far.   looked_at: the knot at which new planes were looked for.
    """

    state: Estimation
    drift: Drift
    reach: PlaneExtents
    outlined: BoolArray | None
    seen_at: IntArray
    solved_knots: int
    share_at_first: float
    looked_at: int


def propagate(data: JointData, state: Estimation, schedule: Schedule) -> Estimation:
    """The estimate carried to the recording's end, or to where the planes went out of sight for good."""
    policy = schedule.propagation
    total, spacing_s = data.knots, data.readings.spacing_s
    if policy is None or state.knots >= total - policy.least_rest_s / spacing_s:
        return state
    piece = max(2, round(policy.piece_s / spacing_s))
    way = begin(data, state, schedule, policy)
    while way.state.knots < total:
        end = min(way.state.knots + piece, total)
        if total - end < piece // 2:
            end = total
        before = way.seen_at
        piece_of = data.portion(way.state.knots / total, end / total)
        way, share = advance(data, way, end, schedule, policy)
        way = replace(way, state=with_scans_reached(data, way.state))
        piece_of.run.stage("solve", 0.0, "carrying the estimate through the recording")
        if (end - way.seen_at.max()) * spacing_s > policy.blind_limit_s:
            break
        came_back = (way.seen_at == end) & (end - before > policy.away_s / spacing_s)
        way = look_again(data, way, share, schedule, policy)
        grown = end / way.solved_knots
        if came_back.any() or grown >= policy.doubled or (end == total and grown > policy.little_more):
            way = solve_all(piece_of, way, schedule, policy)
    return let_go(data, way, policy)


def begin(data: JointData, state: Estimation, schedule: Schedule, policy: Propagation) -> Propagated:
    """From an estimate of all that was tracked."""
    drift = drift_of(data, state)
    state, reach, outlined = surveyed_reach(data, state, schedule, policy)
    seen_at = np.full(len(state.planes), state.knots)
    return Propagated(state, drift, reach, outlined, seen_at, state.knots, 0.0, state.knots)


def advance(
    data: JointData, way: Propagated, end: int, schedule: Schedule, policy: Propagation
) -> tuple[Propagated, float]:
    """Predict the knots up to `end`, then let the points there correct them; and the share of points on known planes."""
    state, window_knots = way.state, round(policy.window_s / data.readings.spacing_s)
    drift = way.drift.after((end - state.knots) * data.readings.spacing_s)
    window = predict(data, state, state.knots - window_knots, end)
    fresh_s = float(data.readings.knots_s[state.knots - 1] + state.estimate.time_offset_s)
    inside = window.scans_over(data)
    straying_m = drift.along(state.estimate.normals)
    known_again = regain(
        data,
        state,
        window,
        [i for i in inside if i > max(state.positions)],
        lost=too_wide(straying_m, policy),
        straying_m=straying_m,
        reach=way.reach,
        outlined=way.outlined,
        policy=policy,
    )
    if known_again is not None:
        back_to = int(way.seen_at[np.unique(known_again.plane)].min())
        window, drift = bridge(data, state, drift, known_again, back_to - window_knots, end, policy)
    way = replace(way, drift=drift)
    way, window, count, returns = correct(data, way, window, inside, fresh_s, schedule, policy)
    seen_at = np.where(count > policy.fewest_points, end, way.seen_at)
    share = float(count.sum()) * coarse_stride(data, state, schedule.sampling) / max(returns, 1)
    return replace(way, state=window.joined_to(state), seen_at=seen_at), share


def bridge(
    data: JointData, state: Estimation, drift: Drift, regained: Micro, start: int, end: int, policy: Propagation
) -> tuple[Window, Drift]:
    """The window back to where regained planes were last seen, solved with them: the gap is bent to meet both its ends."""
    window = predict(data, state, start, end)
    window = window.corrected(regained, iterations=policy.regained_iterations, least_decrease=policy.least_decrease)
    return window, drift.corrected(state.estimate.normals[np.unique(regained.plane)])


def correct(
    data: JointData,
    way: Propagated,
    window: Window,
    inside: list[int],
    fresh_s: float,
    schedule: Schedule,
    policy: Propagation,
) -> tuple[Propagated, Window, FloatArray, int]:
    """The window after two passes of gating and descent; points on each plane since `fresh_s` (P,), and returns in all."""
    state, normals, drift = way.state, way.state.estimate.normals, way.drift
    stride = coarse_stride(data, state, schedule.sampling)
    count: FloatArray = np.zeros(len(normals))
    returns = 1
    settled: Micro | None = None
    # Where the lidar told nothing for a while, the prediction is all there is.
    for extra_m in (policy.gate_m, policy.tightened * policy.gate_m) if inside else ():
        gate = gate_of(state, extra_m, schedule.sampling)
        gate = replace(gate, extra_of_plane_m=gates_m(drift.along(normals), extra_m, policy))
        points = associate(window.view(data), inside, state.lidar_noise, gate, way.reach, stride=stride)
        if len(points.count) == 0:
            break
        window = window.corrected(points, iterations=policy.piece_iterations, least_decrease=policy.least_decrease)
        fresh = points.time_s > fresh_s
        count = np.bincount(points.plane[fresh], points.count[fresh], len(normals)).astype(np.float64)
        seen = count > policy.fewest_points
        clocks = data.run.clocks
        returns = sum(int(clocks.scan_points[i]) for i in inside if clocks.scan_s[i] > fresh_s - STRAYING.half_sweep_s)
        drift = drift.corrected(normals[seen])
        settled = points.part(fresh & seen[points.plane])
    reach = way.reach if settled is None else spread(way.reach, settled, window, way.outlined, policy)
    return replace(way, drift=drift, reach=reach), window, count, returns


def too_wide(straying_m: FloatArray, policy: Propagation) -> BoolArray:
    """Planes that no gate may look for any more, (P,). straying_m: (P,) along their normals."""
    return np.asarray(3.0 * straying_m + policy.gate_m > policy.widest_gate_m)


def gates_m(straying_m: FloatArray, extra_m: float, policy: Propagation) -> FloatArray:
    """Each plane's room in the gate beyond the noise, (P,): three standard deviations of the drift; -1 where it is too wide."""
    return np.where(too_wide(straying_m, policy), -1.0, extra_m + 3.0 * straying_m)


def drift_of(data: JointData, state: Estimation) -> Drift:
    """After a solve of the whole: what its information leaves open of the acceleration at the last knot.

    The error of R (f - b) + g: bias and gravity, which a motion without turning cannot tell apart.
    """
    noise = float(data.run.noise.density.accel_m_s2_sqrt_hz.max())
    cov = np.eye(3) * STRAYING.acceleration_std_m_s2**2
    if state.information is not None:
        node = int(data.nodes.node[min(state.knots, len(data.nodes.node)) - 1])
        start = layout_of(data, state).accel_bias().start + 3 * node
        every = covariance(state.information).matrix
        pick = np.r_[start : start + 3, GRAVITY]
        J = np.hstack([-state.estimate.states.R[-1], np.eye(3)])
        cov = J @ every[np.ix_(pick, pick)] @ J.T + np.eye(3) * STRAYING.least_acceleration_std_m_s2**2
    return Drift.begun(cov, noise)


def with_scans_reached(data: JointData, state: Estimation) -> Estimation:
    """The scans that the knots now reach join those in play."""
    now = data.readings.knots_s[state.knots - 1] + state.estimate.time_offset_s
    newest = max(state.positions)
    more = [int(i) for i in np.flatnonzero(_middles_s(data) < now) if i > newest]
    return replace(state, positions=(*state.positions, *more))


def look_again(data: JointData, way: Propagated, share: float, schedule: Schedule, policy: Propagation) -> Propagated:
    """With planes that have come into view lately, where the known ones explain little while the motion is certain."""
    first, knots, spacing_s = max(way.share_at_first, share), way.state.knots, data.readings.spacing_s
    way = replace(way, share_at_first=first)
    waited_s = (knots - way.looked_at) * spacing_s
    steady = way.drift.farthest_m() < policy.gate_m
    if not (share < policy.explained * first and waited_s > policy.fresh_look_s and steady):
        return way
    way = replace(way, looked_at=knots)
    if schedule.planes is None:
        return way
    period_s = max(float(np.median(np.diff(data.run.clocks.scan_s))), 1e-9)
    recent = max(STRAYING.fewest_scans, round(policy.fresh_look_s / period_s))
    state = add_planes(data, way.state, way.state.positions[-recent:], schedule.planes)
    if state is way.state:
        return way
    seen_at = np.append(way.seen_at, np.full(len(state.planes) - len(way.seen_at), knots))
    state, reach, outlined = surveyed_reach(data, state, schedule, policy)
    return replace(way, state=state, seen_at=seen_at, reach=reach, outlined=outlined)


def solve_all(data: JointData, way: Propagated, schedule: Schedule, policy: Propagation) -> Propagated:
    """All knots so far solved again, twice where they may have strayed beyond the gate; drift begins anew."""
    state = way.state
    twice = way.drift.farthest_m() > policy.gate_m
    for extra_m in (2 * policy.gate_m, policy.gate_m) if twice else (policy.gate_m,):
        # A plane goes on for ever, the floor under things does not: what merely lies near it pulls the motion.
        state = one_round(data, state, Round(gate_m=extra_m, iterations=policy.whole_iterations), schedule.sampling)
    drift = drift_of(data, state)
    knots = state.knots
    state, reach, outlined = surveyed_reach(data, state, schedule, policy)
    return replace(way, state=state, drift=drift, reach=reach, outlined=outlined, solved_knots=knots)


def let_go(data: JointData, way: Propagated, policy: Propagation) -> Estimation:
    """Without what was carried on after the last plane went out of sight for good."""
    return until_seen(data, way.state, int(way.seen_at.max()), policy)


def until_seen(data: JointData, state: Estimation, seen_at: int, policy: Propagation) -> Estimation:
    """Without the knots long after the one at which a plane was last in view."""
    spacing_s = data.readings.spacing_s
    keep = min(seen_at + round(STRAYING.kept_s / spacing_s), state.knots)
    if (state.knots - keep) * spacing_s < policy.window_s:
        return state
    now_s = data.readings.knots_s[keep - 1] + state.estimate.time_offset_s
    since_start_s = data.run.recording.skipped_s + now_s
    data.run.say(
        "warning",
        "planes.lost",
        f"the planes went out of view {since_start_s:.0f} s after the recording's first scan and were not seen again: the rest "
        "of the recording is not used",
    )
    middles_s = _middles_s(data)
    return replace(
        state,
        estimate=replace(state.estimate, states=state.estimate.states.part(0, keep)),
        positions=tuple(i for i in state.positions if middles_s[i] < now_s),
    )


def _middles_s(data: JointData) -> FloatArray:
    """When half of each scan was taken, lidar clock: (M,)."""
    return np.asarray(data.run.clocks.scan_s + 0.5 * data.run.clocks.sweep_s)
