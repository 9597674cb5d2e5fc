"""The doctor's report as the wire carries it."""

from __future__ import annotations

from pydantic import JsonValue

#: The report is calib_core's own model; its JSON is passed on untouched.
Report = dict[str, JsonValue]
