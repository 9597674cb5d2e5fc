"""What a person is told of the error budget's parts, where they are worth a sentence (error_budget.py has which says which).

Of sensors that were only counted unestimated_shifts.py tells, beside their values.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_core.full.assess.disagreement import Disagreement
from calib_core.full.assess.error_budget import CLOCKS, DISAGREEMENT, SHAPES
from calib_core.full.assess.observability import Knowledge
from calib_core.full.assess.weak_sentences import named_direction
from calib_core.full.joint.state import ROTATION, TIME_OFFSET, TRANSLATION
from calib_core.full.joint.undetermined import UNITS
from calib_core.full.prepare.settings import STEPS
from calib_core.full.run import Run
from calib_core.types import FloatArray

#: The ways of taking a recording apart, to a person.
_WORDS = {
    "time": "stretches of time",
    "surfaces": "places on the planes",
    "planes": "planes",
    "range": "near and far points",
    "lasers": "lasers",
}


def say_shapes(run: Run, shift: FloatArray, others: FloatArray) -> None:
    """Where the answer went with shapes that did not rest by as much as all else allows it in any direction.

    shift: (7,) [rad, m, s].   others: (7, 7), scaled units, of all other parts.
    """
    scaled = shift / UNITS
    if scaled @ np.linalg.lstsq(others, scaled, rcond=None)[0] < 1.0:
        return
    turned_deg, moved_mm = np.degrees(np.linalg.norm(shift[ROTATION])), 1e3 * np.linalg.norm(shift[TRANSLATION])
    run.say(
        "warning",
        SHAPES,
        "some planes are not flat, and the solve could not estimate their shape, as the estimate did not settle; the answer "
        f"moved by {turned_deg:.2g} deg and {moved_mm:.2g} mm with it, and the error bars are widened by that; choose planes "
        "that are flat and stand still, or record where there are such planes",
    )


def say_disagreement(run: Run, found: Sequence[Disagreement], beyond: FloatArray, *, is_torn: bool) -> None:
    """Where parts of the recording disagree. beyond: (7, 7), scaled units, what the answer is widened by for it."""
    if not beyond.any():
        return
    torn = ", but may still be too narrow: do not rely on them, and record again" if is_torn else ""
    parts = ", ".join(f"{_WORDS[each.name]} {each.ratio:.1f} times" for each in found if each.is_beyond_noise)
    lasers = "lasers that read short or long, " if any(d.name == "lasers" and d.is_beyond_noise for d in found) else ""
    run.say(
        "warning",
        DISAGREEMENT,
        f"the parts of the recording disagree by more than noise explains ({parts}); the cause may be surfaces that are not "
        f"flat, a mount that bends, {lasers}or an error that the model does not contain; the error bars are widened, most for "
        f"{named_direction(beyond)}{torn}",
    )


def say_clocks(run: Run, knowledge: Knowledge) -> None:
    """Of each clock that cuts stamps, where that widens the time offset's error bar by what is worth it."""
    steps_std_s = run.clocks.steps_std_s
    else_std_s = np.sqrt(max(knowledge.covariance[TIME_OFFSET, TIME_OFFSET] - steps_std_s**2, 0.0))
    if steps_std_s > STEPS.worth_saying * else_std_s:
        for step in run.clocks.steps:
            run.say("warning", CLOCKS, step.text)
