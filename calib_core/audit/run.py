"""The audit of one recording: its own calibration, the given extrinsic held against it, and both rooms.

recording -> calibrate -> difference, sigmas, verdict per axis
-> calibrate again with the given extrinsic held -> the room with each
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_core.audit import compare
from calib_core.audit.crisp import Judged, audit_crispness, mounting_of
from calib_core.audit.limits import Limits
from calib_core.audit.pose import GivenExtrinsic
from calib_core.audit.report import AuditCrispness, AuditReport, AxisAudit, Verdict, in_si
from calib_core.calibrate import Calibration, calibrate
from calib_core.events import OnEvent, ShouldCancel, ignore_event, never_cancel
from calib_core.full.known_extrinsic import held
from calib_core.result import AXIS_WORDS
from calib_core.settings import CalibrateSettings
from calib_core.sigmas import decimals, scale_of, std_text
from calib_core.types import Recording


def audit(
    recording: Recording,
    given: GivenExtrinsic,
    limits: Limits,
    settings: CalibrateSettings,
    *,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> AuditReport:
    """The given extrinsic held against what this recording says by itself."""
    found = calibrate(recording, settings, on_event=on_event, should_cancel=should_cancel)
    given = compare.carried(given, found.result)
    crispness, refusal = None, None
    if found.trajectory is not None and settings.crispness:
        crispness, refusal = _with_given_held(recording, given, found, settings, on_event, should_cancel)
    return report_of(given, found, limits, crispness, refusal)


def report_of(
    given: GivenExtrinsic,
    found: Calibration,
    limits: Limits,
    crispness: AuditCrispness | None = None,
    held_refusal: str | None = None,
) -> AuditReport:
    """The document.   held_refusal: why no motion fits the recording with the given extrinsic, where none does."""
    axes = compare.axes_of(given, found.result, limits)
    apart = compare.distances(given, found.result)
    hints = compare.hints(given, found.result)
    if axes:
        hints += compare.own_sigmas(given, limits)
    if held_refusal is not None:
        # What a refusal advises is of recordings that give no answer: this one gives its own.
        why = held_refusal.partition(";")[0].rstrip(".")
        text = "With the given extrinsic held fixed, no motion fits the recording; with the recording's own extrinsic one does"
        hints.append(f"{text}: {why}.")
    if given.time_offset_ns is None:
        hints.append("The given file has no time offset, so the time offset is not judged.")
    verdict = compare.verdict_of(axes)
    return AuditReport(
        verdict=verdict,
        text=_sentence(verdict, axes, found),
        extrinsic_form=given.form,
        axes=axes,
        rotation_deg=None if apart is None else apart[0],
        translation_mm=None if apart is None else apart[1],
        hints=hints,
        crispness=crispness,
        calibration=found.result,
    )


def _with_given_held(
    recording: Recording,
    given: GivenExtrinsic,
    found: Calibration,
    settings: CalibrateSettings,
    on_event: OnEvent,
    should_cancel: ShouldCancel,
) -> tuple[AuditCrispness | None, str | None]:
    """How crisp the room is with each; and why no motion fits with the given one, where none does."""
    answer = found.result
    if found.trajectory is None or answer.T_imu_lidar is None or answer.time_offset_ns is None:
        return None, None
    offset_ns = answer.time_offset_ns if given.time_offset_ns is None else given.time_offset_ns
    guess, priors = held(given.T_imu_lidar, offset_ns)
    fixed = settings.model_copy(update={"priors": priors, "crispness": False})
    again = calibrate(recording, fixed, initial_guess=guess, on_event=on_event, should_cancel=should_cancel)
    if again.trajectory is None:
        reasons = [message.text for message in again.result.messages if message.level == "error"]
        return None, reasons[-1] if reasons else "the solve gave no answer"
    theirs = Judged(mounting_of(given.T_imu_lidar, offset_ns), again.trajectory, _gyro_bias(again))
    matrix = np.array(answer.T_imu_lidar.matrix)
    ours = Judged(mounting_of(matrix, answer.time_offset_ns), found.trajectory, _gyro_bias(found))
    return audit_crispness(recording, theirs, ours), None


def _gyro_bias(done: Calibration) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.array(done.result.gyroscope_bias_rad_s or [0.0, 0.0, 0.0], dtype=np.float64)


def _sentence(verdict: Verdict, axes: Sequence[AxisAudit], found: Calibration) -> str:
    """The verdict for a person. Of what the file does not have, or has no limit, nothing is said: it is not judged."""
    if not axes:
        reasons = [message.text for message in found.result.messages if message.level == "error"]
        why = reasons[0] if reasons else "it gives no calibration"
        return f"This recording cannot tell: {why.rstrip('.')}."
    if verdict == "passed":
        told = [axis for axis in axes if axis.verdict == "passed"]
        reach = {
            unit: max((a.smallest_error for a in told if a.unit == unit), default=None) for unit in ("deg", "mm", "ms")
        }
        errors = ", ".join(f"{value:.3g} {unit}" for unit, value in reach.items() if value is not None)
        which = "on every axis" if len(told) == len(axes) else f"on the {len(told)} axes that are judged"
        return f"Passed: the extrinsic is within its limits {which}; errors from {errors} on would have shown."
    chosen = [axis for axis in axes if axis.verdict == ("failed" if verdict == "failed" else "unknown")]
    if verdict == "failed":
        worst = max(chosen, key=lambda a: abs(a.difference or 0.0) / a.smallest_error)
        judged = [axis for axis in axes if axis.verdict is not None]
        of = f"{len(judged)} axes" if len(judged) == len(axes) else f"the {len(judged)} axes that are judged"
        return (
            f"Failed on {len(chosen)} of {of}: the {AXIS_WORDS[worst.axis]} is off by "
            f"{_off(worst)}, where {worst.limit:g} {worst.unit} is allowed."
        )
    if not chosen:
        return "This recording cannot tell: no axis is judged; give limits for some."
    widest = max(chosen, key=lambda a: a.smallest_error / (a.limit or a.smallest_error))
    return (
        f"This recording cannot tell: it determines the {AXIS_WORDS[widest.axis]} only to "
        f"{std_text(*in_si(widest.difference_std, widest.unit))} (1 sigma), which is too uncertain for a limit of "
        f"{widest.limit:g} {widest.unit}; record more motion."
    )


def _off(axis: AxisAudit) -> str:
    """The difference and its sigma, both to the sigma's second digit, as the table beside the sentence has them."""
    std, unit = in_si(axis.difference_std, axis.unit)
    scale, name = scale_of(std, unit)
    digits = decimals(scale * std)
    difference, _ = in_si(axis.difference or 0.0, axis.unit)
    return f"{scale * difference:+.{digits}f} ± {scale * std:.{digits}f} {name}"
