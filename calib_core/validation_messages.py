"""Why a document or a setting does not fit its model, in words for a person who has never heard of the model's library."""

from __future__ import annotations

import re
from collections.abc import Mapping

#: What the library calls what it was given, at the beginning of a sentence about it.
_GIVEN = re.compile(r"^(Input|String|List|Tuple|Dictionary|Value|URL) (should|must)")
#: What is no name of a field, but a kind of value: literal['auto','off'], tuple[constrained-float, ...], constrained-str.
_KIND = re.compile(r"\[|^constrained-|^function-")
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
        case "union_tag_invalid", {"discriminator": key, "tag": tag, "expected_tags": expected}:
            return f"{_bare(key)} should be one of {expected}, found {str(tag)[:_LONGEST]!r}"
        case "union_tag_not_found", {"discriminator": key}:
            return f"{_bare(key)} is missing"
        case "string_pattern_mismatch", _:
            return f"no such thing is known{_found(problem)}"
        case "value_error", _:
            return message.removeprefix("Value error, ")
        case _:
            said = _GIVEN.sub(r"it \2", message)
            return said if said == message else f"{said}{_found(problem)}"


def place_of(problem: Mapping[str, object]) -> str:
    """Where it is wrong, as the names that lead there. The library puts the kinds of value that it tried among them."""
    location = problem["loc"]
    parts = [str(part) for part in location] if isinstance(location, tuple) else []
    return ".".join(part for part in parts if not _KIND.search(part))


def _found(problem: Mapping[str, object]) -> str:
    """What was found, where that is one short word or number."""
    found = problem["input"]
    shown = repr(found) if isinstance(found, str) else str(found)
    is_one = isinstance(found, str | int | float) and len(shown) <= _LONGEST
    return f", found {shown}" if is_one else ""


def _bare(name: object) -> str:
    """A field's name without the quotes that the library puts around it."""
    return str(name).strip("'")
