"""A solve with planes that were proposed and that nobody touched: what turns out to be doubtful is left out of it by name.

A person who chooses a plane is told what is wrong with it, and it counts. Who only pressed Solve chose nothing: the answer is
to be the one of the planes beyond doubt, as it is where the planes are left to be found.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from calib_core.events import IterationEvent, LogEvent, OnEvent, StageEvent
from calib_core.result import CalibrationResult, Message
from calib_core.types import Plane, Trajectory

#: How the estimator names a doubtful plane among those that it was told to use.
COUNTS = " and counts because it was chosen"
#: Its code where those beyond doubt do not hold the motion.
DOUBTFUL = "planes.doubtful"
#: The document, and the motion where there is an answer.
Solved = tuple[CalibrationResult, Trajectory | None]
Solve = Callable[[Sequence[Plane] | None, OnEvent], Solved]


def solve_suggestion(solve: Solve, planes: Sequence[Plane], on_event: OnEvent) -> Solved:
    """The calibration by those of the planes that are beyond doubt; by what is found where they are too few."""
    heard: list[LogEvent] = []
    latest = StageEvent(stage="solve", fraction=1.0)

    def first(event: StageEvent | IterationEvent | LogEvent) -> None:
        nonlocal latest
        if isinstance(event, StageEvent):
            latest = event
        # Who follows is not to be told that a plane was chosen, since nobody chose it.
        if isinstance(event, LogEvent) and event.code.startswith("planes."):
            heard.append(event)
        else:
            on_event(event)

    def again(event: StageEvent | IterationEvent | LogEvent) -> None:
        # The stages have been gone through: progress does not go back, and what goes on is said where it has come to.
        if isinstance(event, StageEvent):
            event = latest.model_copy(update={"text": f"once more, {how}: {event.text or event.stage}"})
        on_event(event)

    result, trajectory = solve(planes, first)
    said = left_out(result, planes)
    if not said and not any(message.code == DOUBTFUL for message in result.messages):
        for event in heard:
            on_event(event)
        return result, trajectory
    for message in said.values():
        on_event(LogEvent(level=message.level, code=message.code, text=message.text))
    sound = [plane for plane in planes if plane.name not in said] if said else None
    how = f"without {', '.join(said)}" if said else "with the planes that are found"
    result, trajectory = solve(sound, again)
    return result.model_copy(update={"messages": [*result.messages, *said.values()]}), trajectory


def left_out(result: CalibrationResult, planes: Sequence[Plane]) -> dict[str, Message]:
    """What is said of each plane that the result calls doubtful, by its name."""
    said = {}
    for message in result.messages:
        if message.code.startswith("planes.") and COUNTS in message.text:
            fault = message.text.split(COUNTS)[0]
            # The longest: "wall 1" begins "wall 1 of the hall", too.
            named = [plane.name for plane in planes if fault.startswith(f"{plane.name} ")]
            if named:
                said[max(named, key=len)] = message.model_copy(update={"text": f"{fault}: left out"})
    return said
