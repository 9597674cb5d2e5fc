"""The page above both methods: leave out spans, choose the method, catch a refusal, make the document.

calibrate -> _answer_of_whole_or_side -> _answer -> full/calibrate.py or paper/answer.py
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib_core.document import document, refused
from calib_core.errors import Refused, SettingsError
from calib_core.events import PLANNED, ForwardOnly, LogEvent, OnEvent, ShouldCancel, ignore_event, never_cancel
from calib_core.final_messages import since_the_start, with_cause, with_doubts_settled
from calib_core.full.calibrate import calibrate_full
from calib_core.full.clock_skew import RATE, ClockSkew, without_skew
from calib_core.full.initialise.given_frame import of_part, told_in
from calib_core.full.prepare.excluded_spans import without_spans
from calib_core.full.prepare.prepare import prepare, require_length
from calib_core.maps.crispness import crispness_of
from calib_core.message_log import MessageLog
from calib_core.method import Answer, Question
from calib_core.phrasing import counted
from calib_core.presets import by_preset_names
from calib_core.recording_break import SILENT, agrees_with_itself, break_of, disagrees
from calib_core.request import check_settings, each_once, say_unused, with_offset_to_hold
from calib_core.result import CalibrationResult, Message
from calib_core.settings import CalibrateSettings
from calib_core.solver.broken_down import arithmetic_or_refused
from calib_core.threads import one_blas_thread
from calib_core.types import InitialGuess, Plane, Recording, Trajectory

__all__ = ["Calibration", "calibrate"]


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
    cache_dir: Path | None = None,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
) -> Calibration:
    """The calibration of one recording; arguments and errors as in `calib_core.api.calibrate`."""
    check_settings(settings, initial_guess)
    started = time.monotonic()
    whole, recording = recording, without_spans(recording, settings.excluded_spans_s)
    findings = [Message(code=f.code, level=f.level, text=f.text) for f in recording.findings]
    settings = by_preset_names(settings)
    log = MessageLog(ForwardOnly(on_event, PLANNED[settings.method]), findings)
    if settings.excluded_spans_s:
        left_out = len(whole.scans) - len(recording.scans)
        text = f"{counted(left_out, 'scan was', 'scans were')} left out as asked"
        log(LogEvent(level="info", code="scans.excluded", text=text))
    say_unused(settings, log)
    planes = None if planes is None else each_once([facing_the_lidar(plane) for plane in planes], log)
    guess = with_offset_to_hold(recording, settings, initial_guess, log)
    try:
        question = Question(settings, planes, guess, cache_dir, log, should_cancel)
        question = _without_spans(question, whole, recording) if settings.excluded_spans_s else question
        answer, recording, log = _answer_of_whole_or_side(recording, question)
    except Refused as refusal:
        text = with_cause(refusal, log.messages)
        messages = [*log.messages, Message(code=refusal.code, level="error", text=text)]
        return Calibration(refused(recording, settings, messages, time.monotonic() - started), None)
    answer = since_the_start(answer, recording.skipped_s)
    messages = log.messages if answer.is_weak else with_doubts_settled(log.messages)
    result = document(recording, settings, answer, messages, time.monotonic() - started)
    return with_crispness(Calibration(result, answer.trajectory), recording, settings)


def facing_the_lidar(plane: Plane) -> Plane:
    """The same plane, its normal of unit length and towards where it was seen from, the map's origin: either way round it is one.

    Planes that are looked for face that way, and what faces another is none of theirs.
    """
    length = float(np.linalg.norm(plane.normal))
    towards = length if plane.offset_m >= 0.0 else -length
    return replace(plane, normal=plane.normal / towards, offset_m=plane.offset_m / towards)


def with_crispness(done: Calibration, recording: Recording, settings: CalibrateSettings) -> Calibration:
    """The calibration with the crispness of its room in it, where that is asked for and can be measured."""
    if done.trajectory is None or not settings.crispness:
        return done
    measured = crispness_of(recording.scans, done.trajectory)
    quality = done.result.quality.model_copy(update={"crispness": measured})
    return replace(done, result=done.result.model_copy(update={"quality": quality}))


def _answer_of_whole_or_side(recording: Recording, question: Question) -> tuple[Answer, Recording, MessageLog]:
    """The answer, the recording that it is of, and what was said on the way to it: of the whole recording, or of its longer side
    where it falls in two. Raises Refused where the whole has none.
    """
    log = question.log
    before = log.snapshot()
    answer = _answer(recording, question)
    found = break_of(answer, recording, log)
    if found is None:
        return answer, recording, log
    side, side_log = without_spans(recording, [found.sides.left_out_s]), log.another(before)
    side_log(found.told(f"only the part {found.longer_in_words} is used"))
    # Nothing is kept of a side: the next solve begins with the whole again.
    of_side = _of_one_side(side, recording, replace(question, cache_dir=None, log=side_log))
    if of_side is None:
        log(found.told("neither part alone gives an answer, so all of it is used: do not rely on the answer"))
        return answer, recording, log
    if found.code == SILENT and disagrees(side_log):  # the silence was not why
        return answer, recording, log
    return of_side, side, side_log


def _answer(recording: Recording, question: Question) -> Answer:
    """The answer of the chosen method. Raises Refused, of arithmetic that broke down as well."""
    with one_blas_thread(), arithmetic_or_refused():
        return _answer_of_method(recording, question)


def _answer_of_method(recording: Recording, question: Question) -> Answer:
    if question.settings.method == "paper":
        from calib_core.paper.answer import calibrate_published

        return calibrate_published(recording, question)
    require_length(recording, "a calibration", "; record for half a minute or more")
    log = question.log
    before = log.snapshot()

    def solve(stamped: Recording, clock_rate_std_ppm: float) -> Answer:
        run = prepare(stamped, question.settings, log, question.should_cancel)
        run = replace(run, log=log, clock_rate_std_ppm=clock_rate_std_ppm)
        return calibrate_full(run, question.planes, question.guess, question.cache_dir, told_at_ns=question.told_at_ns)

    def begin_again(skew: ClockSkew) -> None:
        log.restore(before)
        log(skew.told(recording))

    answer, skew = without_skew(recording, solve, begin_again)
    if skew is None:
        return answer
    answer = skew.undone(answer, recording)
    log.retract([RATE])  # the points know it better than the turns did
    log(skew.found(answer).told(recording))
    return answer


def _of_one_side(side: Recording, recording: Recording, question: Question) -> Answer | None:
    """The answer of one side of a recording that falls in two; None where it has none that agrees with itself."""
    of_side = of_part(question, recording, side)
    if of_side is None:
        return None
    try:
        answer = _answer(side, of_side)
    except Refused:
        return None
    return answer if agrees_with_itself(answer, side) else None


def _without_spans(question: Question, whole: Recording, kept: Recording) -> Question:
    """The question about what spans leave of the recording. Raises SettingsError where the planes' frame is left out."""
    of_kept = of_part(question, whole, kept)
    if of_kept is None:
        at_s = (whole.scans[told_in(question, whole)].stamp_ns - whole.scans[0].stamp_ns) * 1e-9
        raise SettingsError(
            f"Expected excluded spans that keep the scan at {at_s:.2f} s, because the chosen planes are in its frame; exclude "
            "another span, or leave the choice of planes to the program."
        )
    return of_kept
