"""Why a document or a setting does not fit its model, in words for a person who has never heard of the model's library."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

#: What the library calls what it was given, at the beginning of a sentence about it.
_GIVEN = re.compile(r"^(Input|String|List|Tuple|Dictionary|Value|URL) (should|must)")
#: Longer texts are not repeated.
_LONGEST = 40


def misfit(problem: ErrorDetails) -> str:
    """What is wrong, without where. problem: one of a `ValidationError`'s `errors()`."""
    match problem["type"]:
        case "missing":
            return "it is missing"
        case "extra_forbidden":
            return "nothing of this name is known"
        case "literal_error":
            return f"it should be {problem['ctx']['expected']}{_found(problem)}"
        case "string_pattern_mismatch":
            return f"no such thing is known{_found(problem)}"
        case "value_error":
            return problem["msg"].removeprefix("Value error, ")
        case _:
            said = _GIVEN.sub(r"it \2", problem["msg"])
            return said if said == problem["msg"] else f"{said}{_found(problem)}"


def _found(problem: ErrorDetails) -> str:
    """What was found, where that is one short word or number."""
    found = problem["input"]
    shown = repr(found) if isinstance(found, str) else str(found)
    is_one = isinstance(found, str | int | float) and len(shown) <= _LONGEST
    return f", found {shown}" if is_one else ""
