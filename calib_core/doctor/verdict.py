"""The doctor's opinion: good, usable within limits, or not usable, each with its reasons and what to record next.

The thresholds are starting points for words. The forecast of the standard deviations, where there is one, has the
last word on observability; here only what no forecast can mend is called unusable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from calib_core.doctor.report import ImuReport, LidarReport, Verdict
from calib_core.errors import InputError
from calib_core.types import Finding

MIN_OVERLAP_S = 5.0
SHORT_S = 15.0
STILL_START_S = 2.0
STILL_SOME_S = 1.0
MIN_RATE_HZ = 95.0
STILL_ROTATION_DEG_S = 0.7
STILL_ACCELERATION_M_S2 = 0.1
WEAK_ROTATION_DEG_S = 5.0
ADVISED_ROTATION_DEG_S = 10.0
CLIPPED_SHARE = 5e-4
#: Findings that limit a calibration by themselves; their own text is the reason.
_LIMITING = frozenset(
    {
        "imu.gaps",
        "imu.jitter",
        "imu.axis_signs",
        "recording.truncated",
        "points.malformed",
        "clock.epochs",
        "points.deskewed",
    }
)
_SEVERAL = frozenset({"recording.several_lidar", "recording.several_imu"})


@dataclass(frozen=True, slots=True)
class Opinion:
    """The verdict, the sentences it rests on, and what to do."""

    verdict: Verdict
    reasons: tuple[str, ...]
    advice: tuple[str, ...]


@dataclass(slots=True)
class _Case:
    fatal: list[str] = field(default_factory=list)
    limits: list[str] = field(default_factory=list)
    advice: list[str] = field(default_factory=list)


def judge(
    *,
    lidar: LidarReport | None,
    imu: ImuReport | None,
    problems: Sequence[InputError],
    findings: Sequence[Finding],
    overlap_s: float | None,
) -> Opinion:
    """The opinion on what was found. overlap_s: seconds that both sensors cover, None where one is missing."""
    case = _Case()
    for problem in problems:
        (case.limits if problem.code in _SEVERAL else case.fatal).append(str(problem))
    if overlap_s is not None:
        _judge_length(case, overlap_s)
    if imu is not None:
        _judge_motion(case, imu)
        _judge_imu(case, imu)
    if lidar is not None:
        _judge_lidar(case, lidar)
    for finding in findings:
        if finding.code in _LIMITING:
            case.limits.append(finding.text)
        elif finding.level == "warning" and finding.confidence < 0.5:
            case.limits.append(f"{finding.text} This is unsure; check it, or set it with {finding.override}.")
    if case.fatal:
        return Opinion("unusable", (*case.fatal, *case.limits), tuple(case.advice))
    if case.limits:
        return Opinion("limited", tuple(case.limits), tuple(case.advice))
    return Opinion(
        "good",
        ("Topics, point times, units, motion and stillness are as a calibration needs them.",),
        tuple(case.advice),
    )


def _judge_length(case: _Case, overlap_s: float) -> None:
    if overlap_s < MIN_OVERLAP_S:
        case.fatal.append(
            f"Lidar and IMU cover only {overlap_s:.1f} s together; at least {MIN_OVERLAP_S:g} s are"
            f" needed, check the clocks or record longer."
        )
    elif overlap_s < SHORT_S:
        case.limits.append(f"Lidar and IMU cover {overlap_s:.1f} s together, which is short.")
        case.advice.append("Record 30 to 60 s.")


def _judge_motion(case: _Case, imu: ImuReport) -> None:
    motion = imu.excitation
    strongest = max(motion.rotation_rms_deg_s)
    if strongest < STILL_ROTATION_DEG_S and max(motion.acceleration_rms_m_s2) < STILL_ACCELERATION_M_S2:
        case.fatal.append(f"The rig stands still throughout ({strongest:.2f} deg/s): a calibration needs motion.")
        case.advice.append("Turn the rig about all three axes and move it, for 30 to 60 s.")
        return
    if strongest < WEAK_ROTATION_DEG_S:
        case.limits.append(f"The rig hardly turns (at most {strongest:.1f} deg/s): the lever arm stays unknown.")
        case.advice.append("Turn the rig about all three axes at 20 to 60 deg/s, changing direction often.")
    elif motion.weakest_axis_rms_deg_s < WEAK_ROTATION_DEG_S:
        case.limits.append(
            f"There is little rotation about {axis_in_words(motion.weakest_axis)} of the IMU"
            f" ({motion.weakest_axis_rms_deg_s:.1f} deg/s): the lever arm along it stays weak."
        )
        case.advice.append(
            f"Turn the rig about {axis_in_words(motion.weakest_axis)} of the IMU too, at 20 to 60 deg/s."
        )
    elif motion.weakest_axis_rms_deg_s < ADVISED_ROTATION_DEG_S:
        case.advice.append(
            f"More rotation about {axis_in_words(motion.weakest_axis)} of the IMU would sharpen the answer"
            f" ({motion.weakest_axis_rms_deg_s:.1f} deg/s now, above {ADVISED_ROTATION_DEG_S:g} is better)."
        )
    longest_s = max((span.end_s - span.start_s for span in imu.still_spans), default=0.0)
    if longest_s < STILL_SOME_S:
        case.limits.append(
            "The rig never stands still for a second: noise comes from a preset and planes from one scan."
        )
    if longest_s < STILL_START_S:
        case.advice.append(
            f"Let the rig stand still for 3 to 5 s before moving it (longest now: {longest_s:.1f} s),"
            " so that the noise can be measured."
        )


def _judge_imu(case: _Case, imu: ImuReport) -> None:
    if imu.stamps.rate_hz < MIN_RATE_HZ:
        case.limits.append(f"The IMU runs at {imu.stamps.rate_hz:.0f} Hz; 100 Hz or more is advised.")
        case.advice.append("Raise the IMU's rate to 100 Hz or more.")
    clipped = max(imu.saturation.gyroscope_clipped_share, imu.saturation.accelerometer_clipped_share)
    if clipped > CLIPPED_SHARE:
        which = "gyroscope" if imu.saturation.gyroscope_clipped_share >= clipped else "accelerometer"
        case.limits.append(
            f"The {which} is clipped in {clipped:.2%} of its readings: motion there is not what it says."
        )
        case.advice.append(f"Move more gently, or widen the {which}'s range.")
    if not imu.preset_identified and imu.measured_noise is None:
        case.advice.append("Name the IMU with --imu-noise: its noise could neither be measured nor looked up.")


def _judge_lidar(case: _Case, lidar: LidarReport) -> None:
    if lidar.stamps.dropped > 0.02 * max(lidar.scans, 1):
        case.limits.append(f"{lidar.stamps.dropped} scans on {lidar.topic} are missing ({lidar.scans} are there).")
        case.advice.append("Record to a faster disk, or record fewer topics.")
    if lidar.ranges is not None and lidar.ranges.median_m > 25:
        case.advice.append("Record closer to walls and floor: 1 to 10 m make the sharpest planes.")


def axis_in_words(axis: tuple[float, float, float]) -> str:
    """The axis a direction is near, as "x", "y" or "z"; else its components."""
    largest = max(range(3), key=lambda i: abs(axis[i]))
    if abs(axis[largest]) > 0.9:
        return "xyz"[largest]
    return "direction (" + ", ".join(f"{c:.2f}" for c in axis) + ")"
