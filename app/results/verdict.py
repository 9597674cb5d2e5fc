"""A result in one sentence, and what of it the list of jobs shows."""

from __future__ import annotations

import re

from app.axes import AXIS_NAMES
from app.results.agreement import STRETCHES, zero_crossings_told
from app.schemas.jobs import SolveOutcome, Tone
from calib_core.phrasing import counted
from calib_core.result import CalibrationResult, Status
from calib_core.sigmas import decimals, std_text, two_digits

#: The message that says that the recording's parts contradict each other; its text has by how much.
DISAGREEMENT = "solve.disagreement"

#: One part of what its text has in brackets: "places on the planes 2.4 times".
_DISAGREEING = re.compile(r"(?P<what>[a-z][a-z ]*[a-z]) [\d.]+ times")

#: The message that says that a plane is doubtful and counts all the same.
DOUBTED = "planes.doubted"

#: The message that says that next to no point lies on a plane that a person chose.
UNSEEN = "planes.unseen"

#: The message that says that other planes than a person chose gave the answer.
INSTEAD = "planes.instead"

#: The message that says that what a person gave contradicts the recording.
CONTRADICTED = "prior.contradicted"


HEADINGS: dict[Status, str] = {"calibrated": "Calibrated", "weak": "Weak", "refused": "Refused"}


def disagrees(result: CalibrationResult) -> bool:
    """Whether parts of the recording contradict each other by more than noise explains."""
    return any(message.code == DISAGREEMENT for message in result.messages)


def disagreeing(result: CalibrationResult) -> list[str]:
    """What contradicts each other by more than noise explains, as the message names it: "planes", "stretches of time".

    Empty where nothing does, and where the message does not name it.
    """
    said = next((message.text for message in result.messages if message.code == DISAGREEMENT), "")
    return [each["what"] for each in _DISAGREEING.finditer(said.partition(" (")[2].partition(")")[0])]


def said_of_planes(result: CalibrationResult) -> str:
    """What speaks against the planes that a person chose, as whole sentences; "" where nothing does.

    They gave way to others, some are doubtful and count all the same, or count for nothing.
    """
    several = {
        INSTEAD: "",  # said once at the most
        DOUBTED: "{} planes are doubtful, but are used because they were chosen: leave them out and solve again.",
        UNSEEN: "{} of the chosen planes have next to no effect on the answer, and may not be where they were placed.",
    }
    sentences = []
    for code, of_several in several.items():
        said = [message.text for message in result.messages if message.code == code]
        if said:
            sentences.append(of_several.format(len(said)) if len(said) > 1 else _whole(said[0]))
    return " ".join(sentences)


def tone(result: CalibrationResult) -> Tone:
    """The colour of the verdict: green is for an answer that nothing speaks against."""
    match result.status:
        case "refused":
            return "bad"
        case "weak":
            return "doubtful"
        case "calibrated":
            return "doubtful" if disagrees(result) or said_of_planes(result) else "good"


def held_offset(result: CalibrationResult) -> bool:
    """Whether the time offset was held where it was: its sigma then says nothing of how well it is known."""
    return result.provenance.settings.get("estimate_time_offset") is False


def rests_on(result: CalibrationResult) -> str:
    """Of how many points, scans and planes, what is left of them, and what it took."""
    quality = result.quality
    if quality.points_used == 0:
        return f"{counted(quality.scans_total, 'scan')} in the recording, none used."
    return (
        f"{quality.points_used:,} points of {quality.scans_used} of {quality.scans_total} scans on "
        f"{counted(len(quality.planes), 'plane')} lie {1e3 * quality.point_to_plane_rms_m:.2f} mm (rms) from them; "
        f"{counted(quality.iterations, 'iteration')} in {quality.duration_s:.1f} s."
    )


def sigma_of_offset(result: CalibrationResult) -> float | None:
    """The time offset's standard deviation [s]; None where it was held, or nothing is known of it."""
    return None if result.uncertainty is None or held_offset(result) else result.uncertainty.time_offset_std_s


def offset_holds(result: CalibrationResult) -> str:
    """When the time offset holds and how it goes on from there, in the words of the page; "" where the clocks were taken to run
    alike."""
    rate, std, at_s = result.clock_rate_ppm, result.clock_rate_ppm_std, result.time_offset_at_s
    if rate is None or std is None or at_s is None:
        return ""
    change = f"{round(rate, decimals(std)) + 0.0:.{decimals(std)}f} ± {two_digits(std)}"
    return f"The offset holds {at_s:.1f} s after the recording began; from there it changes by {change} µs per second."


def verdict(result: CalibrationResult) -> str:
    """One word and a sentence or two for a person: may I use this, and how well is it known."""
    return f"{HEADINGS[result.status]}. {told(result)}"


def told(result: CalibrationResult) -> str:
    """The sentences behind the word, each a whole one: they stand under a heading too."""
    if result.status == "refused" or result.uncertainty is None:
        reasons = [message.text for message in result.messages if message.level == "error"]
        return _whole(reasons[0] if reasons else "this recording does not determine the answer")
    turn = std_text(max(result.uncertainty.rotation_std_deg), "deg")
    place = std_text(max(result.uncertainty.translation_std_m), "m")
    clock = std_text(result.uncertainty.time_offset_std_s, "s")
    known = (
        f"One standard deviation is {turn} and {place} at most; the time offset was held, not estimated."
        if held_offset(result)
        else f"One standard deviation is {turn}, {place} and {clock} at most."
    )
    named = disagreeing(result)
    which = f" ({', '.join(named)})" if named else ""
    parts = f"Parts of the recording{which} disagree by more than noise explains; the error bars allow for that."
    if result.status == "weak":
        given = [m.text for m in result.messages if m.code == CONTRADICTED and m.level == "warning"]
        weak = result.observability.weak_directions
        if given:
            return _whole(given[0])
        if disagrees(result) and not weak:
            parts = f"Parts of the recording{which} contradict each other, so that errors may be larger than stated."
        known = f"{_whole(weak[0].text)}{_weak_axes(result)}" if weak else known
    if disagrees(result):
        known = f"{parts} {known}"
    return f"{said_of_planes(result)} {known}".lstrip()


def _weak_axes(result: CalibrationResult) -> str:
    """Which numbers of the tables are weak, as a sentence to add; "" where that one direction is one of them says it already."""
    observability = result.observability
    axes = observability.weak_axes
    first = observability.weak_directions[0]
    if not axes or (axes == [first.label] and len(observability.weak_directions) == 1):
        return ""
    *names, last = (AXIS_NAMES[axis].lower() for axis in axes)
    return f" Weak {'are' if names else 'is'} {', '.join(names)}{' and ' if names else ''}{last}."


def _whole(text: str) -> str:
    """A message as a sentence of its own."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."


def solve_outcome(result: CalibrationResult) -> SolveOutcome:
    """The result's summary."""
    transform, uncertainty = result.T_imu_lidar, result.uncertainty
    blocks = result.evidence.parts.time_blocks if result.evidence is not None else []
    return SolveOutcome(
        status=result.status,
        verdict=verdict(result),
        tone=tone(result),
        codes=sorted({message.code for message in result.messages if message.level != "info"}),
        planes_used=len(result.quality.planes),
        stretches=zero_crossings_told(blocks, torn=STRETCHES in disagreeing(result)) if blocks else "",
        translation_m=None if transform is None else transform.translation_m,
        euler_xyz_deg=None if transform is None else transform.euler_xyz_deg,
        time_offset_s=result.time_offset_s,
        rotation_std_deg=None if uncertainty is None else uncertainty.rotation_std_deg,
        translation_std_m=None if uncertainty is None else uncertainty.translation_std_m,
        time_offset_std_s=None if uncertainty is None else uncertainty.time_offset_std_s,
        point_to_plane_rms_m=None if transform is None else result.quality.point_to_plane_rms_m,
    )
