"""Bodies, headers and words of requests that make no sense: numbers no float holds, text that is none, nesting without end."""

from __future__ import annotations

import json
import random
from typing import cast

Json = object
Media = dict[str, dict[str, dict[str, Json]]]
#: Written into the JSON as they stand: a float's limits, and what the standard does not know but parsers do.
RAW_NUMBERS = ("NaN", "Infinity", "-Infinity", "1e999", "-1e999", "1e-999", "9" * 400, "-0.0", "1E400", "0.1e1", "007")
STRINGS = (
    "",
    "x" * 20_000,
    "\ud800",
    "\x00",
    "../../../etc/passwd",
    "/etc/passwd",
    "%00",
    "<script>",
    "ünï\u202ecode",
    "0" * 32,
    "'; DROP TABLE jobs; --",
    "\r\nX: y",
)
HEADERS: tuple[dict[str, str], ...] = (
    {},
    {"Last-Event-ID": "9" * 5000},
    {"Range": "bytes=5-1"},
    {"Content-Type": "text/plain"},
    {"Content-Type": "application/json; charset=utf-7"},
    {"Content-Encoding": "gzip"},
    {"Accept": "nothing/at-all"},
    {"X-HTTP-Method-Override": "DELETE"},
    {"X-Forwarded-Host": "evil.example"},
    {"Cookie": "unsweep_session=" + "a" * 3000},
    {"If-None-Match": "*"},
    {"Origin": "null"},
)
_MARK = "@@raw-number-{}@@"
#: Levels of what is nested deepest.
DEEPEST = 2000


def spoilt_body(operation: dict[str, Json], chance: random.Random) -> bytes:
    """What an operation may be sent, spoilt; nothing where it takes none."""
    content = cast("dict[str, Media]", cast("dict[str, Json]", operation.get("requestBody", {})).get("content"))
    if not content:
        return b""
    examples = next(iter(content.values())).get("examples") or {"none": {"value": {}}}
    value: Json = json.loads(json.dumps(chance.choice(list(examples.values()))["value"]))
    for _ in range(chance.randint(0, 3)):
        value = _spoilt(value, chance)
    try:
        text = json.dumps(value)
    except RecursionError:  # nested twice: deeper than this program itself can write
        text = "[" * DEEPEST + "]" * DEEPEST
    for number, raw in enumerate(RAW_NUMBERS):
        text = text.replace(f'"{_MARK.format(number)}"', raw)
    raw_body = text.encode("utf-8", "replace")
    return raw_body[: chance.randrange(len(raw_body) + 1)] if chance.random() < 0.05 else raw_body


def _spoilt(value: Json, chance: random.Random) -> Json:
    """The value with one thing wrong somewhere inside."""
    inside = chance.random() < 0.75
    if isinstance(value, dict) and value and inside:
        key = chance.choice(list(value))
        return {**value, key: _spoilt(value[key], chance)}
    if isinstance(value, list) and value and inside:
        place = chance.randrange(len(value))
        return [*value[:place], _spoilt(value[place], chance), *value[place + 1 :]]
    return _nonsense(value, chance)


def _nonsense(value: Json, chance: random.Random) -> Json:
    pick = chance.random()
    if pick < 0.35:
        return _MARK.format(chance.randrange(len(RAW_NUMBERS)))
    if pick < 0.55:
        return chance.choice(STRINGS)
    if pick < 0.62:
        nested: Json = value
        for _ in range(chance.choice([5, 900])):
            nested = [nested]
        return nested
    if pick < 0.7 and isinstance(value, dict):
        return {**value, chance.choice(["extra", "", "__proto__", "x" * 1000]): value}
    return chance.choice([None, True, -1, 2**70, 1e308, [], {}, [value] * 300, {"op": "undo"}, 0.5])
