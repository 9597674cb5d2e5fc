"""Why a document or a setting does not fit its model, in words for a person who has never heard of the model's library."""

from __future__ import annotations

import re
from collections.abc import Mapping

#: What the library calls what it was given, at the beginning of a sentence about it.
_GIVEN = re.compile(r"^(Input|String|List|Tuple|Dictionary|Value|URL) (should|must)")
#: Longer texts are not repeated.
_LONGEST = 40


def misfit(problem: Mapping[str, object]) -> str:
    """What is wrong, without where. problem: one of a `ValidationError`'s `errors()`."""
    message = str(problem["msg"])
    match problem["type"], problem.get("ctx"):
        case "missing", _:
            return "it is missing"
        case "extra_forbidden", _:
            return "nothing of this name is known"
        case "literal_error", {"expected": expected}:
            return f"it should be {expected}{_found(problem)}"
        case "string_pattern_mismatch", _:
            return f"no such thing is known{_found(problem)}"
        case "value_error", _:
            return message.removeprefix("Value error, ")
        case _:
            said = _GIVEN.sub(r"it \2", message)
            return said if said == message else f"{said}{_found(problem)}"


def _found(problem: Mapping[str, object]) -> str:
    """What was found, where that is one short word or number."""
    found = problem["input"]
    shown = repr(found) if isinstance(found, str) else str(found)
    is_one = isinstance(found, str | int | float) and len(shown) <= _LONGEST
    return f", found {shown}" if is_one else ""
