"""What was said and found on the way, put right once the outcome is known: doubts settled, causes named, times from the start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from calib_core.errors import Refused
from calib_core.full.assess.plausibility import SIGNS_BORNE_OUT, SIGNS_RIGHT, borne_out
from calib_core.full.prepare.prepare import LESS_CLIPPED
from calib_core.method import Answer
from calib_core.result import Message
from calib_core.types import ARE_IN_G

#: Warnings of what breaks any model of rigid motion, the plainest cause first; and refusals that say no more than that it broke.
_CAUSES = ("imu.stuck", "points.times_off", "imu.axis_signs", "imu.clipped", "motion.unseen")
_BROKEN = (
    "solve.unsettled", "solve.inconsistent", "solve.broke_down", "solve.diverged", "solve.offset_ran_away",
    "solve.lever_arm_ran_away", "planes.unsettled", "planes.lost", "motion.not_rigid",
)  # fmt: skip
#: What helps against such a cause, where the refusal's own advice is about something else.
_HELPS = {"imu.clipped": LESS_CLIPPED}
#: What is said on the way of a motion that tells too little.
_ONE_AXIS = "start.open_turn"


def with_cause(refusal: Refused, messages: Sequence[Message]) -> str:
    """The refusal's sentence. Where it only says that the solve broke, and messages warn of something that breaks it, that comes
    first: "the gyroscope's x axis is stuck; that may be why the solve did not come to rest", and what helps against it, where
    the refusal's own advice would mislead. So does a turning about one axis alone, which breaks none, but lets what is hardly
    flat or still bend the motion; what helps then comes last.
    """
    warned = {message.code: message.text for message in reversed(messages) if message.level == "warning"}
    code = next((code for code in _CAUSES if code in warned), "")
    if refusal.code not in _BROKEN:
        return str(refusal)
    if not code and any(message.code == _ONE_AXIS for message in messages):
        about = "as far as the lidar could be followed, all rotation is about one axis"
        return f"{about}; that may be why {refusal}, and turn the rig about the other axes too"
    if not code:
        return str(refusal)
    first = warned[code].split(";")[0].rstrip(".")
    helps = f" ({_HELPS[code]})" if code in _HELPS else ""
    return f"{first[0].lower()}{first[1:]}{helps}; that may be why {refusal}"


def with_doubts_settled(messages: Sequence[Message]) -> list[Message]:
    """The messages of an answer without the doubts about the IMU's unit and axes that it has settled: in another unit, or with
    flipped axes, there would be no answer. Accelerations in g are no warning any more.
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


def since_the_start(answer: Answer, skipped_s: float) -> Answer:
    """The answer with its times counted from the recording's first scan, not from the first scan that was used.

    skipped_s: how much later that one is, as the recording that was used has it; sentences count from there as they are made.
    """
    if not skipped_s:
        return answer
    if answer.time_offset_at_s is not None:
        answer = replace(answer, time_offset_at_s=answer.time_offset_at_s + skipped_s)
    if answer.evidence is None:
        return answer
    parts = answer.evidence.parts
    blocks = [
        block.model_copy(update={"t_start_s": block.t_start_s + skipped_s, "t_end_s": block.t_end_s + skipped_s})
        for block in parts.time_blocks
    ]
    evidence = answer.evidence.model_copy(update={"parts": parts.model_copy(update={"time_blocks": blocks})})
    return replace(answer, evidence=evidence)
