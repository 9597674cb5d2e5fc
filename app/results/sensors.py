"""The document's sentences about the sensors themselves, as the estimator worded and ordered them, for screens that have room
for a few.
"""

from __future__ import annotations

from calib_core.result import CalibrationResult

#: What begins the code of each, and what it costs not to know which sensors there are: the one that asks for something.
_SENSOR, _COST = "sensor.", "sensor.priors"


def biggest_of_sensors(result: CalibrationResult, most: int) -> tuple[list[str], int]:
    """The first so many of what was found and what was counted, and what it costs after them; and how many more there are.

    Warnings are no part of it: they are told as such.
    """
    said = [message for message in result.messages if message.code.startswith(_SENSOR) and message.level == "info"]
    found = [message.text for message in said if message.code != _COST]
    cost = [message.text for message in said if message.code == _COST]
    return [*found[:most], *cost], max(0, len(found) - most)
