"""The published method's answer beside ours (`--method paper`).

Its covariance is that of the cost's own weights: with the factor balance of eq. (14) it is not the errors' covariance,
and the document says so.
"""

from __future__ import annotations

import numpy as np

from calib_core.errors import Refused
from calib_core.events import LogEvent
from calib_core.full.assess.observability import assess
from calib_core.full.assess.weak_sentences import weak_directions
from calib_core.full.joint.first_estimate import BEGINNING
from calib_core.full.joint.priors import PriorRow, Priors
from calib_core.method import Answer, Question
from calib_core.paper.calibrate import calibrate_paper
from calib_core.paper.records import PaperSolution
from calib_core.result import Message, PlaneQuality
from calib_core.types import Recording

_ABOUT_STD = (
    "the standard deviations are those of the published cost, whose factor balance is not a noise model: "
    "use `--method full` for error bars"
)


def calibrate_published(recording: Recording, question: Question) -> Answer:
    """The paper's method, with its own defaults (100 points a plane and scan, +-45 deg) where none was set."""
    if any(plane.outline_m is not None for plane in question.planes or ()):
        text = "the published method knows no outlines of planes: theirs are not used; `--method full` uses them"
        question.log(LogEvent(code="planes.outline_unused", level="warning", text=text))
    solution = calibrate_paper(
        recording,
        question.settings,
        planes=question.planes,
        initial_guess=question.guess,
        on_event=question.log,
        should_cancel=question.should_cancel,
    )
    if not solution.converged:
        raise Refused(
            "solve.diverged",
            f"the published method did not converge on {recording.name}; record a stand of a few seconds and then slow turns "
            "about all three axes, or use `--method full`, which tells what is wrong",
        )
    return _answer(solution)


def _answer(solution: PaperSolution) -> Answer:
    information = np.asarray(np.linalg.inv(solution.covariance), dtype=np.float64)
    information = information + np.diag(1.0 / np.array(BEGINNING.standing_std) ** 2)
    standing = tuple(PriorRow(i, 0.0, std) for i, std in enumerate(BEGINNING.standing_std))
    knowledge = assess(information, Priors(solution.R_imu_lidar, standing, solution.gravity_m_s2, 0.0))
    findings = [Message(code=f.code, level=f.level, text=f.text) for f in solution.messages]
    return Answer(
        R_imu_lidar=solution.R_imu_lidar,
        p_imu_lidar=solution.p_imu_lidar,
        time_offset_ns=solution.time_offset_ns,
        gyro_bias_rad_s=solution.gyro_bias_rad_s,
        accel_bias_m_s2=solution.accel_bias_m_s2,
        gravity_m_s2=solution.gravity_m_s2,
        gravity_std_m_s2=0.0,
        covariance=knowledge.covariance,
        is_weak=knowledge.is_weak,
        weak_axes=knowledge.weak_axes,
        weak_directions=weak_directions(knowledge),
        advice=(),
        rms_m=solution.rms_m,
        points_used=solution.points_used,
        scans_used=solution.scans_used,
        scans_total=solution.scans_total,
        planes=tuple(
            PlaneQuality(
                name=p.plane.name,
                normal=p.plane.normal.tolist(),
                offset_m=p.plane.offset_m,
                points=p.n_points,
                rms_m=p.rms_m,
            )
            for p in solution.planes
        ),
        iterations=solution.iterations,
        trajectory=solution.trajectory,
        remarks=(*findings, Message(code="uncertainty.published", level="warning", text=_ABOUT_STD)),
    )
