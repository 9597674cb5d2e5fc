"""The paper from its first section to its last: the page to read beside it.

    II-E   planes of every scan, tracked from the first             front_end.py, planes/
    eq. 13 rough scan poses, and start values from them             scan_pose.py, initial.py
    II-C   IMU readings upsampled by GPs, one window per scan       upsample.py, gp/
    eq. 3  preintegration to every point and to the next scan       preintegration.py
    eq. 2  cost of lidar factors (7-10) and IMU factors (11)        problem.py, lidar_factor.py, imu_factor.py
    III-A  first round with unit covariances, then rounds with propagated noise, balanced by eq. 14

What the paper leaves open, or where its letter is left:

    eq. 3     has its missing 1/2; reading and attitude are taken in mid-step, so that steps may be 1 ms
    II-C      kernel of smoothness 5/2; scales by maximum likelihood on a grid, the same on every machine
    II-E      planes by sequential RANSAC whose hypotheses count inliers, where the paper cites MLESAC, which weighs them by
              their likelihood: both are refitted to all points in the band
    II-E      P is what the first scan shows in directions 30 deg apart; a point close to two planes is given to neither
    eq. 2     the turn of the world about the vertical is held: nothing observes it
    lost      scans keep a state without lidar factors, so that no preintegration spans more than a scan (timeline.py)
    III-A     the first round's unit covariances are balanced by eq. (14) as all others are; three rounds follow
    eq. 14    covariances get a floor of a hundredth of their mean: a window of few readings may be fitted without noise
    start     lever arm zero, biases zero, time shift and rotation from both sensors' turning (initial.py)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib_core.errors import Cancelled, Refused
from calib_core.events import OnEvent, ShouldCancel, StageEvent, ignore_event, never_cancel
from calib_core.paper import report
from calib_core.paper.front_end import Selection, run_front_end
from calib_core.paper.prepare import Run, prepare
from calib_core.paper.problem import PaperState, covariance_of_calibration
from calib_core.paper.records import FrontEnd, PaperOptions, PaperSolution
from calib_core.paper.rounds import Round, expand, reweighted
from calib_core.paper.solve import Descent, descend
from calib_core.phrasing import counted
from calib_core.settings import CalibrateSettings
from calib_core.solver.arrow import solve_arrow
from calib_core.solver.system import ArrowSystem
from calib_core.types import Finding, InitialGuess, Plane, Recording

_MIN_PLANES, _MIN_SCANS = 3, 10
_PUBLISHED = PaperOptions()


def calibrate_paper(
    recording: Recording,
    settings: CalibrateSettings,
    *,
    planes: Sequence[Plane] | None = None,
    initial_guess: InitialGuess | None = None,
    first_scan: int = 0,
    options: PaperOptions = _PUBLISHED,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> PaperSolution:
    """The calibration by the published method. Raises Refused where there is none, and Cancelled.

    planes: in the lidar frame at the first point of scan `first_scan`, during which the sensors are taken to stand
    still;
    None: detected in it.
    """
    front = track_planes(
        recording, settings, planes=planes, first_scan=first_scan, on_event=on_event, should_cancel=should_cancel
    )
    return solve_tracked(
        recording,
        settings,
        front,
        initial_guess=initial_guess,
        options=options,
        on_event=on_event,
        should_cancel=should_cancel,
    )


def track_planes(
    recording: Recording,
    settings: CalibrateSettings,
    *,
    planes: Sequence[Plane] | None = None,
    first_scan: int = 0,
    by_map: bool = False,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> FrontEnd:
    """The map and each scan's points on it (II-E); arguments as for `calibrate_paper`.   by_map: as Selection has it."""
    return run_front_end(
        recording.scans,
        range(first_scan, len(recording.scans)),
        planes=planes,
        selection=replace(_selection(settings), by_map=by_map),
        on_event=on_event,
        should_cancel=should_cancel,
    )


def solve_tracked(
    recording: Recording,
    settings: CalibrateSettings,
    front: FrontEnd,
    *,
    initial_guess: InitialGuess | None = None,
    options: PaperOptions = _PUBLISHED,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> PaperSolution:
    """The calibration from tracked scans, so that several solves can share them."""
    total = max(recording.scans_total, len(recording.scans))
    _check(front)
    on_event(StageEvent(stage="initialise", fraction=0.0, text="start values from the scans' rough poses"))
    run = prepare(recording, settings, front, initial_guess, options)
    descent, rounds = _solve(run, on_event, should_cancel)
    return _solution(run, rounds, descent, recording.coarse_offset_ns, total)


def _selection(settings: CalibrateSettings) -> Selection:
    """The point cap and field of view, in degrees to either side."""
    view_deg = settings.field_of_view_deg
    return Selection(settings.points_per_plane_per_scan, 180.0 if view_deg is None else view_deg, settings.random_seed)


def _check(front: FrontEnd) -> None:
    """Raises Refused where too few planes or scans were found."""
    used, dropped = len(front.scans), len(front.dropped)
    if len(front.planes) < _MIN_PLANES:
        text = (
            f"expected {_MIN_PLANES} planes of different directions in the first scan's field of view, found "
            f"{len(front.planes)}; record a corner from close by, or use --method full"
        )
        raise Refused("paper.planes", text)
    if used < _MIN_SCANS:
        text = (
            f"expected at least {_MIN_SCANS} scans that show all {len(front.planes)} planes, found {used} of "
            f"{used + dropped}; keep the corner in view, or use --method full"
        )
        raise Refused("paper.scans", text)


def _solve(run: Run, on_event: OnEvent, should_cancel: ShouldCancel) -> tuple[Descent, Round]:
    """Unit covariances first, then rounds with the noise propagated at the last estimate (III-A)."""
    rounds, state = expand(run, None, run.state)
    descent = _one_round(run, rounds, state, 0, 0, on_event, should_cancel)
    for number in range(1, run.options.refinement_rounds + 1):
        state, done = descent.state, descent.iterations
        if run.options.relinearise:
            rounds, state = expand(run, rounds, state)
        rounds = reweighted(run, rounds, state)
        descent = _one_round(run, rounds, state, number, done, on_event, should_cancel)
    return descent, rounds


def _one_round(
    run: Run, rounds: Round, state: PaperState, number: int, done: int, on_event: OnEvent, should_cancel: ShouldCancel
) -> Descent:
    """The minimum of one round. done: iterations of the rounds before, counted on."""
    text = "covariances at identity" if number == 0 else f"noise propagated, round {number}"
    on_event(StageEvent(stage="solve", fraction=number / (run.options.refinement_rounds + 1), text=text))
    iteration = done

    def watch(now: PaperState, system: ArrowSystem) -> None:
        nonlocal iteration
        iteration += 1
        if should_cancel():
            raise Cancelled("stopped between two iterations of the solve; nothing was written")
        if on_event is ignore_event:
            return
        qualities = report.plane_qualities(run.front, rounds.plane_of_point, rounds.problem.distances(now))
        offset_s = rounds.time_offset_s + now.shared.time_delta_s
        on_event(report.iteration_event(now, system, (iteration, number), offset_s, qualities))

    descent = descend(rounds.problem, state, max_iterations=run.options.iterations_per_round, on_step=watch)
    return replace(descent, iterations=iteration)


def _solution(run: Run, rounds: Round, descent: Descent, coarse_ns: int, total: int) -> PaperSolution:
    shared = descent.state.shared
    relative_s = rounds.time_offset_s + shared.time_delta_s
    offset_ns = coarse_ns + round(relative_s * 1e9)
    dist_m = rounds.problem.distances(descent.state)
    tracked = frozenset(scan.position for scan in run.front.scans)
    messages = [Finding("paper.weights", "info", _ABOUT_COVARIANCE)]
    if run.front.dropped:
        text = (
            f"{counted(len(run.front.dropped), 'scan was', 'scans were')} dropped because not all "
            f"{len(run.front.planes)} planes were found"
        )
        messages.append(Finding("paper.scans_dropped", "info", text))
    if not descent.converged:
        text = f"the cost was still falling after {descent.iterations} iterations; the answer is the last estimate"
        messages.append(Finding("solve.not_converged", "warning", text))
    return PaperSolution(
        R_imu_lidar=shared.R_imu_lidar,
        p_imu_lidar=shared.p_imu_lidar,
        time_offset_s=offset_ns * 1e-9,
        time_offset_ns=offset_ns,
        gyro_bias_rad_s=rounds.gyro_bias + shared.gyro_bias_delta,
        accel_bias_m_s2=rounds.accel_bias + shared.accel_bias_delta,
        gravity_m_s2=float(-run.gravity_world[2]),
        covariance=covariance_of_calibration(solve_arrow(descent.system, damping=1e-9)),
        planes=report.plane_qualities(run.front, rounds.plane_of_point, dist_m),
        rms_m=float(np.sqrt(np.mean(dist_m**2))),
        points_used=int(dist_m.size),
        scans_used=len(run.front.scans),
        scans_dropped=len(run.front.dropped),
        scans_total=total,
        iterations=descent.iterations,
        converged=descent.converged,
        cost=descent.system.cost,
        trajectory=report.trajectory(
            descent.state, rounds.preintegration, run.timeline, tracked, run.gravity_world, run.front.epoch_ns
        ),
        messages=tuple(messages),
    )


_ABOUT_COVARIANCE = (
    "the published method balances its factors by hand (eq. 14) and takes neighbouring upsampled readings as "
    "independent: its standard deviations are those of its cost, not of its errors; use --method full for honest ones"
)
