"""The doctor's opinion: good, usable within limits, or not usable, each with its reasons and what to record next.

The forecast of the standard deviations, where there is one, has the last word on what the motion and the planes
determine; where there is none, thresholds on the IMU's motion are the next best. Only what no solve would mend is called
unusable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import sqrt

from calib_core.doctor.report import Forecast, ImuReport, LidarReport, ParameterForecast, PlanesReport, Verdict
from calib_core.errors import InputError
from calib_core.imu.clipping import clipped_text, worse_sensor
from calib_core.phrasing import counted, joined
from calib_core.result import AXIS_WORDS, WEAK_DEG, WEAK_M, WEAK_S
from calib_core.types import Finding

_WEAK_IN = {"deg": WEAK_DEG, "m": WEAK_M, "s": WEAK_S}
MIN_OVERLAP_S = 5.0
SHORT_S = 15.0
LONG_S = 30.0
STILL_SOME_S = 1.0
MIN_RATE_HZ = 95.0
STILL_ROTATION_DEG_S = 0.7
STILL_ACCELERATION_M_S2 = 0.1
WEAK_ROTATION_DEG_S = 5.0
ADVISED_ROTATION_DEG_S = 10.0
#: Findings that limit a calibration by themselves; their own text is the reason.
_LIMITING = frozenset(
    {
        "imu.gaps",
        "imu.jitter",
        "imu.stamped_in_bundles",
        "imu.axis_signs",
        "imu.stuck",
        "recording.truncated",
        "recording.incomplete",
        "points.malformed",
        "clock.epochs",
        "clock.set",
        "points.deskewed",
    }
)
_GOOD = "Topics, point times, units, motion and stillness are as a calibration needs them."
_TURN = "Turn the rig about all three axes and move it, for 30 to 60 s."
_RAW = "Record the lidar driver's own clouds, with its motion compensation switched off."
#: Reasons without a forecast for which a solve would refuse the recording too, and what to record.
_FATAL: dict[str, tuple[str, ...]] = {
    "motion.none": (_TURN,),
    "motion.undetermined": (_TURN,),
    "recording.too_short": ("Record 30 to 60 s.",),
    "imu.gyroscope_unit": (),
    "imu.axis_signs": (),
    "points.unit": (),
    "points.standing": (_RAW,),
    "points.straightened": (_RAW,),
    "points.times_backwards": (),
}
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
    planes: PlanesReport | None = None,
    forecast: Forecast | None = None,
) -> Opinion:
    """The opinion on what was found. overlap_s: seconds that both sensors cover, None where one is missing."""
    case = _Case()
    for problem in problems:
        (case.limits if problem.code in _SEVERAL else case.fatal).append(str(problem))
    numbers = () if forecast is None else forecast.parameters
    if overlap_s is not None:
        _judge_length(case, overlap_s, numbers)
    if forecast is not None:
        _judge_forecast(case, forecast)
    if planes is not None:
        _judge_planes(case, planes)
    if imu is not None:
        if forecast is None or (not numbers and forecast.code not in _FATAL):
            _judge_motion(case, imu)
        _judge_imu(case, imu)
    if lidar is not None:
        _judge_lidar(case, lidar)
    _judge_findings(case, findings)
    advice = tuple(dict.fromkeys(case.advice))
    if case.fatal:
        return Opinion("unusable", (*case.fatal, *case.limits), advice)
    if case.limits:
        return Opinion("limited", tuple(case.limits), advice)
    return Opinion("good", (_GOOD if forecast is None else forecast.text,), advice)


def _judge_length(case: _Case, overlap_s: float, numbers: Sequence[ParameterForecast]) -> None:
    """numbers: of the forecast, which says whether more of the same motion would help; none where there is no forecast."""
    weak = [p for p in numbers if p.weak]
    if overlap_s < MIN_OVERLAP_S and (weak or not numbers):
        case.fatal.append(
            f"Lidar and IMU cover only {overlap_s:.1f} s together; at least {MIN_OVERLAP_S:g} s are"
            f" needed, check the clocks or record longer."
        )
    elif overlap_s < SHORT_S and not numbers:
        case.limits.append(
            f"Lidar and IMU cover {overlap_s:.1f} s together, less than {SHORT_S:g} s; 20 s are usually enough."
        )
    # Standard deviations shrink with the root of the time. One below the limit that is weak all the same is a prior's.
    longer = sqrt(max(1.0, LONG_S / max(overlap_s, 1e-3)))
    told = [AXIS_WORDS[p.name] for p in weak if _WEAK_IN[p.unit] < p.std < longer * _WEAK_IN[p.unit]]
    if told:
        case.limits.append(
            f"Lidar and IMU cover {overlap_s:.1f} s together, too short for the {joined(told)}: {LONG_S:g} s of such motion"
            " would be enough."
        )
    if overlap_s < SHORT_S or told:
        case.advice.append("Record 30 to 60 s.")


def _judge_forecast(case: _Case, forecast: Forecast) -> None:
    """The forecast has the last word on what the motion and the planes determine."""
    if forecast.code == "planes.none":
        return
    if forecast.reason:
        sentence = f"{forecast.reason[0].upper()}{forecast.reason[1:]}."
        if forecast.code in _FATAL:
            case.fatal.append(sentence)
            case.advice.extend(_FATAL[forecast.code])
        else:
            case.limits.append(f"No forecast is possible: {forecast.reason}.")
        return
    case.limits.extend(forecast.weak)
    unnamed = [p.name for p in forecast.parameters if p.weak]
    if unnamed and not forecast.weak:
        case.limits.append(forecast.text)
    case.advice.extend(forecast.advice)


def _judge_motion(case: _Case, imu: ImuReport) -> None:
    """By the IMU alone, where there is no forecast."""
    motion = imu.excitation
    strongest = max(motion.rotation_rms_deg_s)
    if strongest < STILL_ROTATION_DEG_S and max(motion.acceleration_rms_m_s2) < STILL_ACCELERATION_M_S2:
        case.fatal.append(f"The rig stands still throughout ({strongest:.2f} deg/s): a calibration needs motion.")
        case.advice.append(_TURN)
    elif strongest < WEAK_ROTATION_DEG_S:
        case.limits.append(f"The rig hardly turns (at most {strongest:.1f} deg/s): the translation stays unknown.")
        case.advice.append("Turn the rig about all three axes at 20 to 60 deg/s, changing direction often.")
    elif motion.weakest_axis_rms_deg_s < WEAK_ROTATION_DEG_S:
        case.limits.append(
            f"There is little rotation about {axis_in_words(motion.weakest_axis)} of the IMU"
            f" ({motion.weakest_axis_rms_deg_s:.1f} deg/s): the translation along it stays weak."
        )
        case.advice.append(
            f"Turn the rig about {axis_in_words(motion.weakest_axis)} of the IMU too, at 20 to 60 deg/s."
        )
    elif motion.weakest_axis_rms_deg_s < ADVISED_ROTATION_DEG_S:
        case.advice.append(
            f"More rotation about {axis_in_words(motion.weakest_axis)} of the IMU would sharpen the answer"
            f" ({motion.weakest_axis_rms_deg_s:.1f} deg/s now, above {ADVISED_ROTATION_DEG_S:g} is better)."
        )


def _judge_planes(case: _Case, planes: PlanesReport) -> None:
    if not planes.planes:
        case.fatal.append(planes.text)
    elif not planes.determined:
        case.limits.append(planes.text)


def _judge_imu(case: _Case, imu: ImuReport) -> None:
    longest_s = max((span.end_s - span.start_s for span in imu.still_spans), default=0.0)
    if longest_s < STILL_SOME_S:
        case.advice.append("Let the rig stand still for 3 s before moving it: this makes the first planes sharper.")
    if imu.stamps.rate_hz < MIN_RATE_HZ:
        case.limits.append(f"The IMU runs at {imu.stamps.rate_hz:.0f} Hz; 100 Hz or more is advised.")
        case.advice.append("Raise the IMU's rate to 100 Hz or more.")
    shares = imu.saturation.gyroscope_clipped_share, imu.saturation.accelerometer_clipped_share
    if text := clipped_text(shares):
        case.limits.append(f"{text[0].upper()}{text[1:]}.")
        case.advice.append(f"Move more gently, or widen the {worse_sensor(shares)}'s range.")


def _judge_lidar(case: _Case, lidar: LidarReport) -> None:
    if lidar.stamps.dropped > 0.02 * max(lidar.scans, 1):
        case.limits.append(
            f"{counted(lidar.stamps.dropped, 'scan')} on {lidar.topic} {'is' if lidar.stamps.dropped == 1 else 'are'} missing "
            f"({lidar.scans} are there)."
        )
        case.advice.append("Record to a faster disk, or record fewer topics.")
    if lidar.ranges is not None and lidar.ranges.median_m > 25:
        case.advice.append("Record closer to walls and floor: 1 to 10 m make the sharpest planes.")


def _judge_findings(case: _Case, findings: Sequence[Finding]) -> None:
    for finding in findings:
        if finding.code in _LIMITING:
            case.limits.append(finding.text)
        elif finding.level == "warning" and finding.confidence < 0.5:
            cure = f"check it, or set it with {finding.override}" if finding.override[:2] == "--" else finding.override
            case.limits.append(f"{finding.text} This is unsure; {cure}.")


def axis_in_words(axis: tuple[float, float, float]) -> str:
    """The axis a direction is near, as "x", "y" or "z"; else its components."""
    largest = max(range(3), key=lambda i: abs(axis[i]))
    if abs(axis[largest]) > 0.9:
        return "xyz"[largest]
    return "direction (" + ", ".join(f"{c:.2f}" for c in axis) + ")"
