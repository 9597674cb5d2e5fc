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
#: So often is it solved again at the most: what bends the motion hides what bends less. The last time with what is found, where
#: the estimator leaves out by itself what is none.
_TURNS = 3
#: The document, and the motion where there is an answer.
Solved = tuple[CalibrationResult, Trajectory | None]
Solve = Callable[[Sequence[Plane] | None, OnEvent], Solved]


def solve_suggestion(solve: Solve, planes: Sequence[Plane], on_event: OnEvent) -> Solved:
    """The calibration by those of the planes that are beyond doubt; by what is found where they are too few, or go on falling."""
    said: dict[str, Message] = {}
    counted: Sequence[Plane] | None = planes
    listening = _Listening(on_event)
    result, trajectory = solve(counted, listening.to("", withhold=True))
    for turns_left in reversed(range(_TURNS)):
        more = {} if counted is None else left_out(result, counted)
        too_few = result.status == "refused" and (
            bool(said) or any(message.code == DOUBTFUL for message in result.messages)
        )
        if counted is None or not (more or too_few):
            break
        for message in more.values():
            on_event(LogEvent(level=message.level, code=message.code, text=message.text))
        said |= more
        counted = [plane for plane in planes if plane.name not in said] if more and turns_left else None
        how = "with the planes that are found" if counted is None else f"without {', '.join(said)}"
        result, trajectory = solve(counted, listening.to(how, withhold=counted is not None))
    listening.tell()
    return result.model_copy(update={"messages": [*result.messages, *said.values()]}), trajectory


class _Listening:
    """What is said on the way of one solve after the other, as one."""

    def __init__(self, on_event: OnEvent) -> None:
        self._on_event = on_event
        self._withheld: list[LogEvent] = []
        self._latest = StageEvent(stage="solve", fraction=1.0)

    def to(self, how: str, *, withhold: bool) -> OnEvent:
        """For the next solve. how: in what it differs, empty for the first.   withhold: who follows is not to be told that a
        plane was chosen, since nobody chose it."""
        self._withheld = []

        def heard(event: StageEvent | IterationEvent | LogEvent) -> None:
            if isinstance(event, StageEvent) and how:
                # The stages have been gone through: progress does not go back, and what goes on is said where it has come to.
                event = self._latest.model_copy(update={"text": f"once more, {how}: {event.text or event.stage}"})
            elif isinstance(event, StageEvent):
                self._latest = event
            if withhold and isinstance(event, LogEvent) and event.code.startswith("planes."):
                self._withheld.append(event)
            else:
                self._on_event(event)

        return heard

    def tell(self) -> None:
        """What was withheld of the last one."""
        for event in self._withheld:
            self._on_event(event)


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
