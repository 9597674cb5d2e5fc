"""The page above both methods: leave out spans, choose the method, catch a refusal, make the document."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib_core.asked import check_priors, each_once, say_unused, with_offset_to_hold
from calib_core.counts import counted
from calib_core.document import Answer, Heard, Question, document, refused
from calib_core.errors import Refused, SettingsError
from calib_core.events import PLANNED, ForwardOnly, LogEvent, OnEvent, ShouldCancel, ignore_event, never_cancel
from calib_core.full.assess.clock_step import Sides, clock_step, misfit, turning_within
from calib_core.full.assess.error_budget import DISAGREEMENT
from calib_core.full.assess.imu_silence import imu_silence
from calib_core.full.assess.plausibility import SIGNS_BORNE_OUT, SIGNS_RIGHT, borne_out
from calib_core.full.assess.settings import CLOCK_STEP
from calib_core.full.calibrate import calibrate_full
from calib_core.full.planes.propose import find_reference
from calib_core.full.prepare.excluded_spans import without_spans
from calib_core.full.prepare.prepare import prepare, require_length
from calib_core.maps.crispness import crispness_of
from calib_core.result import CalibrationResult, Message
from calib_core.settings import CalibrateSettings
from calib_core.solver.broken_down import arithmetic_or_refused
from calib_core.threads import one_blas_thread
from calib_core.types import ARE_IN_G, InitialGuess, Plane, Recording, Trajectory

__all__ = ["Calibration", "calibrate"]

#: The code of what is said where an IMU's silence breaks a recording in two.
SILENT = "imu.silent"


@dataclass(frozen=True)
class Calibration:
    """The result document, and the motion (None where the calibration was refused)."""

    result: CalibrationResult
    trajectory: Trajectory | None


def calibrate(
    recording: Recording,
    settings: CalibrateSettings,
    *,
    planes: Sequence[Plane] | None = None,
    initial_guess: InitialGuess | None = None,
    kept_in: Path | None = None,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> Calibration:
    """The calibration of one recording.

    planes: in the map frame (the lidar frame at the first used scan's time); None: found.   kept_in: folder in which the
    lidar's motion is kept for the next solve of the same recording.   Raises SettingsError and
    Cancelled; whatever the recording cannot give is a result with status `refused`.
    """
    check_priors(settings, initial_guess)
    started = time.monotonic()
    whole, recording = recording, without_spans(recording, settings.excluded_spans_s)
    forward = ForwardOnly(on_event, PLANNED[settings.method])
    heard = Heard(forward, [Message(code=f.code, level=f.level, text=f.text) for f in recording.findings])
    if settings.excluded_spans_s:
        left_out = len(whole.scans) - len(recording.scans)
        heard(
            LogEvent(
                level="info",
                code="scans.excluded",
                text=f"{counted(left_out, 'scan was', 'scans were')} left out as asked",
            )
        )
        _check_reference(whole, recording, settings, planes)
    say_unused(settings, heard)
    planes = None if planes is None else each_once([facing_the_lidar(plane) for plane in planes], heard)
    guess = with_offset_to_hold(recording, settings, initial_guess, heard)
    aloud = heard.said_so_far()
    question = Question(settings, planes, guess, kept_in, heard, should_cancel)
    try:
        answer = _answer(recording, question)
        broken = _broken(answer, recording, heard)
        if broken is not None:
            kept = without_spans(recording, [broken.sides.left_out_s])
            again = Heard(forward, aloud)
            again(broken.said(f"only what lies {_between(broken.sides.longer_s)} is used"))
            better = _of_one_side(kept, recording, replace(question, kept_in=None, on_event=again))
            if better is not None and not (broken.code == SILENT and _disagrees(again)):
                answer, recording, heard = better, kept, again
            elif better is None:
                heard(
                    broken.said(
                        "neither side alone gives an answer, and all of it is used, which is not to be relied on"
                    )
                )
    except Refused as refusal:
        text = because_of(refusal, heard.messages)
        said = [*heard.messages, Message(code=refusal.code, level="error", text=text)]
        return Calibration(refused(recording, settings, said, time.monotonic() - started), None)
    left_out_s = whole.skipped_s + (recording.scans[0].stamp_ns - whole.scans[0].stamp_ns) * 1e-9
    answer = since_the_start(answer, left_out_s)
    said = with_doubts_settled(heard.messages) if not answer.is_weak else heard.messages
    result = document(recording, settings, answer, said, time.monotonic() - started)
    return with_crispness(Calibration(result, answer.trajectory), recording, settings)


def since_the_start(answer: Answer, left_out_s: float) -> Answer:
    """With times from the recording's start, of which so much was left out."""
    if not left_out_s:
        return answer
    if answer.time_offset_at_s is not None:
        answer = replace(answer, time_offset_at_s=answer.time_offset_at_s + left_out_s)
    if answer.evidence is None:
        return answer
    parts = answer.evidence.parts
    blocks = [
        block.model_copy(update={"t_start_s": block.t_start_s + left_out_s, "t_end_s": block.t_end_s + left_out_s})
        for block in parts.time_blocks
    ]
    evidence = answer.evidence.model_copy(update={"parts": parts.model_copy(update={"time_blocks": blocks})})
    return replace(answer, evidence=evidence)


#: What was warned of and breaks any model of rigid motion, by what it breaks that is plainest; and refusals that say no more than
#: that it broke.
_CAUSES = ("imu.stuck", "points.times_off", "imu.axis_signs", "imu.clipped", "motion.unseen")
_BROKEN = (
    "solve.unsettled", "solve.inconsistent", "solve.broke_down", "solve.diverged", "solve.offset_ran_away",
    "solve.lever_arm_ran_away", "planes.unsettled", "planes.lost", "motion.not_rigid",
)  # fmt: skip


def because_of(refusal: Refused, messages: Sequence[Message]) -> str:
    """The refusal's sentence; behind the plainest of the causes that were warned of, where it names but what came of them."""
    warned = {message.code: message.text for message in reversed(messages) if message.level == "warning"}
    cause = next((warned[code] for code in _CAUSES if code in warned), "")
    if refusal.code not in _BROKEN or not cause:
        return str(refusal)
    first = cause.split(";")[0].rstrip(".")
    return f"{first[0].lower()}{first[1:]}; that may be why {refusal}"


def facing_the_lidar(plane: Plane) -> Plane:
    """The same plane, its normal of unit length and towards where it was seen from, the map's origin: either way round it is one.

    Planes that are looked for face that way, and what faces another is none of theirs.
    """
    length = float(np.linalg.norm(plane.normal))
    towards = length if plane.offset_m >= 0.0 else -length
    return replace(plane, normal=plane.normal / towards, offset_m=plane.offset_m / towards)


def with_doubts_settled(messages: Sequence[Message]) -> list[Message]:
    """The messages of an answer, which there is none of in another unit of the IMU, nor with flipped axes: of accelerations in g
    nobody has to be warned any more.
    """

    def settled(message: Message) -> Message:
        if message.code == "imu.gyroscope_unit":
            return message.model_copy(update={"text": borne_out(message.text)})
        if message.code == "imu.accelerometer_unit" and ARE_IN_G in message.text:
            return message.model_copy(update={"level": "info"})
        if message.code == "imu.axis_signs":
            return message.model_copy(update={"code": SIGNS_BORNE_OUT, "text": SIGNS_RIGHT, "level": "info"})
        return message

    return [settled(message) for message in messages]


def with_crispness(done: Calibration, recording: Recording, settings: CalibrateSettings) -> Calibration:
    """The calibration with the crispness of its room in it, where that is asked for and can be measured."""
    if done.trajectory is None or not settings.crispness:
        return done
    measured = crispness_of(recording.scans, done.trajectory)
    quality = done.result.quality.model_copy(update={"crispness": measured})
    return replace(done, result=done.result.model_copy(update={"quality": quality}))


def _answer(recording: Recording, question: Question) -> Answer:
    """The answer of the chosen method. Raises Refused, of arithmetic that broke down as well."""
    with one_blas_thread(), arithmetic_or_refused():
        return _answer_of_method(recording, question)


def _answer_of_method(recording: Recording, question: Question) -> Answer:
    if question.settings.method == "paper":
        from calib_core.paper.answer import calibrate_published

        return calibrate_published(recording, question)
    require_length(recording, "a calibration", "; record for half a minute or more")
    run = prepare(recording, question.settings, question.on_event, question.should_cancel)
    if isinstance(question.on_event, Heard):
        run = replace(run, heard=question.on_event)
    return calibrate_full(run, question.planes, question.guess, question.kept_in)


def clock_step_of(answer: Answer, recording: Recording) -> Sides | None:
    """Where a clock was set in mid-recording, as far as an answer's stretches of time tell."""
    if answer.evidence is None:
        return None
    blocks = answer.evidence.parts.time_blocks
    return clock_step(blocks, turning_within(blocks, recording, answer.time_offset_ns))


@dataclass(frozen=True)
class Break:
    """Where a recording falls in two: its sides, and in words what breaks it, and what helps."""

    sides: Sides
    code: str
    what: str
    cure: str

    def said(self, used: str) -> LogEvent:
        """For a person. used: what of the recording."""
        return LogEvent(level="warning", code=self.code, text=f"{self.what}: {used}; {self.cure}")


def _broken(answer: Answer, recording: Recording, heard: Heard) -> Break | None:
    """Where a recording whose parts disagree falls in two that may not, and what is said of it; None where it is of one piece."""
    step = clock_step_of(answer, recording)
    if step is not None:
        # A mount that slips asks stretches for other offsets as well.
        what = f"the two clocks were set against each other, or the mount slipped, {_between(step.within_s)}"
        cure = "find out which clock jumps and give it a source of time, or fasten the mount"
        return Break(step, "clock.set", what, cure)
    silence = imu_silence(recording, answer.time_offset_ns) if _disagrees(heard) else None
    if silence is not None:
        what = f"the IMU is silent {_between(silence.within_s)}, and what lies before does not go with what lies after"
        return Break(silence, SILENT, what, "find out where its readings are lost")
    return None


def _disagrees(heard: Heard) -> bool:
    return any(message.code == DISAGREEMENT for message in heard.messages)


def _between(span_s: tuple[float, float]) -> str:
    return f"between {span_s[0]:z.1f} s and {span_s[1]:z.1f} s"


def _of_one_side(kept: Recording, recording: Recording, question: Question) -> Answer | None:
    """The answer of the scans on the longer side of a break; None where it has none that agrees with itself."""
    if not _holds_reference(recording, kept, question.settings, question.planes):
        return None
    try:
        answer = _answer(kept, question)
    except Refused:
        return None
    if answer.evidence is None:
        return None
    blocks = answer.evidence.parts.time_blocks
    agrees = misfit(blocks, turning_within(blocks, kept, answer.time_offset_ns)) < CLOCK_STEP.misfit
    return answer if agrees else None


def _holds_reference(
    whole: Recording, kept: Recording, settings: CalibrateSettings, planes: Sequence[Plane] | None
) -> bool:
    """Given planes live in the frame of the first usable scan: without that scan they mean nothing."""
    if planes is None:
        return True
    before, _ = find_reference(whole.scans, settings)
    after, _ = find_reference(kept.scans, settings)
    return whole.scans[before].stamp_ns == kept.scans[after].stamp_ns


def _check_reference(
    whole: Recording, kept: Recording, settings: CalibrateSettings, planes: Sequence[Plane] | None
) -> None:
    """Raises SettingsError where the planes' frame is left out."""
    if not _holds_reference(whole, kept, settings, planes):
        before, _ = find_reference(whole.scans, settings)
        at_s = (whole.scans[before].stamp_ns - whole.scans[0].stamp_ns) * 1e-9
        raise SettingsError(
            f"Expected excluded spans without the scan at {at_s:.2f} s, in whose frame the given planes are; exclude "
            "another span, or leave the planes to be found."
        )
