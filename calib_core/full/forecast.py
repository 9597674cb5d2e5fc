"""What a solve of a recording would know, before it is run: the same information, at a fraction of the price.

How well a calibration is determined depends on the motion, the planes and the noise, hardly on the answer itself. So a
few whole scans give the planes, a sample of every scan's points a lidar-only track, the track gives start values, the IMU
smooths the motion with the calibration held at them, and the joint problem is linearised there once:

    information(7 x 7) = what remains of J' J after eliminating knots, biases, gravity and planes

with every sampled point counting for as many as it stands for. The very rules that judge a solve judge this
(observability.py), so that both call the same directions weak.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import null_space

from calib_core.errors import Cancelled, Refused
from calib_core.events import OnEvent, ShouldCancel, StageEvent, ignore_event, never_cancel
from calib_core.factors.lidar_plane import Gate
from calib_core.full.assess.observability import Knowledge, assess
from calib_core.full.assess.verdict import require_rotation
from calib_core.full.assess.weak_sentences import Advice, advice
from calib_core.full.clock_skew import without_skew
from calib_core.full.forecast_by_choice import Foresight, foresight
from calib_core.full.initialise.initialise import initialise
from calib_core.full.initialise.lidar_motion import begin as follow_planes
from calib_core.full.initialise.start import LidarTrack, Start
from calib_core.full.joint.doubtful_planes import face_three_ways, plane_doubts
from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.first_estimate import begin
from calib_core.full.joint.moments import gather
from calib_core.full.joint.plane_set import only_planes
from calib_core.full.joint.policies import PlaneSet
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.round import associate, gathered, measure, survey
from calib_core.full.joint.schedule import FORECAST
from calib_core.full.joint.solve import admit_sensors, estimate_motion
from calib_core.full.joint.state import CALIBRATION, ROTATION, TRANSLATION, Estimate
from calib_core.full.joint.state_views import problem_of
from calib_core.full.joint.undetermined import UNITS, data_information, undetermined
from calib_core.full.odometry.distance_travelled import stood_text, travelled
from calib_core.full.odometry.reference import Followed
from calib_core.full.odometry.reference_cloud import propose_planes
from calib_core.full.odometry.register import ScanMotion
from calib_core.full.planes.plane_tests import Fault, fault_of
from calib_core.full.planes.propose import no_planes, scan_points
from calib_core.full.prepare.prepare import prepare, require_length
from calib_core.full.prepare.settings import SAMPLED
from calib_core.full.run import Run
from calib_core.planes.sample import sample_scan
from calib_core.planes.segment import segment_planes
from calib_core.settings import CalibrateSettings
from calib_core.solver.arrow import NotPositiveDefinite, solve_arrow
from calib_core.threads import one_blas_thread
from calib_core.types import FloatArray, PlaneProposals, Recording, Scan

NO_PLANES = PlaneProposals(
    (), np.zeros((0, 3), np.float32), np.zeros(0, np.int16), np.zeros(0, np.float32), (0,), static=False
)


@dataclass(frozen=True, slots=True)
class Forecasting:
    """What makes a forecast cheaper than a solve."""

    #: measured over the same, with the sigmas above: a solve's knots for each of ours. What the readings say of a calibration
    #: builds up over tenths of a second.
    coarser: int = 2
    #: judged: scans that are looked at for planes before a reference is searched for: where none shows one, the search is
    #: long. Time alone depends on it.
    scans: int = 8
    #: measured: no more than this is gone after beyond what was tracked: what follows is taken to say as much a second. Of
    #: partial-views, whose motion changes, 20 s foretell 1.57 times the time offset's sigma, 40 s (all of it) 0.96 times. Time
    #: depends on it.
    propagated_s: float = 40.0
    #: judged: room in the gate while the lidar's noise is learnt: that of a solve (Settling).
    learning_m: float = 0.02
    #: derived: a lever arm that turns with the rotation's uncertainty by less than this part of its own standard deviation adds
    #: a tenth to it at most.
    felt: float = 0.45
    #: measured on a minute by hand: with 15 of 600 scans off their way by up to 0.08 m, as samples of clouds are followed,
    #: sigmas are within 0.1 % of those without, and following again costs three times the forecast.
    at_fault: float = 0.05


FORECASTING = Forecasting()
#: The gate while planes' reach and the lidar's noise are learnt.
LEARNING = Gate(extra_m=FORECASTING.learning_m)


@dataclass(frozen=True)
class Outlook:
    """What a solve would find to work with, and to know.

    proposals: the expected planes.   faults: what seems wrong with each, so that a solve would leave it out; () where that is not
    known.   foresight: what tells how the numbers change with the choice of planes; None where it would
    not fit the proposals.   gravity: (3,) [m/s2] in their frame.   knowledge: None where `reason` says why, under
    the stable `code`.   advice: what to record for what would stay unknown.   covered_s: seconds that could be followed,
    standstill included.   range_std_m: the lidar's noise, seen on the planes.
    """

    proposals: PlaneProposals
    gravity: FloatArray | None = None
    knowledge: Knowledge | None = None
    code: str = ""
    reason: str = ""
    advice: tuple[Advice, ...] = ()
    covered_s: float = 0.0
    range_std_m: float | None = None
    foresight: Foresight | None = None
    faults: tuple[Fault, ...] = ()


def forecast(
    recording: Recording,
    points_per_scan: Sequence[int],
    settings: CalibrateSettings | None = None,
    *,
    share: float = 1.0,
    whole: Sequence[Scan] | None = None,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> Outlook:
    """The outlook of a recording whose scans may be samples, each evenly spread over the whole scan.

    points_per_scan: (M,) of the whole scans.   share: of the whole recording that these scans are; the rest is taken to
    say as much a second.   whole: the same scans with all their points, and later ones, in which the planes are found that
    `propose_planes` finds in the whole recording; None looks for them in the samples, which then should hold ten thousand
    points where they may serve as the reference. Raises Cancelled.
    """

    def tell(fraction: float, text: str) -> None:
        if should_cancel():
            raise Cancelled("Inspecting was stopped.")
        on_event(StageEvent(stage="inspect", fraction=fraction, text=text))

    settings = settings or CalibrateSettings()
    with one_blas_thread():
        tell(0.1, "looking for planes")
        proposals = NO_PLANES
        seen = recording if whole is None else replace(recording, scans=whole)
        if _shows_planes(seen.scans):
            proposals = propose_planes(seen, settings, should_cancel=should_cancel)
        try:
            if not proposals.patches:
                raise no_planes(recording.scans)

            def look(stamped: Recording, _: float) -> Outlook:
                each = np.asarray(points_per_scan)
                return _look(stamped, each, share, settings, proposals, tell, should_cancel)

            return without_skew(recording, look)[0]
        except Refused as error:
            return Outlook(proposals, code=error.code, reason=str(error))


def _shows_planes(scans: Sequence[Scan]) -> bool:
    """Whether any of a few scans, spread over all, shows a plane: where none does, the search for a reference is long."""
    spread = np.unique(np.linspace(0, len(scans) - 1, FORECASTING.scans).astype(np.int64))
    return any(segment_planes(scan_points(scans[int(position)])) for position in spread)


def _look(
    recording: Recording,
    points_per_scan: FloatArray,
    share: float,
    settings: CalibrateSettings,
    proposals: PlaneProposals,
    tell: Callable[[float, str], None],
    should_cancel: ShouldCancel,
) -> Outlook:
    """Track, start values, smoothed motion, information. Raises Refused."""
    require_length(recording, "a forecast")
    run = prepare(recording, settings, ignore_event, should_cancel)
    tell(0.3, "following the planes from scan to scan")
    sampled = proposals.reference_scans[0] < len(recording.scans)
    followed = follow_planes(run, None, proposals if sampled else None, at_fault=FORECASTING.at_fault)
    _require_motion(followed.motions)
    tell(0.6, "first values of the calibration")
    lidar, start = initialise(run, followed.motions, followed.planes, None)
    tell(0.7, "what a solve would know")
    run, stands_for = _thinned(run, points_per_scan)
    data, state, share = _smoothed(run, followed, lidar, start, share)
    state, faults = _without_doubtful(data, state)
    knowledge, problem, estimate = _knowledge(data, state, stands_for, share)
    require_rotation(knowledge)
    rate = recording.imu.gyro_rad_s
    turning = np.sqrt(np.mean((rate - rate.mean(axis=0)) ** 2, axis=0))
    said = tuple(advice(knowledge, turning, state.estimate.R_imu_lidar))
    tell(1.0, "")
    covered_s = state.knots * data.readings.spacing_s
    outlook = Outlook(
        proposals, knowledge=knowledge, advice=said, covered_s=covered_s, range_std_m=state.lidar_noise.range_std_m
    )
    # In another reference scan's frame gravity says nothing of the proposals' planes, nor does the problem.
    if followed.reference != proposals.reference_scans[0]:
        return outlook
    proposed = len(followed.proposals)
    used = [which for which, fault in zip(followed.of_proposal, faults, strict=True) if not fault]
    kept = foresight(problem, estimate, proposed, used, share)
    told = _of_proposals(followed.of_proposal, faults, proposed)
    return replace(outlook, gravity=start.linear.gravity, faults=told, foresight=kept)


def _of_proposals(of_proposal: Sequence[int], faults: Sequence[Fault], proposed: int) -> tuple[Fault, ...]:
    """What seems wrong with each of so many proposals: with all of the planes (P,) that it is."""
    told: list[Fault] = [""] * proposed
    for which, fault in zip(of_proposal, faults, strict=True):
        if fault and which >= 0 and which not in [w for w, f in zip(of_proposal, faults, strict=True) if not f]:
            told[which] = fault
    return tuple(told)


def _require_motion(motions: Sequence[ScanMotion]) -> None:
    """Raises Refused where the lidar stands still throughout."""
    if travelled(motions).stood:
        raise Refused("motion.none", stood_text())


def _thinned(run: Run, points_per_scan: FloatArray) -> tuple[Run, FloatArray]:
    """The run with a sample of every scan's points, and how many points of a scan each stands for: (M,)."""
    sampled = [sample_scan(scan, SAMPLED.points) for scan in run.recording.scans]
    kept = np.array([len(scan.points) for scan in sampled], dtype=np.int64)
    clocks = replace(run.clocks, scan_points=kept)
    run = replace(run, recording=replace(run.recording, scans=sampled), clocks=clocks)
    return run, points_per_scan / np.maximum(kept, 1)


def _smoothed(
    run: Run, followed: Followed, lidar: LidarTrack, start: Start, share: float
) -> tuple[JointData, Estimation, float]:
    """The motion on a coarse chain of knots, with the calibration at its start values; and the share that it stands for."""
    data, state, looked = begin(
        run,
        followed,
        lidar,
        start,
        None,
        FORECAST,
        every=FORECASTING.coarser,
        most_s=FORECASTING.propagated_s,
        beyond=0,
    )
    state = estimate_motion(data, state, FORECAST)
    assert FORECAST.propagation is not None
    if state.knots > data.knots - FORECAST.propagation.least_rest_s / data.readings.spacing_s:
        share *= looked
    state = measure(data, survey(data, state, LEARNING, FORECAST.sampling), LEARNING, FORECAST.sampling)
    # A gate that is wider than the noise would count its width as noise.
    return data, associate(data, admit_sensors(data, state), Gate(), stride=1), share


def _without_doubtful(data: JointData, state: Estimation) -> tuple[Estimation, list[Fault]]:
    """The same, without the planes that a solve would leave out; and what is wrong with each of all, "" where nothing is.

    Of few planes each bends the motion that all are judged by: unless the others hold it, all stay.
    """
    doubt = plane_doubts(gathered(data, state), state.estimate)
    keep = doubt.max(axis=1) <= 1.0
    if keep.all() or not face_three_ways(state.estimate.normals[keep]):
        return state, [""] * len(keep)
    state = only_planes(state, keep, doubt[:, 2] < 1.0, PlaneSet())
    state = survey(data, state, LEARNING, FORECAST.sampling)
    return associate(data, state, Gate(), stride=1), [fault_of(row) for row in doubt]


def _knowledge(
    data: JointData, state: Estimation, stands_for: FloatArray, share: float
) -> tuple[Knowledge, JointProblem, Estimate]:
    """What the joint problem would know of the calibration, at the smoothed motion; and that problem. Raises Refused.

    With a start whose lever arm is a metre off, a rotation that is known to degrees only would not count in the lever arm's
    standard deviations: judged again about the arm that the problem steps to, where they would feel it.
    """
    problem = _problem(data, state, stands_for)
    knowledge, step = _about(data, problem, state.estimate, share)
    turned = np.sqrt(np.max(np.diag(knowledge.covariance)[ROTATION]))
    if float(np.linalg.norm(step[TRANSLATION])) * turned < FORECASTING.felt * np.min(knowledge.data_std[TRANSLATION]):
        return knowledge, problem, state.estimate
    there = replace(state.estimate, p_imu_lidar=state.estimate.p_imu_lidar + step[TRANSLATION])
    problem = _problem(data, replace(state, estimate=there), stands_for)
    return _about(data, problem, there, share)[0], problem, there


def _problem(data: JointData, state: Estimation, stands_for: FloatArray) -> JointProblem:
    """The joint problem about the present estimate, every sampled point counted for as many as it stands for."""
    assert state.observations is not None
    weight = stands_for[state.observations.scan][:, None]
    lasers = state.observations.lasers
    whole = replace(
        state.observations,
        scatter=state.observations.scatter * weight,
        lasers=None if lasers is None else lasers.weighted(stands_for),
    )
    # What the first round held is judged anew: with more points, at the smoothed motion, it may be known.
    problem = problem_of(data, replace(state, priors=replace(state.priors, held=())))
    return replace(problem, bins=gather(whole, problem.motion(state.estimate), state.estimate))


def _about(data: JointData, problem: JointProblem, estimate: Estimate, share: float) -> tuple[Knowledge, FloatArray]:
    """What the problem knows about an estimate; and the calibration's step (7,) [rad, m, s] from it. Raises Refused."""
    try:
        solution = solve_arrow(problem.linearise(estimate))
    except NotPositiveDefinite as error:
        raise Refused("solve.diverged", "the planes and the motion that were found do not fit together") from error
    knowledge = assess(
        solution.information,
        problem.priors,
        inflation=float(np.sqrt(share)),
        frozen_offset=not data.run.settings.estimate_time_offset,
        offset_std_s=float(np.hypot(data.run.clocks.line.mean_std_s * np.sqrt(share), data.run.clocks.steps_std_s)),
    )
    return knowledge, _step_held(data_information(solution.information, problem.priors), solution.step_shared)


def _step_held(information: FloatArray, step_shared: FloatArray) -> FloatArray:
    """The calibration's step (7,) [rad, m, s] where what is left open stays as it is, as a solve has it.

    information: (7, 7), scaled units.   step_shared: (S,), where nothing is held.
    """
    free = step_shared[:CALIBRATION] / UNITS
    opened = undetermined(information)
    known = null_space(opened.T) if opened.size else np.eye(CALIBRATION)
    inside = known.T @ information
    return np.asarray(known @ np.linalg.lstsq(inside @ known, inside @ free, rcond=None)[0] * UNITS)
