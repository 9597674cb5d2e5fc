"""A recording that falls in two: a clock was set in the middle of it, or the IMU was silent for a while.

`full/assess/clock_step.py` and `full/assess/imu_silence.py` look for the two. Here it is decided whether there is one,
and put into words; `calibrate.py` then solves the longer side alone.
"""

from __future__ import annotations

from dataclasses import dataclass

from calib_core.events import LogEvent
from calib_core.full.assess.clock_step import Sides, clock_step, misfit, turning_within
from calib_core.full.assess.error_budget import DISAGREEMENT
from calib_core.full.assess.imu_silence import imu_silence
from calib_core.full.assess.settings import CLOCK_STEP
from calib_core.message_log import MessageLog
from calib_core.method import Answer
from calib_core.types import Recording

#: The code of what is said where an IMU's silence breaks a recording in two.
SILENT = "imu.silent"


@dataclass(frozen=True)
class Break:
    """Where a recording falls in two.

    sides: the longer one, what to leave out for it, and the span that the break lies in.   code: of what is said of it.
    what: breaks it, in words.   cure: what the user can do about it, in words.   skipped_s: of the recording that falls in two,
    whose first scan the sides count from; what is told counts from the first one that there is, as the result's times do.
    """

    sides: Sides
    code: str
    what: str
    cure: str
    skipped_s: float = 0.0

    @property
    def longer_in_words(self) -> str:
        """The longer side's span."""
        return _between(self.sides.longer_s, self.skipped_s)

    def told(self, used: str) -> LogEvent:
        """The warning. used: what of the recording the answer is of, in words."""
        return LogEvent(level="warning", code=self.code, text=f"{self.what}: {used}; {self.cure}")


def break_of(answer: Answer, recording: Recording, log: MessageLog) -> Break | None:
    """Where a recording falls in two, by the answer of all of it; None where nothing says so.

    log: what was said on the way to that answer. A silence counts only where it says that parts of the recording disagree.
    """
    step = _clock_step_of(answer, recording)
    if step is not None:
        # A mount that slips asks stretches for other offsets as well.
        what = f"one of the two clocks was set, or the mount slipped, {_between(step.within_s, recording.skipped_s)}"
        cure = "find out which clock jumps and give it a source of time, or fasten the mount"
        return Break(step, "clock.set", what, cure, recording.skipped_s)
    silence = imu_silence(recording, answer.time_offset_ns) if disagrees(log) else None
    if silence is not None:
        when = _between(silence.within_s, recording.skipped_s)
        what = f"the IMU is silent {when}, and the recording before that does not agree with the recording after"
        return Break(silence, SILENT, what, "find out where its readings are lost", recording.skipped_s)
    return None


def agrees_with_itself(answer: Answer, recording: Recording) -> bool:
    """Whether one side's answer is of one piece: its stretches of time ask for one time offset. recording: that side."""
    if answer.evidence is None:
        return False
    blocks = answer.evidence.parts.time_blocks
    turning_rad_s = turning_within(blocks, recording, answer.time_offset_ns)
    return misfit(blocks, turning_rad_s, at_once=answer.at_once) < CLOCK_STEP.misfit


def disagrees(log: MessageLog) -> bool:
    """Whether it was said that parts of the recording disagree beyond noise."""
    return any(message.code == DISAGREEMENT for message in log.messages)


def _clock_step_of(answer: Answer, recording: Recording) -> Sides | None:
    """Where a clock was set in mid-recording, as far as an answer's stretches of time tell."""
    if answer.evidence is None:
        return None
    blocks = answer.evidence.parts.time_blocks
    turning_rad_s = turning_within(blocks, recording, answer.time_offset_ns)
    return clock_step(blocks, turning_rad_s, at_once=answer.at_once)


def _between(span_s: tuple[float, float], skipped_s: float) -> str:
    return f"between {skipped_s + span_s[0]:z.1f} s and {skipped_s + span_s[1]:z.1f} s"
